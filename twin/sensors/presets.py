"""Sensor presets: one TOML file each, the configuration's values and a ``[sources]`` table with where each is from.

A key of a nested table has its source under the dotted name, e.g. ``"states.fix.white_sigma_m"``.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from twin.errors import BadInputError
from twin.paths import PRESETS, plain_name
from twin.validation import did_you_mean


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
        hint = did_you_mean(name, known)
        raise BadInputError(f"unknown preset {name!r}{hint} (there are {', '.join(known)})")
    values = tomllib.loads(known[name].read_text(encoding="utf-8"))
    values.pop("sources", None)
    return values
