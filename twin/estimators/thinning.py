"""A filter that runs slower than its sensors: the samples of several ticks made into one (paper 000, section 4.4).

The paper logged at 50 Hz and asked what a filter at 10 Hz or 1 Hz would lose. It did not run its sensors slower, it
made one sample of each n = 50 Hz / rate, two ways of which are here:

* ``moving_average``: the mean over the new period, as the paper did. White noise falls by sqrt(n), vibration with a
  whole number of periods in the window vanishes; what a sample says is the middle of its window's truth, (n - 1) / 2
  samples before its last: the paper's "sort of inertia".
* ``decimation``: the last sample of the period ("simply picking a subset"). No delay, all of the noise, and vibration
  faster than half the new rate comes back as a slower one or a constant: at 10 Hz a vibration of 10 Hz is a bias.

**Where it sits.** Behind the :class:`~twin.estimators.ticks.TickClock`, which has by then dealt with late, repeated
and lost samples at the units' own rate: its ticks are the rows of the paper's 50 Hz log, and what came late counts in
the row in which it came. So all members of an ensemble share the windows, and a member equals its own run.

**Window and stamp.** Window k holds the ticks after (k - 1) n up to and including k n, and is handed on as tick k of
the new clock with its last tick; the stamp of its samples is the end of the window, as a controller that averages
would send them. A sample that comes after its window was handed on counts in the next. A sensor that gave nothing in a
window (a receiver slower than the new rate) gives nothing in its tick; one that gave once passes as it was. All samples
of a window count as of its tick, and come in the order of the estimator's sensors.

**What is averaged**: accelerations, angular rates, speeds and positions, over the samples a member did get. What else a
sensor says (quality, reported sigmas, course, counts) is that of its newest sample: there is no mean of a quality.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.errors import BadInputError
from twin.estimators.roles import INERTIAL_COLUMNS, SPEED_COLUMN
from twin.estimators.ticks import Tick
from twin.signals import POSITION, BoolArray, FloatArray, Measurement

Thinning = Literal["moving_average", "decimation"]

_AVERAGED = frozenset({*INERTIAL_COLUMNS, SPEED_COLUMN, *POSITION})


def ticks_per_sample(rate_hz: float, input_rate_hz: float, *, where: str) -> int:
    """How many ticks at ``rate_hz`` make one at ``input_rate_hz``.

    Raises:
        BadInputError: not a whole number.
    """
    ratio = rate_hz / input_rate_hz
    if ratio < 1.0 or not ratio.is_integer():
        raise BadInputError(
            f"{where} input_rate_hz = {input_rate_hz:g}: the inertial units' rate, {rate_hz:g} Hz, has to be a whole "
            f"multiple of it, as {rate_hz:g}, {rate_hz / 2:g}, {rate_hz / 5:g}"
        )
    return int(ratio)


class Thinner:
    """Makes one tick of ``ticks`` ones, for R runs.

    Args:
        ticks: n, ticks of the sensors in one of the filter.
        thinning: how n samples become one.
        sensors: names of the sensors, in the order in which their samples are handed on.
        step_ns: length of a tick of the sensors.
    """

    def __init__(self, *, ticks: int, thinning: Thinning, sensors: Sequence[str], step_ns: int) -> None:
        self._ticks = ticks
        self._window_ns = ticks * step_ns
        self._averages = thinning == "moving_average"
        self._order = {name: place for place, name in enumerate(sensors)}
        self._window = 0
        self._handed: int | None = None
        self._gathered: dict[str, _Gathered] = {}

    def add(self, tick: Tick) -> list[Tick]:
        """Take the next tick at the sensors' rate; return the ticks at the new rate that are complete by it."""
        complete: list[Tick] = []
        window = -(-tick.index // self._ticks)
        if window > self._window:
            if self._gathered:  # the last tick of its window never came
                complete.append(self._hand_on())
            self._window = window
        for measurement, _ in tick.samples:
            gathered = self._gathered.get(measurement.sensor)
            if gathered is None:
                gathered = self._gathered[measurement.sensor] = _Gathered(measurement, averages=self._averages)
            gathered.add(measurement)
        if tick.index >= self._window * self._ticks:
            complete.append(self._hand_on())
            self._window += 1
        return complete

    def _hand_on(self) -> Tick:
        steps = 1 if self._handed is None else self._window - self._handed
        self._handed = self._window
        names = sorted(self._gathered, key=self._order.__getitem__)
        stamp_ns = self._window * self._window_ns
        samples = [(self._gathered[name].measurement(stamp_ns), True) for name in names]
        self._gathered = {}
        return Tick(self._window, steps, samples)


class _Gathered:
    """Samples of one sensor in one window."""

    def __init__(self, first: Measurement, *, averages: bool) -> None:
        self._sensor, self._columns = first.sensor, first.columns
        shape = first.values.shape
        self._newest: FloatArray = np.full(shape, np.nan)
        self._valid: BoolArray = np.zeros(shape[0], dtype=np.bool_)
        self._averaged = [
            place for place, column in enumerate(first.columns) if averages and column in _AVERAGED
        ]  # no places: the newest sample as it is
        self._sum: FloatArray = np.zeros((shape[0], len(self._averaged)))
        self._count: FloatArray = np.zeros_like(self._sum)

    def add(self, measurement: Measurement) -> None:
        """Take a sample: what was lost, or is not a number, counts for nothing in that member."""
        valid = measurement.valid[:, np.newaxis]
        self._newest = np.where(valid, measurement.values, self._newest)
        self._valid = self._valid | measurement.valid
        if self._averaged:
            values = measurement.values[:, self._averaged]
            counts = np.isfinite(values) & valid
            self._sum += np.where(counts, values, 0.0)
            self._count += counts

    def measurement(self, t_ns: int) -> Measurement:
        """The one sample that stands for all."""
        values = self._newest
        if self._averaged:
            values = values.copy()
            mean = self._sum / np.maximum(self._count, 1.0)
            values[:, self._averaged] = np.where(self._count > 0.0, mean, np.nan)
        return Measurement(
            sensor=self._sensor,
            t_ns=t_ns,
            t_available_ns=t_ns,
            columns=self._columns,
            values=values,
            valid=self._valid,
        )
