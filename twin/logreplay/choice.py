"""Which estimators run over a log: kinds by name with their default options, variants of them, the user's own.

``guidance_pv``, or ``cv=guidance_kinematic:model=constant_velocity,variant=corrected`` (a name of its own, and
options), or the user's ``package.module:Class``. A kind hears all sensors of the log that it can use, found by building
it with them, or those that its option ``sensors`` names; a user's own class hears all.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel, ValidationError, create_model

from twin.errors import BadInputError
from twin.estimation import EstimatorFactory
from twin.estimators import AnyEstimatorConfig, EstimatorConfigUnion, build_estimator
from twin.estimators.adapter import registered
from twin.estimators.roles import GNSS
from twin.paths import plain_name
from twin.scenario import RESERVED, parse_setting, unknown
from twin.signals import Estimator, EstimatorSetup
from twin.validation import explain, models_of

_SENSORS = "sensors"
_NOT_BY_NAME = "plugin"
_A_CLASS = re.compile(r"(\w+=)?[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def _kinds() -> dict[str, type[BaseModel]]:
    """Configuration classes of the kinds that may be named."""
    classes = models_of(AnyEstimatorConfig)
    kinds = {str(_kind_of(each)): each for each in classes}
    return {kind: each for kind, each in kinds.items() if kind != _NOT_BY_NAME}


def _kind_of(config: type[BaseModel]) -> object:
    annotation: Any = config.model_fields["kind"].annotation
    return annotation.__args__[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """An estimator that was asked for."""

    name: str
    kind: str = ""
    """Empty for a user's own class."""
    options: Mapping[str, Any]
    factory: EstimatorFactory | None = None
    """Of a user's own class."""

    def build(self, setup: EstimatorSetup) -> tuple[Estimator, tuple[str, ...]]:
        """The estimator, and the names of the sensors that it hears of those in ``setup``.

        Raises:
            BadInputError: it cannot work with the sensors of the log, or an option is wrong.
        """
        setup = replace(setup, name=self.name)
        if self.factory is not None:
            return self.factory(setup), tuple(setup.sensors)
        if _SENSORS in self.options:
            return self._with(setup, tuple(self.options[_SENSORS]))
        return self._with(setup, self._usable(setup))

    def _usable(self, setup: EstimatorSetup) -> tuple[str, ...]:
        """The first receiver and all that can be used beside it, or else what can be used without one."""
        receivers = [info.name for info in setup.sensors.values() if info.kind == GNSS]
        others = [name for name, info in setup.sensors.items() if info.kind != GNSS]
        for base in (receivers[:1], []):
            kept = list(base)
            for name in others:
                if self._fits(setup, [*kept, name]):
                    kept.append(name)
            if kept and self._fits(setup, kept):
                return tuple(kept)
        # What is wrong is said when it is built with them.
        return (*receivers[:1], *others)

    def _fits(self, setup: EstimatorSetup, sensors: Sequence[str]) -> bool:
        try:
            self._with(setup, tuple(sensors))
        except BadInputError:
            return False
        return True

    def _with(self, setup: EstimatorSetup, sensors: tuple[str, ...]) -> tuple[Estimator, tuple[str, ...]]:
        absent = [name for name in sensors if name not in setup.sensors]
        if absent:
            raise BadInputError(f"estimators.{self.name}.sensors: {unknown(absent[0], dict(setup.sensors), 'sensor')}")
        config = self._config(sensors)
        heard = {name: setup.sensors[name] for name in sensors}
        return build_estimator(config, replace(setup, sensors=heard)), sensors

    def _config(self, sensors: tuple[str, ...]) -> AnyEstimatorConfig:
        table = {**self.options, "kind": self.kind, _SENSORS: list(sensors)}
        model = create_model("Estimators", estimators=(dict[str, EstimatorConfigUnion], ...))
        try:
            held: Any = model.model_validate({"estimators": {self.name: table}})
        except ValidationError as error:
            raise BadInputError(explain(error, model, f"--estimator {self.name}")) from None
        config: AnyEstimatorConfig = held.estimators[self.name]
        return config


def is_built_in(text: str) -> bool:
    """Whether what follows ``--estimator`` names a kind, rightly or wrongly, and not a class of the user's."""
    kind = _split(text)[1]
    return kind in _kinds() or not (_A_CLASS.fullmatch(text) or kind in registered())


def _split(text: str) -> tuple[str, str, str]:
    """Name, kind and options of ``[NAME=]KIND[:KEY=VALUE,...]``."""
    head, _, options = text.partition(":")
    name, equals, kind = head.partition("=")
    return (name.strip(), kind.strip(), options) if equals else (head.strip(), head.strip(), options)


def choose(
    texts: Sequence[str],
    *,
    plugins: Mapping[str, EstimatorFactory] | None = None,
    options: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Choice]:
    """Estimators by name, kinds first.

    Raises:
        BadInputError: a kind is unknown, two have one name, or options are for none of them.
    """
    kinds, options = _kinds(), options or {}
    chosen: list[Choice] = []
    for text in texts:
        name, kind, told = _split(text)
        if kind not in kinds:
            raise BadInputError(f"--estimator {text}: {unknown(kind, kinds, 'kind')}; or package.module:Class")
        given = dict(parse_setting(part) for part in told.split(",") if part.strip())
        chosen.append(Choice(name=_own_name(name), kind=kind, options={**given, **options.get(name, {})}))
    chosen += [Choice(name=_own_name(name), options={}, factory=made) for name, made in (plugins or {}).items()]
    names = [each.name for each in chosen]
    for name in names:
        if names.count(name) > 1:
            raise BadInputError(f"--estimator {name}: two of that name; tell them apart, as other={name}:key=value")
    for name in options:
        if name not in [each.name for each in chosen if each.kind]:
            raise BadInputError(f"--set estimators.{name}: {unknown(name, names, 'estimator')}")
    return chosen


def _own_name(name: str) -> str:
    plain_name(name, what="--estimator")
    if name in RESERVED or "." in name:
        raise BadInputError(
            f"--estimator {name}: the name is reserved, or has a dot in it, which names of metrics have"
        )
    return name
