"""The shared error processes against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.sensors.converter import converter
from twin.sensors.noise import (
    GaussMarkov,
    LowPass,
    OccasionalNormals,
    RandomWalk,
    Streams,
    WhiteNoise,
    first_order_tau_s,
    noise_sigma,
    sensitivity_matrices,
)
from twin.signals import FloatArray


def streams(runs: int) -> Streams:
    return Streams(seed=3, runs=tuple(range(runs)), name="test")


def allan(values: FloatArray, m: int) -> float:
    """Allan deviation of series (T, R) at m samples, over all runs: rms of neighbouring cluster means / sqrt 2."""
    length = len(values) // m * m
    means = values[:length].reshape(-1, m, values.shape[1]).mean(axis=1)
    return float(np.sqrt(np.mean(np.diff(means, axis=0) ** 2) / 2.0))


def series(process: WhiteNoise | GaussMarkov | RandomWalk, steps: int) -> FloatArray:
    """(steps, R) of the first column."""
    return np.stack([process.step()[:, 0].copy() for _ in range(steps)])


def gauss_markov(*, sigma: float, tau_s: float, period_s: float, runs: int) -> GaussMarkov:
    source = streams(runs)
    return GaussMarkov(
        sigma=[sigma],
        tau_s=tau_s,
        period_s=period_s,
        stream=source.normal("gm", 1),
        start=source.once("gm_start", 1),
    )


def test_allan_deviation_of_white_noise_has_slope_minus_half_and_the_data_sheet_value_at_one_second() -> None:
    # One-sided density D: two-sided D^2/2, so Allan's N = D/sqrt(2), read at 1 s. 16 runs of 400 s give 6400 clusters
    # of 1 s: relative standard error 1/sqrt(2*6400) = 0.9 % (more, sqrt(3/2), for neighbouring differences); four: 5 %.
    density, rate_hz = 2e-4, 50.0
    sigma = noise_sigma(density=density, rate_hz=rate_hz, bandwidth_hz=None)
    values = series(WhiteNoise(sigma=[sigma], stream=streams(16).normal("white", 1)), 20_000)
    assert allan(values, 50) == pytest.approx(density / math.sqrt(2.0), rel=0.05)
    # At 8 s there are 800 clusters: 3 % each; the slope over a factor 80 in time is then good to 0.03*4/ln(80) = 0.03.
    slope = math.log(allan(values, 400) / allan(values, 5)) / math.log(80.0)
    assert slope == pytest.approx(-0.5, abs=0.03)


def test_first_order_bandwidth_sets_variance_and_correlation_of_noise() -> None:
    # Noise bandwidth of a first-order filter: pi/2 of its corner; sampled, its autocorrelation is e^{-2 pi BW T}.
    density, bandwidth_hz, period_s, runs = 4e-3, 5.0, 0.02, 4000
    sigma = noise_sigma(density=density, rate_hz=1 / period_s, bandwidth_hz=bandwidth_hz)
    assert sigma**2 == pytest.approx(density**2 * 1.5708 * bandwidth_hz, rel=1e-4)
    process = gauss_markov(sigma=sigma, tau_s=first_order_tau_s(bandwidth_hz), period_s=period_s, runs=runs)
    first, second = series(process, 2)
    # Standard error of a variance over 4000 runs: sqrt(2/4000) = 2.2 %; of a correlation: (1 - r^2)/sqrt(4000) = 0.011.
    assert np.var(first) == pytest.approx(sigma**2, rel=4 * 0.0224)
    expected = math.exp(-2 * math.pi * bandwidth_hz * period_s)
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(expected, abs=4 * 0.011)


def test_gauss_markov_is_stationary_from_the_start_and_falls_to_1_e_in_its_correlation_time() -> None:
    runs, steps = 4000, 50
    process = gauss_markov(sigma=0.3, tau_s=10.0, period_s=0.2, runs=runs)
    values = series(process, steps + 1)
    for k in (0, steps):
        assert np.var(values[k]) == pytest.approx(0.09, rel=4 * 0.0224)
    # Lag 50 * 0.2 s = tau.
    assert np.corrcoef(values[0], values[steps])[0, 1] == pytest.approx(math.exp(-1.0), abs=4 * (1 - math.e**-2) / 63.2)


def test_gauss_markov_allan_deviation_peaks_at_0618_sigma() -> None:
    # 0.437 q sqrt(tau) with q = sigma sqrt(2/tau), at 1.89 tau: 38 samples of tau = 20. 64 runs of 105 clusters: 6700
    # differences, relative standard error near 1 %.
    values = series(gauss_markov(sigma=1.0, tau_s=20.0, period_s=1.0, runs=64), 4000)
    peak = allan(values, 38)
    assert peak == pytest.approx(0.618, rel=0.05)
    assert allan(values, 4) < peak
    assert allan(values, 300) < peak


def test_random_walk_variance_grows_with_time_from_its_start() -> None:
    source = streams(4000)
    process = RandomWalk(density=[0.1], period_s=0.5, stream=source.normal("walk", 1), start=np.full((4000, 1), 7.0))
    last = series(process, 80)[-1]
    # K^2 t = 0.01 * 40 s; standard error of the mean sigma/sqrt(4000).
    assert np.var(last) == pytest.approx(0.4, rel=4 * 0.0224)
    assert np.mean(last) == pytest.approx(7.0, abs=4 * math.sqrt(0.4 / 4000))


def test_low_pass_has_the_exact_step_response_and_starts_settled() -> None:
    low_pass = LowPass(tau_s=[0.5], period_s=0.1)
    assert low_pass.step(np.array([[2.0]]))[0, 0] == 2.0
    response = [low_pass.step(np.array([[3.0]]))[0, 0] for _ in range(10)]
    times = 0.1 * np.arange(1, 11)
    np.testing.assert_allclose(response, 3.0 - np.exp(-times / 0.5), rtol=1e-12)


def test_converter_rounds_to_its_lsb_and_clips_at_its_codes() -> None:
    quantiser = converter(full_scale=[2.0, None], bits=4)
    # LSB = 2 * 2 / 16; codes -8 to 7.
    assert quantiser.lsb.tolist() == [0.25, 0.0]
    values = quantiser.apply(np.array([[0.12, 0.12], [0.13, 9.0], [5.0, 5.0], [-5.0, -5.0]]))
    np.testing.assert_array_equal(values, [[0.0, 0.12], [0.25, 9.0], [1.75, 5.0], [-2.0, -5.0]])


def test_sensitivity_puts_scale_misalignment_and_tilt_where_they_belong() -> None:
    nothing = np.zeros((1, 6))
    scaled = sensitivity_matrices(scale=np.array([[0.1, 0.0, -0.2]]), misalignment=nothing)
    np.testing.assert_allclose(scaled[0], np.diag([1.1, 1.0, 0.8]))
    crossed = sensitivity_matrices(scale=np.zeros((1, 3)), misalignment=np.array([[1, 2, 3, 4, 5, 6]]) * 0.01)
    np.testing.assert_allclose(crossed[0], [[1, 0.01, 0.02], [0.03, 1, 0.04], [0.05, 0.06, 1]])
    # Mounted nose down by 0.1 rad (positive pitch in FLU), at rest: the reaction +g on z leans backwards, onto -x.
    tilted = sensitivity_matrices(
        scale=np.zeros((1, 3)), misalignment=nothing, tilt_rpy_rad=np.array([[0.0, 0.1, 0.0]])
    )
    np.testing.assert_allclose(tilted[0] @ [0, 0, 9.8], [-9.8 * math.sin(0.1), 0, 9.8 * math.cos(0.1)])


def test_occasional_normals_of_a_run_do_not_depend_on_how_many_others_use() -> None:
    def numbers(runs: tuple[int, ...], speeds: tuple[int, ...]) -> list[float]:
        """What run 7, the last, sees if in every step each run uses so many."""
        pool = OccasionalNormals(streams=Streams(seed=1, runs=runs, name="x"), process="p", least=2)
        seen: list[float] = []
        for _ in range(50):
            seen += pool.values[-1, pool.used[-1] : pool.used[-1] + speeds[-1]].tolist()
            pool.used += np.array(speeds)
            pool.top_up(int(pool.used.max()))
        return seen

    alone = numbers((7,), (1,))
    assert len(set(alone)) == 50
    assert numbers((3, 7), (2, 1)) == alone
    assert numbers((3, 7), (0, 1)) == alone
