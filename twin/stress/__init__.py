"""Many runs of one scenario: noise realisations side by side, in several worlds, with a key varied.

A block of the members of one (point, world) is one task. Blocks are fixed by index and tasks are merged in order, so
the numbers do not depend on the number of workers.
"""

from __future__ import annotations

from twin.stress.merging import headline_metrics, merge_in_order, merge_results
from twin.stress.parts import Parts
from twin.stress.plan import Plan, Setting, Task, make_plan, parse_vary
from twin.stress.pool import run_tasks
from twin.stress.result import Point, StressResult
from twin.stress.result_files import write_files
from twin.stress.task_result import TaskResult
from twin.stress.tasks import run_block, run_task

__all__ = [
    "Parts",
    "Plan",
    "Point",
    "Setting",
    "StressResult",
    "Task",
    "TaskResult",
    "headline_metrics",
    "make_plan",
    "merge_in_order",
    "merge_results",
    "parse_vary",
    "run_block",
    "run_task",
    "run_tasks",
    "write_files",
]
