"""Two parallel rows of trees through the trunks of one scan: where the machine is between them, and which way it looks.

With the machine at the offset e (left of the lane's axis positive) and the heading psi against the axis, a trunk seen
at (x, y) in the machine's frame stands at

    Y = e + x sin(psi) + y cos(psi)

across the lane, and should stand at +h (left row) or -h (right row), half the lane's width from the axis. Residuals
of all trunks are made small over (e, psi, h); h is known to within ``width_sigma_m``, and what a unit's constant range
error makes of it. So one row alone still gives an offset, with a sigma that says so.

**Robust**: first every (e, psi) on a grid is tried and the one that explains most trunks is taken (a truncated sum of
squares: MSAC, Torr & Zisserman 2000, with all hypotheses instead of random ones, which needs no random numbers and
misses none). Then Gauss-Newton with Tukey's biweight. What stands between the rows, a suckering tree, ground or a wrong
spot, weighs nothing.

**Sigma** in two parts, which a filter has to treat differently: ``noise`` comes anew with every scan (range noise, the
spacing of the beams); ``standing`` stays as long as the same trees are in sight (trees beside their row, the width).
With weights W, design A and N = (A' W A + prior)^-1: noise = N A' W V W A N with V the variances of a scan's own
errors, and standing likewise with the trees' places, and the prior's own share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.config import Config, NonNegative, Positive
from twin.estimators.lidar_scan import Trunks
from twin.signals import BoolArray, FloatArray, IntArray

E, PSI, HALF = 0, 1, 2
_TUKEY, _GATE = 4.685, 3.5
_STEPS = 8
_GRID_E_M, _GRID_PSI_RAD = 0.04, np.deg2rad(1.5)


class RowsConfig(Config):
    """The rows as the owner knows them."""

    lane_width_m: Positive
    """From row to row."""
    width_sigma_m: NonNegative = 0.03
    """How well that is known."""
    crooked_m: Positive = 0.03
    """Standard deviation of a tree's place across its row."""
    search_heading_rad: Annotated[float, Field(gt=0.0, le=1.2)] = 0.6
    """Largest heading against the axis that is looked for."""
    search_offset_share: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.85
    """Largest offset that is looked for, as a share of half the lane's width."""
    min_trunks: Annotated[int, Field(ge=3, le=20)] = 4
    """Trunks that make a fit: through three that stand anywhere, rows can nearly always be laid."""
    min_hits: Annotated[int, Field(ge=0, le=1000)] = 16
    """Beams that have to hit those trunks, all together: wrong spots that happen to lie next to each other are two or
    three beams, so four such hits are no fit, however well they lie."""
    max_heading_sigma_rad: Positive = 0.06
    """A fit that knows the heading less well is none: trees too close together."""


@dataclass(frozen=True, slots=True)
class RowFit:
    """Result for R members; where not ``good`` the numbers mean nothing (but are finite)."""

    good: BoolArray
    offset_m: FloatArray
    heading_rad: FloatArray
    noise: FloatArray
    """(R, 2, 2) covariance of offset and heading by what every scan has anew."""
    standing: FloatArray
    """(R, 2, 2) covariance by what stays while the same trees are seen."""
    rows_seen: IntArray
    """(R,) rows of which at least two trunks were used; 0 without a fit."""
    trunks: IntArray
    """(R,) trunks used."""

    @property
    def covariance(self) -> FloatArray:
        """(R, 2, 2) of a single fit."""
        return self.noise + self.standing


@dataclass(frozen=True, slots=True)
class _Seen:
    """Trunks in the machine's frame (R, M)."""

    there: BoolArray
    x: FloatArray
    y: FloatArray
    along: FloatArray
    """(R, M) variance along the line of sight."""
    across: FloatArray
    bearing: FloatArray
    beams: FloatArray

    def variance(self, psi: FloatArray) -> FloatArray:
        """Variance across the lane of each, for headings that broadcast with (..., R, M)."""
        angle = self.bearing + psi
        found: FloatArray = np.sin(angle) ** 2 * self.along + np.cos(angle) ** 2 * self.across
        return found


