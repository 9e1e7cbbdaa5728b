"""Estimators over a log, from its beginning to its end, in memory that does not grow with it.

Measurements go to the estimators in the order in which the log has them. Estimates are asked for after each sample of
the receiver, and while it is silent for longer than one and a half of its periods, at other sensors' samples, as often
as it would have spoken; a log without receiver asks after each sample of its slowest sensor. Streams and estimates are
handled in blocks of some thousand rows: into the Parquet files, the metrics and the sketch for pictures.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.estimation import stream_columns, stream_parts
from twin.estimators.roles import GNSS
from twin.formats.log import Log
from twin.logreplay.choice import Choice
from twin.logreplay.figures import Figures
from twin.logreplay.reference import ReferenceTrack
from twin.logreplay.settings import ReplaySettings, Vehicle
from twin.logreplay.start import Pose, look_ahead, reference_pose
from twin.logreplay.streams import ParquetFiles, Sketch, parquet_files
from twin.recording import Recording, Stream, StreamWriter, estimate_stream, measurement_stream
from twin.scoring.consistency import nis_columns
from twin.signals import (
    HEADING,
    NS_PER_S,
    POSITION,
    SPEED,
    Estimator,
    EstimatorSetup,
    FloatArray,
    Measurement,
    Mount,
    SensorInfo,
    sigma_column,
)

BLOCK_ROWS = 4096
"""Of the stream that fills first."""
REFERENCE = "reference"
"""Name of the reference among a sketch's streams."""
_SILENT_PERIODS = 1.5
_GAP_PERIODS = 2.5
"""Nothing is said of steps across longer gaps."""
_EPOCH_COLUMNS = ("quality", *POSITION[:2], SPEED, "course_rad")
_DRAWN = (*POSITION[:2], HEADING, SPEED)
_TOLD_EVERY_NS = 60 * NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True)
class LogReplay:
    """What came of a replay."""

    log: Log
    receiver: str | None
    heard: dict[str, tuple[str, ...]]
    """Sensors that each estimator hears."""
    columns: dict[str, tuple[str, ...]]
    """Columns of each estimator's stream."""
    start: Pose
    """Of the reference frame, whose pose is estimated."""
    metrics: dict[str, float]
    counts: dict[str, int]
    """Measurements by sensor."""
    ended_t_s: float
    timing: dict[str, float]
    sketch: Recording
    reference: Log | None = None

    @property
    def problems(self) -> Counter[str]:
        """Lines that were passed over, by kind of trouble."""
        return self.log.problems


