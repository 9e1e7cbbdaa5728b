"""Compiles the few functions that run at every step.

Machine code is kept on disk in a folder named after all sources of compiled functions: numba itself looks at the file
of a function alone, and would go on using what was compiled with an older version of a function called from it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def _kernel_folder() -> str:
    """Where machine code of these very sources is kept."""
    package = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(package.rglob("*.py")):
        content = source.read_bytes()
        if b"compiled" in content:
            digest.update(content)
    return str(package / "__pycache__" / f"kernels-{digest.hexdigest()[:16]}")


_settings: Any = numba.config
if not _settings.CACHE_DIR:
    _settings.CACHE_DIR = _kernel_folder()


def compiled(function: Function) -> Function:
    """Compile a function to machine code on first use and keep the result on disk.

    No fast-math: the results are those of IEEE arithmetic in the order written, so they repeat bit for bit.
    """
    return cast("Function", numba.njit(cache=True, error_model="numpy")(function))
