"""Keeps text to the characters that the viewer's own font has.

The viewer ends itself (a panic) on the first character without a glyph, so one such character in a scenario's title
would make the recording impossible to look at.
"""

from __future__ import annotations

import unicodedata

SUBSTITUTE = "?"

LEGIBLE = frozenset(
    {chr(code) for code in (*range(0x20, 0x7F), *range(0xA1, 0xAD), *range(0xAE, 0x180))} - {"ŉ"}
    | {chr(code) for code in (*range(0x3B1, 0x3CA), *range(0x391, 0x3A2), *range(0x3A3, 0x3AA), *range(0x410, 0x450))}
    | set("\n–—‘’“”„…•‰′″⁰⁴₀₁₂≤≥≈≠√∞−∑←↑→↓✓✔✗")
)
"""Tried in the viewer, in plain text and in code."""


def legible(text: str) -> str:
    """Return ``text`` with every character that the viewer cannot draw taken apart (ﬁ to fi) or replaced by ``?``."""
    return "".join(character if character in LEGIBLE else _nearest(character) for character in text)


def _nearest(character: str) -> str:
    if character.isspace():
        return " "
    parts = [part for part in unicodedata.normalize("NFKD", character) if not unicodedata.combining(part)]
    return "".join(parts) if parts and all(part in LEGIBLE for part in parts) else SUBSTITUTE
