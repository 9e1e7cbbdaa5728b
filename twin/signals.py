"""The vocabulary that world, sensors, estimators and control share.

Everything that is recorded is a *stream*: rows in time of named scalar **columns**. A column's name carries its unit
(``position_e_m``, ``heading_rad``, ``row_speed_1_m_s``). Scoring and pictures match an estimate to the truth by
column name, so an estimator that estimates a thing gives it the column name the truth has. Columns whose name the
truth does not have (innovations, modes) are recorded but not scored.

Frames, units and time follow one convention: local ENU world, FLU body, SI and radians, integer nanoseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from twin.geometry import Path

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

NS_PER_S = 1_000_000_000


def seconds(t_ns: int) -> float:
    """Integer nanoseconds as seconds."""
    return t_ns / NS_PER_S


def nanoseconds(t_s: float) -> int:
    """Seconds as the nearest integer nanosecond."""
    return round(t_s * NS_PER_S)


# --- named quantities ------------------------------------------------------------------------------------------------

POSITION = ("position_e_m", "position_n_m", "position_u_m")
VELOCITY = ("velocity_e_m_s", "velocity_n_m_s", "velocity_u_m_s")
HEADING = "heading_rad"
SPEED = "speed_m_s"
YAW_RATE = "yaw_rate_rad_s"
LANE_OFFSET = "lane_offset_m"
"""Of the point that a driver steers by, from the axis of its lane; positive to the left."""
LANE_HEADING = "lane_heading_rad"
"""Of the machine against the axis of its lane; positive to the left."""
ROWS_SEEN = "rows_seen"
"""Rows of trees that are seen now: 0, 1 or 2."""
SIGN_SEEN, SIGN_RANGE, SIGN_BEARING = "sign_seen", "sign_range_m", "sign_bearing_rad"
"""Whether a stop sign is seen (0 or 1), how far it is, and where to, positive to the left."""
HEIGHT = "height_m"
"""Of the reference frame (a blade's edge, the plate of a bench) above the design plane."""
STROKE = "stroke_m"
"""Of the slide that raises and lowers the reference frame, in the slide's own coordinate."""
CLEARANCE = "clearance_m"
"""From the machine's outline to the nearest trunk; zero or less where they touch."""

LEVEL_WITHIN_M = 0.030
"""Ground, and an implement that makes it, counts as level within this (TD/T 1033-2012, as paper 002 cites it)."""

COLLISION = "collision"
"""Why a run ended in which the machine touched a tree."""

_WRAPPING = frozenset({HEADING, LANE_HEADING, "course_rad", "roll_rad", "pitch_rad"})


def row_speed(row: int) -> str:
    """Column of the forward speed of row unit ``row`` (counted from 1, the leftmost), m/s."""
    return f"row_speed_{row}_m_s"


def row_position(row: int) -> tuple[str, str]:
    """Columns of the east and north position of row unit ``row`` (counted from 1, the leftmost), m."""
    return f"row_{row}_e_m", f"row_{row}_n_m"


def sigma_column(column: str) -> str:
    """Column holding one standard deviation of ``column`` in an estimate."""
    return f"{column}.sigma"


def wraps(column: str) -> bool:
    """Tell whether differences of this column have to be wrapped into (-pi, pi]."""
    return column in _WRAPPING


# --- where things sit ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """A fixed pose on a rigid body of the machine.

    ``body`` is a link of the machine; ``xyz_m`` lies in that link's frame (FLU, origin at the link frame's origin);
    ``rpy_rad`` turns body axes into the mount's axes.
    """

    body: str
    xyz_m: tuple[float, float, float]
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)


# --- what a sensor asks the world for, and gets ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionNeed:
    """A sensor needs the motion of its mount, averaged over its sample interval."""

    mount: Mount


@dataclass(frozen=True, slots=True, kw_only=True)
class MountMotion:
    """Motion of a mount at the end of one sample interval, and its means over that interval.

    The means over ``interval_s`` are exact averages of what happened at the physics rate (delta-velocity and
    delta-angle over the interval), so that vibration does not alias into a slower sensor.
    """

    t_ns: int
    """End of the interval."""
    interval_s: float
    position_enu_m: FloatArray
    """(3,) at ``t_ns``."""
    rotation: FloatArray
    """(3, 3) mount to world at ``t_ns``."""
    velocity_enu_m_s: FloatArray
    """(3,) at ``t_ns``."""
    mean_velocity_enu_m_s: FloatArray
    """(3,) displacement over the interval divided by the interval."""
    mean_specific_force_m_s2: FloatArray
    """(3,) mean of R^T (a - g) in mount axes: what an ideal accelerometer integrates. At rest +g on the up axis."""
    mean_rate_rad_s: FloatArray
    """(3,) mean angular rate in mount axes: what an ideal gyroscope integrates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointNeed:
    """A sensor needs the angles of hinges or the strokes of slides, as an encoder or a displacement transducer does."""

    mount: Mount
    joints: tuple[str, ...]
    """Joints of the machine."""
    slides: bool = False
    """Whether they have to be slides; if not, they have to be hinges."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointMotion:
    """Angles of hinges and strokes of slides at one instant."""

    t_ns: int
    position_enu_m: FloatArray
    """(3,) of the mount."""
    position: FloatArray
    """(J,) in the order of the need, rad of a hinge, m of a slide; turns are counted, so that an angle grows beyond
    pi."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MagneticNeed:
    """A sensor needs the magnetic field at its mount."""

    mount: Mount


