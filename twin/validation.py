"""Turns validation errors into sentences: which key, what was given, what is allowed."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError
from pydantic_core import ErrorDetails

_LONGEST_VALUE = 60
_WANTED = {
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a table",
    "mapping_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}
"""What a file has, by pydantic's name of the error that something else was given."""


def explain(error: ValidationError, model: type[BaseModel], where: str) -> str:
    """One line per mistake, each with the file, the key as written in it, what was given and what is allowed."""
    details = [detail for detail in error.errors(include_url=False) if not _only_follows(detail)]
    return "\n".join(f"{where}: {_sentence(detail, model)}" for detail in details)


def _only_follows(detail: ErrorDetails) -> bool:
    """Whether a list counts as too short only because what is in it is wrong, which is said beside."""
    return detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]


def _sentence(detail: ErrorDetails, model: type[BaseModel]) -> str:
    keys, types_on_the_way = _follow(model, detail["loc"])
    key = ".".join(keys) or "(scenario)"
    if detail["type"] == "extra_forbidden":
        return _unknown_key(keys, types_on_the_way)
    if detail["type"] == "missing":
        return f"{key}: missing, and it has no default"
    if detail["type"] == "union_tag_not_found":
        return f"{key}: needs a kind (or, for a sensor, a preset)"
    if detail["type"] == "union_tag_invalid":
        context = detail.get("ctx", {})
        given, allowed = str(context.get("tag")), str(context.get("expected_tags")).replace("'", "")
        return f"{key}: unknown kind {given!r}{did_you_mean(given, allowed.split(', '))} (there are {allowed})"
    message = detail["msg"].removeprefix("Value error, ")
    if detail["type"] == "value_error":
        return f"{key}: {message}" if keys else message
    return f"{key}: given {_short(detail['input'])}: {_in_words_of_the_file(detail['type'], message)}"


def _in_words_of_the_file(kind: str, message: str) -> str:
    """What is told of a value's type or length, without words of Python's."""
    if kind in _WANTED:
        return f"input should be {_WANTED[kind]}"
    plain = message.replace("Tuple", "list").replace("Dictionary", "table").replace(" after validation", "")
    return plain[0].lower() + plain[1:]


def _unknown_key(keys: list[str], types_on_the_way: list[Any]) -> str:
    allowed: list[str] = []
    for model in models_of(types_on_the_way[-1]):
        allowed += [name for name in model.model_fields if name not in allowed]
    hint = did_you_mean(keys[-1], allowed)
    if hint and len(keys) == 1:
        return f"{keys[0]}: unknown key{hint}"  # all sections would be too many to read
    return f"{'.'.join(keys)}: unknown key{hint} (allowed here: {', '.join(allowed)})"


def did_you_mean(given: str, allowed: Iterable[str], *, alike: float = 0.6) -> str:
    """``; did you mean 'x'?`` where something allowed is near to what was given (1: the same), else nothing."""
    near = difflib.get_close_matches(given, list(allowed), n=1, cutoff=alike)
    return f"; did you mean {near[0]!r}?" if near else ""


def unknown_listed(given: str, known: Iterable[str], what: str) -> str:
    """Say that a name is not among the many of ``twin list``: with the nearest one, or where to look."""
    return f"unknown {what} {given!r}{did_you_mean(given, known) or ' (twin list names all)'}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else text[:_LONGEST_VALUE] + "..."


def _follow(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[list[str], list[Any]]:
    """Walk an error's location through the models; drop the union tags that are no keys of the file.

    Returns the keys as written in the file and, for each, the type that holds it.
    """
    at: Any = model
    keys: list[str] = []
    holders: list[Any] = []
    for part in location:
        tagged = _tagged(at, part)
        if tagged is not None:
            at = tagged
            continue
        keys.append(str(part))
        holders.append(at)
        at = _below(at, part)
    return keys, holders


def models_of(annotation: Any) -> list[type[BaseModel]]:
    """All model classes that an annotation stands for, or (a table of them) holds."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) is Annotated:
        return models_of(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return [model for option in get_args(annotation) for model in models_of(option)]
    if get_origin(annotation) is dict:
        return models_of(get_args(annotation)[1])
    return []


def _tagged(annotation: Any, part: int | str) -> Any:
    """Return the member of a union that ``part`` names as its kind, or None where ``part`` is a real key."""
    models = models_of(annotation)
    if get_origin(annotation) is dict or len(models) < 2:
        return None
    for member, tag in _members_with_tags(annotation):
        if tag == part:
            return member
    for model in models:
        field = model.model_fields.get("kind")
        if field is not None and part in get_args(field.annotation):
            return model
    return None


def _members_with_tags(annotation: Any) -> Iterator[tuple[Any, str]]:
    """Members of a union that say themselves by which tag they are chosen."""
    if get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        yield from ((inner, each.tag) for each in metadata if isinstance(each, Tag))
        annotation = inner
    if get_origin(annotation) in (Union, types.UnionType):
        for option in get_args(annotation):
            yield from _members_with_tags(option)


def _below(annotation: Any, part: int | str) -> Any:
    if get_origin(annotation) is Annotated:
        return _below(get_args(annotation)[0], part)
    arguments = get_args(annotation)
    if get_origin(annotation) is dict:
        return arguments[1]
    for model in models_of(annotation):
        if part in model.model_fields:
            return model.model_fields[str(part)].annotation
    if get_origin(annotation) in (tuple, list):
        return arguments[0]
    if get_origin(annotation) in (Union, types.UnionType):
        return next((option for option in arguments if get_args(option)), None)
    return None
