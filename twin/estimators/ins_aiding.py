"""What the strapdown filter makes of its aiding sensors' samples: models of the sensors, and readings of samples.

**Pulse sensors.** A radar's output lags (two time constants, by its data sheet); the filter follows the lagged speed as
a state and compares that. No pulses mean no speed above the sensor's minimum, and nothing more: a dead radar reads
the same. They are a cue of standstill, never a speed.

**GNSS.** A position errs by a time-correlated part, a state of the filter with the size that the fix state allows, and
a white part. A receiver's word is believed where such receivers are honest (a fixed solution), and not below a floor by
fix state where they are not: a floating solution reports millimetres and errs by decimetres. Corrections that get old
let the error grow (0.74 mm/s an axis). The units' mounting tilt turns the lever arm, which adds to the
correlated part. A change of the fix state is a new error. A sigma of zero or none means
that the receiver does not know it. Velocity is north and east, behind the receiver's own filter, with the noise of its
data sheet.

**Time.** A sample is about the time it is stamped with, if that can be: a stamp later than the arrival, or earlier by
more than the data sheet's latency and some, comes from a wrong clock. In the first case the time of arrival less the
latency is taken. In the second it may as well be late, and the position is believed less by the way covered meanwhile.
"""

from __future__ import annotations

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.estimators.ins_filter import AidReading, Receiving
from twin.estimators.ins_model import PulseSensorModel, ReceiverModel, lag_gain
from twin.estimators.ins_observations import AntennaFix, StatesThemselves
from twin.estimators.roles import ACCOSAT, POSITION_COLUMNS, SPEED_COLUMN, column_places, mount_arm, usable
from twin.fix_quality import DIFFERENTIAL, PPS, RTK_FIXED, RTK_FLOAT
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

_AGE_GROWTH_M_S = 0.00074
"""Growth of the horizontal error of a fixed solution with the age of its corrections, each axis (lefebure.com, RTK
accuracy against age of corrections)."""
_FRESH_S = 2.0
_PULSE_SIGMA_M_S = 0.0005
"""Reading of a pulse period of some 20 ms with a timer of 10 us: 0.2 per mille of the speed."""
_ACCOSAT_WHITE_M_S = 0.01
_WHITE_SHARE = 0.26
"""Share of a receiver's sigma that is new in every sample: 0.8 of 3.1 mm with the F9P's fixed solution."""
_LEAST_WHITE_M = 0.0005
_STAMP_SLACK_S = 0.15
_CHANGE_M_S2 = 0.5
"""How fast a farm machine changes its velocity: what a sample of a doubtful time may be off by."""


class ReceiverTrust(Config):
    """Least standard deviation, per axis, of a receiver's position error in each state of its fix, m.

    The defaults are those of the presets' sources: a F9P's float errs by 0.12 and 0.19 m about each stretch's mean and
    by up to 0.4 m in all, DGPS by 0.4 m, a single-point position by 0.8 m or more.
    """

    fix_m: NonNegative = 0.003
    float_m: NonNegative = 0.25
    differential_m: NonNegative = 0.5
    single_m: NonNegative = 1.0
    correlation_s: Positive = 200.0
    """1/e time of the position error."""

    def floor(self, quality: FloatArray) -> FloatArray:
        """By NMEA quality (R,)."""
        conditions = [
            quality == RTK_FIXED,
            quality == RTK_FLOAT,
            (quality == DIFFERENTIAL) | (quality == PPS),
        ]
        return np.select(conditions, [self.fix_m, self.float_m, self.differential_m], default=self.single_m)


