"""Errors of an orientation against an optical one, as the authors of BROAD score them.

Source: Laidig, Caruso, Cereatti and Seel, "BROAD", *Data* 6(7):72, 2021, and the example code beside it. The error is a
rotation in the earth's axes, q = q_estimated q_optical^-1. Its whole angle is the *total* error; the angle of its turn
about the vertical, 2 atan2(q_z, q_w), the *heading* error; the angle of the rest the *inclination* error. Root mean
squares are over the samples in which the body moves and the optical system sees it.

The optical orientation is aligned to magnetic north, so that the heading error is one against magnetic north. A filter
without a magnetometer cannot know north: its heading errors also are given **relative**, with their (circular) mean
taken off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.geometry import wrap_angle
from twin.signals import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class OrientationErrors:
    """Root mean square errors, deg; NaN where the estimator does not say."""

    total_deg: float
    heading_deg: float
    inclination_deg: float
    relative_heading_deg: float
    """Heading error less its mean."""
    samples: int


def orientation_errors(estimated: FloatArray, optical: FloatArray, scored: BoolArray) -> OrientationErrors:
    """Errors of orientations (N, 4), (x, y, z, w), body to ENU, over ``scored`` samples (N,) where both are known."""
    known = scored & np.isfinite(estimated).all(axis=1) & np.isfinite(optical).all(axis=1)
    if not known.any():
        nan = float("nan")
        return OrientationErrors(
            total_deg=nan, heading_deg=nan, inclination_deg=nan, relative_heading_deg=nan, samples=0
        )
    _, _, z, w = multiply(estimated[known], optical[known] * np.array([-1.0, -1.0, -1.0, 1.0])).T
    heading = wrap_angle(2.0 * np.arctan2(z, w))
    mean = np.angle(np.exp(1j * heading).mean())
    return OrientationErrors(
        total_deg=_rms_deg(2.0 * np.arccos(np.clip(np.abs(w), 0.0, 1.0))),
        heading_deg=_rms_deg(heading),
        inclination_deg=_rms_deg(2.0 * np.arccos(np.clip(np.sqrt(w * w + z * z), 0.0, 1.0))),
        relative_heading_deg=_rms_deg(wrap_angle(heading - mean)),
        samples=int(known.sum()),
    )


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternion products (N, 4), (x, y, z, w): first q, then p."""
    px, py, pz, pw = p.T
    qx, qy, qz, qw = q.T
    return np.stack(
        [
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ],
        axis=-1,
    )


def _rms_deg(angles: FloatArray) -> float:
    return float(np.rad2deg(np.sqrt(np.mean(np.square(angles)))))
