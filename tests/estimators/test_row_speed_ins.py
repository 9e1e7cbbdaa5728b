"""Row speeds by strapdown navigation, from samples to estimates, over synthetic drives."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.estimators.planter import (
    IMU_COLUMNS,
    IMU_ROWS,
    IMUS,
    ROWS_Y,
    STEP_NS,
    STEP_S,
    G,
    imu_info,
    make_setup,
    measurement,
    profile,
    radar,
    receiver,
    report,
    sensors,
)
from tests.estimators.test_row_speed_ekf import column, member, play
from twin.errors import BadInputError
from twin.estimators import build_estimator
from twin.estimators.ins_build import RowSpeedInsConfig
from twin.estimators.ins_model import BA, PITCH
from twin.estimators.row_speed_ins import RowSpeedIns
from twin.signals import EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

IMU_SHEET = {
    "accel_noise_m_s2": 0.22,
    "gyro_noise_rad_s": 1e-3,
    "accel_bias_m_s2": 0.48,
    "gyro_bias_rad_s": 0.0467,
}
RADAR_SHEET = {"lag_speeding_up_s": 0.2, "lag_braking_s": 0.7, "mounting_angle_rad": math.radians(35.0)}
ROW_COLUMNS = [f"row_speed_{row}_m_s" for row in (1, 4, 5, 8)]
MAST_M = 2.0


def make(setup: EstimatorSetup, **options) -> RowSpeedIns:
    config = RowSpeedInsConfig(kind="row_speed_ins", sensors=tuple(setup.sensors), **options)
    built = build_estimator(config, setup)
    assert isinstance(built, RowSpeedIns)
    return built


def setup_of(*, runs: int = 1, gnss: bool = True, noise_m_s: float = 0.011) -> EstimatorSetup:
    infos = {name: replace(info, datasheet=IMU_SHEET) for name, info in sensors().items() if name != "radar"}
    infos["radar"] = replace(sensors()["radar"], datasheet={**RADAR_SHEET, "speed_noise_m_s": noise_m_s})
    if gnss:
        infos["gnss"] = receiver("gnss", datasheet={"position_noise_m": 0.003, "speed_noise_m_s": 0.01})
    return make_setup(infos, runs=runs)


@dataclass
class Drive:
    """Straight to the east up a slope, or round a level circle (then without GNSS), with everything the sensors say."""

    speed: FloatArray
    rate: FloatArray
    slope: float = 0.0
    runs: int = 1
    noisy: bool = True
    bias: tuple[float, ...] = (0.0,) * 6
    gnss: bool = True
    seed: int = 0

    def ticks(self) -> list[list[Measurement]]:
        rng = np.random.default_rng(self.seed)
        size = 1.0 if self.noisy else 0.0
        nose_up = math.atan(self.slope)
        accel = np.diff(self.speed, prepend=0.0) / STEP_S
        turning = np.diff(self.rate, prepend=0.0) / STEP_S
        way = np.cumsum(self.speed) * STEP_S
        lagged, ticks = 0.0, []
        for k, (v, w) in enumerate(zip(self.speed, self.rate, strict=True)):
            t_ns, tick = (k + 1) * STEP_NS, []
            for name, row in zip(IMUS, IMU_ROWS, strict=True):
                y = ROWS_Y[row - 1]
                force = [accel[k] + G * math.sin(nose_up) - turning[k] * y, v * w - w * w * y, G * math.cos(nose_up)]
                noise = size * rng.normal(size=(self.runs, 6)) * np.repeat([0.22, 1e-3], 3)
                values = np.array([*force, 0.0, 0.0, w]) + np.array(self.bias) + noise
                tick.append(measurement(name, t_ns, values, columns=IMU_COLUMNS))
            before = self.speed[k - 1] if k else 0.0
            seen = 0.5 * (v + before)
            lagged += (1.0 - math.exp(-STEP_S / (0.7 if seen < lagged - 0.05 else 0.2))) * (seen - lagged)
            reads = lagged + size * 0.011 * rng.normal(size=self.runs)
            tick.append(radar(t_ns, np.where(lagged < 0.13, 0.0, reads)))
            if self.gnss and k % 5 == 4:
                east = way[k] * math.cos(nose_up) - MAST_M * math.sin(nose_up)
                noise = size * rng.normal(size=(3, self.runs)) * np.array([[0.001], [0.001], [0.01]])
                shown = np.abs(v * math.cos(nose_up) + noise[2])
                tick.append(report("gnss", t_ns, east + noise[0], noise[1], shown, sigma_m=0.003))
            ticks.append(tick)
        return ticks


STOP_AND_GO = profile((3.0, 0.0, 0.0), (5.0, 2.5, 0.0), (10.0, 2.5, 0.0), (4.0, 0.0, 0.0), (7.0, 0.0, 0.0))


def test_on_a_slope_of_5_percent_gravity_is_not_taken_for_acceleration_and_no_calibration_is_needed() -> None:
    """Unknown biases of data-sheet size (0.4 m/s^2, 0.04 rad/s), 2.8 degrees nose up, from a stand.

    With a speed seen to 0.05 m/s at 50 Hz before the lag and to 0.01 m/s at 10 Hz, and 0.11 m/s^2 of noise in a step,
    a steady filter knows the speed to less than sqrt(0.11 x 0.02 x 0.05) = 0.0105 m/s (the radar alone, without lag),
    mean absolute 0.0084; the rows add the gyroscopes' 5e-4 x 2.6 = 1.3 mm/s. Taken for acceleration, gravity would be
    0.49 m/s^2, 0.5 m/s within a second.
    """
    speed, rate = profile((4.0, 0.0, 0.0), (5.0, 2.5, 0.0), (25.0, 2.5, 0.0))
    estimator = make(setup_of())
    bias = (0.4, -0.3, 0.2, 0.03, -0.02, 0.04)
    estimates = play(estimator, Drive(speed, rate, slope=0.05, bias=bias).ticks())
    driving = np.arange(len(speed)) * STEP_S > 9.0
    for name in ("speed_m_s", *ROW_COLUMNS):
        error = column(estimator, estimates, name)[:, 0] - speed * math.cos(math.atan(0.05))
        assert np.abs(error[driving]).mean() < 0.0084 + 0.0013, name
    # What gravity and bias add to the longitudinal axis is known together (apart only in turns).
    x = estimator.filter.engine.x[0]
    felt = -G * math.sin(x[PITCH]) + x[BA]
    assert felt == pytest.approx(G * math.sin(math.atan(0.05)) + 0.4, abs=0.03)


def test_the_tilt_itself_is_found_with_accelerometers_that_are_known() -> None:
    """Without a bias in the data sheet the cross-axis share of gravity is left, 0.01 g / 2 = 0.05 m/s^2 or 5 mrad, to
    the 0.1 rad of tilt at the start: the tilt is found to a share of 5^2 / 100^2 and the noise."""
    infos = {name: replace(info, datasheet={"accel_noise_m_s2": 0.22}) for name, info in setup_of().sensors.items()}
    estimator = make(make_setup(infos))
    play(estimator, Drive(*profile((20.0, 0.0, 0.0)), slope=0.05).ticks())
    # Nose up is negative. 0.11 m/s^2 of noise over 1000 samples: 0.4 mrad.
    assert estimator.filter.engine.x[0, PITCH] == pytest.approx(-math.atan(0.05), abs=2e-3)


def test_the_radar_s_lag_is_taken_out_of_a_start_and_a_stop() -> None:
    """0.5 m/s^2 up and 0.6 m/s^2 down: the radar trails by 0.10 and by up to 0.42 m/s; the filter does not."""
    speed, rate = profile((3.0, 0.0, 0.0), (5.0, 2.5, 0.0), (8.0, 2.5, 0.0), (3.0, 0.7, 0.0))
    drive = Drive(speed, rate, gnss=False)
    ticks = drive.ticks()
    estimator = make(setup_of(gnss=False))
    estimates = play(estimator, ticks)
    error = np.abs(column(estimator, estimates, "speed_m_s")[:, 0] - speed)
    shown = np.array([tick[-1].values[0, 0] for tick in ticks])
    up, down = slice(200, 400), slice(850, 950)
    assert np.abs(shown - speed)[up].mean() > 0.08
    assert np.abs(shown - speed)[down].mean() > 0.3
    assert error[up].mean() < 0.03
    assert error[down].mean() < 0.1  # the wrong time constant for the first 0.1 s, and then a quarter of the lag


def test_rows_on_a_circle() -> None:
    """2.5 m/s, 0.25 rad/s to the left: row at y goes 2.5 - 0.25 y; without noise, to what the start leaves."""
    speed, rate = profile((3.0, 0.0, 0.0), (5.0, 2.5, 0.0), (25.0, 2.5, 0.25))
    estimator = make(setup_of(gnss=False))
    last = play(estimator, Drive(speed, rate, gnss=False, noisy=False).ticks())[-1]
    values = dict(zip(estimator.columns, last.values[0], strict=True))
    for row, y in enumerate(ROWS_Y, start=1):
        assert values[f"row_speed_{row}_m_s"] == pytest.approx(2.5 - 0.25 * y, abs=0.02)
    assert values["yaw_rate_rad_s"] == pytest.approx(0.25, abs=0.002)
    assert values["standstill"] == 0.0


def test_standing_is_seen_at_both_ends_and_not_between() -> None:
    """After braking with 0.625 m/s^2 the accelerometers' mean over 2 s has to come back to within 0.12 m/s^2 (four
    units, four sigma): 2 ln(5) = 3.3 s, and some noise."""
    speed, rate = STOP_AND_GO
    estimator = make(setup_of())
    estimates = play(estimator, Drive(speed, rate).ticks())
    standing = column(estimator, estimates, "standstill")[:, 0] == 1.0
    t_s = np.arange(1, len(speed) + 1) * STEP_S
    assert standing[(t_s > 1.0) & (t_s < 3.0)].mean() > 0.98
    assert not standing[(t_s > 3.25) & (t_s < 21.8)].any()  # a quarter of a second after the start
    assert standing[t_s > 26.5].mean() > 0.95
    assert np.abs(column(estimator, estimates, "speed_m_s")[t_s > 26.5]).max() < 0.02


# --- ensembles ------------------------------------------------------------------------------------------------------


def lossy(ticks: list[list[Measurement]], runs: int, seed: int) -> list[list[Measurement]]:
    """Every sample lost in a tenth of the members, and half of what the radar says; NaN for some more."""
    rng = np.random.default_rng(seed)

    def cut(m: Measurement) -> Measurement:
        valid = rng.random(runs) > (0.5 if m.sensor == "radar" else 0.1)
        values = np.where(valid[:, np.newaxis], m.values, np.nan)
        values[rng.random(runs) < 0.02] = np.nan
        return replace(m, values=values, valid=valid)

    return [[cut(m) for m in tick] for tick in ticks]


@pytest.mark.parametrize("engine", ["filterpy", "ensemble"])
def test_every_member_equals_its_single_run(engine: str) -> None:
    """In a single run what is lost does not arrive at all."""
    runs, (speed, rate) = 3, profile((2.0, 0.0, 0.0), (3.0, 1.5, 0.0), (1.5, 0.0, 0.0), (1.5, 0.0, 0.0))
    ticks = lossy(Drive(speed, rate, runs=runs, seed=3).ticks(), runs, seed=4)
    together = make(setup_of(runs=runs))
    expected = np.array([each.values for each in play(together, ticks)])
    assert 0.1 < expected[:, :, together.columns.index("standstill")].mean() < 0.7
    for index in range(runs):
        alone = make(setup_of(), engine=engine)
        arriving = [[m for m in tick if m.valid[0]] for tick in member(ticks, index)]
        found = np.array([each.values[0] for each in play(alone, arriving)])
        np.testing.assert_allclose(found, expected[:, index], rtol=1e-9, atol=1e-9)


def test_repeats_and_what_is_no_number_change_nothing() -> None:
    speed, rate = profile((2.0, 0.0, 0.0), (3.0, 1.5, 0.0), (3.0, 1.5, 0.0))
    ticks = Drive(speed, rate, seed=5).ticks()
    troubled = []
    for tick in ticks:
        nothing = [
            replace(m, t_ns=m.t_ns + 1_000_000, values=np.full_like(m.values, np.nan))
            for m in tick
            if m.sensor in ("radar", "gnss")
        ]
        troubled.append([*tick, *tick, *nothing])
    plain, other = make(setup_of()), make(setup_of())
    for a, b in zip(play(plain, ticks), play(other, troubled), strict=True):
        for name in ("speed_m_s", "position_e_m", "heading_rad", *ROW_COLUMNS):
            place = plain.columns.index(name)
            np.testing.assert_allclose(b.values[:, place], a.values[:, place], rtol=1e-9, atol=1e-9)


TROUBLES = ["none", "none", "late", "lost", "nan", "spike", "twice", "ahead", "infinite"]


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), stop=st.booleans(), hard=st.floats(0.0, 1.0))
def test_whatever_arrives_and_when_the_estimates_stay_finite_and_their_covariance_one(
    seed: int, stop: bool, hard: float
) -> None:
    """Samples late by up to 1.5 s, lost, repeated, not a number, wild, or from a clock that is ahead, of any sensor."""
    speed, rate = profile((0.6, 0.0, 0.0), (1.0, 1.5, 0.0), (0.8, 0.0 if stop else 1.5, 0.0))
    rng = np.random.default_rng(seed)
    arrivals: list[Measurement] = []
    for m in (m for tick in Drive(speed, rate, runs=2, seed=1).ticks() for m in tick):
        trouble = rng.choice(TROUBLES) if rng.random() < hard else "none"
        values = m.values.copy()
        member = rng.integers(2)
        if trouble == "spike":
            size = 4.0 if m.sensor in IMUS else 10.0 ** rng.integers(0, 5)  # units clip at their range
            values[member] += rng.choice([-1.0, 1.0]) * size
        if trouble in ("nan", "infinite"):
            values[member, rng.integers(values.shape[1])] = math.nan if trouble == "nan" else math.inf
        late_ns = STEP_NS * int(rng.integers(1, 75)) if trouble == "late" else 0
        ahead_ns = STEP_NS * int(rng.integers(1, 30)) if trouble == "ahead" else 0
        arriving = replace(m, values=values, t_ns=m.t_ns + ahead_ns, t_available_ns=m.t_ns + late_ns)
        copies = {"lost": 0, "twice": 2}.get(str(trouble), 1)
        arrivals += [arriving] * copies
    arrivals.sort(key=lambda m: m.t_available_ns)
    estimator = make(setup_of(runs=2))
    told = 0
    for k in range(len(speed)):
        while told < len(arrivals) and arrivals[told].t_available_ns <= (k + 1) * STEP_NS:
            estimator.process(arrivals[told])
            told += 1
        said = estimator.estimate((k + 1) * STEP_NS)
        assert np.isfinite(said.values[:, : estimator.columns.index("standstill")]).all()
        P = estimator.filter.engine.P
        scale = np.sqrt(np.einsum("rii->ri", P))
        assert (scale > 0.0).all()
        correlation = P / (scale[:, :, np.newaxis] * scale[:, np.newaxis, :])
        np.testing.assert_allclose(correlation, correlation.transpose(0, 2, 1), atol=1e-8)
        assert np.linalg.eigvalsh(correlation).min() > -1e-8


# --- hindsight ------------------------------------------------------------------------------------------------------


def hindsight(offset_ns: int) -> tuple[FloatArray, FloatArray]:
    """East in hindsight and what the filter said, asked ``offset_ns`` after every tick."""
    speed, rate = profile((2.0, 0.0, 0.0), (3.0, 2.0, 0.0), (5.0, 2.0, 0.0))
    estimator = make(setup_of(), hindsight=True)
    said = []
    for k, tick in enumerate(Drive(speed, rate, seed=6).ticks()):
        for m in tick:
            estimator.process(m)
        said.append(estimator.estimate((k + 1) * STEP_NS + offset_ns))
    place = estimator.columns.index("position_e_m")
    smoothed = list(estimator.hindsight())
    assert [each.t_ns for each in smoothed] == [each.t_ns for each in said]
    return np.array([each.values[0, place] for each in smoothed]), np.array([each.values[0, place] for each in said])


def test_hindsight_is_about_the_time_that_was_asked_for() -> None:
    """Half a step later at 2 m/s is 20 mm further."""
    on_tick, between = hindsight(0)[0], hindsight(STEP_NS // 2)[0]
    np.testing.assert_allclose((between - on_tick)[300:], 0.02, atol=0.001)


def test_hindsight_errs_less_than_the_filter() -> None:
    """Mean over five seeds of the speed's error while driving."""
    speed, rate = profile((2.0, 0.0, 0.0), (3.0, 2.0, 0.0), (5.0, 2.0, 0.0))
    errors = []
    for seed in range(5):
        estimator = make(setup_of(), hindsight=True)
        said = play(estimator, Drive(speed, rate, seed=seed).ticks())
        pair = [column(estimator, each, "speed_m_s")[150:450, 0] for each in (said, list(estimator.hindsight()))]
        errors.append([np.abs(each - speed[150:450]).mean() for each in pair])
    mean = np.mean(errors, axis=0)
    assert mean[1] < 0.8 * mean[0]


