"""Many runs of one scenario: noise realisations side by side, in several worlds, with a key varied.

One (point, world) is one task. Blocks of members are fixed by index and tasks are merged in order, so the numbers do
not depend on the number of workers.
"""

from __future__ import annotations

from twin.stress.parts import Parts
from twin.stress.plan import Plan, Setting, make_plan, parse_vary
from twin.stress.pool import run_tasks
from twin.stress.result import Point, StressResult, headline_metrics, merge_results, write_files
from twin.stress.tasks import TaskResult, run_task

__all__ = [
    "Parts",
    "Plan",
    "Point",
    "Setting",
    "StressResult",
    "TaskResult",
    "headline_metrics",
    "make_plan",
    "merge_results",
    "parse_vary",
    "run_task",
    "run_tasks",
    "write_files",
]
