"""The IMM of one run, on filterpy's objects. Import it only where it is used: filterpy brings scipy."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from twin.estimators.imm_engine import ModeMotion, Modes, weighed
from twin.signals import BoolArray, FloatArray


class FilterpyImm:
    """An IMM of one run on :class:`filterpy.kalman.IMMEstimator`; see :mod:`twin.estimators.imm_engine` for what is
    not left to it.

    Raises:
        ValueError: more than one run was asked for.
    """

    def __init__(self, H: FloatArray, modes: Modes) -> None:
        if len(modes.x) != 1:
            raise ValueError(f"the filterpy engine steps one run, not {len(modes.x)}")
        self._H = H
        self.restore(modes)

    def restore(self, modes: Modes) -> None:
        """Go on from other states."""
        filters = []
        for x, P, H in zip(modes.x[0], modes.P[0], self._H, strict=True):
            one = KalmanFilter(dim_x=H.shape[1], dim_z=H.shape[0])
            one.x, one.P, one.H = x.copy(), P.copy(), H
            filters.append(one)
        self._imm = IMMEstimator(filters, modes.mu[0], np.eye(len(filters)))

    @property
    def modes(self) -> Modes:
        """States and probabilities now."""
        filters = self._imm.filters
        x, P = np.array([one.x for one in filters]), np.array([one.P for one in filters])
        return Modes(x[np.newaxis], P[np.newaxis], np.array(self._imm.mu)[np.newaxis])

    def predict(self, motion: ModeMotion) -> None:
        """Mix by this interval's M, and move on."""
        imm, M = self._imm, motion.M[0]
        for one, F, Q in zip(imm.filters, motion.F[:, 0], motion.Q[:, 0], strict=True):
            one.F, one.Q = F, Q
        c = imm.mu @ M
        imm.M, imm.omega = M, M * imm.mu[:, np.newaxis] / c
        imm.predict()
        imm.mu = imm.cbar = c

    def update(self, z: FloatArray, R: FloatArray, mask: BoolArray) -> None:
        """Update with ``z`` (1, m) if ``mask`` (1,) is True."""
        if not mask[0]:
            return
        imm, c = self._imm, self._imm.cbar
        for one in imm.filters:
            one.R = np.diag(R[0])
        imm.update(z[0])
        said = np.array([one.log_likelihood for one in imm.filters])
        imm.mu = weighed(c[np.newaxis], said[np.newaxis])[0]