@dataclass(frozen=True, slots=True, kw_only=True)
class MagneticField:
    """Magnetic field at a mount at one instant: the earth's and that of all that lies in the world."""

    t_ns: int
    position_enu_m: FloatArray
    """(3,) of the mount."""
    field_ut: FloatArray
    """(3,) flux density in mount axes. What moves with the machine (hard iron) is the sensor's own affair."""
    motor_current_a: float
    """Current that the machine's motors draw together; zero where there are none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RayNeed:
    """A sensor needs to know how far beams of light go from its mount, sent one after the other by a turning head."""

    mount: Mount
    bearings_rad: tuple[float, ...]
    """Of the beams in the order in which they are sent, counter-clockwise from the mount's x axis in its x-y plane."""
    reach_m: float
    """Nothing farther is looked for."""
    sweep_s: float
    """Time from the first beam to the last, which is sent when the sensor samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RayScan:
    """How far beams went."""

    t_ns: int
    """When the last was sent."""
    position_enu_m: FloatArray
    """(3,) of the mount then."""
    distance_m: FloatArray
    """(n,) infinite where a beam met nothing within its reach."""
    illuminance_lux: float
    """How bright it was."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageNeed:
    """A sensor needs a picture of what is seen from its mount along the mount's x axis, z upwards."""

    mount: Mount
    width_px: int
    height_px: int
    horizontal_fov_rad: float
    """Field of view from the left edge to the right; pixels are square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """What is seen at one instant, as an ideal camera shows it."""

    t_ns: int
    position_enu_m: FloatArray
    """(3,) of the mount."""
    rgb: NDArray[np.uint8]
    """(height, width, 3), evenly exposed however bright it is."""
    illuminance_lux: float
    """How bright it was."""
    sign_xyz_m: FloatArray
    """(3,) middle of the nearest stop sign whose front faces the mount, in mount axes; NaN if there is none. It is
    said whether the sign is in the picture or not: for the record, not to be measured."""


Need = MotionNeed | JointNeed | MagneticNeed | RayNeed | ImageNeed
"""What a sensor may ask for; a new kind is answered by :mod:`twin.world.watch`."""
Capture = MountMotion | JointMotion | MagneticField | RayScan | Picture


# --- what sensors give -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """One sample of one sensor for the R runs of an ensemble (an ordinary run is R = 1).

    ``t_ns`` is when the sensor says it was true (a sensor clock may be wrong), ``t_available_ns`` when it arrived.
    Estimators receive measurements in order of arrival; late, repeated and out-of-order samples are normal input.
    """

    sensor: str
    t_ns: int
    t_available_ns: int
    columns: tuple[str, ...]
    values: FloatArray
    """(R, n), one value per column; NaN where the sensor gave none."""
    valid: BoolArray
    """(R,) False where the whole sample was lost in that run."""

    @property
    def t(self) -> float:
        """Time of validity, s."""
        return self.t_ns / NS_PER_S

    @property
    def t_available(self) -> float:
        """Time of arrival, s."""
        return self.t_available_ns / NS_PER_S

    def column(self, name: str) -> FloatArray:
        """Values of one column, shape (R,)."""
        return self.values[:, self.columns.index(name)]


# --- what anybody can look up -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class EarthField:
    """The earth's magnetic field at a place, as a model of it (IGRF, WMM) tells anybody; angles in rad."""

    strength_ut: float = 46.0
    inclination_rad: float = math.radians(56.0)
    """Downwards positive."""
    declination_rad: float = math.radians(5.0)
    """Of magnetic north from true north, eastwards positive."""

    @property
    def enu_ut(self) -> FloatArray:
        """(3,) east, north, up."""
        level = self.strength_ut * math.cos(self.inclination_rad)
        east, north = level * math.sin(self.declination_rad), level * math.cos(self.declination_rad)
        return np.array([east, north, -self.strength_ut * math.sin(self.inclination_rad)])


