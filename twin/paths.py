"""Where assets and scenarios lie: the only module that knows."""

from __future__ import annotations

import re
from pathlib import Path

from twin.errors import BadInputError

_PACKAGE = Path(__file__).resolve().parent
_BUNDLED = _PACKAGE / "_data"
_ROOT = _BUNDLED if _BUNDLED.is_dir() else _PACKAGE.parent

ASSETS = _ROOT / "assets"
MACHINES = ASSETS / "machines"
PRESETS = ASSETS / "sensors"
SCENARIOS = _ROOT / "scenarios"

_PLAIN_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\Z")


def plain_name(name: str, *, what: str) -> str:
    """Return ``name`` if it is a bare name without path parts.

    Raises:
        BadInputError: the name has path parts, is empty or starts with a dot.
    """
    if not _PLAIN_NAME.match(name) or ".." in name:
        raise BadInputError(f"{what} {name!r}: expected a plain name (letters, digits, '_', '-', '.'), not a path")
    return name