def replay_log(
    log: Log,
    choices: Sequence[Choice],
    *,
    reference: Log | None = None,
    folder: Path | None = None,
    settings: ReplaySettings | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> LogReplay:
    """Run estimators over a log, once.

    Args:
        log: Opened, and not read yet.
        choices: The estimators.
        reference: Another log of the same drive, to compare positions with.
        folder: Where ``estimates/`` and ``measurements/`` are written as Parquet; None: nowhere.
        settings: What the log does not know.
        progress: Told the time in the log now and then, s.

    Raises:
        BadInputError: nothing in the log can be used, an estimator cannot work with its sensors, or the reference
            cannot be matched.
        OSError: files cannot be written.
    """
    settings = settings or ReplaySettings()
    began = time.perf_counter()
    with parquet_files(folder) as files:
        replayer = _Replayer(log, choices, reference, files, settings)
        replayer.run(progress)
    if not replayer.usable:
        raise BadInputError(f"{log.path}: nothing in it can be used{_troubles(log)}")
    wall_s = time.perf_counter() - began
    ended_t_s = replayer.ended_ns / NS_PER_S
    timing = {"log_s": ended_t_s, "wall_s": wall_s, "real_time_factor": ended_t_s / wall_s}
    return LogReplay(
        log=log,
        receiver=replayer.receiver.name if replayer.receiver else None,
        heard=replayer.heard,
        columns=replayer.columns,
        start=replayer.start,
        metrics=replayer.figures.metrics(),
        counts=dict(replayer.counts),
        ended_t_s=ended_t_s,
        timing=timing,
        sketch=replayer.sketch.recording(log.path.stem, ended_t_s=ended_t_s, timing=timing),
        reference=reference,
    )


def _troubles(log: Log) -> str:
    found = ", ".join(f"{count} x {kind}" for kind, count in log.problems.most_common())
    return f" (passed over: {found})" if found else ""


def log_setup(log: Log, receiver: SensorInfo | None, start: Pose, vehicle: Vehicle) -> EstimatorSetup:
    """What the owner of a log can tell: the antenna's place is the reference frame's unless told."""
    info = receiver or next(iter(log.sensors.values()))
    place = np.subtract(info.mount.xyz_m, vehicle.antenna_xyz_m).tolist()
    return EstimatorSetup(
        name="log",
        runs=1,
        sensors=log.sensors,
        reference=Mount(body=info.mount.body, xyz_m=(place[0], place[1], place[2])),
        rows_y_m=(),
        start_e_n_heading=start,
        wheelbase_m=vehicle.wheelbase_m,
        reference_x_m=vehicle.reference_x_m,
    )


class _Replayer:
    def __init__(
        self, log: Log, choices: Sequence[Choice], reference: Log | None, files: ParquetFiles, settings: ReplaySettings
    ) -> None:
        if not log.sensors:
            raise BadInputError(f"{log.path}: nothing in it can be used{_troubles(log)}")
        clash = sorted({each.name for each in choices} & set(log.sensors))
        if clash:
            raise BadInputError(f"--estimator {clash[0]}: the log has a sensor of that name")
        infos = list(log.sensors.values())
        self.receiver = next((info for info in infos if info.kind == GNSS), None)
        clock = self.receiver or min(infos, key=lambda info: info.rate_hz)
        self._clock = clock.name
        self._period_ns = round(NS_PER_S / clock.rate_hz)
        ahead, left, _ = settings.vehicle.antenna_xyz_m
        antenna, self._measurements = look_ahead(log.measurements(), self.receiver)
        self.start = reference_pose(antenna, (ahead, left))
        setup = log_setup(log, self.receiver, self.start, settings.vehicle)
        built = {choice.name: choice.build(setup) for choice in choices}
        self.heard = {name: sensors for name, (_, sensors) in built.items()}
        self._estimators: dict[str, Estimator] = {name: estimator for name, (estimator, _) in built.items()}
        self._listeners = {
            info.name: [estimator for estimator, sensors in built.values() if info.name in sensors] for info in infos
        }
        self._reference = None
        if reference is not None:
            self._reference = ReferenceTrack(
                reference,
                origin=log.origin,
                start_utc_ns=log.start_utc_ns,
                longest_gap_s=settings.reference.longest_gap_s,
            )
        self.columns = {name: stream_columns(estimator) for name, estimator in self._estimators.items()}
        self.figures = Figures(
            self.columns,
            receiver=self.receiver.name if self.receiver else None,
            longest_gap_s=_GAP_PERIODS * self._period_ns / NS_PER_S,
            with_reference=reference is not None,
            antenna_m=settings.vehicle.antenna_xyz_m,
        )
        self.sketch = Sketch()
        self._files = files
        self._infos = log.sensors
        self._places = [clock.columns.index(column) if column in clock.columns else -1 for column in _EPOCH_COLUMNS]
        self._open()
        self.counts: Counter[str] = Counter()
        self.usable = 0
        self.ended_ns = 0
        self._asked_ns: int | None = None
        self._quality = math.nan

    def _open(self) -> None:
        """Start new blocks."""
        self._measured = {name: StreamWriter(info.columns, 1) for name, info in self._infos.items()}
        self._said = {name: StreamWriter(columns, 1) for name, columns in self.columns.items()}
        self._epochs = StreamWriter(_EPOCH_COLUMNS, 1)
        self._rows: Counter[str] = Counter()

    def run(self, progress: Callable[[float], None]) -> None:
        """Read the log to its end."""
        told_ns = 0
        for measurement in self._measurements:
            self._take(measurement)
            if self.ended_ns - told_ns >= _TOLD_EVERY_NS:
                told_ns = self.ended_ns
                progress(told_ns / NS_PER_S)
        self._flush()

    def _take(self, measurement: Measurement) -> None:
        name = measurement.sensor
        now = self.ended_ns = max(self.ended_ns, measurement.t_available_ns)
        if measurement.valid[0]:
            for estimator in self._listeners[name]:
                estimator.process(measurement)
        self._measured[name].append(
            measurement.t_ns,
            measurement.values,
            t_available_ns=measurement.t_available_ns,
            valid=measurement.valid,
        )
        self.counts[name] += 1
        self._rows[name] += 1
        if name == self._clock:
            self._ask(now, measurement)
        elif self._asked_ns is not None and now - self._asked_ns > _SILENT_PERIODS * self._period_ns:
            self._ask(now, None)
        if self._rows[name] >= BLOCK_ROWS:
            self._flush()

    def _ask(self, t_ns: int, heard: Measurement | None) -> None:
        self._asked_ns = t_ns
        for name, estimator in self._estimators.items():
            estimate = estimator.estimate(t_ns)
            self._said[name].append(t_ns, *stream_parts(estimate))
        row = np.full((1, len(_EPOCH_COLUMNS)), math.nan)
        if heard is not None and heard.valid[0]:
            told = heard.values[0]
            row[0] = [told[place] if place >= 0 else math.nan for place in self._places]
            self.usable += (
                bool(np.isfinite(told).any()) if self.receiver is None else bool(np.isfinite(row[0, 1:3]).all())
            )
        self._epochs.append(t_ns, row)
        self._rows["asked"] += 1
        if self._rows["asked"] >= BLOCK_ROWS:
            self._flush()

    def _flush(self) -> None:
        """Hand the blocks on, and start new ones."""
        measured = {name: writer.finish() for name, writer in self._measured.items()}
        said = {name: writer.finish() for name, writer in self._said.items()}
        epochs = self._epochs.finish()
        self._open()
        raw = measured[self.receiver.name] if self.receiver else None
        reference = self._reference
        times = np.concatenate([epochs.t_ns, raw.t_ns]) if raw is not None else epochs.t_ns
        if reference is not None and len(times):
            new = reference.advance(int(times.min()), int(times.max()))
            if new is not None:
                self.sketch.add(REFERENCE, new)
        for name, stream in measured.items():
            if len(stream):
                self._files.add(measurement_stream(name), stream)
                self.sketch.add(measurement_stream(name), stream)
        if raw is not None and len(raw) and self.receiver is not None:
            errors = self.figures.add_receiver(raw, reference.at(raw.t_ns) if reference else None)
            self._draw_errors(self.receiver.name, errors)
        if len(epochs):
            found = self.figures.add_estimates(epochs, said, reference.at(epochs.t_ns) if reference else None)
            self.sketch.add("epochs", epochs, self._changes(epochs.column("quality")[:, 0]))
            for name, stream in said.items():
                self._files.add(estimate_stream(name), stream)
                self.sketch.add(estimate_stream(name), *_drawn(stream))
                self._draw_errors(name, found.get(name))

    def _changes(self, quality: FloatArray) -> FloatArray:
        """Where the quality is another than in the row before: such rows stay in a picture."""
        before = np.concatenate([[self._quality], quality[:-1]])
        self._quality = float(quality[-1])
        changed: FloatArray = (quality != before).astype(np.float64)
        return changed

    def _draw_errors(self, name: str, errors: Stream | None) -> None:
        if errors is not None:
            self.sketch.add(f"errors/{name}", errors, errors.column("error_m")[:, 0])


def _drawn(stream: Stream) -> tuple[Stream, FloatArray | None]:
    """The columns that are drawn, and what makes a row worth keeping: how surprised the filter was."""
    nis = nis_columns(stream.columns)
    wanted = [*_DRAWN, *(sigma_column(column) for column in _DRAWN[:2]), *nis]
    kept = tuple(column for column in wanted if stream.has(column))
    values = np.stack([stream.column(column) for column in kept], axis=-1) if kept else stream.values[:, :, :0]
    surprise = np.fmax.reduce([stream.column(column)[:, 0] for column in nis]) if nis else None
    return Stream(columns=kept, t_ns=stream.t_ns, values=values), surprise
