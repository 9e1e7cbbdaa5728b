"""The seed meter of each row unit: it turns with the *estimated* speed of its row, and drops seed by seed.

A meter asks for f = v_estimate / x_ref cells per second (paper 000, section 2.1: with one speed for all rows f is too
high inside a turn and too low outside). It works on the estimate alone, standstill included: a filter that believes
to move while the machine stands piles its seeds in one place, one that believes to stand leaves a gap. A speed that is
negative or not known turns no meter.

What follows the disc is the machine, not the estimate: a cell may be empty or hold two seeds, and a seed takes its
time to fall. Where it lands is for whoever knows where the row unit truly was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.special import ndtri

from twin.config import Config, Probability
from twin.randomness import counted_uniform, counter_keys
from twin.signals import BoolArray, FloatArray, IntArray

_CELL = 1 << 40
"""Phase of one cell. Whole numbers add up to the same however the run is cut into pieces."""
_DRAWS = 3
"""Random numbers of a cell: what it holds, and how long the first and the second seed fall."""
_LONGEST_SPREAD = 4.0
"""Drop times stay within so many standard deviations, so that it is known when all earlier seeds have landed."""


class SeedingConfig(Config):
    """What the row units plant, and how well they do it at a speed that is right."""

    spacing_m: Annotated[float, Field(ge=0.005, le=10.0)]
    """Theoretical seed spacing x_ref in the row. Maize: 83 000 seeds/ha in rows of 0.75 m are 0.16 m."""
    drop_delay_s: Annotated[float, Field(ge=0.0, le=2.0)] = 0.1
    """From the meter's disc to rest in the furrow. Choice: half a metre of tube at 5 m/s, as pressed air carries it."""
    drop_spread_s: Annotated[float, Field(ge=0.0, le=0.5)] = 0.005
    """Standard deviation of that time, independent from seed to seed. Choice: at 2.5 m/s and 0.16 m the precision is
    then 100 sqrt(2) 2.5 0.005 / 0.16 = 11 %, a good planter's."""
    skip_probability: Probability = 0.005
    """Of a cell without a seed. Choice: with the doubles 99 % singulation."""
    double_probability: Probability = 0.005
    """Of a cell with two seeds. Choice."""
    largest_rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    """Cells per second that the meter's drive can do. Choice: far beyond what planting asks for."""

    @model_validator(mode="after")
    def _one_outcome(self) -> Self:
        if self.skip_probability + self.double_probability > 1.0:
            raise ValueError("skip_probability + double_probability: more than 1")
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class Seeds:
    """Seeds of many meters, sorted by member, row and time of landing."""

    member: IntArray
    """(N,) place on the ensemble axis."""
    row: IntArray
    """(N,) place among the metered rows."""
    landed_s: FloatArray
    """(N,) when it came to rest."""

    def those(self, which: BoolArray | IntArray) -> Seeds:
        """Only the seeds of a mask (N,), or of indices, in their order."""
        return Seeds(member=self.member[which], row=self.row[which], landed_s=self.landed_s[which])


