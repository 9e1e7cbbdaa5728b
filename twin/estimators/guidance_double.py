"""The double filter's choice (paper 004, section 4): constant velocity on straights, constant acceleration in curves.

The paper has the two models and says that they are used so, not how the choice is made; it names what could make it.
Each is a switch here:

* ``"course_rate"``: the receiver's own course and speed (the filter's velocity where it tells none);
* ``"odometer_and_steering"``: the curvature tan(delta) / wheelbase of an angle transducer; without one, a yaw rate
  (odometry, yaw gyro, inertial unit) over the speed (odometry, the receiver's, the filter's); without that, the
  difference of two wheel encoders over their mean and the track;
* ``"planned_track"``: the planned track and alternate hypotheses, below.

With the printed eq 11 the double filter's straight is a line fitted to all fixes since the last bend
(:mod:`twin.estimators.guidance_kinematic_models`): smooth, and off the way of a hand that steers.

The first two compare a curvature, smoothed, with two thresholds: a curve begins at the radius ``enter_radius_m``
and ends at ``leave_radius_m``. Bends of a field are of 60 m or less, and a straight driven by hand is straight to
1 / 500 m; one degree of error of the steering angle makes 1 / 140 m on a wheelbase of 2.5 m.

**Planned track.** Where the plan changes from straight to curve or back at its point nearest to the machine, the model
changes with it. Beside the filter that is shown runs another by the other model, the alternate hypothesis, which starts
where the first one is. What the fixes are likelier under the other one is summed, in logarithms, never below zero (the
cumulative sum of Page's test for a change): beyond ``margin_odds`` the other one is shown from then on, with all that
it has learnt under its hypothesis, if it is the model that the plan says; against the plan it takes ``plan_odds`` times
as much. While nothing speaks for it the other one starts anew every ``test_s``. How long a driver who leaves the plan
is not noticed: at 2.5 m/s^2 constant velocity is 0.95 m wrong about each fix, which is believed to 1.3 m, constant
acceleration 0.3 m: a factor of 1.18 a fix at 5 Hz, 35 fixes to odds of 300. In a bend so wide that either would do,
the simpler model is likelier, by 1.08 a fix at most, and comes to be shown after 15 s.
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np

from twin.config import Config, Positive
from twin.errors import BadInputError
from twin.estimators.guidance_kinematic_receiver import NEVER, Fix
from twin.estimators.guidance_kinematic_track import KinematicTrack, Surprise
from twin.estimators.guidance_turn_sensors import CurvatureSensors
from twin.estimators.roles import SPEED_COLUMN
from twin.geometry import Path, wrap_angle
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement

_LOST_S = 5.0
"""After a longer gap the place on the plan is looked for anew."""
_LOOK_M = 15.0
"""How far around the expected place on the plan it is looked for: fixes err by metres."""


class SwitchConfig(Config):
    """How the double filter chooses its model."""

    by: Literal["course_rate", "odometer_and_steering", "planned_track"] = "course_rate"
    enter_radius_m: Positive = 120.0
    """A curve begins where the radius falls below this."""
    leave_radius_m: Positive = 200.0
    """It ends where the radius grows beyond this."""
    smoothing_s: Positive = 0.5
    """Time constant of the curvature."""
    wheel_radius_m: Positive | None = None
    """Rolling radius of the wheels that have encoders; without it, that of the machine which carries the sensors."""
    track_m: Positive | None = None
    """Between them; the same."""
    test_s: Positive = 5.0
    """Planned track: how long the other hypothesis is followed before it starts anew, if nothing speaks for it."""
    plan_odds: Positive = 100.0
    """Planned track: odds that a plan is kept to."""
    margin_odds: Positive = 3.0
    """Planned track: odds that the other model has to have if it is the plan's."""


class ModelSwitch(Protocol):
    """Chooses the model for R members."""

    def hear(self, measurement: Measurement) -> None:
        """Take a sample of a sensor that is not the receiver."""

    def before(self, fix: Fix, track: KinematicTrack) -> BoolArray:
        """Say which members are in a curve, (R,), before a fix is used."""

    def after(
        self, fix: Fix, track: KinematicTrack, variances: FloatArray, surprise: Surprise, place: FloatArray
    ) -> None:
        """Look at what a fix was to the filter; ``place`` (R, 3) is where the machine is then."""


