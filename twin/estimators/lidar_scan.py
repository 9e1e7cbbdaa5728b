"""How the estimators read a turning lidar: beams with their bearings and ages, and trunks among them.

Beam k of n is sent at the bearing 2 pi k / n, counter-clockwise from the mount's x axis, and (1 - (k + 1) / n) of a
turn before the scan's own time, which is that of its last beam.

A **trunk** is a run of beams next to one another (a few may be lost between them) of much the same range. A beam that
meets a disc of radius R anywhere is stopped pi R / 4 before the disc's middle on average, so the centre lies that much
beyond the mean range. What is wider than two trunks is none: the ground that a tilted scan meets, a wall.

Errors of a centre: along the beam sigma(range) / sqrt(n) for n beams. Across it, the middle of the beams that hit is
off by up to half a beam's spacing D: uniform over D where whole spacings fit the trunk, over D/2 where half ones do;
over all widths the variance is D^2 / 24.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.config import Config, NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.roles import lever_arm
from twin.geometry import rotation_from_rpy, rpy_from_rotation
from twin.signals import BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement, SensorInfo

LIDAR = "lidar"
_LEVEL_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarSheet:
    """What the owner knows of the lidar and its mount."""

    name: str
    bearings_rad: FloatArray
    """(n,) of the beams in the reference frame, counter-clockwise from ahead, not wrapped."""
    ages_s: FloatArray
    """(n,) how long before the scan's time each beam was sent."""
    forward_m: float
    """Of the mount, ahead of the reference point."""
    left_m: float
    """Of the mount, to the left of the reference point."""
    period_s: float
    max_range_m: float
    near_to_m: float
    near_noise_m: float
    far_noise_ratio: float
    bias_ratio: float
    """Constant error of a unit as a share of the range, beyond ``near_to_m``."""

    @classmethod
    def of(cls, info: SensorInfo, setup: EstimatorSetup) -> LidarSheet:
        """Read the data sheet and the mount.

        Raises:
            BadInputError: the lidar does not turn about the machine's upward axis, or sits on another body.
        """
        forward, left = lever_arm(info, setup)
        turn = rotation_from_rpy(*setup.reference.rpy_rad).T @ rotation_from_rpy(*info.mount.rpy_rad)
        roll, pitch, yaw = (float(angle) for angle in rpy_from_rotation(turn))
        if max(abs(roll), abs(pitch)) > _LEVEL_RAD:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors: {info.name!r} is mounted with roll {math.degrees(roll):.3g} and"
                f" pitch {math.degrees(pitch):.3g} deg; a lidar that sees trees all round has to be level"
            )
        beams = len(info.columns)
        places, sheet = np.arange(beams), info.datasheet
        return cls(
            name=info.name,
            bearings_rad=np.asarray(2.0 * np.pi / beams * places + yaw, dtype=np.float64),
            ages_s=(1.0 - (places + 1) / beams) / info.rate_hz,
            forward_m=forward,
            left_m=left,
            period_s=1.0 / info.rate_hz,
            max_range_m=sheet.get("max_range_m", math.inf),
            near_to_m=sheet.get("near_to_m", 0.0),
            near_noise_m=sheet.get("near_noise_m", 0.0),
            far_noise_ratio=sheet.get("far_noise_ratio", 0.0),
            bias_ratio=sheet.get("far_bias_ratio", 0.0),
        )

    @property
    def spacing_rad(self) -> float:
        """From beam to beam."""
        return 2.0 * math.pi / len(self.bearings_rad)

    def noise_m(self, range_m: FloatArray) -> FloatArray:
        """Standard deviation of a single range."""
        return np.where(range_m < self.near_to_m, self.near_noise_m, self.far_noise_ratio * range_m)


def the_lidar(setup: EstimatorSetup, infos: list[SensorInfo], *, kind: str) -> LidarSheet:
    """The one lidar of an estimator.

    Raises:
        BadInputError: there is none, or there are several.
    """
    if len(infos) != 1:
        raise BadInputError(f"[estimators.{setup.name}] sensors: {kind} takes one of kind {LIDAR!r}, not {len(infos)}")
    return LidarSheet.of(infos[0], setup)


