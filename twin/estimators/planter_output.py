"""What a planter filter reports: pose, speed and yaw rate of the machine, and speed and place of every row unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

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
    row_position,
    row_speed,
)

STATE_COLUMNS = (POSITION[0], POSITION[1], SPEED, HEADING, YAW_RATE)
STANDSTILL = "standstill"
"""Diagnostic: 1 where the machine (distributed: the unit nearest the reference) is taken to stand, else 0."""


class PlanterOutput:
    """Columns ``STATE_COLUMNS``, all row speeds, all row places (east, north by row), ``standstill``.

    Every point is served by the filter whose origin is nearest to it, the first of equals; sigmas follow from that
    filter's covariance by rigid-body transport.
    """

    def __init__(self, *, rows_y_m: Sequence[float], origins_left_m: Sequence[float]) -> None:
        origins = np.asarray(origins_left_m, dtype=np.float64)
        numbers = range(1, len(rows_y_m) + 1)
        self.columns: tuple[str, ...] = (
            *STATE_COLUMNS,
            *(row_speed(number) for number in numbers),
            *(name for number in numbers for name in row_position(number)),
            STANDSTILL,
        )
        self._reference = int(np.argmin(np.abs(origins)))
        self._reference_left_m = float(-origins[self._reference])
        nearest = [int(np.argmin(np.abs(origins - y))) for y in rows_y_m]
        self._served: list[_Rows] = []
        for server, rows in groupby(range(len(rows_y_m)), key=nearest.__getitem__):
            block = list(rows)
            first_place = STATES + len(rows_y_m) + 2 * block[0]
            self._served.append(
                _Rows(
                    server=server,
                    left_m=np.asarray(rows_y_m, dtype=np.float64)[block] - origins[server],
                    speed=slice(STATES + block[0], STATES + block[-1] + 1),
                    east=slice(first_place, first_place + 2 * len(block), 2),
                    north=slice(first_place + 1, first_place + 2 * len(block), 2),
                )
            )

    def estimate(
        self, t_ns: int, states: Sequence[tuple[FloatArray, FloatArray]], standing: Sequence[BoolArray]
    ) -> Estimate:
        """Report the filters' states (R, 5) and covariances (R, 5, 5), one pair per origin."""
        x, P = transport(*states[self._reference], self._reference_left_m)
        values = np.empty((len(x), len(self.columns)))
        variances = np.empty_like(values)
        values[:, :STATES] = x
        values[:, PHI] = wrap_angle(x[:, PHI])
        variances[:, :STATES] = np.einsum("rii->ri", P)
        for rows in self._served:
            _fill_rows(values, variances, rows, *states[rows.server])
        values[:, -1] = standing[self._reference]
        variances[:, -1] = np.nan
        # Rounding may leave a perfectly known speed at -1e-40.
        return Estimate(t_ns=t_ns, values=values, sigmas=np.sqrt(np.maximum(variances, 0.0)), covariance=P)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """Neighbouring rows that one filter serves, and their columns."""

    server: int
    left_m: FloatArray
    speed: slice
    east: slice
    north: slice


def _fill_rows(values: FloatArray, variances: FloatArray, rows: _Rows, x: FloatArray, P: FloatArray) -> None:
    """Eqs 2.10 to 2.12 for the rows to the left of the origin, and their variances."""
    left = rows.left_m
    state, covariance = x[:, :, np.newaxis], P[:, :, :, np.newaxis]
    forward_e, forward_n = left * np.cos(state[:, PHI]), left * np.sin(state[:, PHI])
    values[:, rows.speed] = state[:, S] - left * state[:, OMEGA]
    values[:, rows.east] = state[:, E] - forward_n
    values[:, rows.north] = state[:, N] + forward_e
    for columns, of, by, lever in (
        (rows.speed, S, OMEGA, left),
        (rows.east, E, PHI, forward_e),
        (rows.north, N, PHI, forward_n),
    ):
        variances[:, columns] = covariance[:, of, of] + lever * (
            lever * covariance[:, by, by] - 2.0 * covariance[:, of, by]
        )
