"""What every fault of the vocabulary shares: its window, and how it becomes an effect on one sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.config import Names
from twin.errors import BadInputError
from twin.sensors.fault_effects import Effect
from twin.sensors.noise import Streams
from twin.sensors.windows import WindowConfig
from twin.signals import FloatArray, IntArray
from twin.validation import did_you_mean

Columns = Annotated[Names, Field(min_length=1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultContext:
    """The sensor a fault acts on."""

    sensor: str
    columns: tuple[str, ...]
    noise_sigma: FloatArray
    """(n,) standard deviation of the sensor's own error in one sample."""
    streams: Streams
    inner: frozenset[str] = frozenset()
    """Kinds of faults that act inside this sensor."""
    key: str = "faults"
    """Where the fault stands in the sensor's table, e.g. ``faults[0]``."""
    process: str = "faults"
    """Name of the fault's random stream."""

    def indices(self, wanted: Sequence[str]) -> IntArray:
        """Indices of these columns; of all columns if none are named.

        Raises:
            BadInputError: the sensor has no such column.
        """
        for column in wanted:
            if column not in self.columns:
                hint = did_you_mean(column, self.columns)
                raise BadInputError(
                    f"{self.key}.columns: there is no column {column!r}{hint}; there are {', '.join(self.columns)}"
                )
        names = wanted or self.columns
        return np.array([self.columns.index(column) for column in names], dtype=np.int64)


class FaultConfig(WindowConfig):
    """What all faults have."""

    def effect(self, context: FaultContext) -> Effect | None:
        """What the fault does to samples; None if it acts inside the sensor, which then has to know its kind."""
        raise NotImplementedError
