"""Finds views in a written .rrd that have nothing to show.

The viewer itself shows an empty view without a word, for instance where an origin is misspelt.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from rerun.chunk import RrdReader

from twin.errors import BadInputError


@dataclass(kw_only=True)
class StoredView:
    """A view as the file's blueprint has it."""

    kind: str = ""
    name: str = ""
    origin: str = "/"
    query: list[str] = field(default_factory=list)
    """Rules such as ``$origin/**``, ``+ /a/b`` and ``- /a/b/**``."""


def stored_views(path: Path) -> list[StoredView]:
    """Read the views of the layout in a .rrd.

    Raises:
        BadInputError: the file has no layout.
    """
    reader = RrdReader(path)
    blueprints = reader.blueprints()
    if not blueprints:
        raise BadInputError(f"{path}: the recording has no layout")
    views: dict[str, StoredView] = {}
    for chunk in reader.stream(store=blueprints[-1]):
        parts = chunk.entity_path.strip("/").split("/")
        if parts[0] != "view" or len(parts) > 3:
            continue
        view = views.setdefault(parts[1], StoredView())
        batch = chunk.to_record_batch()

        def last(column: str) -> list[str]:
            names = batch.schema.names  # noqa: B023  (called in this turn of the loop only)
            return batch[column].to_pylist()[-1] if column in names else []  # noqa: B023

        view.kind = next(iter(last("ViewBlueprint:class_identifier")), view.kind)
        view.name = next(iter(last("ViewBlueprint:display_name")), view.name)
        view.origin = next(iter(last("ViewBlueprint:space_origin")), view.origin)
        view.query = last("ViewContents:query") or view.query
    return list(views.values())


def shown_entities(view: StoredView, entities: Iterable[str]) -> list[str]:
    """Entities (with leading slash) that a view's rules choose; the last rule that fits an entity decides."""
    rules = []
    for rule in view.query or ["$origin/**"]:
        keep = not rule.startswith("-")
        pattern = rule.lstrip("+- ").replace("$origin", view.origin.rstrip("/"))
        rules.append((keep, pattern.removesuffix("/**"), pattern.endswith("/**")))

    def kept(entity: str) -> bool:
        verdicts = [
            keep
            for keep, root, below in rules
            if entity == root or (below and entity.startswith(root.rstrip("/") + "/"))
        ]
        return bool(verdicts) and verdicts[-1]

    return [entity for entity in entities if kept(entity)]


def empty_views(path: Path) -> list[str]:
    """Names of the views in a .rrd's layout of which no entity exists in its schema.

    Raises:
        BadInputError: the file has no layout.
    """
    entities = RrdReader(path).store().schema().entity_paths()
    return [view.name for view in stored_views(path) if not shown_entities(view, entities)]
