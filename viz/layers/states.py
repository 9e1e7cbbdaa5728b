"""Lanes of states: path segment, turning, standstill of each estimator, GNSS quality, faults. Never thinned."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr

from twin.estimators import height_filter_branches as branches
from twin.estimators import height_vpkf
from twin.estimators.magnetic_disturbance import CLEAN, DISTURBED, LEARNING, RECOVERING
from twin.recording import Stream
from twin.signals import HEIGHT, YAW_RATE, FloatArray, IntArray
from viz import entities
from viz.layers.load import LOAD
from viz.legible import legible
from viz.magnetic import FELT_SHARE
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import changes

TURNING_RAD_S = 0.05
"""A machine turns where its true yaw rate exceeds this, as in the metrics of turns and straights."""

FRESH_S = 4.0
"""Corrections that arrive are no older than this (paper 002, section 2.1: at most 4 s before the link was cut)."""
_SETS = 1.5
"""Nor than so many intervals of their sets, where these are far apart."""

Styles = Mapping[float, tuple[str, entities.Colour]]
"""Label and colour of each value."""

MAGNETIC_STATE = "magnetic_state"
_LANE_OF = {MAGNETIC_STATE: "magnetometer", "slipping": "wheels", "resting": "rest"}
_DIAGNOSTICS: Mapping[str, Styles] = {
    MAGNETIC_STATE: {
        float(LEARNING): ("learning", entities.LEARNING_COLOUR),
        float(CLEAN): ("trusted", entities.TRUSTED_COLOUR),
        float(DISTURBED): ("disturbed", entities.FAULT_COLOUR),
        float(RECOVERING): ("recovering", entities.RECOVERING_COLOUR),
    },
    "slipping": {0.0: ("rolling", entities.TRUSTED_COLOUR), 1.0: ("slipping", entities.FAULT_COLOUR)},
    "resting": {0.0: ("moving", entities.CALM_COLOUR), 1.0: ("resting", entities.LEARNING_COLOUR)},
}
"""Columns of :class:`twin.estimators.heading_filter.HeadingFilter` in words."""

_MODE = height_vpkf.MODE
_MODES: Mapping[str, Styles] = {
    height_vpkf.KIND: {
        height_vpkf.GOOD: ("trusts GNSS (Q1)", entities.TRUSTED_COLOUR),
        height_vpkf.LOST: ("distrusts GNSS (Q2)", entities.RECOVERING_COLOUR),
        height_vpkf.COASTING: ("coasting", entities.LEARNING_COLOUR),
    },
    "height_filter": {
        float(branches.WAITING): ("waiting for a fix", entities.CALM_COLOUR),
        float(branches.TRACKING): ("tracking", entities.TRUSTED_COLOUR),
        float(branches.COASTING): ("coasting", entities.LEARNING_COLOUR),
        float(branches.PROBATION): ("fixes on probation", entities.RECOVERING_COLOUR),
        float(branches.CONTRADICTED): ("fixes contradict", entities.FAULT_COLOUR),
    },
}
"""Modes of height filters in words, by kind of estimator."""
_RAISED_M = 0.1
"""A blade so far above the design plane does not level."""

_FAULT = re.compile(r"fault (\w+) (begins|ends)")
_NO_FAULT = "no fault"
_UNKNOWN: tuple[str, entities.Colour] = ("unknown", (90, 90, 90))


def draw_states(run: Run, sheet: Sheet) -> None:
    """Draw every lane that the streams hold."""
    _draw_segments(run, sheet)
    _draw_field(run, sheet)
    _draw_blade(run, sheet)
    # Whether a machine in a lane turns is told by its driver's state, and a leveller's yaw rate is not what counts.
    if run.truth is not None and run.truth.has(YAW_RATE) and not run.keeps_lane and not run.levels:
        turning = np.abs(run.column(run.truth, YAW_RATE)) > TURNING_RAD_S
        styles = {0.0: ("straight", entities.CALM_COLOUR), 1.0: ("turning", entities.TURN_COLOUR)}
        draw_lane(sheet, "turning", run.truth.t_ns, turning.astype(float), styles)
    for name in run.estimators:
        stream = run.recording.estimates(name)
        _draw_heading_filter(run, sheet, name, stream)
        _draw_mode(run, sheet, name, stream)
        if stream.has("standstill"):
            standing = (run.column(stream, "standstill") > 0.5).astype(float)
            styles = {0.0: ("moving", entities.CALM_COLOUR), 1.0: ("standstill", run.colours[name])}
            draw_lane(sheet, f"standstill_{name}", stream.t_ns, standing, styles)
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        if stream.has("quality"):
            codes = entities.QUALITY_LABELS
            styles = {float(code): (label, entities.QUALITY_COLOURS[code]) for code, label in codes.items()}
            draw_lane(sheet, f"{sensor}_quality", stream.t_ns, run.column(stream, "quality"), styles)
        if stream.has("age_s"):
            _draw_corrections(run, sheet, sensor, stream)
    _draw_faults(run, sheet)
    sheet.panel(PanelKind.LANES, entities.STATE, "States")


def _draw_heading_filter(run: Run, sheet: Sheet, name: str, stream: Stream) -> None:
    """Draw what our heading filter makes of magnetometer, wheels and rest (its diagnostics); others have none."""
    for column, styles in _DIAGNOSTICS.items():
        found = run.columns(stream, column)
        # Where nothing was heard there is nothing to tell: a filter without magnetometer learns for ever.
        if found is not None and not (column == MAGNETIC_STATE and (found == LEARNING).all()):
            draw_lane(sheet, f"{name}_{_LANE_OF[column]}", stream.t_ns, np.round(found[:, 0]), styles)


def _section(run: Run, table: str, name: str) -> dict[str, Any]:
    """What the run's scenario says of a sensor or an estimator."""
    section: dict[str, Any] = tomllib.loads(run.recording.scenario_toml).get(table, {}).get(name, {})
    return section


