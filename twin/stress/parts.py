"""Finished tasks of a stress test on disk, so that an interrupted one can go on where it stopped.

One .npz file per task (plain arrays, never pickled objects) in a hidden folder that is named after scenario and plan,
and that is removed when all is done.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import BadInputError
from twin.scenario import LoadedScenario
from twin.scoring.envelopes import Envelope
from twin.scoring.honesty import Honesty
from twin.scoring.verdict import versions
from twin.stress.plan import Plan, Task
from twin.stress.task_result import TaskResult


class Parts:
    """The finished tasks of one plan below a folder."""

    def __init__(self, folder: Path, plan: Plan, loaded: LoadedScenario) -> None:
        told = [
            versions(),
            loaded.sha256,
            plan.runs,
            plan.block_sizes,
            plan.seeds,
            [[list(map(str, pair)) for pair in p] for p in plan.points],
        ]
        digest = hashlib.sha256(json.dumps(told).encode()).hexdigest()[:16]
        self.digest = digest
        """Tells one plan from another."""
        self._folder = folder / f".stress-{digest}"
        self._plan = plan

    def _file(self, task: Task) -> Path:
        return self._folder / f"point{task.point}_world{task.world}_block{task.block}.npz"

    def write(self, task: Task, result: TaskResult) -> None:
        """Keep a finished task.

        Raises:
            BadInputError: it cannot be written.
        """
        arrays: dict[str, Any] = {}
        arrays |= {f"metric/{name}": values for name, values in result.metrics.items()}
        arrays |= {f"motion/{name}": np.array(value) for name, value in result.motion.items()}
        arrays |= {f"states/{name}": np.array(value) for name, value in result.states.items()}
        for name, envelope in result.envelopes.items():
            arrays |= {f"times/{name}": envelope.t_ns, f"counts/{name}": envelope.counts}
        for name, found in result.honesty.items():
            arrays |= {f"honesty/{name}": found.counts, f"honesty_sums/{name}": found.sums}
            arrays |= {f"honesty_of_members/{name}": found.members, f"honesty_family/{name}": np.array(found.family)}
        for name, (t_ns, values) in result.nees.items():
            arrays |= {f"nees_t/{name}": t_ns, f"nees/{name}": values}
        for name, (t_ns, values) in result.nis.items():
            arrays |= {f"nis_t/{name}": t_ns, f"nis/{name}": values}
        arrays |= {f"wall/{name}": np.array(value) for name, value in result.wall_s.items()}
        arrays["reason"], arrays["ended_t_s"] = np.array(result.ended_reason), np.array(result.ended_t_s)
        partial = self._file(task).with_suffix(".partial.npz")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            np.savez_compressed(partial, **arrays)
            partial.replace(self._file(task))
        except OSError as error:
            raise BadInputError(f"{self._file(task)}: cannot be written ({error.strerror or error})") from error

    def finished(self) -> set[Task]:
        """Tasks finished before; files that cannot be read count as not finished."""
        return {task for task in self._plan.tasks() if self._read(task) is not None}

    def read(self, task: Task) -> TaskResult:
        """The result of a finished task.

        Raises:
            BadInputError: it cannot be read any more.
        """
        result = self._read(task)
        if result is None:
            raise BadInputError(f"{self._file(task)}: cannot be read")
        return result

    def _read(self, task: Task) -> TaskResult | None:
        try:
            with np.load(self._file(task), allow_pickle=False) as arrays:
                return _result(dict(arrays))
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None

    def remove(self) -> None:
        """Forget all finished tasks."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _result(arrays: dict[str, Any]) -> TaskResult:
    def below(prefix: str) -> dict[str, Any]:
        return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}

    counts, nees, nis = below("counts/"), below("nees/"), below("nis/")
    sums, members, families = below("honesty_sums/"), below("honesty_of_members/"), below("honesty_family/")
    return TaskResult(
        metrics=below("metric/"),
        motion={name: float(value) for name, value in below("motion/").items()},
        envelopes={name: Envelope(t_ns=t_ns, counts=counts[name]) for name, t_ns in below("times/").items()},
        honesty={
            name: Honesty(family=str(families[name]), counts=found, sums=sums[name], members=members[name])
            for name, found in below("honesty/").items()
        },
        nees={name: (t_ns, nees[name]) for name, t_ns in below("nees_t/").items()},
        nis={name: (t_ns, nis[name]) for name, t_ns in below("nis_t/").items()},
        states={name: int(value) for name, value in below("states/").items()},
        ended_reason=str(arrays["reason"]),
        ended_t_s=float(arrays["ended_t_s"]),
        wall_s={name: float(value) for name, value in below("wall/").items()},
    )
