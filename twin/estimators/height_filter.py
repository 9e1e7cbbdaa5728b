"""Height of an implement through losses of RTK: our own filter (kind ``height_filter``).

One Kalman filter over an attitude sensor's free acceleration and a GNSS receiver's height and vertical speed, in which
everything that stays wrong for a while is a state (:mod:`twin.estimators.height_filter_model`): the accelerometer's
bias, the fix's correlated error and its drift with the age of corrections, the error of the vertical speed and that of
coarse positions, the attitude error by which level acceleration leaks into Up. All variances come from data sheets. So
sigma is honest: it says before the height is lost that it will be.

Which fixes are believed is decided by :mod:`twin.estimators.height_filter_branches`, outliers of the acceleration by
:mod:`twin.estimators.height_filter_samples`. Receivers are late, by 0.1 s as a rule and by more at times: the filter
stands at the time of the newest sample of the receiver and looks ahead from there by the accelerations heard since. A
sample that is older than one taken before is put in its place, and what came after is done again, as far back as
``history_s``.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Literal

import numpy as np

from twin.config import Config, Names, NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.height_filter_beliefs import GatesConfig
from twin.estimators.height_filter_branches import Branches, Snapshot
from twin.estimators.height_filter_kernels import spread
from twin.estimators.height_filter_levers import Lever
from twin.estimators.height_filter_model import B0, B1, C, Layout, SlowError, SpanMotion
from twin.estimators.height_filter_profile import ALIGNMENT, TRIM, ProfileAid
from twin.estimators.height_filter_receiver import FixReading, HeightReceiver
from twin.estimators.height_filter_samples import AccelerationHistory
from twin.estimators.height_filter_surface import DIFFERENCE, SurfaceAid
from twin.estimators.height_filter_tilt import LevelFilter
from twin.estimators.held_height import AHRS
from twin.estimators.roles import GNSS
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import HEIGHT, NS_PER_S, VELOCITY, Estimate, EstimatorSetup, FloatArray, Measurement, SensorInfo

TRANSDUCER = "displacement_transducer"
_PATIENCE_NS = 150_000_000
"""A receiver's sample waits so long for the acceleration of its time."""
_LONGEST_SPAN_NS = 250_000_000
"""Longer spans are taken in parts of 0.1 s, so that slow errors act within them."""
_PART_NS = 100_000_000
_TREND_S = 100.0
"""A steady trend of the offset is taken for a random walk that goes as far in this time."""
_CONSTANT_S = 1000.0
"""For how long what is left of a tilt is the same."""
_OFFSET_M_S2 = 0.02
"""Offset of an accelerometer whose data sheet is silent, 1 sigma."""
_LAGS = 8.0
"""What is older than so many time constants of a lag has no part in it."""


class HeightFilterConfig(Config):
    """Options of :class:`HeightFilter`."""

    kind: Literal["height_filter"]
    sensors: Names
    """An AHRS and a GNSS receiver on the implement."""
    rate_hz: Positive = 50.0
    """Output rate."""
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """Kalman engine; auto: filterpy for a single run."""
    vertical_speed: bool = True
    """Use the receiver's vertical speed, if it has one."""
    coarse_positions: bool = True
    """Use positions that are no fixes, each stretch with an error of its own."""
    lever_arm: bool = True
    """Reckon antenna and reference point from the AHRS by its attitude; without it, as if the mast stood upright."""
    tilt: bool = True
    """Learn the AHRS's attitude error, which leaks into Up, from the receiver's level velocity."""
    profile: bool = True
    """Use the ground's profile, if there are an AHRS on the carrier and a transducer of the implement's stroke."""
    surface: bool = False
    """Use the ground that the blade has cut before, where the rear axle comes by; needs the transducer and ``tilt``."""
    working_speed_m_s: Positive = 1.0
    """How fast the machine moves level, 1 sigma: all that is known of it while the receiver says nothing."""
    bias_walk_m_s2_rts: NonNegative = 0.0
    """How the accelerometer's offset wanders beside its instability (temperature), per square root of a second."""
    history_s: Positive = 0.8
    """So much older than the newest may a sample be."""
    gates: GatesConfig = GatesConfig()


