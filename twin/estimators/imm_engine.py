"""Interacting multiple models: filters side by side, mixed before each prediction and weighed by their likelihoods.

Source: Blom and Bar-Shalom, IEEE Trans. Automatic Control 33 (1988) 780; Bar-Shalom, Li and Kirubarajan, *Estimation
with Applications to Tracking and Navigation*, section 11.6. With mode probabilities mu, M[i, j] the probability of
going from mode i to mode j, x_i and P_i the modes' own:

    c_j = sum_i mu_i M_ij,   w_ij = M_ij mu_i / c_j,
    x0_j = sum_i w_ij x_i,   P0_j = sum_i w_ij (P_i + (x_i - x0_j)(x_i - x0_j)^T),
    predict and update each mode from there,   mu_j ~ c_j L_j.

Two engines exist and agree to rounding: filterpy's IMMEstimator for one run, and one that broadcasts over the ensemble
axis R. Shapes: x (R, N, n), P (R, N, n, n), mu (R, N), F and Q (N, R, n, n) by mode, M (R, N, N).

Of filterpy's class only mixing, prediction and update are used. Its docstring has M the other way round (M[i, j] is
taken from i to j, as here); its mixing weights are those of the M it had at the last update, which is wrong where the
time to the next fix is not known then; its state before an update is weighed by the mode probabilities of the update
before, not by c; and its likelihoods underflow for a fix far off, after which all modes are as likely as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from twin.estimators.engines import EngineName
from twin.estimators.imm_kernels import correct_modes, mean_of, mix, move, weigh
from twin.signals import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """States of all modes of R members, and how likely each mode is."""

    x: FloatArray
    """(R, N, n)."""
    P: FloatArray
    """(R, N, n, n)."""
    mu: FloatArray
    """(R, N)."""

    def mean(self) -> tuple[FloatArray, FloatArray]:
        """State (R, n) and covariance (R, n, n) of the mixture."""
        return mean_of(self.x, self.P, self.mu)


@dataclass(frozen=True, slots=True, eq=False)
class ModeMotion:
    """How modes move on over one interval, each member over its own."""

    F: FloatArray
    """(N, R, n, n)."""
    Q: FloatArray
    """(N, R, n, n)."""
    M: FloatArray
    """(R, N, N)."""


def mixed(modes: Modes, M: FloatArray) -> Modes:
    """What each mode starts the next prediction from; ``mu`` is then c, the prediction of the probabilities."""
    return Modes(*mix(modes.x, modes.P, modes.mu, M))


def predicted(modes: Modes, motion: ModeMotion) -> Modes:
    """Mix and move on."""
    x, P, c = mix(modes.x, modes.P, modes.mu, motion.M)
    return Modes(*move(x, P, motion.F, motion.Q), c)


def weighed(c: FloatArray, log_likelihood: FloatArray) -> FloatArray:
    """Mode probabilities (R, N) after a fix; in logarithms, so that a fix far from all modes still compares them."""
    return weigh(c, log_likelihood)


class ImmEngine(Protocol):
    """An IMM of R members."""

    @property
    def modes(self) -> Modes:
        """States and probabilities now."""

    def restore(self, modes: Modes) -> None:
        """Go on from other states."""

    def predict(self, motion: ModeMotion) -> None:
        """Mix and move on; members whose F and M are identities and whose Q is zero stay as they are."""

    def update(self, z: FloatArray, R: FloatArray, mask: BoolArray) -> None:
        """Update the members where ``mask`` (R,) with ``z`` (R, m) of variances ``R`` (R, m), finite everywhere."""


def make_imm(name: EngineName, H: FloatArray, modes: Modes) -> ImmEngine:
    """Return an engine whose modes j measure H_j x, H (N, m, n), and that starts from ``modes``.

    Raises:
        ValueError: the filterpy engine was asked for more than one run.
    """
    if name == "ensemble":
        return EnsembleImm(H, modes)
    from twin.estimators.filterpy_imm import FilterpyImm  # noqa: PLC0415  (imports scipy: a second or more)

    return FilterpyImm(H, modes)


class EnsembleImm:
    """The IMM for any number of runs; compiled (:mod:`twin.estimators.imm_kernels`), covariances in Joseph's form."""

    def __init__(self, H: FloatArray, modes: Modes) -> None:
        self._H = np.ascontiguousarray(H)
        self.modes = modes

    def restore(self, modes: Modes) -> None:
        """Go on from other states."""
        self.modes = modes

    def predict(self, motion: ModeMotion) -> None:
        """Mix and move on."""
        self.modes = predicted(self.modes, motion)

    def update(self, z: FloatArray, R: FloatArray, mask: BoolArray) -> None:
        """Update the members where ``mask`` is True."""
        before = self.modes
        told, variances = np.ascontiguousarray(z), np.ascontiguousarray(R)
        x, P, said = correct_modes(self._H, before.x, before.P, told, variances, mask)
        mu = np.where(mask[:, np.newaxis], weigh(before.mu, said), before.mu)
        self.modes = Modes(x, P, mu)
