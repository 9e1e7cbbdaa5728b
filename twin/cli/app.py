"""The commands and their options. What they do lies in the modules beside this one, imported when needed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="twin",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Physics-simulated digital twin for farm machines: run scenarios, score estimators, look at the recordings.",
)

Scenarios = Annotated[list[str], typer.Argument(help="Scenario names (see `twin list`), files, or folders.")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key, as driver.speed_m_s=3.0.")
]
Json = Annotated[bool, typer.Option("--json", help="Print result.json objects as an array, and nothing else.")]
Plugins = Annotated[
    list[str] | None, typer.Option(help="Add your own estimator: package.module:Class, or a registered name.")
]
Out = Annotated[Path, typer.Option(help="Folder for the results.")]


@app.command()
def run(  # noqa: PLR0917  (typer makes options of them)
    scenarios: Scenarios,
    seed: Annotated[int | None, typer.Option(min=0, help="World seed; default: the scenario's.")] = None,
    run_index: Annotated[
        int, typer.Option("--run", min=0, help="Which realisation of the noise; the first of several repetitions.")
    ] = 0,
    settings: Settings = None,
    out: Out = Path("runs"),
    rrd: Annotated[bool, typer.Option(help="Write run.rrd for the Rerun viewer.")] = True,
    junit: Annotated[Path | None, typer.Option(help="Write a JUnit report to this file.")] = None,
    nmea: Annotated[
        Path | None, typer.Option(help="Write what each receiver would have sent, as NMEA files below this folder.")
    ] = None,
    estimator: Plugins = None,
    update_baselines: Annotated[bool, typer.Option(help="Rewrite the baselines that moved.")] = False,
    full_rate: Annotated[bool, typer.Option("--full-rate", help="Keep the truth of every physics step.")] = False,
    as_json: Json = False,
) -> int:
    """Run scenarios: metrics beside the published figures, then the verdict."""
    from twin.cli.running import RunOptions, run_scenarios  # noqa: PLC0415

    options = RunOptions(
        seed=seed,
        run=run_index,
        settings=tuple(settings or ()),
        out=out,
        rrd=rrd,
        junit=junit,
        nmea=nmea,
        estimators=tuple(estimator or ()),
        update_baselines=update_baselines,
        full_rate=full_rate,
        as_json=as_json,
    )
    return run_scenarios(scenarios, options)


@app.command()
def stress(  # noqa: PLR0917  (typer makes options of them)
    scenario: Annotated[str, typer.Argument(help="Scenario name or file.")],
    runs: Annotated[int, typer.Option(min=1, help="Noise realisations in each world.")] = 100,
    worlds: Annotated[int, typer.Option(min=1, help="Worlds: the seed and its successors.")] = 1,
    vary: Annotated[
        list[str] | None, typer.Option(metavar="KEY=...", help="KEY=LO:HI, KEY=LO:HI:N or KEY=A,B,C; may be repeated.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="First world seed; default: the scenario's.")] = None,
    settings: Settings = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes, for several worlds or points.")] = 1,
    out: Out = Path("runs"),
    resume: Annotated[bool, typer.Option("--resume", help="Go on where an interrupted stress test stopped.")] = False,
    singles: Annotated[
        int, typer.Option(min=0, help="Also run this many members alone: same numbers? how much slower?")
    ] = 0,
    as_json: Json = False,
) -> int:
    """Run a scenario many times: distributions, envelopes, plots and a verdict."""
    from twin.cli.stressing import StressOptions, run_stress  # noqa: PLC0415

    options = StressOptions(
        runs=runs,
        worlds=worlds,
        vary=tuple(vary or ()),
        seed=seed,
        settings=tuple(settings or ()),
        workers=workers,
        out=out,
        resume=resume,
        singles=singles,
        as_json=as_json,
    )
    return run_stress(scenario, options)


@app.command()
def replay(  # noqa: PLR0917  (typer makes options of them)
    log: Annotated[
        Path, typer.Argument(help="A run folder, a log (NMEA, .pos, CSV, ...), or a trial of BROAD (.mat).")
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Of a run: estimators.*, seeding.*, scoring.* or checks. Of a log: vehicle.antenna_xyz_m, "
            "vehicle.wheelbase_m, vehicle.reference_x_m, reference.longest_gap_s or estimators.NAME.KEY.",
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]KIND[:KEY=VALUE,...]",
            help="Over a log: kinds, as guidance_pv or cv=guidance_kinematic:model=constant_velocity. "
            "Over anything: your own, as package.module:Class, or a registered name.",
        ),
    ] = None,
    reference: Annotated[Path | None, typer.Option(help="Another log of the same drive, to compare with.")] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(help="What the columns of a log of CSV files mean: a TOML file, or a name from `twin list`."),
    ] = None,
    reference_mapping: Annotated[Path | None, typer.Option(help="The same of the log to compare with.")] = None,
    origin: Annotated[
        str | None, typer.Option(metavar="LAT,LON", help="Of the local frame, deg; default: the first position.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The results of a log go to logs/ in it; default: runs.")] = None,
    rrd: Annotated[bool, typer.Option(help="Write run.rrd for the Rerun viewer; for logs alone.")] = True,
    as_json: Json = False,
) -> int:
    """Run estimators over recorded measurements, without the world: those of a run, or a log of real receivers."""
    from twin.cli.replaying_log import LogOptions, replay_any  # noqa: PLC0415

    options = LogOptions(
        settings=tuple(settings or ()),
        estimators=tuple(estimator or ()),
        reference=reference,
        mapping=mapping,
        reference_mapping=reference_mapping,
        origin=origin,
        out=out,
        rrd=rrd,
        as_json=as_json,
    )
    return replay_any(log, options)


@app.command()
def score(folder: Annotated[Path, typer.Argument(help="A run folder.")], as_json: Json = False) -> int:
    """Compute metrics and checks of a run folder again."""
    from twin.cli.replaying import score_folder  # noqa: PLC0415

    return score_folder(folder, as_json=as_json)


@app.command()
def compare(
    first: Annotated[
        Path, typer.Argument(help="A run folder, the folder of a stress test, or that of a replayed log (logs/NAME).")
    ],
    second: Annotated[Path, typer.Argument(help="Another of the same kind.")],
    tolerance: Annotated[
        float | None, typer.Option(help="Relative tolerance of every value; default: that of baselines.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the differences as JSON, and nothing else.")] = False,
) -> int:
    """Say what differs between two runs, stress tests or replayed logs: metrics, ends, events and streams."""
    from twin.cli.comparing import compare_folders  # noqa: PLC0415

    return compare_folders(first, second, tolerance=tolerance, as_json=as_json)


@app.command()
def view(what: Annotated[Path, typer.Argument(help="A run folder, or an .rrd file.")]) -> int:
    """Open a recording in the Rerun viewer."""
    from viz.viewer import open_recording  # noqa: PLC0415

    return open_recording(what)


@app.command("list")
def list_all() -> int:
    """List scenarios, sensor presets and kinds."""
    from twin.cli.listing import print_lists  # noqa: PLC0415

    print_lists()
    return 0


@app.command()
def schema() -> int:
    """Print the JSON Schema of scenario files, for editors."""
    from twin.scenario import json_schema  # noqa: PLC0415

    typer.echo(json.dumps(json_schema(), indent=1))
    return 0
