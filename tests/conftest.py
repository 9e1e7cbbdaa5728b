"""Recordings that several tests look at, made once."""

from __future__ import annotations

import pytest

import twin
from twin.recording import Recording


@pytest.fixture(scope="session")
def planter_turns() -> Recording:
    """The demo scenario, seed 1, run 0."""
    return twin.run("planter_turns")
