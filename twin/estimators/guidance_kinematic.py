"""Kalman filters on positions alone, as a receiver has inside (kind ``guidance_kinematic``): paper 004, eqs 1 to 15.

``model`` is the constant-velocity model (eqs 3 to 11), the constant-acceleration model (eqs 12 to 15), or the double
filter that uses the one on straights and the other in curves (:mod:`twin.estimators.guidance_double`). Measurements
are three coordinates with variances by the dilutions of precision (eq 10). Models and what the printed eq 11 does:
:mod:`twin.estimators.guidance_kinematic_models`; the start: :mod:`twin.estimators.guidance_kinematic_receiver`.

**As published:** eq 11 as printed and C_mm = sigma_0^2 diag(HDOP, HDOP, c^2 VDOP), with the paper's numbers.
**Corrected:** a C_ww that is a covariance, and the squares of HDOP and VDOP, as standard deviations are proportional to
them. Either starts from a position alone (eqs 7 to 9); published, velocity and acceleration are then certainly zero,
corrected, the acceleration may be ``handover_m_s2``.

**How far a track lies outside a bend** is known beforehand. The filter of one axis with the steady gain (K_p, K_v) lags
behind an acceleration a by a dT (1 - K_p) / K_v; a = v^2 / r points to the middle of the bend, so the track is shown
too far out by that. Corrected, HDOP 1: 0.22 s^2 times a at 5 Hz, 0.77 s^2 at 1 Hz: 0.5 m and 1.9 m where v^2 / r is
2.5 m/s^2. With constant acceleration there is left what its turning makes: less than a third of that at 25 m, a sixth
at 60 m.

A fix counts for when it was valid; between fixes the state is moved on by the model. The paper's numbers are of one
receiver at one rate; anything else about a fix (its own sigma, quality other than none) is not looked at.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import NonNegative, Positive
from twin.estimators.engines import EngineOption, compiled_unless_told
from twin.estimators.guidance_base import GuidanceConfig
from twin.estimators.guidance_double import (
    CourseRateSwitch,
    ModelSwitch,
    PlannedTrackSwitch,
    SensorSwitch,
    SwitchConfig,
)
from twin.estimators.guidance_kinematic_kernels import velocity_sigmas
from twin.estimators.guidance_kinematic_models import A_, P_, V_, ProcessNoise
from twin.estimators.guidance_kinematic_output import AntennaPose
from twin.estimators.guidance_kinematic_receiver import Fix, Receiver, StandingStart
from twin.estimators.guidance_kinematic_track import KinematicTrack, Surprise
from twin.signals import HEADING, POSITION, SPEED, BoolArray, Estimate, EstimatorSetup, FloatArray, Measurement

KIND = "guidance_kinematic"
INNOVATION = ("innovation_e_m", "innovation_n_m", "innovation_u_m")
NIS = "nis_position"
TURNING = "mode_turning"
"""1 where acceleration is constant, 0 where velocity is; a filter that weighs both gives the probability."""
UNKNOWN_SPEED_M_S = 10.0
"""1 sigma of each component of a velocity of which nothing is known."""


class GuidanceKinematicConfig(GuidanceConfig):
    """Options of :class:`GuidanceKinematic`; the numbers are the paper's unless said otherwise.

    Its sensors are the receiver, and what tells the double filter of curves.
    """

    kind: Literal["guidance_kinematic"]
    model: Literal["constant_velocity", "constant_acceleration", "double"] = "double"
    variant: Literal["published", "corrected"] = "corrected"
    noise: Literal["step", "continuous"] = "step"
    """Corrected: by how much a state changes from fix to fix, or in continuous time."""
    velocity_variance: Positive = 0.5
    """sigma_v^2: m^2/s^2 per fix; continuous m^2/s^3."""
    acceleration_variance: Positive = 0.5
    """sigma_a^2: m^2/s^4 per fix; continuous m^2/s^5."""
    sigma0_m: Positive = 1.0
    """sigma_0."""
    vertical_factor: Positive = 2.0
    """c."""
    dilutions: Literal["reported", "constant"] = "reported"
    """HDOP and VDOP of each fix, or constants, as in the paper's first tests."""
    hdop: Positive = 1.0
    """The constant, also where none is reported; the paper names no value."""
    vdop: Positive = 1.7
    """The same for VDOP."""
    start_s: NonNegative | None = None
    """When the vehicle begins to move; without it, when the receiver's speed says so."""
    handover_m_s2: Positive = 2.0
    """1 sigma of each component of the acceleration when the double filter enters a curve: v^2 / r of a bend. The
    paper does not say what it does. Corrected, the constant-acceleration model starts with it, too."""
    switch: SwitchConfig = SwitchConfig()
    """The double filter's choice."""
    engine: EngineOption = "auto"
    """Kalman engine; auto: ensemble, whose compiled loops are quicker for a single run, too."""