def _draw_mode(run: Run, sheet: Sheet, name: str, stream: Stream) -> None:
    """Draw what a height filter makes of its receiver, if that ever changes once it has a height."""
    found = run.columns(stream, _MODE, HEIGHT)
    kind = _section(run, "estimators", name).get("kind", "")
    if found is None or kind not in _MODES:
        return
    mode, knows = found[:, 0], np.isfinite(found).all(axis=1)
    if len(np.unique(mode[knows])) > 1:
        draw_lane(sheet, f"{name}_mode", stream.t_ns, mode, _MODES[kind])


def _draw_blade(run: Run, sheet: Sheet) -> None:
    """Draw whether a blade is at work or lifted out of the ground."""
    truth = run.truth
    found = None if truth is None else run.columns(truth, HEIGHT, LOAD)
    if truth is None or found is None:
        return
    styles = {0.0: ("at work", entities.TRUSTED_COLOUR), 1.0: ("raised", entities.TURN_COLOUR)}
    draw_lane(sheet, "blade", truth.t_ns, (found[:, 0] > _RAISED_M).astype(float), styles)


def _draw_field(run: Run, sheet: Sheet) -> None:
    """Draw whether magnets and iron truly push the field at the machine, for comparison with what a filter believes."""
    truth = run.truth
    place = None if truth is None else run.columns(truth, "base_e_m", "base_n_m", "base_u_m")
    if truth is None or place is None or not run.scene.magnetic.count:
        return
    pushed = run.scene.magnetic.disturbance_ut(place, truth.t_ns)
    felt = (pushed > FELT_SHARE * run.scene.magnetic.earth_ut).astype(float)
    styles = {
        0.0: ("the earth's", entities.CALM_COLOUR),
        1.0: (f"magnets: {100.0 * FELT_SHARE:.0f} % or more", entities.FAULT_COLOUR),
    }
    draw_lane(sheet, "magnetic_field", truth.t_ns, felt, styles)