def test_hindsight_keeps_at_most_eight_runs() -> None:
    assert make(setup_of(runs=8), hindsight=True).says_in_hindsight
    with pytest.raises(BadInputError, match=r"\[estimators.central\] hindsight: .* at most 8 runs at once, not 9"):
        make(setup_of(runs=9), hindsight=True)


# --- wrong input ----------------------------------------------------------------------------------------------------


def without_units() -> dict[str, SensorInfo]:
    return {"radar": sensors()["radar"]}


def elsewhere() -> dict[str, SensorInfo]:
    return {**sensors(), "radar": replace(sensors()["radar"], mount=Mount(body="tractor", xyz_m=(0.0, 0.0, 0.5)))}


def unit_elsewhere() -> dict[str, SensorInfo]:
    return {
        **sensors(),
        "imu_1": imu_info("imu_1", (0.0, 0.0, 0.0), mount=Mount(body="tractor", xyz_m=(0.0, 0.0, 0.0))),
    }


def two_rates() -> dict[str, SensorInfo]:
    return {**sensors(), "imu_1": imu_info("imu_1", (0.0, 0.0, 0.0), rate_hz=25.0)}


def a_laser() -> dict[str, SensorInfo]:
    return {**sensors(), "laser": replace(sensors()["radar"], name="laser", kind="laser")}


