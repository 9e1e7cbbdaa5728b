"""What a turn on the spot tells of a magnetometer and of the gyroscope about the upward axis.

The horizontal field that a level body sees while it turns by psi, as a complex number x + iy, is

    z = h + A exp(-i psi) + B exp(i psi):

the hard iron h (with what a tilted unit sees of the vertical field), the earth's field A, and B, by which soft iron,
unequal scales and axes askew make an ellipse of the circle. Given z and the gyroscope's angle phi = psi / (1 - s), with
a scale error s, all of them can be had by least squares once the body has turned a whole turn: only then does the field
come back to where it was and show how far the turn truly went. One sample of 0.3 uT in 26 uT is off by 0.7 deg; some
hundred of them over 360 deg give s to about 0.1 %, where the data sheet of an MPU6050 promises 3 %.

With h and B known the direction of the field follows without either: (conj(A) u - B conj(u)) / (|A|^2 - |B|^2) =
exp(-i psi) for u = z - h. The argument of A is kept: a turn cannot tell the field's deviation from the unit's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.signals import BoolArray, FloatArray

_WHOLE_TURN_RAD = 0.95 * 2.0 * np.pi
"""Least angle between the ends of the turn."""
_FEWEST = 50
"""Samples."""
_ITERATIONS = 4
_UNKNOWNS = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnFit:
    """What was found, for R members; where ``found`` is False the rest changes nothing."""

    found: BoolArray
    """(R,) whether the turn was whole and the field that of a magnetometer that turns."""
    centre_ut: FloatArray
    """(R, 2) h, microtesla."""
    correction: FloatArray
    """(R, 2, 2) makes a circle of what is left once h is off."""
    rate_factor: FloatArray
    """(R,) 1 - s: makes the true rate of the gyroscope's."""
    rate_sigma: FloatArray
    """(R,) standard deviation of ``rate_factor``, from the residuals; NaN where nothing was found."""


def fit_turn(angle_rad: FloatArray, field_ut: FloatArray, used: BoolArray) -> TurnFit:
    """Fit by Gauss-Newton.

    Args:
        angle_rad: (T, R) turned since the beginning by the gyroscope.
        field_ut: (T, R, 2) field along the body's x and y axes.
        used: (T, R) samples that there are.
    """
    weight = used.astype(np.float64)
    z = np.where(used, field_ut[..., 0] + 1j * field_ut[..., 1], 0.0)
    seen = np.where(used, angle_rad, np.nan)
    enough = weight.sum(axis=0) >= _FEWEST
    span = np.zeros(angle_rad.shape[1])
    span[enough] = np.nanmax(seen[:, enough], axis=0) - np.nanmin(seen[:, enough], axis=0)
    unknowns = np.zeros((angle_rad.shape[1], _UNKNOWNS))
    normal = np.tile(np.eye(_UNKNOWNS), (len(unknowns), 1, 1))
    for iteration in range(_ITERATIONS):
        residual, slopes = _linearised(unknowns, angle_rad, z, weight)
        normal = np.real(np.einsum("tri,trj->rij", slopes.conj(), slopes))
        # Without a field there is no slope in s yet: the first step finds h, A and B.
        normal[:, 6, 6] += 1.0 if iteration == 0 else 0.0
        normal += 1e-9 * np.eye(_UNKNOWNS)
        gradient = np.real(np.einsum("tri,tr->ri", slopes.conj(), residual))
        unknowns = unknowns + np.linalg.solve(normal, gradient[..., np.newaxis])[..., 0]
    residual, _ = _linearised(unknowns, angle_rad, z, weight)
    freedoms = np.maximum(2.0 * weight.sum(axis=0) - _UNKNOWNS, 1.0)
    variance = np.sum(np.abs(residual) ** 2, axis=0) / freedoms
    sigma = np.sqrt(variance * np.linalg.inv(normal)[:, 6, 6])
    earth, ellipse = _complex(unknowns, 2), _complex(unknowns, 4)
    found = enough & (span >= _WHOLE_TURN_RAD) & (np.abs(ellipse) < 0.5 * np.abs(earth)) & (sigma < 0.1)
    return TurnFit(
        found=found,
        centre_ut=np.where(found[:, np.newaxis], unknowns[:, :2], 0.0),
        correction=np.where(found[:, np.newaxis, np.newaxis], _to_circle(earth, ellipse), np.eye(2)),
        rate_factor=np.where(found, 1.0 - unknowns[:, 6], 1.0),
        rate_sigma=np.where(found, sigma, np.nan),
    )


def _complex(unknowns: FloatArray, at: int) -> np.ndarray[tuple[int, ...], np.dtype[np.complex128]]:
    return np.asarray(unknowns[:, at] + 1j * unknowns[:, at + 1])


def _linearised(
    unknowns: FloatArray, angle_rad: FloatArray, z: np.ndarray, weight: FloatArray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (T, R) and slopes (T, R, 7) of h, A, B (real and imaginary parts) and s."""
    earth, ellipse = _complex(unknowns, 2), _complex(unknowns, 4)
    back = np.exp(-1j * angle_rad * (1.0 - unknowns[:, 6]))
    forth = back.conj()
    residual = weight * (z - _complex(unknowns, 0) - earth * back - ellipse * forth)
    one = np.ones_like(back)
    by_scale = 1j * angle_rad * (earth * back - ellipse * forth)
    slopes = np.stack([one, 1j * one, back, 1j * back, forth, 1j * forth, by_scale], axis=-1)
    return residual, weight[..., np.newaxis] * slopes


def _to_circle(earth: np.ndarray, ellipse: np.ndarray) -> FloatArray:
    """Matrix (R, 2, 2) of u -> A (conj(A) u - B conj(u)) / (|A|^2 - |B|^2): one where B is zero."""
    across = np.abs(earth) ** 2 - np.abs(ellipse) ** 2
    across = np.where(across == 0.0, 1.0, across)
    straight, mirrored = np.abs(earth) ** 2 / across, -earth * ellipse / across
    rows = [[straight + mirrored.real, mirrored.imag], [mirrored.imag, straight - mirrored.real]]
    return np.moveaxis(np.array(rows), -1, 0)
