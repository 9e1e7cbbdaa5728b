r"""Magnetic field of the world: the earth's, and magnets and iron that lie in it.

**Earth.** One uniform field, of given strength, inclination and declination. The defaults are those of Izmir, where
the robot of paper 001 was built: 46 uT, 56 degrees downwards, magnetic north 5 degrees east (World Magnetic Model 2020,
rounded).

**Magnets** are dipoles with a moment m (A m^2). At r from it, with its unit vector n,

    B = mu_0 / (4 pi r^3) (3 (m . n) n - m)

A magnet the size of a coin has about 1 A m^2: 25 uT across its axis at 0.16 m. It may come and go: from ``from_s`` its
strength rises over ``ramp_s`` as a raised cosine, and falls so before ``to_s``; with ``every_s`` it does so again and
again, as a magnet does that is swung past. A ramp given by two limits is drawn evenly between them, another in each
world.

**Soft iron** (posts, buried pipes, machines) is magnetised by the earth's field. A ball of radius a and relative
permeability mu disturbs a uniform field B_0 outside exactly as a dipole

    m = (4 pi a^3 / mu_0) (mu - 1) / (mu + 2) B_0

does (Jackson, Classical Electrodynamics, section 5.11). Pieces do not magnetise one another here, nor do magnets.

Nearer than its own radius a piece is felt as at its surface: inside a body the formula for outside does not hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, Strict, field_validator, model_validator

from twin.config import Config, NonNegative, Positive, Vector3
from twin.errors import BadInputError
from twin.randomness import world_generator
from twin.signals import EarthField, FloatArray
from twin.world.terrain import Terrain

_MU0_4PI_UT = 0.1
"""mu_0 / (4 pi) = 1e-7 T m / A, in uT m^3 / (A m^2)."""


Span = Annotated[tuple[NonNegative, NonNegative], Strict(strict=False)]


class _Piece(Config):
    east_m: float
    """East."""
    north_m: float
    """North."""
    height_m: float = 0.0
    """Above the ground there; negative where it is buried."""
    radius_m: Positive
    """Its own size."""


class MagnetConfig(_Piece):
    """A permanent magnet."""

    moment_a_m2: Vector3
    """Magnetic moment: east, north, up."""
    radius_m: Positive = 0.01
    """Its own size."""
    from_s: NonNegative = 0.0
    """It comes here."""
    to_s: Positive | None = None
    """It has gone here; without it, it stays."""
    ramp_s: NonNegative | Span = 0.0
    """How long its coming and its going take, each; or two limits between which each world draws it."""
    every_s: Positive | None = None
    """It comes and goes again after this time, counted from coming to coming."""

    @field_validator("ramp_s")
    @classmethod
    def _in_order(cls, value: float | tuple[float, float]) -> float | tuple[float, float]:
        if isinstance(value, tuple) and value[0] > value[1]:
            raise ValueError(f"[{value[0]:g}, {value[1]:g}]: the lower limit comes first")
        return value

    @model_validator(mode="after")
    def _fits_in_time(self) -> Self:
        if self.to_s is None:
            if self.every_s is not None:
                raise ValueError("every_s needs to_s: a magnet that stays does not come again")
            return self
        longest_s = self.ramp_s[1] if isinstance(self.ramp_s, tuple) else self.ramp_s
        if self.to_s - self.from_s < 2.0 * longest_s or self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:g} has to be later than from_s by two ramps of ramp_s or more")
        if self.every_s is not None and self.every_s < self.to_s - self.from_s:
            raise ValueError(f"every_s = {self.every_s:g} is shorter than it stays, {self.to_s - self.from_s:g} s")
        return self

    def in_world(self, seed: int, index: int) -> MagnetConfig:
        """The ``index``-th magnet as it is in the world of this seed: with one ramp."""
        if not isinstance(self.ramp_s, tuple):
            return self
        ramp_s = float(world_generator(seed, f"magnetics.magnets.{index}.ramp").uniform(*self.ramp_s))
        return self.model_copy(update={"ramp_s": ramp_s})

    def share(self, t_s: float) -> float:
        """Share of its moment that is there at a time, 0 to 1; its ramp has been drawn (:meth:`in_world`)."""
        assert not isinstance(self.ramp_s, tuple)
        since = t_s - self.from_s
        if since < 0.0:
            return 0.0
        if self.every_s is not None:
            since %= self.every_s
        left = math.inf if self.to_s is None else self.to_s - self.from_s - since
        if left <= 0.0:
            return 0.0
        nearest = min(since, left)
        return 1.0 if nearest >= self.ramp_s else 0.5 - 0.5 * math.cos(math.pi * nearest / self.ramp_s)


class IronConfig(_Piece):
    """A piece of soft iron, as a ball."""

    permeability: Annotated[float, Field(gt=1.0)] = 200.0
    """Relative; mild steel has some hundred, and the result hardly depends on it."""


class MagneticsConfig(Config):
    """The earth's field, and what disturbs it."""

    strength_ut: Annotated[float, Field(ge=0.0, le=100.0)] = 46.0
    """Of the earth's field."""
    inclination_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 56.0
    """Of the earth's field, downwards."""
    declination_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 5.0
    """Of magnetic north, eastwards from true north."""
    magnets: Annotated[tuple[MagnetConfig, ...], Strict(strict=False), Field(max_length=1000)] = ()
    """Permanent magnets."""
    iron: Annotated[tuple[IronConfig, ...], Strict(strict=False), Field(max_length=1000)] = ()
    """Pieces of soft iron."""

    @property
    def earth_field(self) -> EarthField:
        """The undisturbed field."""
        return EarthField(
            strength_ut=self.strength_ut,
            inclination_rad=math.radians(self.inclination_deg),
            declination_rad=math.radians(self.declination_deg),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Dipoles:
    places_m: FloatArray
    """(K, 3)."""
    moments_a_m2: FloatArray
    """(K, 3) at full strength."""
    radii_m: FloatArray
    """(K,)."""


class Magnetics:
    """The field at any place and time.

    Raises:
        BadInputError: a magnet or a piece of iron does not lie on the terrain.
    """

    def __init__(self, config: MagneticsConfig, terrain: Terrain, *, seed: int = 0) -> None:
        self._earth_ut = config.earth_field.enu_ut
        self._magnets = [magnet.in_world(seed, index) for index, magnet in enumerate(config.magnets)]
        pieces = (*config.magnets, *config.iron)
        induced = [_induced_moment(piece, self._earth_ut) for piece in config.iron]
        moments = [np.array(magnet.moment_a_m2) for magnet in config.magnets] + induced
        self._dipoles = _Dipoles(
            places_m=np.array(
                [_place(piece, terrain, f"magnetics.magnets.{k}") for k, piece in enumerate(config.magnets)]
                + [_place(piece, terrain, f"magnetics.iron.{k}") for k, piece in enumerate(config.iron)]
            ).reshape(-1, 3),
            moments_a_m2=np.array(moments).reshape(-1, 3),
            radii_m=np.array([piece.radius_m for piece in pieces]),
        )
        self._shares = np.ones(len(pieces))

    def field_ut(self, position_enu_m: FloatArray, t_s: float) -> FloatArray:
        """Flux density (3,) east, north, up at a place (3,) and time, uT."""
        dipoles = self._dipoles
        if not len(dipoles.radii_m):
            return self._earth_ut.copy()
        for index, magnet in enumerate(self._magnets):
            self._shares[index] = magnet.share(t_s)
        moments = dipoles.moments_a_m2 * self._shares[:, np.newaxis]
        disturbance = dipole_field_ut(position_enu_m - dipoles.places_m, moments, dipoles.radii_m)
        field: FloatArray = self._earth_ut + disturbance.sum(axis=0)
        return field


def dipole_field_ut(offset_m: FloatArray, moment_a_m2: FloatArray, radius_m: FloatArray) -> FloatArray:
    """Flux density (K, 3) of dipoles at ``offset_m`` (K, 3) from them, uT; no nearer than ``radius_m`` (K,)."""
    distance = np.linalg.norm(offset_m, axis=1)
    # At the very centre any direction will do.
    direction = np.where(distance[:, np.newaxis] > 0.0, offset_m, (0.0, 0.0, 1.0))
    direction = direction / np.where(distance > 0.0, distance, 1.0)[:, np.newaxis]
    felt_m = np.maximum(distance, radius_m)
    along = np.einsum("ki,ki->k", moment_a_m2, direction)[:, np.newaxis]
    field: FloatArray = _MU0_4PI_UT / felt_m[:, np.newaxis] ** 3 * (3.0 * along * direction - moment_a_m2)
    return field


def _induced_moment(piece: IronConfig, earth_ut: FloatArray) -> FloatArray:
    """Moment (3,) of a ball in the earth's field, A m^2."""
    ratio = (piece.permeability - 1.0) / (piece.permeability + 2.0)
    moment: FloatArray = piece.radius_m**3 / _MU0_4PI_UT * ratio * earth_ut
    return moment


def _place(piece: _Piece, terrain: Terrain, where: str) -> Sequence[float]:
    try:
        ground = terrain.height(piece.east_m, piece.north_m)
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error
    return piece.east_m, piece.north_m, ground + piece.height_m
