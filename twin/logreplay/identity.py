"""What a log is called, and what tells it from another."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

IDENTITY = ("file", "size_bytes", "head_sha256")
"""Keys by which a result tells which log it is about."""
_HEAD_BYTES = 1 << 16
_MOST_FILES = 1_000


def name_of(path: Path) -> str:
    """Name of a log's folder and in its result: that of its file, without what a folder cannot be called."""
    parts = [path.name] if path.is_dir() else [path.stem, path.suffix.lstrip(".")]
    return re.sub(r"[^A-Za-z0-9_-]+", "_", "_".join(filter(None, parts))).strip("_-") or "log"


def identity_of(path: Path) -> dict[str, Any]:
    """What tells one log from another: its file's name, size and the sha256 of its first 64 kB.

    Of a folder the files in it are taken together, a thousand at most. Size and sum are None where there is no file,
    or no longer.
    """
    digest, size = hashlib.sha256(), 0
    try:
        folder = path.is_dir()
        files = sorted(each for each in path.iterdir() if each.is_file())[:_MOST_FILES] if folder else [path]
        for each in files:
            own = each.stat().st_size
            size += own
            if folder:
                digest.update(f"{each.name} {own} ".encode("utf-8", "surrogateescape"))
            with each.open("rb") as file:
                digest.update(file.read(_HEAD_BYTES))
    except OSError:
        return dict(zip(IDENTITY, (path.name, None, None), strict=True))
    return dict(zip(IDENTITY, (path.name, size, digest.hexdigest()), strict=True))
