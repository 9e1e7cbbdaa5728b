"""Numbers and words on maps seen from above: round steps of metres, and labels that lie where they are meant to."""

from __future__ import annotations

import math
from collections.abc import Sequence

import rerun as rr

from viz import entities
from viz.sheet import Sheet

_UNSEEN = rr.Radius.ui_points(0.0)


def step_of(span_m: float, most: int) -> float:
    """Distance of lines or ticks: 1, 2 or 5 times a power of ten, so that a span holds at most so many steps."""
    least = span_m / most
    decade = 10.0 ** math.floor(math.log10(least))
    return next(decade * factor for factor in (1.0, 2.0, 5.0, 10.0) if decade * factor >= least * (1.0 - 1e-9))


def multiples(step: float, low: float, high: float) -> list[float]:
    """Multiples of a step between two limits."""
    return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def metres(value: float) -> str:
    """A multiple of a step, in as many digits as it needs."""
    return f"{value:.10g}"


def draw_labels(
    sheet: Sheet,
    entity: str,
    places: Sequence[tuple[float, float]],
    labels: Sequence[str],
    *,
    colour: entities.Colour,
    drop: float,
    order: float | None = None,
) -> None:
    """Write labels at places to the right and downwards; the viewer writes them lower by ``drop``, in the same unit."""
    lifted = [(x, y - drop) for x, y in places]
    texts = rr.Points2D(lifted, labels=labels, colors=[colour], radii=_UNSEEN, show_labels=True, draw_order=order)
    sheet.static(entity, texts)