class GuidanceKinematic:
    """Estimator of :class:`GuidanceKinematicConfig`.

    Columns: position of the reference frame (up only if the receiver tells it), heading and speed; ``nis_position``
    (east and north, two degrees of freedom) and the innovations of the newest fix, NaN where there was none since the
    last output; ``mode_turning``. Sigmas are the filter's own, which knows nothing of errors that last; of speed and
    heading there is none where the printed eq 11 has made the variance of the velocity negative.

    Raises:
        BadInputError: not exactly one receiver, sensors that do not tell what the switch needs, no planned path where
            it is to be followed, or the filterpy engine with more than one run.
    """

    def __init__(self, config: GuidanceKinematicConfig, setup: EstimatorSetup) -> None:
        self._config, runs = config, setup.runs
        self._receiver = Receiver(setup, estimator=KIND)
        self._axes = 3 if self._receiver.gives_up else 2
        self.columns: tuple[str, ...] = (
            *(*POSITION[: self._axes], HEADING, SPEED),
            *(NIS, *INNOVATION[: self._axes], TURNING),
        )
        self.state_columns: tuple[str, ...] = POSITION[: self._axes]
        self._start = StandingStart(runs=runs, moving_m_s=self._receiver.moving_m_s, start_s=config.start_s)
        self._pose = AntennaPose(self._receiver.arm, setup.start_e_n_heading[2], runs, slow_m_s=config.course_from_m_s)
        self._track = self._make_track(setup)
        self._switch = self._make_switch(setup)
        self._news: FloatArray = np.full((runs, 1 + self._axes), np.nan)

    def _make_track(self, setup: EstimatorSetup) -> KinematicTrack:
        config = self._config
        name = compiled_unless_told(config.engine, estimator=setup.name, runs=setup.runs)
        noise = ProcessNoise(
            velocity=config.velocity_variance,
            acceleration=config.acceleration_variance,
            form="printed" if config.variant == "published" else config.noise,
        )
        return KinematicTrack(noise, acceleration_variance=config.handover_m_s2**2, engine=name, runs=setup.runs)

    def _make_switch(self, setup: EstimatorSetup) -> ModelSwitch | None:
        config = self._config
        if config.model != "double":
            return None
        match config.switch.by:
            case "course_rate":
                return CourseRateSwitch(config.switch, setup.runs, slow_m_s=config.course_from_m_s)
            case "odometer_and_steering":
                return SensorSwitch(config.switch, setup, slow_m_s=config.course_from_m_s)
            case "planned_track":
                return PlannedTrackSwitch(config.switch, setup, self._make_track(setup))

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        if measurement.sensor == self._receiver.name:
            self._fix(self._receiver.read(measurement))
        elif self._switch is not None:
            self._switch.hear(measurement)

    def _fix(self, fix: Fix) -> None:
        variances = self._variances(fix)
        moving = self._start.take(fix, variances)
        if moving.any():
            self._begin(moving)
        track, used = self._track, fix.new & self._start.started & (fix.t_ns > self._track.t_ns)
        if not used.any():
            return
        if self._switch is not None:
            track.change_model(np.where(used, self._switch.before(fix, track), track.curved))
        track.predict(fix.t_ns, used)
        surprise = track.update(fix.position, variances, used)
        self._pose.hear(fix.of(SPEED), used)
        heading, _ = self._pose.turn(track.x[:, V_][:, :2], track.x[:, A_][:, :2], used)
        self._pose.keep(heading)
        self._tell(surprise, used)
        if self._switch is not None:
            self._switch.after(fix, track, variances, surprise, self._pose.place(track.x[:, P_], heading))

    def _variances(self, fix: Fix) -> FloatArray:
        """Diagonal of C_mm (eq 10), (R, 3)."""
        config = self._config
        dilutions = []
        for column, constant in (("hdop", config.hdop), ("vdop", config.vdop)):
            told = fix.of(column)
            good = np.isfinite(told) & (told > 0.0) & (config.dilutions == "reported")
            dilutions.append(np.where(good, told, constant))
        power = 1.0 if config.variant == "published" else 2.0
        level, up = dilutions[0] ** power, config.vertical_factor**2 * dilutions[1] ** power
        return config.sigma0_m**2 * np.stack([level, level, up], axis=-1)

    def _begin(self, which: BoolArray) -> None:
        start = self._start
        self._track.start(
            which,
            position=np.where(which[:, np.newaxis], start.mean, 0.0),
            variances=start.covariance,
            speed_variance=np.where(start.stood, 0.0, UNKNOWN_SPEED_M_S**2),
            t_ns=start.t_ns,
            curved=np.full(len(which), self._config.model == "constant_acceleration"),
            acceleration_variance=0.0 if self._config.variant == "published" else self._config.handover_m_s2**2,
        )

    def _tell(self, surprise: Surprise, used: BoolArray) -> None:
        news = np.column_stack([surprise.nis, surprise.y[:, : self._axes]])
        self._news = np.where(used[:, np.newaxis], news, self._news)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return where the machine is at ``t_ns``; before it moves, the mean so far and the heading set out."""
        started, axes = self._start.started, self._axes
        x, P = self._track.at(t_ns, started)
        heading, speed = self._pose.turn(x[:, V_][:, :2], x[:, A_][:, :2], started)
        antenna = np.where(started[:, np.newaxis], x[:, P_], self._start.position)
        place = self._pose.place(antenna, heading)[:, :axes]
        variances = np.where(started[:, np.newaxis], P[:, :, 0, 0], self._start.covariance)[:, :axes]
        variances = np.where(np.isfinite(place), variances, np.nan)
        turned = np.where(started[:, np.newaxis], self._turned(x, P, speed), np.nan)
        values = np.column_stack(
            [place, heading, np.where(started, speed, 0.0), self._news, 1.0 * (self._track.curved & started)]
        )
        sigmas = np.full(values.shape, np.nan)
        sigmas[:, :axes] = np.sqrt(variances)
        sigmas[:, axes : axes + 2] = turned
        self._news = np.full_like(self._news, np.nan)
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas, covariance=variances[:, :, np.newaxis] * np.eye(axes))

    @staticmethod
    def _turned(x: FloatArray, P: FloatArray, speed: FloatArray) -> FloatArray:
        """Sigmas (R, 2) of heading and speed, NaN where the filter states a negative variance."""
        level = P[:, :2, 1, 1]  # of the velocity east and north, which do not see one another
        return velocity_sigmas(np.ascontiguousarray(x[:, V_][:, :2]), level[:, :, np.newaxis] * np.eye(2), speed)
