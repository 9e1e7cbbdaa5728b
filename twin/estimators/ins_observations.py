"""What the sensors, and the machine itself, tell of the strapdown state (:mod:`twin.estimators.ins_model`).

Each implements :class:`twin.estimators.engines.Observation`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.estimators.ins_model import BG, ROLL, SLIP, VX, VY, VZ, YAW, E, ReceiverModel, horizontal
from twin.signals import FloatArray


class StatesThemselves:
    """Some states are measured as they are: a lagged speed, a lagged velocity."""

    def __init__(self, places: Sequence[int], variances: Sequence[float], *, size: int) -> None:
        self.R: FloatArray = np.array(variances, dtype=np.float64)
        self._places = list(places)
        self._H: FloatArray = np.zeros((len(self._places), size))
        self._H[np.arange(len(self._places)), self._places] = 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected measurement (R, m)."""
        return x[:, self._places]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (m, n)."""
        return self._H


class AntennaFix:
    """East and north of an antenna: the reference point, the lever arm turned by the attitude, the correlated error."""

    def __init__(self, receiver: ReceiverModel, *, size: int) -> None:
        self.R: FloatArray = np.ones(2)
        self._arm = np.array(receiver.arm_m)
        self._error = receiver.at + 2
        self._size = size

    def h(self, x: FloatArray) -> FloatArray:
        """Expected position (R, 2)."""
        arm = horizontal(np.broadcast_to(self._arm, (len(x), 3)), x[:, ROLL : YAW + 1])[0]
        expected: FloatArray = x[:, :2] + arm + x[:, self._error : self._error + 2]
        return expected

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian (R, 2, n)."""
        jacobian = np.zeros((len(x), 2, self._size))
        jacobian[:, :, ROLL : YAW + 1] = horizontal(np.broadcast_to(self._arm, (len(x), 3)), x[:, ROLL : YAW + 1])[2]
        for axis in range(2):
            jacobian[:, axis, E + axis] = jacobian[:, axis, self._error + axis] = 1.0
        return jacobian


class NoSlip:
    """A wheeled machine moves where its wheels point: at the axle, sideways as far as it slips, up not at all.

    0 = v_y + (w x r)_y - beta and 0 = v_z + (w x r)_z with r the axle's middle. ``rate`` (R, 3) is set before use.
    """

    def __init__(self, variances: tuple[float, float], *, axle_m: tuple[float, float, float], size: int) -> None:
        self.R: FloatArray = np.array(variances)
        self.rate: FloatArray = np.zeros((1, 3))
        self._axle = axle_m
        self._H: FloatArray = np.zeros((2, size))
        self._H[0, VY] = self._H[1, VZ] = 1.0
        self._H[0, SLIP] = -1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Velocity of the axle that should be zero (R, 2)."""
        forward, left, up = self._axle
        w = self.rate
        sideways = x[:, VY] + w[:, 2] * forward - w[:, 0] * up - x[:, SLIP]
        upwards = x[:, VZ] + w[:, 0] * left - w[:, 1] * forward
        return np.stack([sideways, upwards], axis=-1)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (2, n); the rate is taken as known."""
        return self._H


class Standing:
    """The machine stands: its velocity is zero and the gyroscopes read their biases."""

    def __init__(self, *, speed_variance: float, size: int) -> None:
        self.R: FloatArray = np.array([speed_variance] * 3 + [1.0] * 3)
        self._H: FloatArray = np.zeros((6, size))
        for axis in range(3):
            self._H[axis, VX + axis] = self._H[3 + axis, BG + axis] = 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Velocity and gyroscope bias (R, 6)."""
        return np.concatenate([x[:, VX : VZ + 1], x[:, BG : BG + 3]], axis=1)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (6, n)."""
        return self._H
