"""A user's own estimator: a plain class that sees one run, lifted to the run axis by one adapter.

The class a user writes::

    class MyFilter:
        columns = ("speed_m_s", "heading_rad")  # names the truth has are scored
        # state_columns = (...)                 # only if estimate() returns a covariance

        def __init__(self, setup): ...  # an EstimatorSetup with runs = 1: mounts, data sheets, row places, start pose

        def process(self, sample): ...  # a Sample, in order of arrival; lost samples are not handed on

        def estimate(self, t):
            ...  # seconds -> {"speed_m_s": 2.5, "heading_rad": (0.1, 0.02)} (value, or value
            # and sigma, NaN for none), or an Estimate with arrays of shape (n,) [covariance (m, m)]

Options given in the configuration are passed to ``__init__`` as keywords. The class is found through the entry-point
group ``twin.estimators`` (kind ``plugin``) or as ``package.module:Class`` on the command line; scenario files
cannot name code. An exception of the class ends the run as bad input: the traceback of its own code, then one line.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, Protocol, cast

import numpy as np
from pydantic import Field

from twin.config import Config, Names, Positive
from twin.errors import BadInputError
from twin.estimators.user_code import blaming
from twin.signals import NS_PER_S, Estimate, EstimatorSetup, FloatArray, Measurement
from twin.validation import did_you_mean

ENTRY_POINTS = "twin.estimators"


class PluginConfig(Config):
    """Options of an estimator that another package registers in the entry-point group ``twin.estimators``."""

    kind: Literal["plugin"]
    name: str
    """Name of the entry point."""
    sensors: Names
    """Names of the sensors it listens to."""
    rate_hz: Positive = 50.0
    """Output rate."""
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    """Keywords for the class."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One sample of one sensor in one run."""

    sensor: str
    t: float
    """When it was true, s, by the sensor's clock."""
    t_available: float
    """When it arrived, s."""
    columns: tuple[str, ...]
    values: FloatArray
    """(n,), one value per column; NaN where the sensor gave none."""

    def __getitem__(self, column: str) -> float:
        """Value of one column.

        Raises:
            KeyError: no such column.
        """
        try:
            return float(self.values[self.columns.index(column)])
        except ValueError:
            raise KeyError(f"{self.sensor!r} gives no {self._unknown(column)}") from None

    def _unknown(self, column: str) -> str:
        return f"{column!r}{did_you_mean(column, self.columns)} (there are {', '.join(self.columns)})"


Reported = Estimate | Mapping[str, float | tuple[float, float]]


class SingleRunEstimator(Protocol):
    """What a user's class looks like from here."""

    columns: tuple[str, ...]

    def process(self, sample: Sample) -> None:
        """Take one sample, in order of arrival."""

    def estimate(self, t: float) -> Reported:
        """Return the estimate at ``t`` seconds."""


EstimatorClass = Callable[..., SingleRunEstimator]


