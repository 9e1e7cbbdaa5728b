"""Random numbers that depend on a name, never on the order in which things happen.

Two kinds of randomness exist. The *world* (terrain, trees, driver, soil) and each sensor's *schedule* (sample and
arrival ticks) are drawn from ``(seed, name)`` and are shared by all members of an ensemble. The *values* (noise,
biases, dropouts, re-fix times) are drawn from ``(seed, run, name)``. Each process owns its generator, so adding a
sensor changes no other sensor, and member ``i`` of an ensemble draws what the ordinary run ``i`` draws.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_WORLD, _VALUES = 0, 1


def _generator(kind: int, seed: int, run: int, name: str) -> np.random.Generator:
    digest = hashlib.sha256(name.encode()).digest()
    words = np.frombuffer(digest[:16], dtype="<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([kind, seed, run, *words])))


def world_generator(seed: int, name: str) -> np.random.Generator:
    """Generator for something all runs of one seed share (terrain, a sensor's schedule)."""
    return _generator(_WORLD, seed, 0, name)


def value_generator(seed: int, run: int, name: str) -> np.random.Generator:
    """Generator for something that differs from run to run (noise values, biases, dropouts)."""
    return _generator(_VALUES, seed, run, name)


class NormalStream:
    """Standard normal numbers for R runs, ``size`` numbers a step, drawn in blocks.

    Row ``i`` of what :meth:`next` returns depends on ``(seed, runs[i], name)`` alone, whatever other members the
    ensemble has and whatever the block length is.
    """

    def __init__(self, *, seed: int, runs: Sequence[int], name: str, size: int, block: int = 256) -> None:
        self._generators = [value_generator(seed, run, name) for run in runs]
        self._size = size
        self._block = block
        self._values: FloatArray = np.empty((block, len(self._generators), size))
        self._position = block

    def next(self) -> FloatArray:
        """Return the next step's numbers, shape (R, size). The array is valid until the next call."""
        if self._position == self._block:
            for member, generator in enumerate(self._generators):
                self._values[:, member, :] = generator.standard_normal((self._block, self._size))
            self._position = 0
        row: FloatArray = self._values[self._position]
        self._position += 1
        return row


class UniformStream(NormalStream):
    """Uniform numbers in [0, 1) for R runs, otherwise like :class:`NormalStream`."""

    def next(self) -> FloatArray:
        """Return the next step's numbers, shape (R, size). The array is valid until the next call."""
        if self._position == self._block:
            for member, generator in enumerate(self._generators):
                self._values[:, member, :] = generator.random((self._block, self._size))
            self._position = 0
        row: FloatArray = self._values[self._position]
        self._position += 1
        return row


def draw_per_run(*, seed: int, runs: Sequence[int], name: str, size: int) -> FloatArray:
    """Standard normal numbers drawn once per run (turn-on biases, scale errors), shape (R, size)."""
    return np.stack([value_generator(seed, run, name).standard_normal(size) for run in runs])


# --- numbers by count ------------------------------------------------------------------------------------------------
# For events whose number differs from run to run: the n-th number of a process, without drawing those before it.

CounterKeys = NDArray[np.uint64]


def counter_keys(*, seed: int, runs: Sequence[int], name: str) -> CounterKeys:
    """One key per run for :func:`counted_uniform`, shape (R,)."""
    keys = [value_generator(seed, run, name).integers(0, 2**64, dtype=np.uint64) for run in runs]
    return np.array(keys, dtype=np.uint64)


def counted_uniform(keys: CounterKeys, count: NDArray[np.int64]) -> FloatArray:
    """Uniform number in (0, 1) of each key and count, shape (N,); a pure function of the two.

    SplitMix64 (Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators"), entered at ``count``.
    """
    z = keys + (count.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    uniform: FloatArray = ((z >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    return uniform
