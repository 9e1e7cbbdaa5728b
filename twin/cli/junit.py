"""JUnit report: a suite per scenario, a case per check (of all repetitions), an error for a crash."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import BadInputError
from twin.scoring import Repetitions
from twin.scoring.verdict import ending

if TYPE_CHECKING:
    from twin.cli.running import Crash


def write_junit(path: Path, finished: Sequence[Repetitions | Crash]) -> None:
    """Write the report.

    Raises:
        BadInputError: the file cannot be written.
    """
    root = ET.Element("testsuites", name="agtwin")
    for entry in finished:
        root.append(_suite(entry) if isinstance(entry, Repetitions) else _crashed(entry))
    ET.indent(root)
    try:
        ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written ({error.strerror})") from error


def _suite(found: Repetitions) -> ET.Element:
    suite = ET.Element("testsuite", name=found.scenario_name, time=f"{found.wall_s:.3f}")
    for outcome in found.checks:
        case = _case(suite, found.scenario_name, outcome.metric)
        if not outcome.ok:
            ET.SubElement(case, "failure", message=outcome.sentence())
    first = found.first
    if first.baseline_compared:
        case = _case(suite, found.scenario_name, "baseline")
        if first.drifted:
            ET.SubElement(case, "failure", message="baseline drifted").text = "\n".join(first.drifted)
    case = _case(suite, found.scenario_name, "ran to its end")
    ended = ending(first.ended_reason, first.scenario)
    if ended != "pass":
        tag = "error" if ended == "error" else "failure"
        ET.SubElement(case, tag, message=f"{first.ended_reason} at {first.ended_t_s:.2f} s")
    return _counted(suite)


def _crashed(crash: Crash) -> ET.Element:
    suite = ET.Element("testsuite", name=crash.scenario)
    ET.SubElement(_case(suite, crash.scenario, "run"), "error", message="crashed").text = crash.trace
    return _counted(suite)


def _case(suite: ET.Element, scenario: str, name: str) -> ET.Element:
    return ET.SubElement(suite, "testcase", classname=scenario, name=name)


def _counted(suite: ET.Element) -> ET.Element:
    suite.set("tests", str(len(suite.findall("testcase"))))
    suite.set("failures", str(len(suite.findall("testcase/failure"))))
    suite.set("errors", str(len(suite.findall("testcase/error"))))
    return suite
