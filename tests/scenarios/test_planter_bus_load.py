"""Bus load as metrics, checks and a table, from the scenario to the command."""

import json
from pathlib import Path

import pytest

import twin
from tests.cli.command import twin as command
from tests.cli.command import write_scenario
from twin.scoring import score

TABLE = {
    "central_50_hz": ["9.6", "1800", "79", "96", "yes"],
    "central_10_hz": ["1.92", "360", "15.8", "19.2", "yes"],
    "all_central_50_hz": ["33.6", "4800", "236", "288", "no"],
    "all_central_10_hz": ["6.72", "960", "47.2", "57.6", "yes"],
    "distributed_50_hz": ["0.2", "50", "1.98", "2.4", "yes"],
}


def test_every_check_of_the_scenario_holds() -> None:
    verdict = score(twin.run("planter_bus_load"))
    assert {outcome.check.metric.partition(".")[0] for outcome in verdict.checks} == {"bus"}
    assert verdict.verdict == "pass"


def test_the_command_prints_a_small_table(tmp_path: Path) -> None:
    ran = command("run", "planter_bus_load", "--no-rrd", "--json", cwd=tmp_path)
    metrics = json.loads(ran.stdout)[0]["metrics"]
    assert metrics["bus.central_50_hz.payload_kb_s"] == pytest.approx(9.6)
    ran = command("run", "planter_bus_load", "--no-rrd", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    table = ran.stdout.partition("Bus load")[2]
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in table.splitlines() if line.startswith("│")]
    found = {row[0]: row[3:] for row in rows}
    assert {name: found[name] for name in TABLE} == TABLE
    assert max(map(len, table.splitlines()[1:12])) <= 120


def test_checks_on_a_bus_are_judged_alone_and_under_stress(tmp_path: Path) -> None:
    bus = {"one": {"architecture": "central", "senders": 24, "receivers": 24, "rate_hz": 50.0}}
    metric = "bus.one.load_nominal_percent"
    for limit, code in ((237.0, 0), (100.0, 1)):
        path = write_scenario(tmp_path, bus=bus, checks=[{"metric": metric, "max": limit}])
        for words in (("run", path, "--no-rrd"), ("stress", path, "--runs", "2")):
            ran = command(*words, cwd=tmp_path)
            assert ran.returncode == code, ran.stdout + ran.stderr
    wrong = write_scenario(tmp_path, bus=bus, checks=[{"metric": "bus.one.load_nominal_percents", "max": 1.0}])
    ran = command("run", wrong, cwd=tmp_path)
    assert ran.returncode == 2
    assert f"did you mean '{metric}'" in ran.stderr
