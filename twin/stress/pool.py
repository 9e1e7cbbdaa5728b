"""All tasks of a plan, in one process or several."""

from __future__ import annotations

import signal
from collections.abc import Callable, Collection, Generator
from functools import partial
from multiprocessing import get_context

from twin.stress.plan import Plan, Task
from twin.stress.task_result import TaskResult
from twin.stress.tasks import run_block

Told = Callable[[str], None]


def run_tasks(
    plan: Plan, *, workers: int, done: Collection[Task], tell: Told | None = None
) -> Generator[tuple[Task, TaskResult]]:
    """Run what is not yet in ``done``, in as many processes as asked; results come in the order of the tasks."""
    tasks = [task for task in plan.tasks() if task not in done]
    if workers == 1 or len(tasks) <= 1:
        for task in tasks:
            if tell is not None:
                tell(describe(plan, task))
            yield task, run_block(plan, task)
        return
    # A pool that is left early is terminated: an interrupted stress test does not wait for its workers.
    with get_context("spawn").Pool(min(workers, len(tasks)), initializer=_ignore_interrupt) as pool:
        results = pool.imap(partial(_run_one_of, plan), tasks)
        for task, result in zip(tasks, results, strict=True):
            if tell is not None:
                tell(describe(plan, task))
            yield task, result


def _ignore_interrupt() -> None:
    """Leave Ctrl-C to the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_one_of(plan: Plan, task: Task) -> TaskResult:
    return run_block(plan, task)


def describe(plan: Plan, task: Task) -> str:
    """A task in words."""
    varied = ", ".join(f"{key} = {value}" for key, value in plan.points[task.point])
    parts = [f"world {task.world + 1} of {len(plan.seeds)} (seed {plan.seeds[task.world]})", varied]
    if plan.blocks(task.point) > 1:
        members = plan.members(task)
        which = f"run {members[0]}" if len(members) == 1 else f"runs {members[0]} to {members[-1]}"
        parts.append(f"{which} of {plan.runs}")
    return ", ".join(part for part in parts if part)
