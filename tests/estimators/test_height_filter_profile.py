"""The ground's profile as an aid of the height filter: sign and scale, engines, members, honesty, what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tests.estimators.height_bench import DESIGN_M, Machine, Result, drive, honesty, make_sensor
from tests.sensors.motions import CONFIGS, DT_NS
from twin.errors import BadInputError
from twin.estimators import HeightFilterConfig, build_estimator
from twin.estimators.height_filter_kernels import GAIN_H, GAIN_V, SUMS
from twin.estimators.height_filter_model import Layout
from twin.estimators.height_filter_profile import ProfileAid, Rise
from twin.geometry import rotation_from_rpy
from twin.sensors import build_sensor
from twin.sensors.presets import load_preset
from twin.signals import (
    NS_PER_S,
    Estimate,
    Estimator,
    EstimatorSetup,
    FloatArray,
    JointMotion,
    Measurement,
    Mount,
    SensorInfo,
)

WHEELBASE_M, BLADE_M, MAST_M, SPEED_M_S = 1.1, -0.8, 1.0, 1.0
TAU_S = WHEELBASE_M / SPEED_M_S


@dataclass(frozen=True)
class Carrier(Machine):
    """Rolls east over waves (amplitude m, wavelength m) on a slope, with its implement's slide going up and down."""

    waves: tuple[tuple[float, float], ...] = ((0.02, 9.0), (0.01, 4.3))
    slope: float = 0.0
    stroke_m: float = 0.03
    trim_rad: float = 0.0

    def ground(self, x: float) -> float:
        return self.slope * x + sum(a * math.sin(2.0 * math.pi * x / length) for a, length in self.waves)

    def pitch(self, t: float) -> float:
        x = SPEED_M_S * t
        return -math.asin((self.ground(x + WHEELBASE_M) - self.ground(x)) / WHEELBASE_M)

    def stroke(self, t: float) -> float:
        return self.stroke_m * math.sin(0.7 * t)

    def rotation(self, t: float) -> FloatArray:
        return rotation_from_rpy(0.0, self.pitch(t) + self.trim_rad, 0.0)

    def _place(self, t: float, offset: FloatArray) -> FloatArray:
        x = SPEED_M_S * t
        slid = offset + np.array([0.0, 0.0, self.stroke(t) if offset[0] < 0.0 else 0.0])
        return np.array([x, 0.0, DESIGN_M + self.ground(x)]) + self.rotation(t) @ slid

    def _point(self, t: float, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
        step = 1e-4
        speed = (self._place(t + step, offset) - self._place(t - step, offset)) / (2.0 * step)
        return self._place(t, offset), speed


MOUNTS = {"gnss": (BLADE_M, 0.0, 2.0), "ahrs": (BLADE_M, 0.0, MAST_M), "reference": (BLADE_M, 0.0, 0.0)}


def info(name: str, kind: str, columns: tuple[str, ...], *, body: str, x: float = 0.0, **rest: Any) -> SensorInfo:
    return SensorInfo(
        name=name, kind=kind, columns=columns, mount=Mount(body=body, xyz_m=(x, 0.0, 0.0), **rest), rate_hz=50.0
    )


CHASSIS = info("chassis", "ahrs", ("pitch_rad",), body="chassis")
STROKE = info("stroke", "displacement_transducer", ("displacement_m",), body="chassis")
BLADE = info("ahrs", "ahrs", ("pitch_rad", "heading_rad"), body="plate", x=0.0)


def setup_of(*sensors: SensorInfo, runs: int = 1, wheelbase_m: float = WHEELBASE_M) -> EstimatorSetup:
    return EstimatorSetup(
        name="ours",
        runs=runs,
        sensors={each.name: each for each in sensors},
        reference=Mount(body="plate", xyz_m=(0.0, 0.0, 0.0)),
        rows_y_m=(),
        start_e_n_heading=(0.0, 0.0, 0.0),
        design_height_m=DESIGN_M,
        wheelbase_m=wheelbase_m,
        reference_x_m=BLADE_M,
    )


class _Reading:
    """What the aid needs of a receiver's sample."""

    def __init__(self, t_ns: int, speed: float) -> None:
        self.t_ns = t_ns
        self.level_m_s = np.array([[speed], [0.0]])
        self.level_known = np.array([True])


def rises(machine: Carrier, *, until_s: float, speed: float = SPEED_M_S, turn_rad_s: float = 0.0) -> list[Any]:
    """Times, what the aid says of the AHRS's vertical speed, and what that is, without any error of a sensor."""
    aid = ProfileAid(CHASSIS, STROKE, BLADE, setup_of(CHASSIS, STROKE, BLADE))
    found: list[Any] = []
    before_s, at = 0.0, np.array([BLADE_M, 0.0, 0.0])
    for step in range(1, round(until_s * 50.0) + 1):
        t, t_ns = step / 50.0, step * 20_000_000
        for name, values in (
            ("chassis", [machine.pitch(t)]),
            ("stroke", [machine.stroke(t)]),
            ("ahrs", [machine.pitch(t), turn_rad_s * t]),
        ):
            aid.hear(_measurement(name, t_ns, tuple(values)))
        if step % 5:
            continue
        (here, now), (there, then) = machine._point(t, at), machine._point(before_s, at)
        sums = np.zeros((SUMS, 1))
        sums[GAIN_V], sums[GAIN_H] = now[2] - then[2], here[2] - there[2] - then[2] * (t - before_s)
        aid.advance(sums, t - before_s, t_ns)
        before_s = t
        rise: Rise = aid.look(_Reading(t_ns, speed), None)  # type: ignore[arg-type]
        if rise.known[0]:
            found.append((t, float(rise.speed_m_s[0]), now[2], float(rise.over_s[0])))
    return found


def _measurement(name: str, t_ns: int, values: tuple[float, ...]) -> Measurement:
    columns = {"chassis": CHASSIS, "stroke": STROKE, "ahrs": BLADE}[name].columns
    return Measurement(
        sensor=name,
        t_ns=t_ns,
        t_available_ns=t_ns,
        columns=columns,
        values=np.array([values]),
        valid=np.array([True]),
    )


def test_uphill_is_up() -> None:
    """On a plane slope of 3 % the implement rises with 30 mm/s."""
    found = rises(Carrier(waves=(), slope=0.03, stroke_m=0.0), until_s=10.0)
    assert len(found) >= 6
    for _, said, true, over_s in found:
        assert true == pytest.approx(0.03, abs=1e-9)
        assert said == pytest.approx(true, abs=1e-6)
        assert over_s == pytest.approx(TAU_S)


def test_over_waves_with_a_moving_slide() -> None:
    """What is left is the parabola between the filter's spans: under 1 mm/s, where the speed is 20 mm/s and more."""
    found = rises(Carrier(), until_s=40.0)
    said, true = np.array([each[1:3] for each in found]).T
    assert true.std() > 0.02
    assert np.abs(said - true).max() < 1e-3


@pytest.mark.parametrize(("speed", "turn_rad_s"), [(0.2, 0.0), (1.0, 0.2), (0.0, 0.0)])
def test_nothing_is_said_slow_or_turning(speed: float, turn_rad_s: float) -> None:
    assert not rises(Carrier(), until_s=10.0, speed=speed, turn_rad_s=turn_rad_s)


def test_a_nose_too_low_reads_as_sinking() -> None:
    """An AHRS that says 1 mrad too much nose-down makes v times that of sinking: the weight of its state."""
    aid = ProfileAid(CHASSIS, STROKE, BLADE, setup_of(CHASSIS, STROKE, BLADE))
    layout = Layout.of(drift=False, coarse=False, speed=False, leak=False, tilt=False, pitch=True)
    one = np.array([1.0])
    rise = Rise(one > 0.0, 0.0 * one, TAU_S * one, one, one)
    x = np.zeros((1, layout.size))
    assert layout.pitch is not None
    x[0, layout.pitch] = 1e-3
    assert aid.observe(rise, layout).h(x)[0, 0] == pytest.approx(-1e-3 * SPEED_M_S)


# --- with real sensors -----------------------------------------------------------------------------------------------


class _Stroke:
    """Stands between the bench and an estimator and adds the transducer, which is not a point that moves."""

    def __init__(self, inner: Estimator, machine: Carrier, runs: range) -> None:
        self._inner, self._machine = inner, machine
        config = CONFIGS.validate_python({"mount": "stroke", **load_preset("lift_stroke")})
        self._sensor = build_sensor(
            config, name="stroke", mount=Mount(body="chassis", xyz_m=(0.0, 0.0, 0.0)), dt_ns=DT_NS, seed=1, runs=runs
        )
        self.columns, self.state_columns = inner.columns, inner.state_columns

    def process(self, measurement: Measurement) -> None:
        while self._sensor.next_tick * DT_NS <= measurement.t_ns:
            t_ns = self._sensor.next_tick * DT_NS
            stroke = self._machine.stroke(t_ns / NS_PER_S)
            motion = JointMotion(t_ns=t_ns, position_enu_m=np.zeros(3), position=np.array([stroke]))
            for each in self._sensor.sample(motion).measurements:
                self._inner.process(each)
        self._inner.process(measurement)

    def estimate(self, t_ns: int) -> Estimate:
        return self._inner.estimate(t_ns)


def over_ground(
    options: dict[str, dict[str, Any]],
    *,
    members: range,
    duration_s: float,
    lost_s: float,
    machine: Carrier,
    receiver: str = "rtk_chcnav_i70",
    **changes: Any,
) -> dict[str, Result]:
    faults = [
        {"kind": "corrections_lost", "from_s": lost_s, "to_s": duration_s},
        {"kind": "latency_step", "latency_s": 0.5, "from_s": 11.0, "to_s": 12.0},
    ]
    gnss = make_sensor("gnss", receiver, machine, runs=members, faults=faults, **changes)
    ahrs = make_sensor("ahrs", "ahrs_mti300", machine, runs=members)
    config = CONFIGS.validate_python({"mount": "chassis", **load_preset("ahrs_mti300")})
    place = Mount(body="chassis", xyz_m=(0.0, 0.0, 0.0))
    chassis = build_sensor(config, name="chassis", mount=place, dt_ns=DT_NS, seed=1, runs=members)
    sensors = {each.name: each.info for each in (gnss, ahrs, chassis)} | {"stroke": STROKE}
    setup = EstimatorSetup(
        name="ours",
        runs=len(members),
        sensors=sensors,
        reference=Mount(body="plate", xyz_m=MOUNTS["reference"]),
        rows_y_m=(),
        start_e_n_heading=(0.0, 0.0, 0.0),
        design_height_m=DESIGN_M,
        wheelbase_m=WHEELBASE_M,
        reference_x_m=BLADE_M,
    )
    built: dict[str, Estimator] = {
        name: _Stroke(
            build_estimator(HeightFilterConfig(kind="height_filter", sensors=tuple(sensors), **each), setup),
            machine,
            members,
        )
        for name, each in options.items()
    }
    return drive(built, [gnss, ahrs, chassis], machine, duration_s=duration_s)


def said(result: Result, member: int) -> FloatArray:
    return np.stack([result.error_m[:, member], result.sigma_m[:, member], result.velocity_error_m_s[:, member]])


@pytest.mark.parametrize("tilt", [True, False])
def test_engines_agree_and_a_member_is_its_run(*, tilt: bool) -> None:
    machine = Carrier(mounts=MOUNTS)
    options = {"one": {"engine": "filterpy", "tilt": tilt}, "other": {"engine": "ensemble", "tilt": tilt}}
    alone = over_ground(options, members=range(1, 2), duration_s=18.0, lost_s=13.0, machine=machine)
    together = over_ground({"ours": {"tilt": tilt}}, members=range(3), duration_s=18.0, lost_s=13.0, machine=machine)
    assert np.isfinite(alone["one"].extra["nis_profile"]).sum() > 10
    for other in (said(alone["other"], 0), said(together["ours"], 1)):
        assert (np.abs(said(alone["one"], 0) - other) <= 1e-9 * (1.0 + np.abs(other))).all()


@pytest.fixture(scope="module")
def lost() -> dict[str, Result]:
    """150 members, a trim of 3 mrad, 25 s without fixes after 40 s with them."""
    return over_ground(
        {"ours": {}, "without": {"profile": False}, "without_both": {"profile": False, "vertical_speed": False},
         "no_speed": {"vertical_speed": False}},
        members=range(150), duration_s=65.0, lost_s=30.0, machine=Carrier(mounts=MOUNTS, trim_rad=0.003),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["ours", "no_speed"])
def test_sigma_is_honest_while_coasting(lost: dict[str, Result], name: str) -> None:
    """99 % of 150 members have a standard error of 0.8 %; a second's sigma is told to 1 / sqrt(300), three times over.

    Each 150 members are about one sample of a slow error.
    """
    found = honesty(lost[name], 40.0)
    assert found.inside >= 0.99 - 2.0 * 0.008
    assert found.worst_bin_inside >= 0.99 - 4.0 * 0.008
    assert found.worst_ratio <= 1.5
    assert found.least_ratio >= 1.0 - 3.0 / math.sqrt(300.0)


def test_the_carriers_trim_is_no_climb(lost: dict[str, Result]) -> None:
    """3 mrad of trim would be 75 mm after 25 s; it is learnt while fixes are good, to well under what they err by."""
    assert abs(lost["no_speed"].error_m[-1].mean()) <= 4.0 * lost["no_speed"].sigma_m[-1].mean() / math.sqrt(150.0)


def test_it_pays(lost: dict[str, Result]) -> None:
    end = {name: result.sigma_m[-1].mean() for name, result in lost.items()}
    assert end["ours"] < end["without"]
    assert end["no_speed"] < 0.5 * end["without_both"]


# --- what is refused -------------------------------------------------------------------------------------------------


def build(*sensors: SensorInfo, wheelbase_m: float = WHEELBASE_M, **options: Any) -> Estimator:
    machine = Carrier(mounts=MOUNTS)
    real = [make_sensor(name, preset, machine, runs=[0]).info
            for name, preset in (("gnss", "rtk_chcnav_i70"), ("ahrs", "ahrs_mti300"))]  # fmt: skip
    setup = setup_of(*real, *sensors, wheelbase_m=wheelbase_m)
    return build_estimator(HeightFilterConfig(kind="height_filter", sensors=tuple(setup.sensors), **options), setup)


@pytest.mark.parametrize("sensor", [CHASSIS, STROKE])
def test_one_without_the_other_is_an_error(sensor: SensorInfo) -> None:
    with pytest.raises(BadInputError, match="ground's profile needs one"):
        build(sensor)
    assert "nis_profile" not in build(sensor, profile=False).columns


def test_both_are_the_aid_and_none_is_none() -> None:
    assert "nis_profile" in build(CHASSIS, STROKE).columns
    assert "nis_profile" not in build().columns


def test_without_a_wheelbase_or_turned() -> None:
    with pytest.raises(BadInputError, match="no wheelbase"):
        build(CHASSIS, STROKE, wheelbase_m=0.0)
    turned = info("chassis", "ahrs", ("pitch_rad",), body="chassis", rpy_rad=(0.0, 0.1, 0.0))
    with pytest.raises(BadInputError, match="turned on its mount"):
        build(turned, STROKE)