class SeedMeter:
    """The meters of some rows for the R runs of an ensemble; estimates may come in pieces.

    The speed of an estimate turns the meter until the next one comes. Every cell's luck follows from (seed, run, row,
    number of the cell) alone: whichever estimator turns the discs, they are the same discs.
    """

    def __init__(self, config: SeedingConfig, *, seed: int, runs: Sequence[int], rows: Sequence[int]) -> None:
        """``rows`` are numbers of row units, counted from 1."""
        self._config = config
        keys = [counter_keys(seed=seed, runs=runs, name=f"seed_meter.row_{row}") for row in rows]
        self._keys = np.stack(keys, axis=1)
        shape = (len(runs), len(rows))
        self._phase = np.zeros(shape, dtype=np.int64)
        """Part of a cell that has passed since the last whole one."""
        self._cells = np.zeros(shape, dtype=np.int64)
        """Whole cells that have passed."""
        self._held_s: FloatArray = np.empty(0)
        self._held_speed: FloatArray = np.empty((0, *shape))
        self._falling = Seeds(member=np.empty(0, dtype=np.int64), row=np.empty(0, dtype=np.int64), landed_s=np.empty(0))
        self._shortest_fall_s = max(0.0, config.drop_delay_s - _LONGEST_SPREAD * config.drop_spread_s)

    @property
    def settled_s(self) -> float:
        """All that lands until then has been released; minus infinity before the first estimate."""
        return float(self._held_s[0]) + self._shortest_fall_s if len(self._held_s) else -np.inf

    def turn(self, t_s: FloatArray, speeds_m_s: FloatArray) -> None:
        """Turn on to the last of ``t_s`` (T,), when the rows' speeds (T, R, rows) were estimated."""
        if not len(t_s):
            return
        times = np.concatenate([self._held_s, t_s])
        speeds = np.concatenate([self._held_speed, speeds_m_s])
        self._held_s, self._held_speed = times[-1:].copy(), speeds[-1:].copy()
        lasted = np.diff(times)
        rate = np.clip(np.nan_to_num(speeds[:-1] / self._config.spacing_m), 0.0, self._config.largest_rate_hz)
        steps = np.rint(rate * lasted[:, np.newaxis, np.newaxis] * _CELL).astype(np.int64)
        after = self._phase + np.cumsum(steps, axis=0)
        if len(after):
            self._release(times[:-1], lasted, after - steps, steps)
            self._cells += after[-1] // _CELL
            self._phase = after[-1] % _CELL

    def _release(self, from_s: FloatArray, lasted_s: FloatArray, before: IntArray, steps: IntArray) -> None:
        """Let go the cells that pass during intervals (T,), given the phases before and their steps (T, R, rows)."""
        passing = ((before + steps) // _CELL - before // _CELL).ravel()
        where = np.repeat(np.arange(len(passing)), passing)
        first = np.repeat(np.cumsum(passing) - passing, passing)
        # Number of the cell within this piece, from 1.
        number = before.ravel()[where] // _CELL + 1 + np.arange(len(where)) - first
        part = (number * _CELL - before.ravel()[where]) / steps.ravel()[where]
        interval, member, row = np.unravel_index(where, before.shape)
        released_s = from_s[interval] + part * lasted_s[interval]
        self._drop(member.astype(np.int64), row.astype(np.int64), self._cells[member, row] + number, released_s)

    def _drop(self, member: IntArray, row: IntArray, cell: IntArray, released_s: FloatArray) -> None:
        config = self._config
        keys = self._keys[member, row]
        luck = counted_uniform(keys, _DRAWS * cell)
        landed: list[FloatArray] = []
        falls = (luck >= config.skip_probability, luck >= 1.0 - config.double_probability)
        for order, falling in enumerate(falls, start=1):
            normal = ndtri(counted_uniform(keys[falling], _DRAWS * cell[falling] + order))
            fall_s = config.drop_delay_s + config.drop_spread_s * np.clip(normal, -_LONGEST_SPREAD, _LONGEST_SPREAD)
            landed.append(released_s[falling] + np.maximum(fall_s, 0.0))
        self._falling = Seeds(
            member=np.concatenate([self._falling.member, *(member[falling] for falling in falls)]),
            row=np.concatenate([self._falling.row, *(row[falling] for falling in falls)]),
            landed_s=np.concatenate([self._falling.landed_s, *landed]),
        )

    def landed(self, until_s: float) -> Seeds:
        """Take the seeds that have landed by ``until_s`` or :attr:`settled_s`, whichever comes first."""
        falling = self._falling
        down = falling.landed_s <= min(until_s, self.settled_s)
        self._falling = falling.those(~down)
        taken = falling.those(down)
        return taken.those(np.lexsort((taken.landed_s, taken.row, taken.member)))