class RowFitter:
    """Fits rows to trunks."""

    def __init__(self, config: RowsConfig, *, bias_ratio: float) -> None:
        self._config = config
        half = 0.5 * config.lane_width_m
        self._half_m = half
        self._half_variance = config.width_sigma_m**2 / 4.0 + (bias_ratio * half) ** 2 + 1e-8
        most = config.search_offset_share * half
        offsets = np.linspace(-most, most, 1 + 2 * int(np.ceil(most / _GRID_E_M)))
        most = config.search_heading_rad
        headings = np.linspace(-most, most, 1 + 2 * int(np.ceil(most / _GRID_PSI_RAD)))
        grid = np.meshgrid(offsets, headings, indexing="ij")
        self._grid: FloatArray = np.stack([each.ravel() for each in grid], axis=-1)
        """(G, 2) offsets and headings."""

    def fit(self, trunks: Trunks, x_m: FloatArray, y_m: FloatArray, near: FloatArray, near_sigma: FloatArray) -> RowFit:
        """Fit rows to trunks whose centres lie at ``x_m``, ``y_m`` (R, M) in the machine's frame.

        ``near`` and ``near_sigma`` (R, 2) are what offset and heading are expected to be, the sigmas infinite where
        nothing is: hypotheses far from it count less. The result itself does not lean on them.
        """
        runs = len(x_m)
        seen = _Seen(
            trunks.there, x_m, y_m, trunks.along_sigma_m**2, trunks.across_sigma_m**2, trunks.bearing_rad, trunks.beams
        )
        if x_m.shape[1] == 0:
            return _no_fit(runs)
        start = self._search(seen, near, near_sigma)
        p = np.concatenate([start, np.full((runs, 1), self._half_m)], axis=1)
        for step in range(_STEPS):
            residual, A, variance = self._linearise(seen, p)
            # The grid's spacing and an unknown width are forgiven at first.
            slack = 0.02 if step < _STEPS // 2 else 0.0
            u = residual / (_TUKEY * np.sqrt(variance + self._config.crooked_m**2 + slack**2))
            weight = np.where(seen.there & (np.abs(u) < 1.0), (1.0 - u * u) ** 2, 0.0)
            weight = weight / (variance + self._config.crooked_m**2)
            N, right = self._normal(A, weight, residual, p)
            p = p + np.linalg.solve(N, right[..., np.newaxis])[..., 0]
            p[:, PSI] = np.clip(p[:, PSI], -1.4, 1.4)
        return self._judge(seen, p)

    def _search(self, seen: _Seen, near: FloatArray, near_sigma: FloatArray) -> FloatArray:
        """Best hypothesis of each member, (R, 2)."""
        e, psi = (self._grid[:, part, np.newaxis, np.newaxis] for part in (E, PSI))
        across = e + np.sin(psi) * seen.x + np.cos(psi) * seen.y  # (G, R, M)
        off = np.abs(across) - self._half_m
        spread = self._config.crooked_m**2 + self._half_variance + (0.5 * _GRID_E_M) ** 2
        spread = spread + (0.5 * _GRID_PSI_RAD * seen.x) ** 2
        cost = np.minimum(off * off / (seen.variance(psi) + spread), _GATE**2)
        total = np.sum(np.where(seen.there, cost, 0.0), axis=-1)  # (G, R)
        far = (self._grid[:, np.newaxis, :] - near) / near_sigma
        total = total + np.minimum(np.sum(far * far, axis=-1), _GATE**2)
        found: FloatArray = self._grid[np.argmin(total, axis=0)]
        return found

    def _linearise(self, seen: _Seen, p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals (R, M), design (R, M, 3) and variances (R, M) at parameters (R, 3)."""
        e, psi, half = (p[:, part, np.newaxis] for part in (E, PSI, HALF))
        sine, cosine = np.sin(psi), np.cos(psi)
        across = e + sine * seen.x + cosine * seen.y
        side = np.where(across >= 0.0, 1.0, -1.0)
        residual = side * half - across
        A = np.stack([np.ones_like(across), cosine * seen.x - sine * seen.y, -side], axis=-1)
        return residual, A, seen.variance(psi)

    def _normal(
        self, A: FloatArray, weight: FloatArray, residual: FloatArray, p: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Normal matrix (R, 3, 3) and right side (R, 3), with the prior of h; of the rest only 1 m and 1 rad."""
        N = np.einsum("rmi,rm,rmj->rij", A, weight, A)
        right = np.einsum("rmi,rm,rm->ri", A, weight, residual)
        N[:, HALF, HALF] += 1.0 / self._half_variance
        right[:, HALF] += (self._half_m - p[:, HALF]) / self._half_variance
        N[:, E, E] += 1.0
        N[:, PSI, PSI] += 1.0
        return N, right

    def _judge(self, seen: _Seen, p: FloatArray) -> RowFit:
        """Covariances, and whether it is a fit at all."""
        config = self._config
        residual, A, variance = self._linearise(seen, p)
        total = variance + config.crooked_m**2
        used = seen.there & (residual * residual < _GATE**2 * total)
        weight = np.where(used, 1.0 / total, 0.0)
        N, _ = self._normal(A, weight, residual, p)
        P = np.linalg.inv(N)
        noise = P @ np.einsum("rmi,rm,rmj->rij", A, weight * weight * variance, A) @ P
        standing = P @ np.einsum("rmi,rm,rmj->rij", A, weight * weight * config.crooked_m**2, A) @ P
        standing = standing + P[:, :, HALF, np.newaxis] * P[:, np.newaxis, HALF, :] / self._half_variance
        left = used & (A[..., HALF] < 0.0)
        count = used.sum(axis=1)
        lefts = left.sum(axis=1)
        rows = (lefts >= 2).astype(np.int64) + (count - lefts >= 2)
        sigma = np.sqrt((noise + standing)[:, PSI, PSI])
        good = (count >= config.min_trunks) & (rows > 0) & (sigma < config.max_heading_sigma_rad)
        good &= np.abs(p[:, E]) < self._half_m
        good &= np.sum(np.where(used, seen.beams, 0.0), axis=1) >= config.min_hits
        return RowFit(
            good=good,
            offset_m=p[:, E],
            heading_rad=p[:, PSI],
            noise=noise[:, :HALF, :HALF],
            standing=standing[:, :HALF, :HALF],
            rows_seen=np.where(good, rows, 0),
            trunks=np.where(good, count, 0),
        )


def _no_fit(runs: int) -> RowFit:
    nothing, none = np.zeros(runs), np.zeros(runs, dtype=np.int64)
    blank = np.tile(np.eye(2), (runs, 1, 1))
    return RowFit(np.zeros(runs, dtype=np.bool_), nothing, nothing, blank, blank, none, none)
