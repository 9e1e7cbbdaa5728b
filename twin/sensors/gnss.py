"""GNSS receiver: position, speed and course, and what it says about their quality (kind ``gnss``).

    position = p + e,     velocity = L(v) + e_v

p is the position of the antenna, which sits on a mount of its own, so that the lever arm and the machine's attitude are
in it. v is the antenna's velocity behind the receiver's own filter L (first order); speed and course are modulus and
direction of the noisy horizontal velocity, so that at standstill the course is noise, as it is in reality. Doppler
shifts see the satellites' geometry as ranges do: fewer of them dilute velocities by the factor of positions. Course is
the direction of travel in the twin's convention (counter-clockwise from east), not the compass course of NMEA.

Some receivers step when they change satellites (:mod:`twin.sensors.gnss_jumps`), smooth their positions by a filter of
their own (:mod:`twin.sensors.gnss_internal_filter`; what it adds is in the recorded error, though not in the
time-correlated part beside it) and tell them in coarse steps; DOP may swing (:mod:`twin.sensors.gnss_geometry`).

Errors and reports follow the receiver's fix state: corrections (:mod:`twin.sensors.gnss_corrections`) and satellites
decide it (:mod:`twin.sensors.gnss_states`), it decides the errors (:mod:`twin.sensors.gnss_errors`), and faults act on
all of them (:mod:`twin.sensors.gnss_faults`). Without a position a sample still arrives: quality 0, the satellites that
are left, and NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.fix_quality import RTK_FIXED
from twin.sensors.base import Reading, Sample, Sensor, SensorConfig
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.gnss_corrections import Corrections
from twin.sensors.gnss_datasheet import datasheet
from twin.sensors.gnss_disturbances import Disturbances
from twin.sensors.gnss_errors import PositionErrors, Reports
from twin.sensors.gnss_faults import RECEIVER_FAULTS
from twin.sensors.gnss_kernels import NEVER, speed_and_course
from twin.sensors.gnss_outputs import (
    HEADING_SIGMA,
    VERTICAL_SPEED,
    heading_error,
    vertical_speed_error,
)
from twin.sensors.gnss_position_output import PositionOutput
from twin.sensors.gnss_states import FixStates, dilution
from twin.sensors.kernels import wrap
from twin.sensors.noise import RampLowPass
from twin.signals import HEADING, POSITION, BoolArray, Capture, FloatArray, IntArray, Mount, MountMotion, nanoseconds

TRUE_FIX = "true_fix"
_NO_COURSE_M_S = 1e-3
"""Slower than this, the true course has no meaning."""


class Gnss(Sensor):
    """GNSS receiver. Hidden columns: errors of all that is measured, the position's time-correlated part with its
    steps, and TRUE_FIX.

    TRUE_FIX is 1 where a fix arrives that is what it says: the receiver is in its state of quality 4, its corrections
    are younger than that state allows, no fault makes the fix a wrong one, and none changes it on its way.
    Otherwise, and for receivers that cannot fix, it is 0.
    """

    extra_hidden_columns = (*(f"{column}.correlated" for column in POSITION), TRUE_FIX)
    inner_faults = RECEIVER_FAULTS

    def __init__(
        self, config: GnssConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        vertical = () if config.vertical_speed is None else (VERTICAL_SPEED,)
        heading = () if config.heading is None else (HEADING,)
        self.error_columns = (*POSITION, "speed_m_s", "course_rad", *vertical, *heading)
        self.columns = (*self.error_columns, *Reports.columns, *((HEADING_SIGMA,) if heading else ()))
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._table = list(config.states.values())
        self._dilution_of: dict[int, FloatArray] = {}
        self._build_receiver(config)
        self._output = PositionOutput(config, self._table, period_s=self.period_s, name=name, streams=self._streams)
        self._build_velocity(config)
        self._build_heading(config)
        self._truth = np.full(len(self.columns), np.nan)
        self._extra = np.zeros((self._runs, len(self.extra_hidden_columns)))
        self._true_fix_column = self.hidden_columns.index(TRUE_FIX)
        self._own_position = np.empty((0, 3))

    def sample(self, capture: Capture) -> Sample:
        """Take the sample that is due, and tell the record whether the fix that arrives is a true one."""
        sample = super().sample(capture)
        if self._tampered:
            unchanged: BoolArray = np.zeros(self._runs, dtype=np.bool_)
            if sample.measurements:
                unchanged = (sample.measurements[0].values[:, :3] == self._own_position).all(axis=1)
            sample.hidden[:, self._true_fix_column] *= unchanged
        return sample

    def _build_receiver(self, config: GnssConfig) -> None:
        qualities = [state.quality for state in self._table]
        self._disturbances = Disturbances(
            self._faults.inner,
            qualities=qualities,
            period_s=self.period_s,
            streams=self._streams,
        )
        self._corrections = Corrections(
            interval_s=config.corrections_interval_s,
            delay_s=config.corrections_delay_s,
            loss=config.corrections_loss_probability,
            streams=self._streams,
        )
        self._fix = qualities.index(RTK_FIXED) if RTK_FIXED in qualities else -1
        until_s = self._table[self._fix].until_age_s
        self._fix_until_ns = NEVER if until_s is None else nanoseconds(until_s)
        self._tampered = bool(self._faults) or self._dropout_stream is not None
        self._states = FixStates(config.states, pinned=config.state, streams=self._streams)
        self._position_errors = PositionErrors(
            self._table,
            self._states.index,
            drift_s=config.age_drift_correlation_s,
            period_s=self.period_s,
            streams=self._streams,
        )
        self._normals = self._streams.normal("receiver", self._position_errors.normals_needed)
        self._reports = Reports(self._table, first=len(self.error_columns))
        first = len(self.error_columns)
        self._sigmas = [first, first + 1, first + 2]

    def _build_velocity(self, config: GnssConfig) -> None:
        self._velocity_lag = RampLowPass(tau_s=config.velocity_lag_s, period_s=self.period_s)
        noise = [[state.velocity_noise_m_s, state.velocity_noise_ratio] for state in self._table]
        self._still_noise, self._noise_ratio = np.ascontiguousarray(np.array(noise).T)
        self._vertical_error = None
        if config.vertical_speed is not None:
            self._vertical_error = vertical_speed_error(
                config.vertical_speed, period_s=self.period_s, streams=self._streams
            )

    def _build_heading(self, config: GnssConfig) -> None:
        self._heading_error = None
        if config.heading is not None:
            self._heading_error = heading_error(config.heading, period_s=self.period_s, streams=self._streams)
            self._heading_column = self.columns.index(HEADING)
            self._heading_sigma = config.heading.reported_sigma_rad
            given = [state.quality in config.heading.qualities for state in self._table]
            self._no_heading = ~np.array([*given, False])
            self._sigmas.append(self.columns.index(HEADING_SIGMA))

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        t_ns, position = capture.t_ns, capture.position_enu_m
        disturbances, reference_ns = self._disturbances, self._corrections.reference_ns
        disturbances.update()
        self._corrections.update(t_ns, link_up=disturbances.link_up, late_ns=disturbances.late_ns)
        self._states.update(t_ns, reference_ns, disturbances.satellites)
        index = self._states.index if disturbances.forced is None else disturbances.forced
        disturbances.look_at_states(t_ns, index)
        dilutions = self._output.dilute(self._dilution(disturbances.satellites), t_ns)
        normals = self._normals.next()
        error = self._position_errors.step(
            t_ns,
            reference_ns=reference_ns,
            index=index,
            allowed=self._states.allowed,
            dilution=dilutions,
            normals=normals,
        )
        self._extra[:, :3] = self._position_errors.correlated
        offset = self._output.offset(index, dilutions)
        if offset is not None:
            error = error + offset
            self._extra[:, :3] += offset
        if disturbances.offset_m is not None:
            error = error + disturbances.offset_m
        values = np.empty((self._runs, len(self.columns)))
        values[:, :3] = self._output.told(error + position, index)
        self._truth[:3] = position
        if self._tampered:
            self._own_position = values[:, :3].copy()
        self._put_velocity(values, capture, index, dilutions, normals)
        self._put_heading(values, capture.rotation, index)
        self._reports.write(
            values,
            t_ns,
            reference_ns=reference_ns,
            index=index,
            satellites=disturbances.satellites,
            dilution=dilutions,
        )
        if disturbances.zero_sigmas:
            values[:, self._sigmas] *= 0.0  # what is NaN stays so
        self._extra[:, 3] = self._true_fix(t_ns, index)
        return Reading(values=values, truth=self._truth, hidden=self._extra)

    def _true_fix(self, t_ns: int, index: IntArray) -> BoolArray:
        fixed: BoolArray = index == self._fix
        fixed &= t_ns - self._corrections.reference_ns < self._fix_until_ns
        if self._disturbances.offset_m is not None:
            fixed &= ~self._disturbances.offset_m.any(axis=1)
        return fixed

    def _dilution(self, satellites: int) -> FloatArray:
        if satellites not in self._dilution_of:
            self._dilution_of[satellites] = dilution(self._table, satellites)
        return self._dilution_of[satellites]

    def _put_velocity(
        self, values: FloatArray, capture: MountMotion, index: IntArray, dilutions: FloatArray, normals: FloatArray
    ) -> None:
        velocity = capture.velocity_enu_m_s
        true_speed = math.hypot(velocity[0], velocity[1])
        self._truth[3] = true_speed
        self._truth[4] = math.atan2(velocity[1], velocity[0]) if true_speed >= _NO_COURSE_M_S else math.nan
        east, north, up = self._velocity_lag.step(capture.mean_velocity_enu_m_s, velocity).tolist()
        still_noise, noise_ratio = self._still_noise * dilutions, self._noise_ratio * dilutions
        speed_and_course(east, north, true_speed, index, still_noise, noise_ratio, normals, 3, values)
        self._output.put_velocity(values, 3)
        if self._vertical_error is not None:
            # without a position there is no speed either, whatever stands here
            factor = dilutions[np.minimum(index, len(dilutions) - 1)]
            values[:, 5] = self._vertical_error.step() * factor + up
            self._truth[5] = velocity[2]

    def _put_heading(self, values: FloatArray, rotation: FloatArray, index: IntArray) -> None:
        if self._heading_error is None:
            return
        heading = math.atan2(rotation[1, 0], rotation[0, 0])
        self._truth[self._heading_column] = heading
        values[:, self._heading_column] = self._heading_error.step() + heading
        wrap(values, self._heading_column)
        values[:, -1] = self._heading_sigma
        none = self._no_heading[index]
        values[none, self._heading_column] = np.nan
        values[none, -1] = np.nan

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, GnssConfig)
        return datasheet(config)

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, GnssConfig)
        state = config.usual_state
        sigma = np.zeros(len(self.columns))
        sigma[:3] = state.total_sigma_m()
        sigma[3] = state.velocity_noise_m_s
        if config.vertical_speed is not None:
            sigma[5] = math.hypot(config.vertical_speed.white_sigma_m_s, config.vertical_speed.correlated_sigma_m_s)
        if config.heading is not None:
            sigma[self.columns.index(HEADING)] = math.hypot(
                config.heading.white_sigma_rad, config.heading.correlated_sigma_rad
            )
        return sigma
