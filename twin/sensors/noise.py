"""Error processes that the sensors share, each exact in discrete time and vectorised over the runs of an ensemble.

The error model of a vector sensor with n axes is one equation, in which only the last step is not linear::

    x_out = Q( T x + b + n )

``x`` (n,) is the truth; ``T`` (R, n, n) holds scale, misalignment and mounting tilt (:func:`sensitivity_matrices`);
``b`` (R, n) is the bias: the value at turn-on, which may wander (:class:`RandomWalk`), and an instability
(:class:`GaussMarkov`); ``n`` (R, n) is noise (:class:`WhiteNoise`, or :class:`GaussMarkov` behind a first-order
bandwidth); ``Q`` clips and rounds (:class:`Quantiser`). Every array has the run axis R first, and each run
is handled by itself, so that a member's numbers do not depend on the other members.

Noise densities are *one-sided*, as data sheets give them: white noise of density D through an ideal bandwidth B has
the variance D^2 B. In Allan's terms its coefficient N, read at tau = 1 s on the slope -1/2, is D / sqrt(2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.geometry import rotation_from_rpy
from twin.randomness import NormalStream, UniformStream, draw_per_run, value_generator
from twin.sensors import kernels
from twin.signals import FloatArray, IntArray

_BLOCK_VALUES = 400_000
"""Numbers a stream keeps at most (3.2 MB), so that hundreds of members fit into memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Streams:
    """Where one sensor's processes get their random numbers; each process has a name and a stream of its own."""

    seed: int
    runs: tuple[int, ...]
    name: str

    def normal(self, process: str, size: int) -> NormalStream:
        """Stream of standard normal numbers, (R, size) a step."""
        return NormalStream(
            seed=self.seed, runs=self.runs, name=f"{self.name}.{process}", size=size, block=self._block(size)
        )

    def uniform(self, process: str, size: int) -> UniformStream:
        """Stream of uniform numbers in [0, 1), (R, size) a step."""
        return UniformStream(
            seed=self.seed, runs=self.runs, name=f"{self.name}.{process}", size=size, block=self._block(size)
        )

    def once(self, process: str, size: int) -> FloatArray:
        """Standard normal numbers drawn once a run, (R, size)."""
        return draw_per_run(seed=self.seed, runs=self.runs, name=f"{self.name}.{process}", size=size)

    def _block(self, size: int) -> int:
        return max(16, min(256, _BLOCK_VALUES // (len(self.runs) * size)))


class OccasionalNormals:
    """Standard normal numbers for what happens to one run now and then, not to all of them in every step.

    Each run uses up its own row of ``values`` (R, n), from left to right; ``used`` (R,) says how far it is. At least
    ``least`` numbers are left in every row after :meth:`top_up`.
    """

    def __init__(self, *, streams: Streams, process: str, least: int) -> None:
        self._least = least
        self._size = 8 * least
        self._generators = [value_generator(streams.seed, run, f"{streams.name}.{process}") for run in streams.runs]
        self.values: FloatArray = np.stack([generator.standard_normal(self._size) for generator in self._generators])
        self.used: IntArray = np.zeros(len(self._generators), dtype=np.int64)

    def top_up(self, most_used: int) -> None:
        """Draw new rows where fewer than ``least`` numbers are left; ``most_used`` is the largest of ``used``."""
        if most_used > self._size - self._least:
            for run in np.flatnonzero(self.used > self._size - self._least).tolist():
                self.values[run] = self._generators[run].standard_normal(self._size)
                self.used[run] = 0


def noise_sigma(*, density: float, rate_hz: float, bandwidth_hz: float | None) -> float:
    """Standard deviation of one sample of noise with a one-sided ``density`` (unit/sqrt(Hz)).

    Without a bandwidth the sensor averages over its sample interval, whose noise bandwidth is half the rate. A
    first-order bandwidth has the noise bandwidth pi/2 times its corner frequency, however slowly it is sampled: what
    lies above half the rate aliases, as it does in a real sensor.
    """
    noise_bandwidth_hz = rate_hz / 2.0 if bandwidth_hz is None else bandwidth_hz * math.pi / 2.0
    return density * math.sqrt(noise_bandwidth_hz)


def first_order_tau_s(bandwidth_hz: float | None) -> float:
    """Time constant of a first-order filter from its corner frequency; zero without one."""
    return 0.0 if bandwidth_hz is None else 1.0 / (2.0 * math.pi * bandwidth_hz)


def decay(tau_s: ArrayLike, period_s: float) -> FloatArray:
    """Return exp(-period/tau), what is left of a first-order state after one period; zero where tau is zero."""
    tau = np.atleast_1d(np.asarray(tau_s, dtype=np.float64))
    return np.array([math.exp(-period_s / t) if t > 0.0 else 0.0 for t in tau])


def _per_column(parameter: FloatArray, columns: int) -> FloatArray:
    """One value per column: the kernels do not broadcast."""
    return np.ascontiguousarray(np.broadcast_to(parameter, (columns,)))


class WhiteNoise:
    """Independent normal numbers with the standard deviations ``sigma`` (n,)."""

    def __init__(self, *, sigma: ArrayLike, stream: NormalStream) -> None:
        self._sigma = np.asarray(sigma, dtype=np.float64)
        self._stream = stream

    def step(self) -> FloatArray:
        """Return the next sample's noise, (R, n)."""
        return self._stream.next() * self._sigma


class GaussMarkov:
    """First-order Gauss-Markov process, stationary from the start.

    x' = -x/tau + w, sampled exactly: ``x_{k+1} = e^{-T/tau} x_k + sigma sqrt(1 - e^{-2T/tau}) n_k``. ``sigma`` and
    ``tau_s`` broadcast to (R, n); a zero tau is white noise. Its Allan deviation peaks at 0.618 sigma, at 1.89 tau.
    """

    def __init__(
        self, *, sigma: ArrayLike, tau_s: ArrayLike, period_s: float, stream: NormalStream, start: FloatArray
    ) -> None:
        self._stream = stream
        self.value: FloatArray = start * np.asarray(sigma, dtype=np.float64)
        """(R, n) now; changes in place."""
        self.set_parameters(sigma=sigma, keep=decay(tau_s, period_s))

    def set_parameters(self, *, sigma: ArrayLike, keep: FloatArray) -> None:
        """Go on with another sigma and another ``keep`` = e^{-T/tau}, both broadcastable to (R, n)."""
        drive = np.asarray(sigma, dtype=np.float64) * np.sqrt(1.0 - keep * keep)
        self._keep = np.ascontiguousarray(np.broadcast_to(keep, self.value.shape))
        self._drive = np.ascontiguousarray(np.broadcast_to(drive, self.value.shape))

    def step(self) -> FloatArray:
        """Advance by one period and return ``value``, (R, n)."""
        kernels.gauss_markov(self.value, self._keep, self._drive, self._stream.next())
        return self.value


class RandomWalk:
    """Brownian motion from ``start`` (R, n); ``density`` (n,) is its growth in unit/sqrt(s) (Allan's K)."""

    def __init__(self, *, density: ArrayLike, period_s: float, stream: NormalStream, start: FloatArray) -> None:
        self._stream = stream
        self.value: FloatArray = start.copy()
        """(R, n) now; changes in place."""
        self._drive = _per_column(np.asarray(density, dtype=np.float64) * math.sqrt(period_s), start.shape[1])

    def step(self) -> FloatArray:
        """Advance by one period and return ``value``, (R, n)."""
        kernels.random_walk(self.value, self._drive, self._stream.next())
        return self.value


class LowPass:
    """First-order low-pass, exact for an input that is constant over each period; starts settled on its first input.

    ``y_k = y_{k-1} + (1 - e^{-T/tau}) (u_k - y_{k-1})``
    """

    def __init__(self, *, tau_s: ArrayLike, period_s: float) -> None:
        self._gain = 1.0 - decay(tau_s, period_s)
        self._value: FloatArray | None = None

    def step(self, value: FloatArray) -> FloatArray:
        """Take the next input, (R, n), and return the output, which changes in place at the next call."""
        if self._value is None:
            self._value = np.array(value, order="C")
            self._gain = _per_column(self._gain, value.shape[1])
        kernels.low_pass(self._value, self._gain, value)
        return self._value


class RampLowPass:
    """First-order low-pass, exact for an input that changes linearly over each period, given its mean and its end.

    ``y_k = d y_{k-1} + (1 - d) m + g (v - m)`` with ``d = e^{-T/tau}`` and ``g = (1 - 2 tau/T) + d (1 + 2 tau/T)``: the
    convolution of ``e^{-t/tau} / tau`` with ``m + (v - m)(2 t/T - 1)``. A ramp comes out later by ``tau``, however long
    the period; without a lag the output is the end value. Starts settled on its first end value.
    """

    def __init__(self, *, tau_s: float, period_s: float) -> None:
        self._decay = float(decay(tau_s, period_s)[0])
        ratio = 2.0 * tau_s / period_s
        self._slope_gain = (1.0 - ratio) + self._decay * (1.0 + ratio)
        self._value: FloatArray | None = None

    def step(self, mean: FloatArray, end: FloatArray) -> FloatArray:
        """Take the next input (n,) and return the output (n,)."""
        if self._value is None:
            self._value = np.array(end)
        else:
            self._value = self._decay * self._value + (1.0 - self._decay) * mean + self._slope_gain * (end - mean)
        return self._value


class Quantiser:
    """Limits and digits of an output: clip into ``[low, high]`` and round to the nearest multiple of ``lsb`` (n,).

    A zero ``lsb`` leaves a column unrounded, an infinite limit unclipped.
    """

    def __init__(self, *, lsb: ArrayLike, low: ArrayLike = -np.inf, high: ArrayLike = np.inf) -> None:
        self.lsb: FloatArray = np.atleast_1d(np.array(lsb, dtype=np.float64))
        """(n,) step of the output, zero where it is not rounded."""
        self._low = np.broadcast_to(np.asarray(low, dtype=np.float64), self.lsb.shape).copy()
        self._high = np.broadcast_to(np.asarray(high, dtype=np.float64), self.lsb.shape).copy()

    def apply(self, values: FloatArray) -> FloatArray:
        """Clip and round ``values`` (R, n) in place and return them."""
        assert values.shape[1] == len(self.lsb)
        kernels.quantise(values, self.lsb, self._low, self._high)
        return values


def sensitivity_matrices(
    *, scale: FloatArray, misalignment: FloatArray, tilt_rpy_rad: FloatArray | None = None
) -> FloatArray:
    """Matrices ``T = (I + diag(scale) + M) R_tilt^T`` of three-axis sensors, shape (R, 3, 3).

    Args:
        scale: (R, 3) relative scale errors.
        misalignment: (R, 6) off-diagonal terms of M (xy, xz, yx, yz, zx, zy), rad: an axis sees this part of another.
        tilt_rpy_rad: (R, 3) roll, pitch and yaw of the sensor as mounted against its nominal mount.
    """
    runs = len(scale)
    matrix = np.zeros((runs, 3, 3))
    rows, columns = [0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]
    matrix[:, rows, columns] = misalignment
    matrix[:, range(3), range(3)] = 1.0 + scale
    if tilt_rpy_rad is not None:
        for run, (roll, pitch, yaw) in enumerate(tilt_rpy_rad.tolist()):
            matrix[run] = matrix[run] @ rotation_from_rpy(roll, pitch, yaw).T
    return matrix
