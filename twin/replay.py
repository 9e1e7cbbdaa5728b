"""Enters the house at the measurements: estimators over what a run recorded, without the world."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping

from twin.errors import BadInputError
from twin.estimation import EstimatorFactory, build_bank, in_order_sampled
from twin.members import build_sensors
from twin.recording import Recording, Stream, estimate_stream, measurement_stream
from twin.scenario import loads
from twin.scoring.comparison import compare_streams
from twin.scoring.planting import seed_streams
from twin.signals import nanoseconds


def replay(
    recording: Recording,
    *,
    scenario_toml: str | None = None,
    plugins: Mapping[str, EstimatorFactory] | None = None,
) -> Recording:
    """Run the scenario's estimators over a recording's measurements.

    ``scenario_toml`` replaces the recording's own scenario, to try other estimator settings on the same data.
    With the recording's own scenario the estimates are bit for bit those of the run: estimators use nothing but
    measurements and configuration.

    Raises:
        BadInputError: the scenario cannot be read, or an estimator wants a sensor that was not recorded.
    """
    toml = recording.scenario_toml if scenario_toml is None else scenario_toml
    scenario = loads(toml, where=f"{recording.scenario_name}/scenario.toml")
    started = time.perf_counter()
    infos = {name: sensor.info for name, sensor in build_sensors(scenario, runs=(0,)).items()}
    bank, _ = build_bank(scenario, infos, runs=len(recording.runs), plugins=plugins)
    missing = [name for name in scenario.sensors if measurement_stream(name) not in recording.streams]
    if missing:
        raise BadInputError(f"{recording.scenario_name}: no measurements of {', '.join(missing)} were recorded")
    measured = {name: recording.measurements(name) for name in scenario.sensors}
    for measurement in in_order_sampled(measured):
        bank.deliver(measurement)
    bank.advance(nanoseconds(recording.ended_t_s))
    bank.finish()
    wall_s = time.perf_counter() - started
    kept = {name: stream for name, stream in recording.streams.items() if not name.startswith(("estimates/", "seeds/"))}
    replayed = dataclasses.replace(
        recording,
        scenario_toml=toml,
        streams={**kept, **bank.streams()},
        timing={
            "simulated_s": recording.ended_t_s,
            "wall_s": wall_s,
            "real_time_factor": recording.ended_t_s / wall_s,
        },
    )
    replayed.streams |= seed_streams(scenario, replayed)
    return replayed


def differing(first: Recording, second: Recording) -> dict[str, float]:
    """Largest difference between the estimates of two recordings, by estimator; empty where bit-identical.

    Infinity stands for streams of different length, times, columns or missing values.
    """
    estimates = [_only_estimates(each) for each in (first, second)]
    differences: dict[str, float] = {}
    for found in compare_streams(*estimates, tolerance=None):
        name = found.name.removeprefix("estimates/")
        differences[name] = max(differences.get(name, 0.0), found.largest)
    return differences


def _only_estimates(recording: Recording) -> dict[str, Stream]:
    return {estimate_stream(name): recording.estimates(name) for name in recording.names("estimates")}