class HeightFilter:
    """Estimator of :class:`HeightFilterConfig`.

    Columns: height of the reference point above the design plane and its vertical velocity; the accelerometer's bias;
    ``mode`` (0 waiting for the first fix, 1 tracking, 2 coasting, 3 fixes on probation, 4 fixes that contradict what is
    held); normalised innovations squared of fix and vertical speed.

    Raises:
        BadInputError: not one AHRS and one receiver, both on the body of the reference point, a column is missing, or
            the filterpy engine was asked for more than one run.
    """

    state_columns: tuple[str, ...] = (HEIGHT, VELOCITY[2])

    def __init__(self, config: HeightFilterConfig, setup: EstimatorSetup) -> None:
        if config.engine == "filterpy" and setup.runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs};"
                " allowed: auto, ensemble"
            )
        ahrs, gnss = _the_one(setup, AHRS), _the_one(setup, GNSS)
        runs = setup.runs
        self._runs, self._config = runs, config
        self._receiver = HeightReceiver(gnss, setup, vertical_speed=config.vertical_speed)
        self._lag_s = gnss.datasheet.get("velocity_lag_s", 0.0)
        self._reference = Lever.between(ahrs, setup.reference, setup, upright=not config.lever_arm)
        antenna = Lever.between(ahrs, gnss.mount, setup, upright=not config.lever_arm)
        self._history_ns = round(config.history_s * NS_PER_S)
        kept_s = config.history_s + max(_LAGS * self._lag_s, 0.2) + 0.2
        carrier = _carrier(setup) if config.profile else None
        pitch = None if carrier is None else _tilt(carrier[0])
        stroke = _stroke(setup, tilt=_follows_tilt(config, ahrs, self._receiver)) if config.surface else None
        self._motion = _motion(config, ahrs, self._receiver, pitch, surface=stroke is not None, runs=runs)
        self._profile = None if carrier is None else ProfileAid(*carrier, ahrs, setup)
        self._surface: SurfaceAid | None = None
        if stroke is not None:
            fix = _fix_error(self._receiver)
            self._surface = SurfaceAid(stroke, ahrs, setup, fix=fix, later_s=config.history_s)
        self._attitude_sigma = ahrs.datasheet.get("attitude_sigma_rad", 0.0)
        self._history = AccelerationHistory(
            ahrs,
            setup,
            antenna=antenna,
            kept_s=kept_s,
            leak_sigma_rad=self._attitude_sigma if self._motion.layout.tilt is None else 0.0,
        )
        name: EngineName = "filterpy" if runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        self.branches = Branches(
            make_engine(name, *self._motion.start()),
            make_engine(name, *self._motion.start()),
            self._motion,
            level=self._level_filter(ahrs, name) if self._motion.layout.tilt is not None else None,
            profile=self._profile,
            surface=self._surface,
            receiver=self._receiver,
            gates=config.gates,
        )
        self._names = {ahrs.name: AHRS, gnss.name: GNSS}
        self._now_ns: int | None = None
        """What the branches are at."""
        self._waiting: list[FixReading] = []
        self._done: deque[tuple[int, Snapshot, FixReading]] = deque()
        """Samples of the last moments; before each, the time up to which all was taken in, and what was known then."""
        self._reference_now: tuple[int, FloatArray, FloatArray] | None = None
        self._nis: dict[str, FloatArray] = {}
        self._stroke = None if stroke is None else stroke.name
        self._carried = frozenset(() if carrier is None else (info.name for info in carrier))
        nis = ("nis_fix", *(() if self._receiver.speed is None else ("nis_vertical_speed",)))
        nis += () if self._profile is None else ("nis_profile",)
        nis += () if self._surface is None else ("nis_surface",)
        self.columns: tuple[str, ...] = (*self.state_columns, "accel_bias_m_s2", "mode", *nis)

    def _level_filter(self, ahrs: SensorInfo, engine: EngineName) -> LevelFilter:
        sheet, gates = ahrs.datasheet, self._config.gates
        return LevelFilter(
            _tilt(ahrs),
            SlowError(
                sigma=sheet.get("heading_sigma_rad", 0.0), correlation_s=sheet.get("heading_correlation_s", 60.0)
            ),
            lag_s=self._lag_s,
            speed_m_s=self._config.working_speed_m_s,
            offset_sigma=sheet.get("free_accel_bias_m_s2", _OFFSET_M_S2),
            runs=self._runs,
            gate_sigmas=gates.sigmas,
            patience_s=gates.speed_patience_s,
            engine=lambda x, P: make_engine(engine, x, P),
        )

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        role = self._names.get(measurement.sensor)
        if self._profile is not None and (role == AHRS or measurement.sensor in self._carried):
            self._profile.hear(measurement)
        if self._surface is not None and (role == AHRS or measurement.sensor == self._stroke):
            self._surface.hear(measurement)
        if role == AHRS:
            if self._history.hear(measurement):
                self._follow_reference(measurement.t_ns)
        elif role == GNSS:
            self._queue(self._receiver.read(measurement))
        else:
            return
        self._take_waiting(measurement.t_available_ns)
        self._keep_up()

    def _queue(self, reading: FixReading) -> None:
        if any(reading.t_ns == each.t_ns for each in self._waiting) or any(
            reading.t_ns == t_ns for t_ns in (done[2].t_ns for done in self._done)
        ):
            return  # a repeat says nothing new
        self._waiting.append(reading)
        self._waiting.sort(key=lambda each: each.t_ns)

    def _take_waiting(self, arrival_ns: int) -> None:
        """Take the samples of the receiver whose acceleration is known, or will not come."""
        while self._waiting:
            reading = self._waiting[0]
            settled = self._history.settled_ns
            if settled is None or reading.t_ns > settled:
                if arrival_ns - reading.t_ns < _PATIENCE_NS:
                    return
                self._history.be_silent(reading.t_ns)
            self._take(self._waiting.pop(0))

    def _take(self, reading: FixReading) -> None:
        """Take a sample at its time; one that is late goes where it belongs, and what came after is done again."""
        again = [reading]
        if self._now_ns is not None and reading.t_ns < self._now_ns:
            later = [done for done in self._done if done[2].t_ns > reading.t_ns]
            if not later or later[0][0] > reading.t_ns:
                return  # too old
            self._now_ns = later[0][0]
            self.branches.restore(later[0][1])
            for done in later:
                self._done.remove(done)
            again += [done[2] for done in later]
        for each in again:
            begin_ns = each.t_ns if self._now_ns is None else self._now_ns
            self._done.append((begin_ns, self.branches.snapshot(), each))
            self._advance(each.t_ns)
            self._hear(each)
            if each is reading:
                self._nis = dict(self.branches.nis)
        while self._done[0][0] < self._done[-1][0] - self._history_ns:
            self._done.popleft()

    def _hear(self, reading: FixReading) -> None:
        t_ns = reading.t_ns
        behind = -self._history.antenna_velocity(t_ns, self._lag_s)
        if self._lag_s > 0.0:
            behind += self._history.lagged(t_ns, self._lag_s)
        self.branches.hear(
            reading,
            antenna_m=self._history.antenna(t_ns),
            behind_m_s=behind,
            heading_rad=self._history.attitude[2],
        )

    def _keep_up(self) -> None:
        """Follow the acceleration where the receiver is silent, as far as nothing late can come any more."""
        settled = self._history.settled_ns
        if settled is None:
            return
        if self._now_ns is None:
            self._now_ns = settled
        if settled - self._now_ns > self._history_ns + _PART_NS:
            self._advance(settled - self._history_ns)

    def _advance(self, until_ns: int) -> None:
        if self._now_ns is None:
            self._now_ns = until_ns
        while until_ns > self._now_ns:
            rest = until_ns - self._now_ns
            step = rest if rest <= _LONGEST_SPAN_NS else _PART_NS
            sums = self._history.sums(self._now_ns, self._now_ns + step)
            self.branches.advance(sums, step / NS_PER_S, self._now_ns + step)
            self._now_ns += step

    def _follow_reference(self, t_ns: int) -> None:
        """Height and rate of the reference point above the AHRS."""
        if self._reference.is_nothing:
            return
        height = self._reference.height(self._history.attitude)
        rate = np.zeros(self._runs)
        if self._reference_now is not None and t_ns > self._reference_now[0]:
            rate = (height - self._reference_now[1]) / ((t_ns - self._reference_now[0]) / NS_PER_S)
        self._reference_now = (t_ns, height, rate)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``."""
        held = self.branches.held
        x, P = np.ascontiguousarray(held.x.T), np.ascontiguousarray(held.P.transpose(1, 2, 0))
        begin_ns = t_ns if self._now_ns is None else min(self._now_ns, t_ns)
        self.branches.look(self._history.sums(begin_ns, t_ns))
        (height, velocity), rows, noise = self._motion.ahead(x, (t_ns - begin_ns) / NS_PER_S)
        hh, hv, vv = spread(rows, P, noise)
        if self._reference_now is not None:
            _, above, rate = self._reference_now
            height, velocity = height + above, velocity + rate
            hh, vv = self._lean(hh, vv)
        bias_variance = P[B0, B0] + P[B1, B1] + 2.0 * P[B0, B1]
        nothing = np.full(self._runs, np.nan)
        nis = [self._nis.get(name.removeprefix("nis_"), nothing) for name in self.columns[4:]]
        self._nis = {}
        values = np.column_stack([height, velocity, x[B0] + x[B1], self.branches.mode(t_ns), *nis])
        sigmas = np.full(values.shape, np.nan)
        sigmas[:, 0], sigmas[:, 1], sigmas[:, 2] = np.sqrt(hh), np.sqrt(vv), np.sqrt(bias_variance)
        covariance = np.stack([hh, hv, hv, vv], axis=-1).reshape(self._runs, 2, 2)
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas, covariance=covariance)

    def _lean(self, hh: FloatArray, vv: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Add what the attitude error makes of the lever: of its height, and of its rate between two samples."""
        slope = self._reference.slope(self._history.attitude) * self._attitude_sigma
        change = 2.0 * self._history.step_s / self._history.attitude_correlation_s
        return hh + np.square(slope), vv + np.square(slope / self._history.step_s) * change


