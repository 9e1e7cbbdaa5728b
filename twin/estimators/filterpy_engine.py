"""The Kalman engine of one run, on a filterpy object. Import it only where it is used: filterpy brings scipy."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter

from twin.estimators.engines import Motion, Observation
from twin.signals import BoolArray, FloatArray

_NO_NIS: FloatArray = np.array([np.nan])


class FilterpyEngine:
    """An extended Kalman filter of one run (R = 1) on :class:`filterpy.kalman.KalmanFilter`.

    filterpy has an ``ExtendedKalmanFilter`` too; it is the same algebra (Joseph's form as well) but inverts S by
    ``scipy.linalg.inv``, a third of the cost of a scalar update. ``KalmanFilter`` takes the inverse as an attribute.
    The nonlinear model enters as the textbooks linearise it: x is replaced by f(x) after the prediction, and the
    update is given z - h(x) + H x, whose difference to H x is the innovation. A test holds it against filterpy's own
    extended filter.

    Raises:
        ValueError: more than one run was asked for.
    """

    def __init__(self, x: FloatArray, P: FloatArray) -> None:
        if x.shape[0] != 1:
            raise ValueError(f"the filterpy engine steps one run, not {x.shape[0]}")
        self._filter = KalmanFilter(dim_x=x.shape[1], dim_z=1)
        self._filter.x = np.array(x[0], dtype=np.float64)
        self._filter.P = np.array(P[0], dtype=np.float64)

    @property
    def x(self) -> FloatArray:
        """State, shape (1, n)."""
        x: FloatArray = self._filter.x[np.newaxis]
        return x

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance, shape (1, n, n)."""
        P: FloatArray = self._filter.P[np.newaxis]
        return P

    def restore(self, x: FloatArray, P: FloatArray) -> None:
        """Go back to a state (1, n) and covariance (1, n, n)."""
        self._filter.x, self._filter.P = x[0], P[0]

    def predict(self, motion: Motion, u: FloatArray, dt_s: float) -> None:
        """Move on by ``dt_s``."""
        moved, F = motion.linearise(self.x, u, dt_s)
        Q = motion.Q(dt_s)
        self._filter.Q = Q[0] if Q.ndim == 3 else Q
        self._filter.predict(F=F[0])
        self._filter.x = moved[0]

    def update(
        self, observation: Observation, z: FloatArray, mask: BoolArray, R: FloatArray | None = None
    ) -> FloatArray:
        """Update with ``z`` (1, m) if ``mask`` (1,) is True."""
        if not mask[0]:
            return _NO_NIS
        x = self.x
        H = observation.H(x)
        if H.ndim == 3:
            H = H[0]
        variances = observation.R if R is None else R.reshape(-1)
        expected, straight, inner = observation.h(x)[0], np.dot(H, x[0]), self._filter
        if len(H) == 1:
            inner.inv, inner.R = np.reciprocal, variances[:, np.newaxis]
            # Plain numbers: filterpy keeps a deep copy of the measurement, and of them that costs nothing.
            inner.update(z.item() - expected.item() + straight.item(), H=H)
            y = inner.y.item()
            return np.array([y * y * inner.SI.item()])
        inner.inv, inner.R = np.linalg.inv, np.diag(variances)
        inner.update(z[0] - expected + straight, H=H)
        return np.array([inner.y @ inner.SI @ inner.y])
