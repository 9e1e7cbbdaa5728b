"""Hard and soft iron of a magnetometer, from readings taken while it was turned.

The model is m = A b + o: b the field of the place in body axes, o the *hard iron* (magnetised parts), A the *soft iron*
(parts that bend the field). Turned everywhere, b lies on a sphere and m on an ellipsoid with the centre o.

Paper 001, chapter 3, takes the middle between the largest and the smallest reading of each axis as o (eqs 16 to 18)
and looks at the ellipsoid without correcting it. :func:`fit_ellipsoid` is our variant: it corrects both, and does not
hang on two extreme samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.signals import FloatArray


def hard_iron_by_min_max(field_ut: FloatArray) -> FloatArray:
    """Hard iron (3,) in microtesla of readings (N, 3): (largest + smallest) / 2 of each axis (eq 18).

    It is right where the sensor was turned about all three axes; it hangs on two readings per axis, so that one outlier
    moves it by half its size.
    """
    middle: FloatArray = 0.5 * (field_ut.max(axis=0) + field_ut.min(axis=0))
    return middle


def soft_iron_ratio(field_ut: FloatArray) -> float:
    """Longest over shortest half-extent of readings (N, 3) along the axes: 1 on a sphere; detects soft iron."""
    extent = np.ptp(field_ut, axis=0)
    return float(extent.max() / max(float(extent.min()), 1e-12))


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetometerCalibration:
    """How to make a sphere of the readings: ``correction @ (m - hard_iron_ut)``."""

    hard_iron_ut: FloatArray
    """(3,)"""
    correction: FloatArray
    """(3, 3), symmetric, of determinant 1: the field's mean strength is kept."""

    def apply(self, field_ut: FloatArray) -> FloatArray:
        """Readings (..., 3) without hard and soft iron."""
        corrected: FloatArray = np.einsum("ij,...j->...i", self.correction, field_ut - self.hard_iron_ut)
        return corrected


def fit_ellipsoid(field_ut: FloatArray) -> MagnetometerCalibration:
    """Fit an ellipsoid to readings (N, 3) by least squares of its quadric, and return what makes a sphere of it.

    The quadric m^T M m + 2 n^T m = 1 is linear in its nine parameters; its centre is -M^-1 n and its shape M. The
    rotation that soft iron may hold besides is not seen by the readings (any rotation leaves a sphere a sphere); the
    symmetric root of M is the choice that turns nothing (Renaudin, Afzal and Lachapelle 2010).

    Raises:
        BadInputError: fewer than nine readings, or readings that do not span an ellipsoid (the sensor was not turned
            about two axes at least).
    """
    if len(field_ut) < 9:
        raise BadInputError(f"magnetometer calibration: {len(field_ut)} readings; an ellipsoid needs at least 9")
    middle, scale = field_ut.mean(axis=0), float(np.std(field_ut)) or 1.0
    x, y, z = ((field_ut - middle) / scale).T
    design = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z], axis=-1)
    found, _, rank, _ = np.linalg.lstsq(design, np.ones(len(field_ut)), rcond=1e-8)
    shape = np.array([[found[0], found[3], found[4]], [found[3], found[1], found[5]], [found[4], found[5], found[2]]])
    lengths, axes = np.linalg.eigh(shape)
    if rank < 9 or lengths.min() <= 0.0:
        raise BadInputError(
            "magnetometer calibration: the readings do not span an ellipsoid; turn the sensor about all three axes"
        )
    centre = -np.linalg.solve(shape, found[6:])
    roots = np.sqrt(lengths)
    correction = (axes * (roots / np.cbrt(roots.prod()))) @ axes.T
    return MagnetometerCalibration(hard_iron_ut=middle + scale * centre, correction=correction)