def _the_one(setup: EstimatorSetup, kind: str) -> SensorInfo:
    """The sensor of a kind on the reference frame's body."""
    found = [info for info in setup.sensors.values() if info.kind == kind and info.mount.body == setup.reference.body]
    if len(found) != 1:
        raise BadInputError(
            f"[estimators.{setup.name}] sensors: this estimator needs one sensor of kind {kind!r} on "
            f"{setup.reference.body!r}, but there are {len(found)}"
        )
    return found[0]


def _carrier(setup: EstimatorSetup) -> tuple[SensorInfo, SensorInfo] | None:
    """AHRS on the carrier and transducer of the stroke; None if there is neither."""
    pitch = [each for each in setup.sensors.values() if each.kind == AHRS and each.mount.body != setup.reference.body]
    stroke = [each for each in setup.sensors.values() if each.kind == TRANSDUCER]
    if not pitch and not stroke:
        return None
    if len(pitch) != 1 or len(stroke) != 1:
        raise BadInputError(
            f"[estimators.{setup.name}] sensors: the ground's profile needs one {AHRS!r} on another body than "
            f"{setup.reference.body!r} and one {TRANSDUCER!r}, but there are {len(pitch)} and {len(stroke)}; "
            "leave out both, or set profile = false"
        )
    return pitch[0], stroke[0]


