"""Magnets and iron of a scene: where they lie, when they are there, and how far they are felt."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.signals import FloatArray, IntArray
from twin.world.magnetics import dipole_field_ut

FELT_SHARE, STRONG_SHARE = 0.1, 0.5
"""Of the earth's field: from the one on a disturbance counts (it is also the limit of our heading filter's detector),
from the other on it turns any compass."""
MU0_4PI_UT = 0.1
"""mu_0 / (4 pi), uT m^3 / (A m^2)."""
_RADII = 400


def _none(columns: int) -> FloatArray:
    return np.zeros((0, columns))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MagneticPieces:
    """K magnets and L pieces of iron."""

    magnets: FloatArray = field(default_factory=lambda: _none(4))
    """(K, 4) east, north, up and radius, m."""
    iron: FloatArray = field(default_factory=lambda: _none(4))
    """(L, 4) likewise."""
    moments_a_m2: FloatArray = field(default_factory=lambda: _none(3))
    """(K + L, 3) east, north, up: of the magnets at full strength, then what the earth induces in the iron."""
    share_t_ns: IntArray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    """(T,) times at which shares are known, T > 0; at others the time before counts."""
    shares: FloatArray = field(default_factory=lambda: np.zeros((1, 0)))
    """(T, K) share of each magnet's moment that is there."""
    earth_ut: float = 46.0
    """Strength of the earth's field."""

    def __post_init__(self) -> None:
        if self.shares.shape != (len(self.share_t_ns), len(self.magnets)) or not len(self.share_t_ns):
            raise ValueError(f"shares: expected one for each magnet at each time, got shape {self.shares.shape}")
        if len(self.moments_a_m2) != self.count:
            raise ValueError(f"moments_a_m2: expected {self.count}, got {len(self.moments_a_m2)}")

    @property
    def count(self) -> int:
        """How many pieces there are."""
        return len(self.magnets) + len(self.iron)

    @property
    def places(self) -> FloatArray:
        """(K + L, 4) of all pieces."""
        return np.concatenate([self.magnets, self.iron])

    def disturbance_ut(self, places_m: FloatArray, t_ns: IntArray) -> FloatArray:
        """Strength (N,) of what all pieces together add to the earth's field at places (N, 3) and times (N,)."""
        at = np.clip(np.searchsorted(self.share_t_ns, t_ns, side="right") - 1, 0, None)
        field_ut = np.zeros((len(places_m), 3))
        for index, (piece, moment) in enumerate(zip(self.places, self.moments_a_m2, strict=True)):
            share = self.shares[at, index] if index < len(self.magnets) else np.ones(len(at))
            radii = np.full(len(places_m), piece[3])
            field_ut += dipole_field_ut(places_m - piece[:3], share[:, np.newaxis] * moment, radii)
        strength: FloatArray = np.linalg.norm(field_ut, axis=1)
        return strength


def reach_m(
    moment_a_m2: FloatArray, *, radius_m: float, height_m: float, least_ut: float, azimuths_rad: FloatArray
) -> FloatArray:
    """How far off along the ground a dipole's field is still ``least_ut``, by azimuth (A,) -> (A,), 0 where nowhere.

    ``height_m`` is that of the dipole above the ground, ``moment_a_m2`` (3,) its moment, ``radius_m`` its own size.
    """
    strength = float(np.linalg.norm(moment_a_m2))
    # On its axis a dipole is strongest: 2 mu_0 m / (4 pi r^3).
    farthest = max((2.0 * MU0_4PI_UT * strength / least_ut) ** (1.0 / 3.0), 1e-6)
    radii = np.linspace(0.0, farthest, _RADII)
    azimuth, radius = np.meshgrid(azimuths_rad, radii, indexing="ij")
    offset = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(radius.shape, -height_m)], axis=-1)
    flat = offset.reshape(-1, 3)
    field_ut = dipole_field_ut(flat, np.tile(moment_a_m2, (len(flat), 1)), np.full(len(flat), radius_m))
    felt = (np.linalg.norm(field_ut, axis=1) >= least_ut).reshape(radius.shape)
    last = _RADII - 1 - np.argmax(felt[:, ::-1], axis=1)
    reach: FloatArray = np.where(felt.any(axis=1), radii[last], 0.0)
    return reach
