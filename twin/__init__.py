"""A physics-simulated digital twin for farm machines.

>>> import twin
>>> recording = twin.run("planter_turns", seed=1)
>>> twin.score(recording).metrics["central.row_speed.mean_abs_error_turns_m_s"]
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin.recording import Recording
    from twin.scoring import Verdict

__all__ = ["open", "run", "score"]


def run(
    scenario: str | Path,
    *,
    seed: int | None = None,
    run: int = 0,
    set: Mapping[str, Any] | None = None,  # noqa: A002  (the command line's word)
) -> Recording:
    """Run a scenario and return its recording.

    Args:
        scenario: name of a bundled scenario (``twin list``) or path of a file.
        seed: world seed; default: the scenario's.
        run: which realisation of the noise in that world.
        set: changes to the scenario by dotted key, as ``{"driver.speed_m_s": 3.0}``.

    Raises:
        twin.errors.BadInputError: the scenario is wrong, or ``run`` below zero; the message names file, key and what
            is allowed.
    """
    from twin.errors import BadInputError  # noqa: PLC0415
    from twin.execution import execute  # noqa: PLC0415  (`import twin` stays light)
    from twin.scenario import find, load  # noqa: PLC0415

    if run < 0:
        raise BadInputError(f"run = {run}: expected 0 or more")
    changes = [*(set or {}).items(), *([("seed", seed)] if seed is not None else [])]
    return execute(load(find(str(scenario))[0], settings=changes), runs=(run,))


def open(folder: str | Path) -> Recording:  # noqa: A001  (twin.open reads well)
    """Read a run folder back.

    Raises:
        twin.errors.BadInputError: it is not a run folder.
    """
    from twin.runfolder import read_recording  # noqa: PLC0415

    return read_recording(Path(folder))


def score(recording: Recording) -> Verdict:
    """Metrics, checks and verdict of a recording."""
    from twin.scoring import score as score_recording  # noqa: PLC0415

    return score_recording(recording)