class AdaptedEstimator:
    """R instances of a user's class as one estimator over the run axis.

    Raises:
        BadInputError: the class lacks a part, or does not accept the options; later, if an estimate does not fit the
            columns it declared; and where the user's code raises an exception, with the traceback of that code.
    """

    def __init__(
        self, factory: EstimatorClass, setup: EstimatorSetup, options: Mapping[str, Any] | None = None
    ) -> None:
        made_by = f"{factory.__module__}:{getattr(factory, '__qualname__', factory)}"
        self._where = f"estimator {setup.name} ({made_by})"
        _check_call(factory, setup, options or {}, self._where)
        with blaming(f"{self._where}: __init__()"):
            self._members = [factory(replace(setup, runs=1), **(options or {})) for _ in range(setup.runs)]
        first = self._members[0]
        for part in ("process", "estimate"):
            if not callable(getattr(first, part, None)):
                raise BadInputError(f"{self._where}: has no method {part}()")
        declared = getattr(first, "columns", None)
        if not declared or isinstance(declared, str) or not all(isinstance(name, str) for name in declared):
            raise BadInputError(f"{self._where}: columns must be a tuple of column names, not {declared!r}")
        self.columns: tuple[str, ...] = tuple(declared)
        self.state_columns: tuple[str, ...] = tuple(getattr(first, "state_columns", ()))

    def process(self, measurement: Measurement) -> None:
        """Hand one measurement to every member that got it."""
        with blaming(f"{self._where}: process()"):
            for member, values, valid in zip(self._members, measurement.values, measurement.valid, strict=True):
                if valid:
                    member.process(
                        Sample(
                            sensor=measurement.sensor,
                            t=measurement.t,
                            t_available=measurement.t_available,
                            columns=measurement.columns,
                            values=values.copy(),
                        )
                    )

    def estimate(self, t_ns: int) -> Estimate:
        """Collect every member's estimate."""
        with blaming(f"{self._where}: estimate()"):
            said = [member.estimate(t_ns / NS_PER_S) for member in self._members]
        reports = [self._read(each) for each in said]
        size = len(self.state_columns)
        return Estimate(
            t_ns=t_ns,
            values=np.stack([values for values, _, _ in reports]),
            sigmas=np.stack([sigmas for _, sigmas, _ in reports]),
            covariance=np.stack([covariance for _, _, covariance in reports]) if size else None,
        )

    def _read(self, report: Reported) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values (n,), sigmas (n,) and covariance (m, m) of one member."""
        n, m = len(self.columns), len(self.state_columns)
        covariance: object = None
        if isinstance(report, Estimate):
            values, sigmas, covariance = report.values, report.sigmas, report.covariance
        elif isinstance(report, Mapping):
            values, sigmas = self._from_mapping(report)
        else:
            raise BadInputError(
                f"{self._where}: estimate() gave {type(report).__name__}; expected a mapping or Estimate"
            )
        sigmas = self._shaped(sigmas, (n,), "sigmas")
        for column, sigma in zip(self.columns, sigmas.tolist(), strict=True):
            if sigma < 0.0:
                raise BadInputError(f"{self._where}: estimate() gave {column} a negative sigma, {sigma:g}")
        return (
            self._shaped(values, (n,), "values"),
            sigmas,
            self._shaped(np.full((m, m), np.nan) if covariance is None else covariance, (m, m), "covariance"),
        )

    def _from_mapping(self, report: Mapping[str, float | tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
        if set(report) != set(self.columns):
            raise BadInputError(
                f"{self._where}: estimate() gave {', '.join(map(str, report))}; declared are {', '.join(self.columns)}"
            )
        pairs = [
            entry if isinstance(entry, tuple) else (entry, np.nan) for entry in (report[name] for name in self.columns)
        ]
        both = self._shaped(pairs, (len(pairs), 2), "estimate()")
        return both[:, 0], both[:, 1]

    def _shaped(self, array: object, shape: tuple[int, ...], what: str) -> FloatArray:
        try:
            result = np.array(array, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise BadInputError(f"{self._where}: {what} must be numbers ({error})") from error
        if result.shape != shape:
            raise BadInputError(f"{self._where}: {what} has shape {result.shape}, expected {shape}")
        return result


def load_class(spec: str) -> EstimatorClass:
    """Import ``package.module:Class``.

    Raises:
        BadInputError: the text is not of that form, the module cannot be imported, or it has no such class.
    """
    module_name, colon, class_name = spec.partition(":")
    if not (colon and class_name.isidentifier() and all(part.isidentifier() for part in module_name.split("."))):
        raise BadInputError(f"estimator {spec!r}: expected package.module:Class")
    try:
        with blaming(f"estimator {spec!r}: importing {module_name!r}", but=(ImportError,)):
            module = importlib.import_module(module_name)
    except ImportError as error:
        raise BadInputError(f"estimator {spec!r}: cannot import {module_name!r} ({error})") from error
    return _a_class(
        getattr(module, class_name, None), f"estimator {spec!r}: {module_name!r} has no class {class_name!r}"
    )


def registered() -> dict[str, EntryPoint]:
    """What other packages have registered in the entry-point group, by name."""
    return {point.name: point for point in entry_points(group=ENTRY_POINTS)}


def load_entry_point(name: str) -> EstimatorClass:
    """Load the class that is registered under ``name`` in the entry-point group ``twin.estimators``.

    Raises:
        BadInputError: nothing is registered under that name, or it cannot be imported.
    """
    points = registered()
    if name not in points:
        known = ", ".join(sorted(points)) or "none"
        raise BadInputError(
            f"estimator plug-in {name!r}: not in the entry-point group {ENTRY_POINTS!r}; known: {known}"
        )
    try:
        with blaming(f"estimator plug-in {name!r}: loading {points[name].value!r}", but=(ImportError, AttributeError)):
            loaded = points[name].load()
    except (ImportError, AttributeError) as error:
        raise BadInputError(f"estimator plug-in {name!r}: cannot load {points[name].value!r} ({error})") from error
    return _a_class(loaded, f"estimator plug-in {name!r}: {points[name].value!r} is not a class")


def _a_class(loaded: Any, complaint: str) -> EstimatorClass:
    if not inspect.isclass(loaded):
        raise BadInputError(complaint)
    return cast("EstimatorClass", loaded)


def _check_call(factory: EstimatorClass, setup: EstimatorSetup, options: Mapping[str, Any], where: str) -> None:
    try:
        inspect.signature(factory).bind(setup, **options)
    except TypeError as error:
        raise BadInputError(
            f"{where}: cannot be made from (setup{''.join(f', {key}=' for key in options)}): {error}"
        ) from error
