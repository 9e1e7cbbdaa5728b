"""Scoring: a recording in, metrics, checks and a verdict out."""

from twin.scoring.repetitions import Repetitions
from twin.scoring.verdict import Verdict, score

__all__ = ["Repetitions", "Verdict", "score"]
