"""Kalman engines: the algebra of an extended Kalman filter over the ensemble axis, and nothing else.

An estimator states its model once, as functions that broadcast over the ensemble axis (a :class:`Motion` and its
:class:`Observation` objects); an engine knows only ``predict`` and ``update``. Gates, lag and modes live once, above
the engine. Two engines exist and agree to rounding: filterpy objects for one run
(:mod:`twin.estimators.filterpy_engine`) and, for any number of runs, :class:`EnsembleEngine`.

Letters, as in the textbooks (Gustafsson, *Statistical Sensor Fusion*; paper 000 eqs 2.1 to 2.6): x state (R, n),
P its covariance (R, n, n), f and F motion and its Jacobian, Q process noise, h and H observation and its Jacobian,
z measurement (R, m), R noise covariance of the measurement (m, m), y innovation, S its covariance, K gain. R is also
the length of the ensemble axis; which is meant is clear from the context.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from twin.signals import BoolArray, FloatArray

EngineName = Literal["filterpy", "ensemble"]


class Motion(Protocol):
    """How the state moves on. Every function broadcasts over the ensemble axis."""

    def f(self, x: FloatArray, u: FloatArray, dt_s: float) -> FloatArray:
        """State after ``dt_s`` under the input ``u`` (R,), shape (R, n)."""

    def F(self, x: FloatArray, u: FloatArray, dt_s: float) -> FloatArray:  # noqa: N802
        """Jacobian of :meth:`f` with respect to the state, shape (R, n, n)."""

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise gathered in ``dt_s``, shape (n, n)."""


class Observation(Protocol):
    """What a sensor sees of the state. Every function broadcasts over the ensemble axis."""

    @property
    def R(self) -> FloatArray:  # noqa: N802
        """Noise covariance, shape (m, m)."""

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
        nis: FloatArray = np.einsum("rm,rmk,rk->r", self.y, _inverse(self.S), self.y)
        return nis


class Engine(Protocol):
    """An extended Kalman filter of R members. ``x`` and ``P`` are replaced, never changed in place."""

    @property
    def x(self) -> FloatArray:
        """State, shape (R, n)."""

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance, shape (R, n, n)."""

    def predict(self, motion: Motion, u: FloatArray, dt_s: float) -> None:
        """Move every member on by ``dt_s`` (eqs 2.2 and 2.6)."""

    def update(self, observation: Observation, z: FloatArray, mask: BoolArray) -> None:
        """Update the members where ``mask`` (R,) is True with ``z`` (R, m); the others keep x and P bit for bit.

        ``z`` may hold anything, NaN included, where ``mask`` is False.
        """


def innovation(engine: Engine, observation: Observation, z: FloatArray) -> Innovation:
    """Innovation of ``z`` (R, m) before an update: what gates and consistency tests look at.

    It stands above the engines, so that a gate compares the same NumPy expression whichever engine runs.
    """
    x = engine.x
    H = observation.H(x)
    S = np.einsum("...mi,...ij,...kj->...mk", H, engine.P, H) + observation.R
    return Innovation(z - observation.h(x), S)


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
    """The extended Kalman filter in NumPy for any number of runs, with the covariance in Joseph's form.

    P+ = (I - K H) P (I - K H)^T + K R K^T is evaluated as M = P - K (P H^T)^T, then P+ = M - (M H^T) K^T + K R K^T:
    the same products without ever forming I - K H. A member that is masked out gets the gain zero, with which both
    lines return x and P unchanged.

    The arrays have the shapes (R, n) and (R, n, n), but members lie next to each other in memory (the ensemble axis
    has the smallest stride): ufuncs and einsum then run along the members, three times faster at R = 500.
    """

    def __init__(self, x: FloatArray, P: FloatArray) -> None:
        self._x = _members_fastest(x)
        self._P = _members_fastest(P)

    @property
    def x(self) -> FloatArray:
        """State, shape (R, n)."""
        return self._x

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance, shape (R, n, n)."""
        return self._P

    def predict(self, motion: Motion, u: FloatArray, dt_s: float) -> None:
        """Move every member on by ``dt_s``."""
        F = motion.F(self._x, u, dt_s)
        self._x = motion.f(self._x, u, dt_s)
        self._P = np.einsum("rik,rjk->rij", np.einsum("rij,rjk->rik", F, self._P), F) + motion.Q(dt_s)

    def update(self, observation: Observation, z: FloatArray, mask: BoolArray) -> None:
        """Update the members where ``mask`` is True."""
        x, P = self._x, self._P
        H = observation.H(x)
        PHt = np.einsum("...ij,...mj->...im", P, H)
        S = np.einsum("...mi,...ik->...mk", H, PHt) + observation.R
        K = np.where(mask[:, np.newaxis, np.newaxis], np.einsum("rim,rmk->rik", PHt, _inverse(S)), 0.0)
        y = np.where(mask[:, np.newaxis], z - observation.h(x), 0.0)
        self._x = x + np.einsum("rim,rm->ri", K, y)
        M = P - np.einsum("rim,rjm->rij", K, PHt)
        correction = np.einsum("rim,mk->rik", K, observation.R) - np.einsum("...ij,...mj->...im", M, H)
        self._P = M + np.einsum("rim,rjm->rij", correction, K)


def _inverse(S: FloatArray) -> FloatArray:
    """Inverses of (..., m, m): scalar measurements, nearly all there are, need no factorisation."""
    if S.shape[-1] == 1:
        return 1.0 / S
    return np.asarray(np.linalg.inv(S), dtype=np.float64)


def _members_fastest(array: FloatArray) -> FloatArray:
    """Copy of an array whose first axis has the smallest stride."""
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(array, 0, -1), dtype=np.float64).copy(), -1, 0)
