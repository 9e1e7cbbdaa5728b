"""Sensor presets: one TOML file each, the configuration's values and a ``[sources]`` table with where each is from.

A key of a nested table has its source under the dotted name, e.g. ``"states.fix.white_sigma_m"``.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from twin.errors import BadInputError
from twin.paths import PRESETS, plain_name
from twin.validation import unknown_listed


def preset_files() -> dict[str, Path]:
    """Files of all presets by name, sorted."""
    return {path.stem: path for path in sorted(PRESETS.glob("*.toml"))}


def load_preset(name: str) -> dict[str, Any]:
    """Values of a preset (without its sources), ready to be changed and validated.

    Raises:
        BadInputError: no such preset, or not a plain name.
    """
    plain_name(name, what="preset")
    known = preset_files()
    if name not in known:
        raise BadInputError(unknown_listed(name, known, "preset"))
    values = tomllib.loads(known[name].read_text(encoding="utf-8"))
    values.pop("sources", None)
    return values
