"""Compiles the few functions that run at every step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function to machine code on first use and keep the result on disk.

    No fast-math: the results are those of IEEE arithmetic in the order written, so they repeat bit for bit.
    """
    return cast("Function", numba.njit(cache=True, error_model="numpy")(function))
