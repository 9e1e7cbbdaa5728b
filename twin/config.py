"""Base of every configuration section: strict, frozen, no unknown keys, only finite numbers.

Each kind of machine, sensor and estimator keeps its configuration class beside its code; ``scenario.py`` joins them.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, Strict


class Config(BaseModel):
    """A section of a scenario file. Wrong types are errors: text is never read as a number."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Vector3 = Annotated[tuple[float, float, float], Strict(strict=False)]
"""Three numbers; a TOML array."""
Names = Annotated[tuple[str, ...], Strict(strict=False)]
Numbers = Annotated[tuple[float, ...], Strict(strict=False)]