class PulseAid:
    """A radar or AccoSat of R members.

    Raises:
        BadInputError: it gives no speed.
    """

    def __init__(
        self, info: SensorInfo, model: PulseSensorModel, observation: StatesThemselves, setup: EstimatorSetup, *,
        zero_is_speed: bool,
    ) -> None:  # fmt: skip
        self.model = model
        self.sources = self.speed_sources = (info.name,)
        self._place = column_places(info, (SPEED_COLUMN,), setup=setup)
        self._observation = observation
        self._zero_is_speed = zero_is_speed

    def read(self, measurement: Measurement) -> list[AidReading]:
        """The lagged speed, where there are pulses."""
        z = measurement.values[:, self._place]
        mask = usable(measurement, z)
        if not self._zero_is_speed:
            mask = mask & (z[:, 0] > 0.0)
        name = self.model.name
        return [
            AidReading(
                source=name, sensor=name, observation=self._observation, z=z, mask=mask,
                variances=np.broadcast_to(self._observation.R, z.shape), speed_source=True,
            )
        ]  # fmt: skip

    def slow(self, measurement: Measurement) -> tuple[BoolArray, BoolArray]:
        """Members in which it gives no pulses, and in which it says anything."""
        z = measurement.values[:, self._place]
        known = usable(measurement, z)
        return known & (z[:, 0] <= 0.0), known


