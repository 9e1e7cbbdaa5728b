"""Where the machine is between two rows of trees, from a turning lidar (kind ``row_filter``); ours.

Each scan's trunks (:mod:`twin.estimators.lidar_scan`) are moved to where they are seen from now, for the scan takes a
turn's time and arrives late; two parallel rows are fitted to them robustly (:mod:`twin.estimators.row_fit`). A Kalman
filter (:mod:`twin.estimators.row_motion`) carries offset and heading from fit to fit by the turns of our heading filter
and the way of the wheels, and beyond where no rows are seen: in bright sun, in a gap. Its sigma grows then as the
gyroscope's does. The trees in sight do not stand quite in their rows, and the next scan sees the same ones: that error
is a state and not taken for noise that a hundred scans would average away.

The filter follows the rows, so a constant error of the compass does not matter, and a magnet beside the lane only
harms: of the heading filter it takes turns, not the heading itself. Inertial unit and wheel encoders go together; a
magnetometer may be added. With the lidar alone it is the row fit, held until the next.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from twin.config import Config, Names, NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.engines import innovation, make_engine
from twin.estimators.heading_filter import HeadingFilter, HeadingFilterConfig
from twin.estimators.heading_inputs import MAGNETOMETER, WHEEL_ENCODERS
from twin.estimators.lidar_scan import LIDAR, TrunkConfig, find_trunks, ranges_of, the_lidar
from twin.estimators.roles import IMU, pick_sensors
from twin.estimators.row_fit import RowFit, RowFitter, RowsConfig
from twin.estimators.row_motion import (
    PSI,
    RATE,
    SIZE,
    WE,
    WPSI,
    DeadReckoning,
    E,
    HeadingAndWheels,
    RowMotion,
    RowsObserved,
    Track,
    Unknown,
)
from twin.estimators.wheel_heading import WheelHeadingConfig
from twin.estimators.wheel_odometry import Odometer
from twin.geometry import wrap_angle
from twin.signals import (
    LANE_HEADING,
    LANE_OFFSET,
    NS_PER_S,
    ROWS_SEEN,
    BoolArray,
    Estimate,
    EstimatorSetup,
    FloatArray,
    Measurement,
)

KIND = "row_filter"
_LATEST_S = 2.0
"""How long the way made is remembered: scans that arrive later are of no use."""
_FRESH_PERIODS = 2.0
WHEELS = WheelHeadingConfig(drift_rad_rtm=1.0)
"""Wheels of which one is 0.5 % larger count 0.05 rad per metre that nobody turns, always the same way; a heading filter
without any other reference may make use of wheels all the same, one that sees the rows need not."""
_SURE = 18.4
"""Chi-square of two numbers that is exceeded once in 10 000 times."""


class RowFilterConfig(Config):
    """Options of :class:`RowFilter`."""

    kind: Literal["row_filter"]
    sensors: Names
    """A lidar; with it an inertial unit and wheel encoders, or neither; and a magnetometer if wanted."""
    rate_hz: Positive = 50.0
    """Output rate."""
    rows: RowsConfig
    trunks: TrunkConfig = TrunkConfig()
    heading: HeadingFilterConfig | None = None
    """Options of the heading filter inside (its list of sensors is this estimator's without the lidar). By default its
    own, but with wheels that tell way and standstill and hardly a heading (:data:`WHEELS`)."""
    sideslip_m_rtm: NonNegative = 0.005
    """Sideways drift per root of a metre of way, 1 sigma; a choice."""
    unknown_turn_rad_rts: Positive = 0.3
    """Without inertial unit: what the machine may turn per root of a second; a choice."""
    unknown_side_m_rts: Positive = 0.1
    """Without inertial unit: what it may move sideways per root of a second; a choice."""
    forget_after: Literal[1, 2, 3, 5, 10] = 5
    """Fits in a row that contradict the filter after which it believes them and not itself."""


class RowFilter:
    """Estimator of :class:`RowFilterConfig`.

    Columns: offset and heading against the lane's axis; ``rows_seen`` (0, 1, 2) and ``trunks_seen`` of the last scan, 0
    when there was none for two turns; ``since_fix_s`` and, with wheel encoders, ``since_fix_m``: time and way since a
    fit was last used; ``fit_offset_m`` and ``fit_heading_rad``: the last fit alone, NaN where there was none.

    Raises:
        BadInputError: not exactly one lidar, an inertial unit without wheel encoders or the other way round, or a
            sensor of another kind.
    """

    state_columns: tuple[str, ...] = (LANE_OFFSET, LANE_HEADING)

    def __init__(self, config: RowFilterConfig, setup: EstimatorSetup) -> None:
        picked = pick_sensors(setup, (LIDAR, IMU, WHEEL_ENCODERS, MAGNETOMETER), estimator=KIND)
        self._sheet = the_lidar(setup, picked[LIDAR], kind=KIND)
        self._config, self._runs = config, setup.runs
        runs = setup.runs
        self._fitter = RowFitter(config.rows, bias_ratio=self._sheet.bias_ratio)
        self._moves = _dead_reckoning(config, setup, {kind: len(infos) for kind, infos in picked.items()})
        self._motion = RowMotion(memory_m=config.trunks.reach_share * self._sheet.max_range_m, runs=runs)
        self.engine = make_engine("ensemble", np.zeros((runs, SIZE)), self._start_covariance())
        self._track = Track(runs=runs, kept_s=_LATEST_S)
        self._scan: Measurement | None = None
        self._scan_ns: int | None = None
        self._now_ns: int | None = None
        self._known: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._contradicted = np.zeros(runs, dtype=np.int64)
        self._since_s: FloatArray = np.zeros(runs)
        self._since_m: FloatArray = np.zeros(runs)
        self._seen: FloatArray = np.zeros((runs, 2))
        self._fit: FloatArray = np.full((runs, 2), np.nan)
        self._fit_sigma: FloatArray = np.full((runs, 2), np.nan)
        way = ("since_fix_m",) if self._moves.counts_way else ()
        diagnostics = (ROWS_SEEN, "trunks_seen", "fit_offset_m", "fit_heading_rad", "since_fix_s", *way)
        self.columns: tuple[str, ...] = (LANE_OFFSET, LANE_HEADING, *diagnostics)

    def _start_covariance(self) -> FloatArray:
        rows, P = self._config.rows, np.zeros((self._runs, SIZE, SIZE))
        P[:, E, E] = (0.5 * rows.search_offset_share * 0.5 * rows.lane_width_m) ** 2
        P[:, PSI, PSI] = (0.5 * rows.search_heading_rad) ** 2
        if isinstance(self._moves, HeadingAndWheels):
            P[:, RATE, RATE] = self._moves.drift_variance
        P[:, WE, WE], P[:, WPSI, WPSI] = rows.crooked_m**2, 1e-4
        return P

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival.

        Of several scans between two estimates the latest counts; copies and scans older than one taken before do not.
        """
        if measurement.sensor == self._sheet.name:
            known_ns = self._scan_ns if self._scan is None else self._scan.t_ns
            if known_ns is None or measurement.t_ns > known_ns:
                self._scan = measurement
            return
        self._moves.process(measurement)

    def _advance(self, t_ns: int) -> None:
        dt_s = 0.0 if self._now_ns is None else max(0, t_ns - self._now_ns) / NS_PER_S
        self._now_ns = t_ns
        turned, way = self._moves.step(t_ns, dt_s, self._motion)
        self._track.add(t_ns, turned, way)
        self.engine.predict(self._motion, np.stack([turned, way], axis=-1), dt_s)
        self._since_s = self._since_s + dt_s
        self._since_m = self._since_m + np.abs(way)
        resting, variance = self._moves.resting()
        if resting.any():
            x, P = self.engine.x.copy(), self.engine.P.copy()
            x[:, RATE] = np.where(resting, 0.0, x[:, RATE])
            keep = np.where(resting, 0.0, 1.0)[:, np.newaxis]
            P[:, RATE, :] *= keep
            P[:, :, RATE] *= keep
            P[:, RATE, RATE] += np.where(resting, variance, 0.0)
            self.engine.restore(x, P)

    def _look(self, scan: Measurement, t_ns: int) -> None:
        """Fit rows to a scan and take the fit where it is one."""
        self._scan_ns = scan.t_ns
        trunks = find_trunks(ranges_of(scan), self._sheet, self._config.trunks)
        x = self._sheet.forward_m + trunks.range_m * np.cos(trunks.bearing_rad)
        y = self._sheet.left_m + trunks.range_m * np.sin(trunks.bearing_rad)
        if t_ns - scan.t_ns > _LATEST_S * NS_PER_S / 2.0:
            return
        x, y = self._track.seen_from_now(scan.t_ns - NS_PER_S * trunks.age_s, x, y)
        state, P = self.engine.x, self.engine.P
        sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2)[:, :2] + self._motion.standing)
        sigma = np.where(self._known[:, np.newaxis] & self._moves.counts_way, sigma, np.inf)
        fit = self._fitter.fit(trunks, x, y, state[:, :2], sigma)
        self._seen = np.stack([fit.rows_seen, fit.trunks], axis=-1).astype(np.float64)
        good = fit.good[:, np.newaxis]
        self._fit = np.where(good, np.stack([fit.offset_m, fit.heading_rad], axis=-1), np.nan)
        self._fit_sigma = np.where(good, np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2)), np.nan)
        if fit.good.any():
            self._use(fit)

    def _use(self, fit: RowFit) -> None:
        standing = np.diagonal(fit.standing, axis1=1, axis2=2)
        first = fit.good & ~self._known
        forgotten = self._contradicted >= self._config.forget_after
        anew = first | (fit.good & forgotten)
        if anew.any():
            self._begin(anew, standing)
        self._motion.standing = np.where(fit.good[:, np.newaxis], standing, self._motion.standing)
        noise = np.where(fit.good[:, np.newaxis, np.newaxis], fit.noise, np.eye(2))
        observed = RowsObserved(noise)
        z = observed.whitened(np.stack([fit.offset_m, fit.heading_rad], axis=-1))
        agrees = innovation(self.engine, observed, z).nis < _SURE
        used = fit.good & (agrees | ~self._known)
        self._contradicted = np.where(used, 0, self._contradicted + fit.good)
        self.engine.update(observed, z, used)
        self._known = self._known | used
        self._since_s = np.where(used, 0.0, self._since_s)
        self._since_m = np.where(used, 0.0, self._since_m)

    def _begin(self, members: BoolArray, standing: FloatArray) -> None:
        """What these members held of their place in the lane is worth nothing; the drift of the heading stays known."""
        x, P = self.engine.x.copy(), self.engine.P.copy()
        start = self._start_covariance()
        start[:, WE, WE], start[:, WPSI, WPSI] = standing[:, 0], standing[:, 1]
        start[:, RATE, RATE] = P[:, RATE, RATE]
        cleared = np.zeros_like(x)
        cleared[:, RATE] = x[:, RATE]
        self._known = self._known & ~members
        self.engine.restore(
            np.where(members[:, np.newaxis], cleared, x), np.where(members[:, np.newaxis, np.newaxis], start, P)
        )

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return what is known at ``t_ns``."""
        self._advance(t_ns)
        scan, self._scan = self._scan, None
        if scan is not None:
            self._look(scan, t_ns)
        late_s = _FRESH_PERIODS * self._sheet.period_s
        if self._scan_ns is None or t_ns - self._scan_ns > late_s * NS_PER_S:
            self._seen = np.zeros((self._runs, 2))
            self._fit = np.full((self._runs, 2), np.nan)
            self._fit_sigma = np.full((self._runs, 2), np.nan)
        x, P = self.engine.x, self.engine.P
        ages = [self._since_s, self._since_m] if self._moves.counts_way else [self._since_s]
        values = np.column_stack([x[:, E], wrap_angle(x[:, PSI]), self._seen, self._fit, *ages])
        sigmas = np.full(values.shape, np.nan)
        sigmas[:, :2] = np.sqrt(np.diagonal(P, axis1=1, axis2=2)[:, :2])
        sigmas[:, 4:6] = self._fit_sigma
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas, covariance=P[:, :2, :2].copy())


def _dead_reckoning(config: RowFilterConfig, setup: EstimatorSetup, count: dict[str, int]) -> DeadReckoning:
    """What the estimator's other sensors say of the motion.

    Raises:
        BadInputError: they do not go together.
    """
    where = f"[estimators.{setup.name}] sensors: {KIND}"
    if count[IMU] != count[WHEEL_ENCODERS] or (count[MAGNETOMETER] and not count[IMU]):
        raise BadInputError(
            f"{where} takes an inertial unit and wheel encoders together (and then a magnetometer if wanted), or"
            f" neither; given were {count[IMU]} of kind {IMU!r}, {count[WHEEL_ENCODERS]} of kind {WHEEL_ENCODERS!r},"
            f" {count[MAGNETOMETER]} of kind {MAGNETOMETER!r}"
        )
    if not count[IMU]:
        return Unknown(turn_rad_rts=config.unknown_turn_rad_rts, side_m_rts=config.unknown_side_m_rts, runs=setup.runs)
    others = {name: info for name, info in setup.sensors.items() if info.kind != LIDAR}
    imu = next(info for info in others.values() if info.kind == IMU)
    encoders = next(info for info in others.values() if info.kind == WHEEL_ENCODERS)
    if config.rate_hz < imu.rate_hz:
        raise BadInputError(
            f"[estimators.{setup.name}] rate_hz = {config.rate_hz:g}: has to be at least the {imu.rate_hz:g} Hz of"
            f" {imu.name!r}, whose every turn counts"
        )
    options = config.heading or HeadingFilterConfig(kind="heading_filter", sensors=tuple(others), wheels=WHEELS)
    heading = HeadingFilter(options, replace(setup, sensors=others))
    wheels = options.wheels
    odometer = Odometer(encoders, wheel_radius_m=wheels.wheel_radius_m, track_m=wheels.track_m, runs=setup.runs)
    return HeadingAndWheels(
        heading,
        odometer,
        imu=imu,
        encoders=encoders,
        noise=options.noise,
        sideslip_m_rtm=config.sideslip_m_rtm,
        runs=setup.runs,
    )