# --- what estimators give --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorInfo:
    """What the machine's owner knows of one sensor: where it sits, its rate and its data sheet."""

    name: str
    kind: str
    columns: tuple[str, ...]
    mount: Mount
    rate_hz: float
    datasheet: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorSetup:
    """What an estimator is told before the run: never the simulator's drawn errors."""

    name: str
    runs: int
    """R, the length of the ensemble axis."""
    sensors: Mapping[str, SensorInfo]
    """The sensors this estimator listens to."""
    reference: Mount
    """The frame whose position, heading and speed the truth columns mean."""
    rows_y_m: tuple[float, ...]
    """Lateral positions of the row units in the reference frame, row 1 (leftmost, largest y) first."""
    start_e_n_heading: tuple[float, float, float]
    """Nominal start pose of the reference frame (east m, north m, heading rad), as set out by the owner."""
    earth_field: EarthField = EarthField()
    """The undisturbed magnetic field where the machine works."""
    design_height_m: float = 0.0
    """Up coordinate of the level plane above which heights are told."""
    wheelbase_m: float = 0.0
    """Of the machine that carries it; zero where nothing steers."""
    wheel_radius_m: float = 0.0
    """Rolling radius of the wheels of its rear axle; zero where nobody tells."""
    track_m: float = 0.0
    """Between these wheels; zero where nobody tells."""
    reference_x_m: float = 0.0
    """How far before the middle of the rear axle the reference frame is, with every joint at zero."""
    planned_path: Path | None = None
    """What the driver means to drive, for the middle of the axle that does not steer; None where nothing is planned."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """State of knowledge at ``t_ns`` for R runs.

    ``values`` and ``sigmas`` have shape (R, n) and follow the estimator's ``columns``; a sigma is one standard
    deviation, NaN where the estimator claims none. ``covariance`` is (R, m, m) over the estimator's
    ``state_columns``, or None.
    """

    t_ns: int
    values: FloatArray
    sigmas: FloatArray
    covariance: FloatArray | None = None


class Estimator(Protocol):
    """What the run needs of an estimator."""

    columns: tuple[str, ...]
    state_columns: tuple[str, ...]

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``, after all that arrived until then."""


@runtime_checkable
class Smoother(Estimator, Protocol):
    """An estimator that may say what counts only after the run, when it knows the future too."""

    @property
    def says_in_hindsight(self) -> bool:
        """Whether it does; if not, it is an ordinary estimator."""

    def hindsight(self) -> Iterator[Estimate]:
        """Estimates for every time it was asked for, in order; once, after the run."""


# --- what drives the machine -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """What a driver or controller asks of the machine; each machine takes what it has."""

    speed_m_s: float = 0.0
    """Wanted forward speed."""
    steering_rad: float = 0.0
    """Wanted steering angle of the equivalent single front wheel, positive to the left: for a machine that steers."""
    yaw_rate_rad_s: float = 0.0
    """Wanted rate of turn, positive to the left: for a machine that turns by the difference of its wheels' speeds."""
    brake: bool = False
    """Hold the parking brake."""
    raised: bool = False
    """The driver wants the implement out of the ground."""
    lift_m_s: float = 0.0
    """Wanted speed of the implement's lift, positive upwards: for a machine that has one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleState:
    """What a driver sees: pose of the middle of the rear axle, its forward speed, the steering angle."""

    east_m: float
    north_m: float
    heading_rad: float
    speed_m_s: float
    steering_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """Whom a controller listens to; whoever listens to anybody closes a loop, and the world differs from run to run."""

    estimators: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    truth: bool = True
    """Whether it sees the machine as it is, too."""

    @property
    def closes_loop(self) -> bool:
        """Whether what the machine does depends on what was measured."""
        return bool(self.estimators or self.sensors)

    def __or__(self, other: Listening) -> Listening:
        """Whom two controllers listen to together; what each of them knows is still its own."""
        return Listening(
            estimators=tuple(dict.fromkeys((*self.estimators, *other.estimators))),
            sensors=tuple(dict.fromkeys((*self.sensors, *other.sensors))),
            truth=self.truth or other.truth,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """What an estimator or a sensor said last, in one run."""

    t_ns: int
    """When it was true."""
    values: Mapping[str, float]
    """By column; of an estimate also ``<column>.sigma``. NaN where it gave none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """What drivers and controllers go by at one moment."""

    t_ns: int
    vehicle: VehicleState | None = None
    """What is to be seen from the seat, which is the truth; None where nobody follows it."""
    implement: Said | None = None
    """True height, vertical speed and stroke of the implement, by column; None for whoever does not see them."""
    load_share: float = 0.0
    """How full the blade looks from the seat, roughly and late: the soil it carries over the most that it holds.
    Whoever holds it sees that, whatever else is known of it."""
    said: Mapping[str, Said] = field(default_factory=dict)
    """Latest estimate by estimator, of those that have spoken."""
    measured: Mapping[str, Said] = field(default_factory=dict)
    """Latest sample by sensor, of those from which one has arrived."""

    @property
    def seen_from_the_seat(self) -> VehicleState:
        """The vehicle as a driver sees it who follows the truth."""
        if self.vehicle is None:
            raise ValueError("nobody sits in this machine")
        return self.vehicle

    @property
    def seen_of_implement(self) -> Said:
        """The implement as somebody sees it who follows the truth."""
        if self.implement is None:
            raise ValueError("nobody looks at the implement, or there is none")
        return self.implement


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something worth a line in the log: a segment begins, a fault begins, a gate closes."""

    t_ns: int
    source: str
    """Who says so, e.g. ``driver``, ``sensors.gnss``, ``estimators.central``."""
    level: str
    """``info``, ``warning`` or ``error``."""
    text: str