class CurvatureSwitch:
    """Compares a curvature with two thresholds."""

    def __init__(self, config: SwitchConfig, runs: int) -> None:
        self._enter, self._leave = 1.0 / config.enter_radius_m, 1.0 / config.leave_radius_m
        self._smoothing_s = config.smoothing_s
        self._curvature: FloatArray = np.zeros(runs)
        self._curved: BoolArray = np.zeros(runs, dtype=np.bool_)

    def judge(self, curvature: FloatArray, dt_s: FloatArray) -> BoolArray:
        """Take a curvature (R,) that held for ``dt_s`` (R,); NaN says nothing."""
        share = -np.expm1(-dt_s / self._smoothing_s)
        news = np.where(np.isfinite(curvature), curvature, self._curvature)
        self._curvature = self._curvature + share * (news - self._curvature)
        bent = np.abs(self._curvature)
        self._curved = np.where(self._curved, bent >= self._leave, bent > self._enter)
        return self._curved


class CourseRateSwitch:
    """By the rate of the receiver's course over its speed."""

    def __init__(self, config: SwitchConfig, runs: int, *, slow_m_s: float) -> None:
        self._judge, self._slow_m_s = CurvatureSwitch(config, runs).judge, slow_m_s
        self._course: FloatArray = np.full(runs, np.nan)
        self._t_ns: IntArray = np.full(runs, NEVER)

    def hear(self, measurement: Measurement) -> None:
        """No other sensor is listened to."""

    def before(self, fix: Fix, track: KinematicTrack) -> BoolArray:
        """Take the fix's course and speed."""
        course, speed = fix.of("course_rad"), fix.of(SPEED_COLUMN)
        told = np.isfinite(course) & np.isfinite(speed)
        if not told.all():
            east, north = track.x[:, 3], track.x[:, 4]
            course = np.where(told, course, np.arctan2(north, east))
            speed = np.where(told, speed, np.hypot(east, north))
        dt_s = np.where(fix.new & (self._t_ns != NEVER), fix.t_ns - self._t_ns, 0) / NS_PER_S
        usable = fix.new & (speed >= self._slow_m_s) & (dt_s > 0.0)
        way = np.where(usable, speed * dt_s, 1.0)
        turned = np.where(usable, wrap_angle(course - self._course), np.nan)
        self._course = np.where(fix.new, course, self._course)
        self._t_ns = np.where(fix.new, fix.t_ns, self._t_ns)
        return self._judge(turned / way, dt_s)

    def after(
        self, fix: Fix, track: KinematicTrack, variances: FloatArray, surprise: Surprise, place: FloatArray
    ) -> None:
        """The filter has no say."""


class SensorSwitch:
    """By what odometer, steering and gyro say.

    Raises:
        BadInputError: no sensor tells a curvature.
    """

    def __init__(self, config: SwitchConfig, setup: EstimatorSetup, *, slow_m_s: float) -> None:
        self._judge = CurvatureSwitch(config, setup.runs).judge
        self._sensors = CurvatureSensors(
            setup,
            wheel_radius_m=setup.wheel_radius_m if config.wheel_radius_m is None else config.wheel_radius_m,
            track_m=setup.track_m if config.track_m is None else config.track_m,
            slow_m_s=slow_m_s,
        )
        self._t_ns: IntArray = np.full(setup.runs, NEVER)

    def hear(self, measurement: Measurement) -> None:
        """Take a sample."""
        self._sensors.hear(measurement)

    def before(self, fix: Fix, track: KinematicTrack) -> BoolArray:
        """Judge by the newest of each sensor."""
        speed = fix.of(SPEED_COLUMN)
        speed = np.where(np.isfinite(speed), speed, np.hypot(track.x[:, 3], track.x[:, 4]))
        dt_s = np.where(fix.new & (self._t_ns != NEVER), fix.t_ns - self._t_ns, 0) / NS_PER_S
        self._t_ns = np.where(fix.new, fix.t_ns, self._t_ns)
        return self._judge(self._sensors.curvature(speed), dt_s)

    def after(
        self, fix: Fix, track: KinematicTrack, variances: FloatArray, surprise: Surprise, place: FloatArray
    ) -> None:
        """The filter has no say."""