def _draw_corrections(run: Run, sheet: Sheet, sensor: str, stream: Stream) -> None:
    """Draw whether corrections arrive, if that ever changes."""
    told = _section(run, "sensors", sensor)
    usual_s = _SETS * told.get("corrections_interval_s", 0.0) + told.get("corrections_delay_s", 0.0)
    stale = (~(run.column(stream, "age_s") <= max(FRESH_S, usual_s))).astype(float)
    if len(np.unique(stale)) > 1:
        styles = {0.0: ("corrections arrive", entities.QUALITY_COLOURS[4]), 1.0: ("none", entities.FAULT_COLOUR)}
        draw_lane(sheet, f"{sensor}_corrections", stream.t_ns, stale, styles)


def _draw_faults(run: Run, sheet: Sheet) -> None:
    """Draw a lane per sensor with faults: which of them is at work, from the events of their beginnings and ends."""
    said: dict[str, list[tuple[int, str, bool]]] = {}
    for event in run.recording.events:
        match = _FAULT.match(event.text)
        if match and event.source.startswith("sensors."):
            sensor = event.source.removeprefix("sensors.")
            said.setdefault(sensor, []).append((event.t_ns, match[1].replace("_", " "), match[2] == "begins"))
    for sensor, changes_of_sensor in said.items():
        working: list[str] = []
        times, labels = [0], [_NO_FAULT]
        for t_ns, kind, begins in changes_of_sensor:
            if begins:
                working.append(kind)
            elif kind in working:
                working.remove(kind)
            times.append(t_ns)
            labels.append(", ".join(working) or _NO_FAULT)
        used = {label: entities.CALM_COLOUR if label == _NO_FAULT else entities.FAULT_COLOUR for label in labels}
        entity = entities.lane(f"{sensor}_faults")
        sheet.static(entity, rr.StateConfiguration(values=list(used), labels=list(used), colors=list(used.values())))
        sheet.rows(entity, np.array(times, dtype=np.int64), rr.StateChange.columns(state=labels))


def _draw_segments(run: Run, sheet: Sheet) -> None:
    truth = run.truth
    if truth is None or not truth.has("segment") or not len(truth):
        return
    segment = run.column(truth, "segment")
    labels = segment_labels(run, truth.t_ns, segment)
    styles = {value: (label, entities.segment_colour(label)) for value, label in labels.items()}
    # The segment of a driver that keeps to a lane is its state.
    lane = "driver" if run.keeps_lane else "segment"
    draw_lane(sheet, lane, truth.t_ns, segment, styles)


def segment_labels(run: Run, t_ns: IntArray, segment: FloatArray) -> dict[float, str]:
    """Name of every segment that occurs: the scene's, else the driver's event at its start, else its number."""
    said = {event.t_ns: event.text for event in run.recording.events if event.source == "driver"}
    times = np.array(sorted(said), dtype=np.int64)
    labels: dict[float, str] = {}
    for index in changes(segment).tolist():
        value = float(segment[index])
        if value in labels or np.isnan(value):
            continue
        if 0 <= value < len(run.scene.segment_labels):
            labels[value] = legible(run.scene.segment_labels[int(value)])
            continue
        # The event came after the last row of the segment before, and not after this row.
        before = int(t_ns[index - 1]) if index else int(t_ns[0]) - 1
        heard = times[(times > before) & (times <= t_ns[index])]
        labels[value] = legible(said[int(heard[-1])]) if len(heard) else f"segment {value:.0f}"
    return labels


def draw_lane(sheet: Sheet, name: str, t_ns: IntArray, values: FloatArray, styles: Styles) -> None:
    """Draw one lane: a row at the start and at every change."""
    at = changes(values)
    if not len(at):
        return
    shown = [styles.get(float(value), _UNKNOWN) for value in values[at]]
    entity = entities.lane(name)
    used = dict(shown)  # label to colour
    sheet.static(
        entity,
        rr.StateConfiguration(values=list(used), labels=list(used), colors=list(used.values())),
    )
    sheet.rows(entity, t_ns[at], rr.StateChange.columns(state=[label for label, _ in shown]))
