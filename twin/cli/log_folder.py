"""Where the replay of a log goes."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from twin.errors import BadInputError
from twin.logreplay.identity import identity_of, name_of
from twin.runfolder import read_result
from twin.scoring.verdict import LOG

FOLDER = "logs"
"""Below the folder for results, beside the scenarios'."""


def folder_of_log(out: Path, path: Path) -> Path:
    """Where a log's replay goes below the output folder: ``logs/NAME_SUFFIX``, or with a number behind it where that
    holds the replay of another log."""
    identity = identity_of(path)
    name = name_of(path)
    targets = (out / FOLDER / (name if number == 1 else f"{name}_{number}") for number in count(1))
    return next(target for target in targets if not _holds_another(target, identity))


def _holds_another(target: Path, identity: Mapping[str, Any]) -> bool:
    """Whether there is something of ours that is not this log's replay; what is not ours is refused later."""
    try:
        result = read_result(target)
    except BadInputError:
        return False
    log = result.get("log")
    return (
        result.get("kind") != LOG or not isinstance(log, dict) or any(log.get(key) != identity[key] for key in identity)
    )
