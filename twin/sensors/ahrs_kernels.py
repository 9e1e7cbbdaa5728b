"""The loop of the attitude and heading reference over runs, compiled; as in :mod:`twin.sensors.kernels`."""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray


@compiled
def attitude_and_acceleration(  # noqa: PLR0917 - compiled functions are called by position
    attitude: FloatArray,
    middle: FloatArray,
    force: FloatArray,
    turned: FloatArray,
    gravity: float,
    angle_error: FloatArray,
    force_error: FloatArray,
    values: FloatArray,
    leak: FloatArray,
) -> None:
    """Write roll, pitch, heading and free acceleration (east, north, up) of R units into ``values`` (R, 6).

    ``attitude`` (3,) has the true roll, pitch and heading at the end of the interval, ``middle`` (3,) those at its
    middle; ``force`` (3,) is the mean specific force in mount axes, ``turned`` (3,) the same rightly turned to the
    world. Each unit errs by ``angle_error`` (R, 3) in its angles and by ``force_error`` (R, 3) in the force, in mount
    axes. ``leak`` (R,) is written: what the wrong angles alone add to the acceleration upwards.
    """
    for run in range(values.shape[0]):
        for k in range(3):
            values[run, k] = attitude[k] + angle_error[run, k]
        cr, sr = np.cos(middle[0] + angle_error[run, 0]), np.sin(middle[0] + angle_error[run, 0])
        cp, sp = np.cos(middle[1] + angle_error[run, 1]), np.sin(middle[1] + angle_error[run, 1])
        cy, sy = np.cos(middle[2] + angle_error[run, 2]), np.sin(middle[2] + angle_error[run, 2])
        x = force[0] + force_error[run, 0]
        y = force[1] + force_error[run, 1]
        z = force[2] + force_error[run, 2]
        across = sr * y + cr * z
        values[run, 3] = cy * (cp * x + sp * across) - sy * (cr * y - sr * z)
        values[run, 4] = sy * (cp * x + sp * across) + cy * (cr * y - sr * z)
        values[run, 5] = cp * across - sp * x - gravity
        leak[run] = cp * (sr * force[1] + cr * force[2]) - sp * force[0] - turned[2]


@compiled
def turn(rotation: FloatArray, vectors: FloatArray, out: FloatArray) -> None:
    """Write ``out = R v`` for the vectors of R runs; rotation (3, 3), vectors (R, 3), out (R, 3 or more)."""
    for run in range(vectors.shape[0]):
        for k in range(3):
            out[run, k] = (
                rotation[k, 0] * vectors[run, 0] + rotation[k, 1] * vectors[run, 1] + rotation[k, 2] * vectors[run, 2]
            )