def ranges_of(measurement: Measurement) -> FloatArray:
    """Ranges (R, n) of a scan; NaN where a beam, or a member's whole scan, was lost."""
    return np.where(measurement.valid[:, np.newaxis], measurement.values, np.nan)


class TrunkConfig(Config):
    """What a trunk looks like."""

    radius_m: Positive = 0.05
    """Mean radius of the trunks."""
    min_beams: Literal[1, 2, 3, 4, 5] = 2
    """Beams that have to hit one; a single one may be a wrong spot."""
    lost_between: Literal[0, 1, 2, 3] = 1
    """Beams that may be lost between two that hit the same trunk."""
    reach_share: NonNegative = 0.85
    """Share of the lidar's range within which trunks are looked for: farther out the range's end cuts their noise."""


@dataclass(frozen=True, slots=True)
class Trunks:
    """Trunks of one scan, (R, M) each; places beyond a member's own count hold zeros and are not ``there``."""

    there: BoolArray
    range_m: FloatArray
    """From the lidar to the trunk's centre."""
    bearing_rad: FloatArray
    """In the reference frame, counter-clockwise from ahead."""
    age_s: FloatArray
    """Before the scan's own time."""
    beams: FloatArray
    along_sigma_m: FloatArray
    """Error of the centre along the beam."""
    across_sigma_m: FloatArray
    """Error of the centre across it."""


def find_trunks(ranges_m: FloatArray, sheet: LidarSheet, config: TrunkConfig) -> Trunks:
    """Trunks in a scan (R, n) with NaN where a beam gave nothing."""
    runs = len(ranges_m)
    reach = config.reach_share * sheet.max_range_m
    member, beam = np.nonzero(ranges_m < reach)  # in order of member, then beam; NaN is not less
    if len(member) == 0:
        return _padded(runs, np.zeros(0, dtype=np.int64), [np.zeros(0)] * 6)
    distance = ranges_m[member, beam]
    jump = 2.0 * config.radius_m + 3.0 * math.sqrt(2.0) * sheet.noise_m(distance)
    parted = (np.diff(member) != 0) | (np.diff(beam) > 1 + config.lost_between)
    parted |= np.abs(np.diff(distance)) > jump[1:]
    first = np.concatenate([[0], 1 + np.flatnonzero(parted)])
    count = np.diff(np.append(first, len(member)))
    mean = np.add.reduceat(distance, first) / count
    angle = np.add.reduceat(sheet.bearings_rad[beam], first) / count
    age = np.add.reduceat(sheet.ages_s[beam], first) / count
    width = mean * (beam[first + count - 1] - beam[first]) * sheet.spacing_rad
    trunk = (count >= config.min_beams) & (width <= 4.0 * config.radius_m + mean * sheet.spacing_rad)
    along = sheet.noise_m(mean) / np.sqrt(count)
    across = mean * sheet.spacing_rad / math.sqrt(24.0)
    centre = mean + 0.25 * math.pi * config.radius_m
    parts = [centre, angle, age, count.astype(np.float64), along, across]
    return _padded(runs, member[first][trunk], [part[trunk] for part in parts])


def _padded(runs: int, member: NDArray[np.int64] | IntArray, parts: list[FloatArray]) -> Trunks:
    """Lay values of the trunks, in order of their members, out as (R, M)."""
    counts = np.bincount(member, minlength=runs)
    place = np.arange(len(member)) - np.repeat(np.cumsum(counts) - counts, counts)
    shape = (runs, int(counts.max(initial=0)))
    there = np.zeros(shape, dtype=np.bool_)
    there[member, place] = True
    laid: list[FloatArray] = []
    for part in parts:
        array = np.zeros(shape)
        array[member, place] = part
        laid.append(array)
    return Trunks(there, *laid)