class ReceiverAid:
    """A GNSS receiver of R members.

    Raises:
        BadInputError: it gives neither position nor velocity.
    """

    def __init__(
        self, info: SensorInfo, model: ReceiverModel, trust: ReceiverTrust, setup: EstimatorSetup, *, size: int,
        robust: bool, mounting_tilt_rad: float,
    ) -> None:  # fmt: skip
        self._arm_error_m = mounting_tilt_rad * float(np.linalg.norm(model.arm_m))
        self.model = model
        self.sources = (f"{info.name}_position", f"{info.name}_velocity")
        self.speed_sources = self.sources[1:]
        self._trust = trust
        self._robust = robust
        self._position = AntennaFix(model, size=size)
        self._velocity = StatesThemselves([model.at, model.at + 1], [1.0, 1.0], size=size)
        column_places(info, (*POSITION_COLUMNS, SPEED_COLUMN, "course_rad"), setup=setup)
        self._places = {name: index for index, name in enumerate(info.columns)}
        self._latency_s = info.datasheet.get("latency_s", 0.0)
        self._noise = info.datasheet.get("speed_noise_m_s", 0.05), info.datasheet.get("speed_noise_ratio", 0.0)
        self._sheet_sigma = info.datasheet.get("position_noise_m", trust.single_m)

    def _column(self, measurement: Measurement, name: str, default: float) -> FloatArray:
        place = self._places.get(name)
        if place is None:
            return np.full(len(measurement.values), default)
        values = measurement.values[:, place]
        return np.where(np.isfinite(values), values, np.nan)

    def time_ns(self, measurement: Measurement) -> tuple[int, float]:
        """What time the sample is about, and how much later than usual it came if its stamp is right, s."""
        late_s = (measurement.t_available_ns - measurement.t_ns) / NS_PER_S - self._latency_s
        if not self._robust:
            return min(measurement.t_ns, measurement.t_available_ns), 0.0
        if late_s < -self._latency_s:
            return measurement.t_available_ns - round(self._latency_s * NS_PER_S), 0.0
        return measurement.t_ns, late_s if late_s > _STAMP_SLACK_S else 0.0

    def read(self, measurement: Measurement, speed_m_s: FloatArray) -> list[AidReading]:
        """Velocity and position; ``speed_m_s`` (R,) is the filter's own speed."""
        name = self.model.name
        _, late_s = self.time_ns(measurement)
        speed, course = self._column(measurement, SPEED_COLUMN, np.nan), self._column(measurement, "course_rad", np.nan)
        velocity = np.stack([speed * np.cos(course), speed * np.sin(course)], axis=-1)
        still, ratio = self._noise
        velocity_variance = still**2 + (ratio * speed_m_s) ** 2 + (_CHANGE_M_S2 * late_s) ** 2
        position = np.stack([self._column(measurement, column, np.nan) for column in POSITION_COLUMNS], axis=-1)
        quality = self._column(measurement, "quality", float(RTK_FIXED))
        mask = usable(measurement, position) & (quality > 0.0)
        said, sigma = self._sigma(measurement, quality)
        white = np.maximum(_WHITE_SHARE * said, _LEAST_WHITE_M) ** 2
        sigma = np.hypot(sigma, speed_m_s * late_s)
        return [
            AidReading(
                source=f"{name}_velocity", sensor=name, observation=self._velocity, z=velocity,
                mask=usable(measurement, velocity), variances=np.stack([velocity_variance] * 2, axis=-1),
                speed_source=True,
            ),
            AidReading(
                source=f"{name}_position", sensor=name, observation=self._position, z=position, mask=mask,
                variances=np.stack([white] * 2, axis=-1), speed_source=False,
                receiver=Receiving(model=self.model, sigma_m=np.where(mask, sigma, 1.0), state=quality),
            ),
        ]  # fmt: skip

    def _sigma(self, measurement: Measurement, quality: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard deviation of the position per axis as the receiver says, and as it is believed, (R,) each."""
        east, north = self._column(measurement, "sigma_e_m", np.nan), self._column(measurement, "sigma_n_m", np.nan)
        reported = np.sqrt(0.5 * (east * east + north * north))
        known = np.isfinite(reported) & (reported > 0.0)
        said = np.where(known, reported, self._sheet_sigma)
        age = self._column(measurement, "age_s", 0.0)
        old = np.where(np.isfinite(age) & (quality == RTK_FIXED), np.maximum(age - _FRESH_S, 0.0), 0.0)
        by_age = np.hypot(self._trust.fix_m, _AGE_GROWTH_M_S * old)
        sigma = np.maximum(np.maximum(said, self._trust.floor(quality)), by_age)
        return said, np.hypot(sigma, self._arm_error_m)

    def slow(self, measurement: Measurement) -> tuple[BoolArray, BoolArray]:
        """Members in which its speed is within its noise of zero, and in which it says anything."""
        speed = self._column(measurement, SPEED_COLUMN, np.nan)
        known = usable(measurement, speed[:, np.newaxis])
        return known & (speed <= 0.03 + 5.0 * self._noise[0]), known


def pulse_model(info: SensorInfo, setup: EstimatorSetup, *, accosat_correlation_s: float) -> PulseSensorModel:
    """Model of a radar or AccoSat by its data sheet.

    The noise of the input follows from that of the output: behind a lag of gain g a white noise keeps g / (2 - g) of
    its variance. An AccoSat is a filter itself: its speed is taken as unlagged, with an error that changes slowly and
    is twice what its data sheet says of a steady speed, since it lags behind changes and leaks in turns.

    Raises:
        BadInputError: it sits on another body.
    """
    arm = mount_arm(info, setup)
    sheet = info.datasheet
    sample_s = 1.0 / info.rate_hz
    if info.kind == ACCOSAT:
        return PulseSensorModel(
            name=info.name,
            arm_m=arm,
            beam_slope=0.0,
            speed_noise_m_s=_ACCOSAT_WHITE_M_S,
            sample_s=sample_s,
            lags_s=(0.0, 0.0),
            slow_error=(2.0 * sheet.get("speed_noise_m_s", 0.05), accosat_correlation_s),
        )
    lags = (sheet.get("lag_speeding_up_s", 0.0), sheet.get("lag_braking_s", 0.0))
    # the data sheet's noise is behind the faster lag
    gain = float(lag_gain(np.array(min(lags)), sample_s))
    return PulseSensorModel(
        name=info.name,
        arm_m=arm,
        beam_slope=float(np.tan(sheet.get("mounting_angle_rad", 0.0))),
        speed_noise_m_s=sheet.get("speed_noise_m_s", 0.05) * float(np.sqrt((2.0 - gain) / gain)),
        sample_s=sample_s,
        lags_s=lags,
    )


def pulse_observation(model: PulseSensorModel, *, size: int) -> StatesThemselves:
    """How a pulse sensor's reading sees its lagged speed."""
    return StatesThemselves([model.at], [_PULSE_SIGMA_M_S**2], size=size)


Aid = PulseAid | ReceiverAid