def _motion(
    config: HeightFilterConfig,
    ahrs: SensorInfo,
    receiver: HeightReceiver,
    pitch: SlowError | None,
    *,
    surface: bool,
    runs: int,
) -> SpanMotion:
    """The model, with the errors of the data sheets; ``pitch`` is that of the AHRS on the carrier."""
    sheet, fix, speed = ahrs.datasheet, receiver.fix, receiver.speed
    attitude = _tilt(ahrs)
    tilt = _follows_tilt(config, ahrs, receiver)
    layout = Layout.of(
        drift=fix.age_drift_m_s > 0.0,
        coarse=config.coarse_positions,
        speed=speed is not None and speed.correlated_m_s > 0.0,
        leak=attitude.sigma > 0.0 and not tilt,
        tilt=tilt,
        pitch=pitch is not None,
        surface=surface,
    )
    errors = {
        B1: SlowError(
            sigma=sheet.get("free_accel_bias_instability_m_s2", 1.5e-4),
            correlation_s=sheet.get("free_accel_bias_correlation_s", 100.0),
        ),
        C: SlowError(sigma=1.0, correlation_s=fix.correlation_s),
    }
    if layout.drift is not None:
        errors[layout.drift] = SlowError(sigma=1.0, correlation_s=fix.age_drift_correlation_s)
    if layout.speed is not None and speed is not None:
        errors[layout.speed] = SlowError(sigma=speed.correlated_m_s, correlation_s=speed.correlation_s)
    leak = STANDARD_GRAVITY_M_S2 * attitude.sigma**2
    if layout.leak is not None:
        errors[layout.leak] = SlowError(sigma=leak, correlation_s=0.5 * attitude.correlation_s)
    if layout.tilt is not None:
        for place in (layout.tilt, layout.tilt + 1):
            errors[place] = SlowError(sigma=1.0, correlation_s=_CONSTANT_S)
    if layout.pitch is not None and pitch is not None:
        states = (pitch, TRIM, ALIGNMENT) if tilt else (pitch, TRIM)
        errors.update(enumerate(states, start=layout.pitch))
    if layout.surface is not None:
        errors.update(enumerate((DIFFERENCE, _fix_error(receiver)), start=layout.surface))
    offset = float(np.hypot(sheet.get("free_accel_bias_m_s2", _OFFSET_M_S2), leak))
    walk = float(np.hypot(config.bias_walk_m_s2_rts, sheet.get("free_accel_trend_m_s3", 0.0) * math.sqrt(_TREND_S)))
    return SpanMotion(layout, errors, offset_sigma=offset, offset_walk=walk, runs=runs)


def _tilt(ahrs: SensorInfo) -> SlowError:
    """Roll and pitch error of an AHRS."""
    sheet = ahrs.datasheet
    return SlowError(
        sigma=sheet.get("attitude_sigma_rad", 0.0), correlation_s=sheet.get("attitude_correlation_s", 60.0)
    )


def _follows_tilt(config: HeightFilterConfig, ahrs: SensorInfo, receiver: HeightReceiver) -> bool:
    return config.tilt and receiver.has_level_velocity and _tilt(ahrs).sigma > 0.0


def _fix_error(receiver: HeightReceiver) -> SlowError:
    """The slow error of a fix's height."""
    return SlowError(sigma=receiver.fix.correlated_m, correlation_s=receiver.fix.correlation_s)


def _stroke(setup: EstimatorSetup, *, tilt: bool) -> SensorInfo:
    """Transducer of the stroke of the implement."""
    found = [each for each in setup.sensors.values() if each.kind == TRANSDUCER]
    if len(found) != 1 or not tilt:
        raise BadInputError(
            f"[estimators.{setup.name}] surface: the surface just passed needs one {TRANSDUCER!r}, but there are "
            f"{len(found)}, and the tilt to be followed: tilt = true, and a receiver with level velocity"
        )
    return found[0]
