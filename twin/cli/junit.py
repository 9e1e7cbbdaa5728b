"""JUnit report: a suite per scenario, a case per check, an error for a crash."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import BadInputError
from twin.scoring import Verdict

if TYPE_CHECKING:
    from twin.cli.running import Crash


def write_junit(path: Path, finished: Sequence[Verdict | Crash]) -> None:
    """Write the report.

    Raises:
        BadInputError: the file cannot be written.
    """
    root = ET.Element("testsuites", name="agtwin")
    for entry in finished:
        root.append(_suite(entry) if isinstance(entry, Verdict) else _crashed(entry))
    ET.indent(root)
    try:
        ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written ({error.strerror})") from error


def _suite(verdict: Verdict) -> ET.Element:
    suite = ET.Element("testsuite", name=verdict.scenario_name, time=f"{verdict.timing.get('wall_s', 0.0):.3f}")
    for outcome in verdict.checks:
        case = _case(suite, verdict.scenario_name, outcome.check.metric)
        if not outcome.ok:
            ET.SubElement(case, "failure", message=outcome.sentence())
    if verdict.baseline_compared:
        case = _case(suite, verdict.scenario_name, "baseline")
        if verdict.drifted:
            ET.SubElement(case, "failure", message="baseline drifted").text = "\n".join(verdict.drifted)
    case = _case(suite, verdict.scenario_name, "ran to its end")
    if verdict.ended_reason != "duration":
        ET.SubElement(case, "error", message=f"{verdict.ended_reason} at {verdict.ended_t_s:.2f} s")
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
