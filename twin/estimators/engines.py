"""Kalman engines: the algebra of an extended Kalman filter over the ensemble axis, and nothing else.

An estimator states its model once, as functions that broadcast over the ensemble axis (a :class:`Motion` and its
:class:`Observation` objects); an engine knows only ``predict`` and ``update``. Gates, lag and modes live once, above
the engine. Two engines exist and agree to rounding: filterpy objects for one run
(:mod:`twin.estimators.filterpy_engine`) and, for any number of runs, :class:`EnsembleEngine`.

Letters, as in the textbooks (Gustafsson, *Statistical Sensor Fusion*; paper 000 eqs 2.1 to 2.6): x state (R, n),
P its covariance (R, n, n), f and F motion and its Jacobian, Q process noise, h and H observation and its Jacobian,
z measurement (R, m), R noise variances of its m components, y innovation, S its covariance, K gain. The components of
one measurement err independently: R is a diagonal, kept as (m,) or, where members differ, (R, m). R is also the length
of the ensemble axis; which is meant is clear from the context.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from twin.errors import BadInputError
from twin.estimators.engine_kernels import correct_in_turn, innovation_covariance, normalised_square, propagate
from twin.signals import BoolArray, FloatArray

_MEMBERS_LAST = {1: (0,), 2: (1, 0), 3: (1, 2, 0)}

EngineName = Literal["filterpy", "ensemble"]
EngineOption = Literal["auto", "filterpy", "ensemble"]


class Motion(Protocol):
    """How the state moves on. Every function broadcasts over the ensemble axis."""

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """f, the state after ``dt_s`` under the input ``u`` (R, ...), shape (R, n), and F, its Jacobian, (R, n, n)."""

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise gathered in ``dt_s``, shape (n, n), or (R, n, n) where members differ."""


class Observation(Protocol):
    """What a sensor sees of the state. Every function broadcasts over the ensemble axis."""

    @property
    def R(self) -> FloatArray:  # noqa: N802
        """Noise variances, shape (m,)."""

    def h(self, x: FloatArray) -> FloatArray:
        """Expected measurement, shape (R, m)."""

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian of :meth:`h`, shape (R, m, n), or (m, n) where it does not depend on the state."""


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """What a measurement said that was not expected, and how far off it may be."""

    y: FloatArray
    """(R, m) measured minus expected."""
    S: FloatArray
    """(R, m, m) its covariance."""

    @property
    def nis(self) -> FloatArray:
        """Normalised innovation squared y^T S^-1 y, shape (R,): chi-square with m degrees of freedom if consistent."""
        return normalised_square(_members_last(self.y), _members_last(self.S))


class AboutState:
    """An observation about one state: what is expected, and the Jacobian, are worked out once.

    For a gate and the update that follows it, between which the engine's state does not change.
    """

    def __init__(self, observation: Observation, x: FloatArray) -> None:
        self.R: FloatArray = observation.R
        self._h, self._H = observation.h(x), observation.H(x)

    def h(self, x: FloatArray) -> FloatArray:  # noqa: ARG002
        """Expected measurement, shape (R, m)."""
        return self._h

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian, shape (R, m, n) or (m, n)."""
        return self._H