def no_course() -> dict[str, SensorInfo]:
    return {**sensors(), "gnss": receiver("gnss", columns=("position_e_m", "position_n_m", "speed_m_s"))}


@pytest.mark.parametrize(
    ("infos", "says"),
    [
        (without_units(), "row_speed_ins needs at least one sensor of kind 'imu'"),
        (elsewhere(), "'radar' sits on 'tractor'.*'planter'"),
        (unit_elsewhere(), "'imu_1' sits on 'tractor'.*'planter'"),
        (two_rates(), "must share one rate.*imu_1 25 Hz.*imu_4 50 Hz"),
        (a_laser(), "'laser' is of kind 'laser'; row_speed_ins can use imu, radar, accosat, gnss"),
        (no_course(), "'gnss' gives no course_rad"),
    ],
)
def test_a_wrong_set_of_sensors_is_told_by_its_key(infos: dict[str, SensorInfo], says: str) -> None:
    with pytest.raises(BadInputError, match=rf"\[estimators.central\] sensors: .*{says}"):
        make(make_setup(infos))


def test_filterpy_steps_one_run() -> None:
    with pytest.raises(BadInputError, match=r"\[estimators.central\] engine = 'filterpy': .* not 2.*allowed: auto"):
        make(setup_of(runs=2), engine="filterpy")


@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0])
def test_units_of_any_rate_will_do(rate_hz: float) -> None:
    """Standing, then nothing but finite numbers and a standstill."""
    step_ns = round(1e9 / rate_hz)
    estimator = make(
        make_setup({"imu": imu_info("imu", (0.0, 0.0, 0.0), rate_hz=rate_hz), "radar": sensors()["radar"]})
    )
    rng = np.random.default_rng(1)
    for k in range(1, 60):
        values = np.array([0.0, 0.0, G, 0.0, 0.0, 0.0]) + rng.normal(size=6) * np.repeat([0.2, 1e-3], 3)
        estimator.process(measurement("imu", k * step_ns, values, columns=IMU_COLUMNS))
        estimator.process(radar(k * step_ns, 0.0))
        last = estimator.estimate(k * step_ns)
    assert np.isfinite(last.values[:, :13]).all()
    assert np.isfinite(last.covariance).all()
    assert abs(column(estimator, [last], "speed_m_s")[0, 0]) < 0.05
