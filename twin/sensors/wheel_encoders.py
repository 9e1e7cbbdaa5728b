"""Slotted discs on two wheels, counted (kind ``wheel_encoders``).

A fork light barrier (the LM393 modules of paper 001, section 2.1) gives one pulse per slot that passes. It cannot tell
forwards from backwards; whoever counts takes the direction from what the motor was told. Here the count is signed by
the wheel's true direction, which differs from the drive command's only while a wheel still runs out or is pushed.

With n slots and the wheel turned by an angle a since the first sample, floor(n a / (2 pi) + p) slots have passed; the
phase p in (0, 1), where the disc stood then, is drawn once per wheel and run. A slot may be missed (dirt, a bounce of
the light, an interrupt lost): each that passes is counted with the probability 1 - ``missed_slot_probability``, and a
missed one is missing from then on.

The truth of the counts is n a / (2 pi): so the recorded error shows phase, rounding and missed slots together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from twin.config import Probability
from twin.randomness import counted_uniform, counter_keys
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.signals import Capture, FloatArray, IntArray, JointMotion, JointNeed, Mount, Need

LEFT_SLOTS, RIGHT_SLOTS = "left_slots", "right_slots"


class WheelEncodersConfig(SensorConfig):
    """Two discs and their counters."""

    kind: Literal["wheel_encoders"]
    slots_per_turn: Annotated[int, Field(ge=1, le=100_000)] = 20
    """Slots of each disc (the paper's has 20)."""
    missed_slot_probability: Probability = 0.0
    """Of one slot that passes, in each run independently."""
    left_joint: str = "wheel_left"
    """Joint of the left wheel."""
    right_joint: str = "wheel_right"
    """Joint of the right wheel."""

    def need(self, mount: Mount) -> Need:
        """The angles of both wheels."""
        return JointNeed(mount=mount, joints=(self.left_joint, self.right_joint))


class WheelEncoders(Sensor):
    """Counts of both wheels since the first sample: whole numbers, growing when the wheel turns forwards."""

    columns = (LEFT_SLOTS, RIGHT_SLOTS)
    error_columns = columns

    def __init__(
        self, config: WheelEncodersConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._slots_per_rad = config.slots_per_turn / (2.0 * math.pi)
        keys = counter_keys(seed=seed, runs=runs, name=f"sensors.{name}.phase")
        self._phase = np.stack([counted_uniform(keys, np.full(len(runs), side)) for side in range(2)], axis=1)
        self._missed = config.missed_slot_probability
        self._miss_keys = [counter_keys(seed=seed, runs=runs, name=f"sensors.{name}.missed.{side}") for side in (0, 1)]
        self._passed = np.zeros((len(runs), 2), dtype=np.int64)
        self._seen = np.zeros((len(runs), 2), dtype=np.int64)
        self._counts = np.zeros((len(runs), 2), dtype=np.int64)
        self._start: FloatArray | None = None

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, JointMotion)
        if self._start is None:
            self._start = capture.position.copy()
        slots = (capture.position - self._start) * self._slots_per_rad
        passed = np.floor(slots + self._phase).astype(np.int64)
        step = passed - self._passed
        self._passed = passed
        self._counts += step if self._missed == 0.0 else np.sign(step) * self._noticed(np.abs(step))
        return Reading(
            values=self._counts.astype(np.float64), truth=slots, hidden=np.empty((self._runs, 0), dtype=np.float64)
        )

    def _noticed(self, passing: IntArray) -> IntArray:
        """How many of the slots that pass now are counted; the n-th slot of a wheel is missed or not by its number."""
        noticed = passing.copy()
        for run, side in np.argwhere(passing).tolist():
            numbers = self._seen[run, side] + np.arange(passing[run, side])
            keys = np.full(len(numbers), self._miss_keys[side][run])
            noticed[run, side] -= int(np.count_nonzero(counted_uniform(keys, numbers) < self._missed))
        self._seen += passing
        return noticed

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, WheelEncodersConfig)
        return {
            "slots_per_turn": float(config.slots_per_turn),
            "missed_slot_probability": config.missed_slot_probability,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:  # noqa: ARG002  (part of the protocol)
        """Rounding down from a drawn phase: the difference of two uniform numbers of slots, which is triangular."""
        return np.full(2, math.sqrt(1.0 / 6.0))
