"""Metrics of a replay, fed in pieces: what innovations, tracks, qualities and a reference tell."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from twin.logreplay.reference import ReferencePoints
from twin.recording import Stream, covariance_column
from twin.scoring.against_reference import Differences, HeightDifferences, ReferenceTally
from twin.scoring.innovations import InnovationTally
from twin.scoring.tracks import SmoothnessTally, Track
from twin.scoring.transitions import TransitionTally
from twin.signals import HEADING, HEIGHT, POSITION, FloatArray, sigma_column

_EAST, _NORTH, _UP = POSITION
_RECEIVER_SIGMAS = ("sigma_e_m", "sigma_n_m")
_HEIGHTS = (HEIGHT, _UP)
"""What tells a height; the first that there is counts."""


class Figures:
    """Tallies of the receiver and of every estimator; ``receiver`` is None where a log has none."""

    def __init__(
        self,
        estimators: Mapping[str, tuple[str, ...]],
        *,
        receiver: str | None,
        longest_gap_s: float,
        with_reference: bool,
        antenna_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """``estimators`` has their streams' columns, ``antenna_m`` the antenna's place before, left of and above what
        they estimate."""
        self._receiver = receiver
        self._antenna_m = antenna_m
        self._innovations = {name: InnovationTally(columns) for name, columns in estimators.items()}
        tracks = [name for name, columns in estimators.items() if {_EAST, _NORTH} <= set(columns)]
        self._located = tracks
        told = ([receiver] if receiver is not None else []) + tracks
        self._smoothness = {name: SmoothnessTally(longest_gap_s) for name in told}
        self._transitions = TransitionTally(longest_gap_s)
        self._references = {name: ReferenceTally() for name in told} if with_reference else {}
        heights = {name: next((each for each in _HEIGHTS if each in own), None) for name, own in estimators.items()}
        self._height_columns = {name: column for name, column in heights.items() if column is not None}
        high = ([receiver] if receiver is not None else []) + list(self._height_columns)
        self._heights = {name: ReferenceTally(HeightDifferences) for name in high} if with_reference else {}

    def add_receiver(self, stream: Stream, reference: ReferencePoints | None) -> Stream | None:
        """Take what the receiver measured; return its errors, where there is a reference."""
        assert self._receiver is not None
        self._smoothness[self._receiver].add(Track.of(stream))
        if reference is None:
            return None
        track = Track.of(stream)
        east, north = (_claimed_variance(_column(stream, name)) for name in _RECEIVER_SIGMAS)
        claimed = east, np.zeros(len(stream)), north
        found = _differences((track.east_m, track.north_m), claimed, reference)
        quality = _column(stream, "quality")
        self._references[self._receiver].add(found, quality, reference.fixed)
        up, claimed_up = _column(stream, _UP), _claimed_variance(_column(stream, "sigma_u_m"))
        self._heights[self._receiver].add(_height_differences(up, claimed_up, reference), quality, reference.fixed)
        return _errors(stream, found)

    def add_estimates(
        self, epochs: Stream, estimates: Mapping[str, Stream], reference: ReferencePoints | None
    ) -> dict[str, Stream]:
        """Take rows of all estimators at the same times, with what the receiver told then (``epochs``).

        Return their errors, where there is a reference.
        """
        quality = epochs.column("quality")[:, 0]
        tracks = {} if self._receiver is None else {self._receiver: Track.of(epochs)}
        errors: dict[str, Stream] = {}
        for name, stream in estimates.items():
            self._innovations[name].add(stream)
            if reference is not None and name in self._height_columns:
                self._heights[name].add(self._height_of(name, stream, reference), quality, reference.fixed)
            if name not in self._located:
                continue
            tracks[name] = Track.of(stream)
            self._smoothness[name].add(tracks[name])
            if reference is not None:
                found = self._estimate_differences(stream, reference)
                self._references[name].add(found, quality, reference.fixed)
                errors[name] = _errors(stream, found)
        if self._receiver is not None:
            self._transitions.add(quality, tracks)
        return errors

    def _height_of(self, name: str, stream: Stream, reference: ReferencePoints) -> HeightDifferences:
        column = self._height_columns[name]
        variance = _column(stream, sigma_column(column)) ** 2
        return _height_differences(_column(stream, column) + self._antenna_m[2], variance, reference)

    def _estimate_differences(self, stream: Stream, reference: ReferencePoints) -> Differences:
        east, north = _column(stream, _EAST), _column(stream, _NORTH)
        ahead, left, _ = self._antenna_m
        if ahead or left:
            heading = _column(stream, HEADING)
            east = east + ahead * np.cos(heading) - left * np.sin(heading)
            north = north + ahead * np.sin(heading) + left * np.cos(heading)
        crossed = covariance_column(_EAST, _NORTH)
        # Who tells no covariance of the two claims none.
        covariance = np.nan_to_num(_column(stream, crossed))
        variances = [_column(stream, sigma_column(name)) ** 2 for name in (_EAST, _NORTH)]
        return _differences((east, north), (variances[0], covariance, variances[1]), reference)

    def metrics(self) -> dict[str, float]:
        """Metrics by name; NaN where nothing can be said."""
        found: dict[str, float] = {}
        for name in dict.fromkeys([*self._smoothness, *self._innovations]):
            parts: dict[str, float] = {}
            if name == self._receiver:
                parts |= self._transitions.receiver_figures()
            if name in self._innovations:
                parts |= self._innovations[name].figures()
            if name in self._smoothness:
                parts |= self._smoothness[name].figures()
            parts |= self._transitions.track_figures(name)
            for tallies in (self._references, self._heights):
                if name in tallies:
                    parts |= tallies[name].figures()
            found |= {f"{name}.{key}": value for key, value in parts.items()}
        return found


def _column(stream: Stream, name: str) -> FloatArray:
    return stream.column(name)[:, 0] if stream.has(name) else np.full(len(stream), math.nan)


def _claimed_variance(sigma: FloatArray) -> FloatArray:
    """Of what a receiver reports, m^2: zero, as receivers write where they have none, is no claim (NaN)."""
    variance: FloatArray = np.where(sigma > 0.0, sigma, math.nan) ** 2
    return variance


def _differences(
    places: tuple[FloatArray, FloatArray], covariance: tuple[FloatArray, FloatArray, FloatArray], at: ReferencePoints
) -> Differences:
    """Of places (east, north) with a covariance (east, both, north); the reference's variance comes on top."""
    return Differences(
        east_m=places[0] - at.east_m,
        north_m=places[1] - at.north_m,
        var_e_m2=covariance[0] + at.var_e_m2,
        cov_en_m2=covariance[1],
        var_n_m2=covariance[2] + at.var_n_m2,
    )


def _height_differences(up_m: FloatArray, variance_m2: FloatArray, at: ReferencePoints) -> HeightDifferences:
    return HeightDifferences(up_m=up_m - at.up_m, var_u_m2=variance_m2 + at.var_u_m2)


ERROR_COLUMNS = ("error_m", "error_e_m", "error_n_m", "sigma_m")
"""Of a stream of errors: horizontal, east, north, and root of the sum of the claimed variances."""


def _errors(stream: Stream, found: Differences) -> Stream:
    values = np.column_stack(
        [
            np.hypot(found.east_m, found.north_m),
            found.east_m,
            found.north_m,
            np.sqrt(found.var_e_m2 + found.var_n_m2),
        ]
    )
    return Stream(columns=ERROR_COLUMNS, t_ns=stream.t_ns, values=values[:, np.newaxis])
