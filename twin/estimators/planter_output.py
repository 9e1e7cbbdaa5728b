"""What a planter filter reports: pose, speed and yaw rate of the machine, and speed and place of every row unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.estimators.coordinated_turn import OMEGA, PHI, STATES, E, N, S, transport
from twin.geometry import wrap_angle
from twin.signals import (
    HEADING,
    POSITION,
    SPEED,
    YAW_RATE,
    BoolArray,
    Estimate,
    FloatArray,
    IntArray,
    row_position,
    row_speed,
)

STATE_COLUMNS = (POSITION[0], POSITION[1], SPEED, HEADING, YAW_RATE)
STANDSTILL = "standstill"
"""Diagnostic: 1 where the machine (distributed: the unit nearest the reference) is taken to stand, else 0."""

_PAIRS = (
    np.array([[E, N, S], [E, N, S], [PHI, PHI, OMEGA]]),
    np.array([[E, N, S], [PHI, PHI, OMEGA], [PHI, PHI, OMEGA]]),
)
"""Transport along the bar changes east and north through phi, the speed through omega: places in P of the variances of
the three, of their covariances with those states, and of those states' variances."""


def nis_column(innovation: str) -> str:
    """Diagnostic: normalised innovation squared of the last update of this name, NaN if none since the last row."""
    return f"nis_{innovation}"


class PlanterOutput:
    """Columns ``STATE_COLUMNS``, all row speeds, all row places (east, north by row), ``standstill``, the NIS columns.

    Every point is served by the filter whose origin is nearest to it, the first of equals; sigmas follow from that
    filter's covariance by rigid-body transport. The NIS is that of the filter nearest the reference.
    """

    def __init__(
        self, *, rows_y_m: Sequence[float], origins_left_m: Sequence[float], innovations: Sequence[str]
    ) -> None:
        origins = np.asarray(origins_left_m, dtype=np.float64)
        rows_left = np.asarray(rows_y_m, dtype=np.float64)
        count = len(rows_left)
        self.columns: tuple[str, ...] = (
            *STATE_COLUMNS,
            *(row_speed(number) for number in range(1, count + 1)),
            *(name for number in range(1, count + 1) for name in row_position(number)),
            STANDSTILL,
            *(nis_column(name) for name in innovations),
        )
        self._standstill = STATES + 3 * count
        self._reference = int(np.argmin(np.abs(origins)))
        self._reference_left_m = float(-origins[self._reference])
        nearest = np.array([np.argmin(np.abs(origins - y)) for y in rows_left], dtype=np.int64)
        east = STATES + count + 2 * np.arange(count)
        columns = np.stack([east, east + 1, STATES + np.arange(count)])
        self._served = [
            _Rows(
                server=server,
                left_m=(rows_left - origins[server])[nearest == server],
                columns=columns[:, nearest == server],
            )
            for server in range(len(origins))
        ]

    def estimate(
        self,
        t_ns: int,
        states: Sequence[tuple[FloatArray, FloatArray]],
        *,
        standing: Sequence[BoolArray],
        nis: Sequence[FloatArray],
    ) -> Estimate:
        """Report the filters' states (R, 5) and covariances (R, 5, 5), one pair per origin, ``nis`` (k, R) of each."""
        x, P = transport(*states[self._reference], self._reference_left_m)
        # Column by column: members lie next to each other, as in the filters.
        values = np.empty((len(self.columns), len(x)))
        variances = np.empty_like(values)
        values[:STATES] = x.T
        values[PHI] = wrap_angle(x[:, PHI])
        variances[:STATES] = np.einsum("rii->ir", P)
        for rows in self._served:
            rows.fill(values, variances, *states[rows.server])
        values[self._standstill] = standing[self._reference]
        values[self._standstill + 1 :] = nis[self._reference]
        variances[self._standstill :] = np.nan
        sigmas = np.maximum(variances, 0.0, out=variances)  # rounding may leave a perfectly known speed at -1e-40
        np.sqrt(sigmas, out=sigmas)
        return Estimate(t_ns=t_ns, values=values.T, sigmas=sigmas.T, covariance=P)


class _Rows:
    """The rows that one filter serves: eqs 2.10 to 2.12 for the points to the left of its origin, and their variances.

    East, north and speed of a row are those of the origin plus the way to the left times an arm, and depend through
    that on phi, phi and omega.
    """

    def __init__(self, *, server: int, left_m: FloatArray, columns: IntArray) -> None:
        self.server = server
        self._columns = columns
        """(3, rows): east, north, speed."""
        self._left = left_m[:, np.newaxis]

    def fill(self, values: FloatArray, variances: FloatArray, x: FloatArray, P: FloatArray) -> None:
        """Write into the columns (n, R) from a state (R, 5) and covariance (R, 5, 5)."""
        sine, cosine = np.sin(x[:, PHI]), np.cos(x[:, PHI])
        arm, slope = np.empty((3, 1, len(x))), np.empty((3, 1, len(x)))
        arm[0], arm[1], arm[2] = -sine, cosine, -x[:, OMEGA]
        slope[0], slope[1], slope[2] = -cosine, -sine, -1.0
        values[self._columns] = x.T[:3, np.newaxis] + self._left * arm
        own, cross, by = P.transpose(1, 2, 0)[_PAIRS][:, :, np.newaxis]
        # Terms that all rows share first, then those of each.
        variances[self._columns] = own + self._left * (2.0 * cross * slope + self._left * (by * slope * slope))