class PlannedTrackSwitch:
    """By the plan, and by the likelihoods of both models.

    Raises:
        BadInputError: there is no plan.
    """

    def __init__(self, config: SwitchConfig, setup: EstimatorSetup, other: KinematicTrack) -> None:
        if setup.planned_path is None:
            raise BadInputError(
                f"[estimators.{setup.name}.switch] by = 'planned_track': no path is planned here (a driver of kind "
                "'path' has one); allowed without: course_rate, odometer_and_steering"
            )
        self._path: Path = setup.planned_path
        self._other = other
        self._plan, self._margin = np.log(config.plan_odds), np.log(config.margin_odds)
        self._enter = 1.0 / config.enter_radius_m
        self._test_ns = round(config.test_s * NS_PER_S)
        runs = setup.runs
        self._station: FloatArray = np.zeros(runs)
        self._t_ns: IntArray = np.full(runs, NEVER)
        self._since_ns: IntArray = np.full(runs, NEVER)
        self._bent: BoolArray = np.zeros(runs, dtype=np.bool_)
        """(R,) whether the plan bent at the last fix."""
        self._evidence: FloatArray = np.zeros(runs)
        """(R,) log-likelihood of the fixes under the other model less that under the chosen one, summed."""

    def hear(self, measurement: Measurement) -> None:
        """No other sensor is listened to."""

    def before(self, fix: Fix, track: KinematicTrack) -> BoolArray:  # noqa: ARG002
        """The models change after a fix, not before."""
        return track.curved

    def after(
        self, fix: Fix, track: KinematicTrack, variances: FloatArray, surprise: Surprise, place: FloatArray
    ) -> None:
        """Judge the other hypothesis, and change over where it is the better one."""
        both = fix.new & (self._since_ns != NEVER) & (self._other.t_ns != NEVER)
        self._other.predict(fix.t_ns, both)
        other = self._other.update(fix.position, variances, both)
        gained = np.where(both, other.log_likelihood - surprise.log_likelihood, 0.0)
        self._evidence = np.maximum(self._evidence + gained, 0.0)
        bends = self._bends(fix, track, place)
        planned = bends != track.curved
        needed = self._margin + np.where(planned, 0.0, self._plan)
        changes = both & ((planned & (bends != self._bent)) | (self._evidence > needed))
        self._bent = bends
        if changes.any():
            track.adopt(changes, self._other)
        idle = (self._evidence <= 0.0) & (fix.t_ns - self._since_ns >= self._test_ns)
        anew = fix.new & (changes | ~both | idle)
        self._other.adopt(anew, track)
        self._other.change_model(np.where(anew, ~track.curved, self._other.curved))
        self._since_ns = np.where(anew, fix.t_ns, self._since_ns)
        self._evidence = np.where(anew, 0.0, self._evidence)

    def _bends(self, fix: Fix, track: KinematicTrack, place: FloatArray) -> BoolArray:
        """Whether the plan bends where each member is, (R,)."""
        bends: BoolArray = np.zeros(len(place), dtype=np.bool_)
        speed = np.hypot(track.x[:, 3], track.x[:, 4])
        for member in range(len(place)):
            if fix.new[member]:
                first = self._t_ns[member] == NEVER
                dt_s = 0.0 if first else (fix.t_ns - int(self._t_ns[member])) / NS_PER_S
                near = None if dt_s > _LOST_S else self._station[member] + speed[member] * dt_s
                east, north = float(place[member, 0]), float(place[member, 1])
                self._station[member] = self._path.project(east, north, near_m=near, window_m=_LOOK_M)[0]
            bends[member] = abs(self._path.pose(float(self._station[member])).curvature_1_m) > self._enter
        self._t_ns = np.where(fix.new, fix.t_ns, self._t_ns)
        return bends