class Engine(Protocol):
    """An extended Kalman filter of R members. ``x`` and ``P`` are replaced, never changed in place."""

    @property
    def x(self) -> FloatArray:
        """State, shape (R, n)."""

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance, shape (R, n, n)."""

    def restore(self, x: FloatArray, P: FloatArray) -> None:
        """Go back to a state (R, n) and covariance (R, n, n) that this engine had before."""

    def predict(self, motion: Motion, u: FloatArray, dt_s: float) -> None:
        """Move every member on by ``dt_s`` (eqs 2.2 and 2.6)."""

    def update(
        self, observation: Observation, z: FloatArray, mask: BoolArray, R: FloatArray | None = None
    ) -> FloatArray:
        """Update the members where ``mask`` (R,) is True with ``z`` (R, m); the others keep x and P bit for bit.

        ``z`` may hold anything, NaN included, where ``mask`` is False. ``R``, (m,) or (R, m) and finite everywhere,
        takes the place of the observation's own. Returns the normalised innovation squared (R,), NaN where masked.
        """


def innovation(engine: Engine, observation: Observation, z: FloatArray, R: FloatArray | None = None) -> Innovation:
    """Innovation of ``z`` (R, m) before an update: what gates look at.

    It stands above the engines, so that a gate compares the same expression whichever engine runs.
    """
    x = engine.x
    runs = len(x)
    noise = _of_members(observation.R if R is None else R, 2, runs)
    S = innovation_covariance(_members_last(engine.P), _of_members(observation.H(x), 3, runs), noise)
    return Innovation(z - observation.h(x), S.transpose(2, 0, 1))


def compiled_unless_told(option: EngineOption, *, estimator: str, runs: int) -> EngineName:
    """Engine of an estimator that steps with each fix of a log of any length: the ensemble's unless another is told.

    Its compiled loops take a single run through small matrices sooner than filterpy's objects do.

    Raises:
        BadInputError: the filterpy engine was asked for more than one run.
    """
    if option == "filterpy" and runs > 1:
        raise BadInputError(
            f"[estimators.{estimator}] engine = 'filterpy': steps one run, not {runs}; allowed: auto, ensemble"
        )
    return "ensemble" if option == "auto" else option


def make_engine(name: EngineName, x: FloatArray, P: FloatArray) -> Engine:
    """Return an engine that starts from ``x`` (R, n) and ``P`` (R, n, n).

    Raises:
        ValueError: the filterpy engine was asked for more than one run.
    """
    if name == "ensemble":
        return EnsembleEngine(x, P)
    from twin.estimators.filterpy_engine import FilterpyEngine  # noqa: PLC0415  (imports scipy: a second or more)

    return FilterpyEngine(x, P)


class EnsembleEngine:
    """The extended Kalman filter for any number of runs, with the covariance in Joseph's form.

    The components of a measurement, whose errors are independent, are taken one after the other about the same
    linearisation: algebraically the joint update, and its normalised innovation squared is the sum of theirs. A member
    that is masked out gets the gain zero, with which x and P come out unchanged.

    The arrays have the shapes (R, n) and (R, n, n), but members lie next to each other in memory (the ensemble axis
    has the smallest stride), as the compiled loops (:mod:`twin.estimators.engine_kernels`) want them.
    """

    def __init__(self, x: FloatArray, P: FloatArray) -> None:
        self._x = _members_last(x)
        self._P = _members_last(P)

    @property
    def x(self) -> FloatArray:
        """State, shape (R, n)."""
        return self._x.T

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance, shape (R, n, n)."""
        return self._P.transpose(2, 0, 1)

    def restore(self, x: FloatArray, P: FloatArray) -> None:
        """Go back to a state (R, n) and covariance (R, n, n) that this engine had before."""
        self._x, self._P = _members_last(x), _members_last(P)

    def predict(self, motion: Motion, u: FloatArray, dt_s: float) -> None:
        """Move every member on by ``dt_s``."""
        moved, F = motion.linearise(self.x, u, dt_s)
        Q = motion.Q(dt_s)
        self._x = _members_last(moved)
        self._P = propagate(_members_last(F), self._P, Q[:, :, np.newaxis] if Q.ndim == 2 else _members_last(Q))

    def update(
        self, observation: Observation, z: FloatArray, mask: BoolArray, R: FloatArray | None = None
    ) -> FloatArray:
        """Update the members where ``mask`` is True."""
        before = self.x
        variances, H = observation.R if R is None else R, observation.H(before)
        y = _members_last(z - observation.h(before))
        rows, noise = _of_members(H, 3, len(mask)), _of_members(variances, 2, len(mask))
        self._x, self._P, nis = correct_in_turn(self._x, self._P, rows, y, noise, mask)
        return nis


def _of_members(array: FloatArray, ndim: int, runs: int) -> FloatArray:
    """The array with the ensemble axis last; where it lacks one (fewer than ``ndim`` axes), the same for all."""
    if array.ndim == ndim:
        return _members_last(array)
    if runs == 1:
        return np.ascontiguousarray(array[..., np.newaxis], dtype=np.float64)
    return np.repeat(array[..., np.newaxis], runs, axis=-1)


def _members_last(array: FloatArray) -> FloatArray:
    """The array with its first axis last, contiguous; the same memory if it lies so already."""
    return np.ascontiguousarray(array.transpose(_MEMBERS_LAST[array.ndim]), dtype=np.float64)
