"""Cross-track errors: how far to the left of the driven track an estimate puts the machine.

The error is the signed distance of the estimated position from the line that joins the true poses
(:class:`twin.scoring.driven_track.DrivenTrack`), not from the nearest of them, which would be too far (8.2 % on average
at 1.25 m/s: Easterly et al., Trans. ASABE 59(6):1609). Its figures are those of the family ``cross_track``. The sigma
that is claimed for it is that of the claimed position across the track's course: sigma^2 = n' P n with the left normal
n, P being the covariance of east and north where the estimator gives one, and else diagonal, of its two sigmas.

An error is known once the track is known to the end of its time window, so a piece is held back until the truth has
come so far.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.recording import Stream, covariance_column
from twin.scoring.compared import Compared, as_rows
from twin.scoring.driven_track import DrivenTrack
from twin.signals import POSITION, BoolArray, FloatArray, IntArray, sigma_column

EAST, NORTH = POSITION[:2]
_COVARIANCE = tuple(covariance_column(*pair) for pair in ((EAST, EAST), (EAST, NORTH), (NORTH, NORTH)))


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossTrackErrors:
    """Errors of R runs at some times."""

    t_ns: IntArray
    """(T,)."""
    errors_m: FloatArray
    """(T, R), positive to the left."""
    sigmas_m: FloatArray
    """(T, R); NaN where none is claimed."""
    masks: Mapping[str, BoolArray]
    """(T,) by phase."""


class CrossTrack:
    """Cross-track errors of one estimator, fed in pieces."""

    def __init__(self) -> None:
        self._waiting: list[tuple[IntArray, FloatArray, FloatArray, Mapping[str, BoolArray]]] = []

    def add(
        self, track: DrivenTrack, estimate: Stream, compared: Compared, masks: Mapping[str, BoolArray]
    ) -> list[CrossTrackErrors]:
        """Take the next piece, ``masks`` telling the phases of its times; give what is known by now."""
        self._waiting.append((compared.t_ns, *_claims(estimate, compared), masks))
        return self._known(track)

    def finish(self, track: DrivenTrack) -> list[CrossTrackErrors]:
        """Give all that was held back: no more truth will come."""
        known = [_errors(track, *piece) for piece in self._waiting]
        self._waiting = []
        return known

    def _known(self, track: DrivenTrack) -> list[CrossTrackErrors]:
        known = []
        while self._waiting:
            t_ns, points, covariances, masks = self._waiting[0]
            count = track.covers(t_ns)
            if count == 0 and len(t_ns):
                break
            head, tail = slice(0, count), slice(count, None)
            now, later = ({name: mask[part] for name, mask in masks.items()} for part in (head, tail))
            known.append(_errors(track, t_ns[head], points[head], covariances[head], now))
            if count < len(t_ns):
                # copies, so that what is known already can be let go
                self._waiting[0] = t_ns[tail], points[tail].copy(), covariances[tail].copy(), later
                break
            self._waiting.pop(0)
        return known


def cross_track_errors(track: DrivenTrack, estimate: Stream, compared: Compared) -> CrossTrackErrors:
    """Errors of an estimate at the times that it shares with the truth, by the whole track."""
    return _errors(track, compared.t_ns, *_claims(estimate, compared), {})


def _claims(estimate: Stream, compared: Compared) -> tuple[FloatArray, FloatArray]:
    """Positions (T, R, 2) and their covariances (T, R, 3) at the times that are compared."""
    rows = as_rows(compared.at_estimate)
    return estimate.select((EAST, NORTH))[rows], _covariances(estimate)[rows]


def _errors(
    track: DrivenTrack, t_ns: IntArray, points: FloatArray, covariances: FloatArray, masks: Mapping[str, BoolArray]
) -> CrossTrackErrors:
    offset, course = track.offsets(t_ns, points)
    sigma = np.sqrt(np.maximum(across(covariances, course), 0.0))
    return CrossTrackErrors(t_ns=t_ns, errors_m=offset, sigmas_m=sigma, masks=masks)


def across(covariances: FloatArray, course_rad: FloatArray) -> FloatArray:
    """Variance (...) to the left of a course (...), of covariances (..., 3): east, east and north, north."""
    sine, cosine = np.sin(course_rad), np.cos(course_rad)
    east, both, north = np.moveaxis(covariances, -1, 0)
    variance: FloatArray = sine**2 * east - 2.0 * sine * cosine * both + cosine**2 * north
    return variance


def _covariances(estimate: Stream) -> FloatArray:
    """Claimed covariance of east and north, (T, R, 3); NaN where none is claimed."""
    if all(estimate.has(column) for column in _COVARIANCE):
        return estimate.select(_COVARIANCE)
    sigmas = sigma_column(EAST), sigma_column(NORTH)
    if not all(estimate.has(column) for column in sigmas):
        return np.full((*estimate.values.shape[:2], 3), np.nan)
    east, north = (estimate.column(column) for column in sigmas)
    return np.stack([east**2, np.zeros_like(east), north**2], axis=-1)
