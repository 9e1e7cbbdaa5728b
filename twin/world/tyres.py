r"""Tyre on soil: one wheel's force from the ground under it.

**Ground.** The tyre does not feel the height at a point: it rests on the plane that fits the ground under its contact
patch (5 x 3 points, least squares). So waves shorter than the patch are enveloped, and the motion does not depend on
the grid the heights are stored on. With wheel centre c and the plane's unit normal n, the tyre is pressed in by
d = r - (distance of c from the plane), and n is also the direction of the normal force

    N = max(0, k d + c_n d'),    N = 0 for d <= 0    (soil does not pull).

**Slip** (deflection state; Clover and Bernard 1998, "Longitudinal tire dynamics", and the single-contact-point models
that go back to von Schlippe). The tread that touches the ground stays there while the wheel moves on, so the carcass
deflects by z = (z_x, z_y), which is a state. With v the velocity of the wheel's lowest material point against the
ground, V = |omega| (r - d) the speed at which tread is renewed and sigma the relaxation length,

    z' = -v - (V / sigma) z,    F = K z + C z',    K = (slip stiffness) N / sigma.

Rolling at constant slip z' = 0 and F = (slip stiffness) N (-v / V): the linear slip law with ASABE's slip 1 - v/(omega
r). Standing still V = 0 and the tyre is a spring, so a braked machine stays where it is. |F| is limited to mu N
(friction circle); the deflection is then cut back to what that force can hold. C only damps the carcass at
standstill. z' is integrated implicitly in V: stable at any speed.

**Rolling resistance** is not here: as a force at the contact patch it would cancel on a free wheel. It is a dry moment
rho N (r - d) on the wheel's joint.
"""

# ruff: noqa: PLR0917 (compiled functions are called by position: keywords cost time there)
from __future__ import annotations

import math

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray
from twin.world.machine import Wheel
from twin.world.soil import Soil

# Columns of the parameter table, one row per wheel.
RADIUS, STIFFNESS, DAMPING, HALF_LENGTH, HALF_WIDTH = range(5)
SLIP_X, SLIP_Y, RELAX_X, RELAX_Y, MASS_X, MASS_Y, FRICTION, SPIN_INERTIA = range(5, 13)
FULL_DAMPING = 13
WHEEL_PARAMETERS = 14

# Columns of the result table, one row per wheel.
NORMAL, FORCE_X, FORCE_Y, SLIP_RATIO, SLIP_ANGLE, ARM, SPRING = range(7)
WHEEL_RESULTS = 7

_DAMPING_RATIO = 0.4
_RELAXATION_X_RADII = 0.5
_RELAXATION_Y_RADII = 0.8
"""Relaxation lengths in wheel radii: a choice between the half contact length and the radius."""
_FULL_DAMPING_M = 0.005
"""The normal damper comes in over this deflection, so that touching down is not a blow; on small wheels, which never
deflect so far, over half of the static deflection."""
_SLOWEST_M_S = 0.05
"""Below this wheel speed the reported slip is a ratio of noise; it is reported against this speed."""


def wheel_parameters(wheel: Wheel, soil: Soil, *, static_load_n: float, spin_inertia_kg_m2: float) -> FloatArray:
    """One row of the parameter table, shape (WHEEL_PARAMETERS,).

    The patch is the chord that a circle cuts from the plane at its static deflection and sinkage; the masses are what
    the carcass damping is set for: the load the wheel carries, along the rolling direction together with its inertia.
    """
    row = np.zeros(WHEEL_PARAMETERS)
    deflection = static_load_n / wheel.stiffness_n_m
    mass = static_load_n / 9.80665
    row[RADIUS], row[STIFFNESS], row[DAMPING] = wheel.radius_m, wheel.stiffness_n_m, wheel.damping_n_s_m
    row[HALF_LENGTH] = math.sqrt(2.0 * wheel.radius_m * (deflection + wheel.sunk_m))
    row[HALF_WIDTH] = 0.5 * wheel.width_m
    row[SLIP_X], row[SLIP_Y] = wheel.grip * soil.longitudinal_stiffness, wheel.grip * soil.lateral_stiffness
    row[RELAX_X] = _RELAXATION_X_RADII * wheel.radius_m
    row[RELAX_Y] = _RELAXATION_Y_RADII * wheel.radius_m
    row[MASS_X] = 1.0 / (1.0 / mass + wheel.radius_m**2 / spin_inertia_kg_m2)
    row[MASS_Y] = mass
    row[FRICTION] = wheel.grip * soil.friction
    row[SPIN_INERTIA] = spin_inertia_kg_m2
    row[FULL_DAMPING] = min(_FULL_DAMPING_M, 0.5 * deflection)
    return row


@compiled
def ground_plane(
    heights: FloatArray, west: float, south: float, cell: float, x: float, y: float, fx: float, fy: float,
    half_length: float, half_width: float,
) -> tuple[float, float, float, bool]:  # fmt: skip
    """Mean height, slope forward and slope to the left under a patch; False if it is off the terrain.

    The patch is centred on (x, y); (fx, fy) is its horizontal forward direction.
    """
    rows, columns = heights.shape
    total = along = across = 0.0
    for a in range(5):
        u = 0.5 * (a - 2) * half_length
        for b in range(3):
            w = (b - 1) * 0.8 * half_width
            gx = (x + u * fx - w * fy - west) / cell
            gy = (y + u * fy + w * fx - south) / cell
            if not (0.0 <= gx <= columns - 1 and 0.0 <= gy <= rows - 1):
                return 0.0, 0.0, 0.0, False
            i = min(int(gx), columns - 2)
            j = min(int(gy), rows - 2)
            s, t = gx - i, gy - j
            lower = heights[j, i] + s * (heights[j, i + 1] - heights[j, i])
            upper = heights[j + 1, i] + s * (heights[j + 1, i + 1] - heights[j + 1, i])
            h = lower + t * (upper - lower)
            total += h
            along += u * h
            across += w * h
    # sum of u^2 over the 15 points: 3 (2 (1/2)^2 + 2) half_length^2 = 7.5; of w^2: 5 x 2 x 0.64 half_width^2 = 6.4
    return total / 15.0, along / (7.5 * half_length**2), across / (6.4 * half_width**2), True


@compiled
def tyre_force(
    parameters: FloatArray, deflection: FloatArray, result: FloatArray, dt: float, depth: float, closing: float,
    slide_x: float, slide_y: float, renewal: float,
) -> None:  # fmt: skip
    """Advance one tyre by ``dt`` and write normal force, slip forces and slip into ``result``.

    ``depth`` and ``closing`` are the normal deflection and its rate; ``slide_x`` and ``slide_y`` the velocity of the
    wheel's lowest point against the ground, forward and left; ``renewal`` is V of the module docstring.
    """
    if depth <= 0.0:
        deflection[0] = deflection[1] = 0.0
        result[NORMAL] = result[FORCE_X] = result[FORCE_Y] = result[SLIP_RATIO] = result[SLIP_ANGLE] = 0.0
        result[SPRING] = 0.0
        return
    damper = parameters[DAMPING] * min(1.0, depth / parameters[FULL_DAMPING])
    normal = max(0.0, parameters[STIFFNESS] * depth + damper * closing)
    stiffness_x = parameters[SLIP_X] * normal / parameters[RELAX_X]
    stiffness_y = parameters[SLIP_Y] * normal / parameters[RELAX_Y]
    new_x = (deflection[0] - dt * slide_x) / (1.0 + dt * renewal / parameters[RELAX_X])
    new_y = (deflection[1] - dt * slide_y) / (1.0 + dt * renewal / parameters[RELAX_Y])
    damping_x = 2.0 * _DAMPING_RATIO * math.sqrt(stiffness_x * parameters[MASS_X])
    damping_y = 2.0 * _DAMPING_RATIO * math.sqrt(stiffness_y * parameters[MASS_Y])
    force_x = stiffness_x * new_x + damping_x * (new_x - deflection[0]) / dt
    force_y = stiffness_y * new_y + damping_y * (new_y - deflection[1]) / dt
    limit = parameters[FRICTION] * normal
    size = math.hypot(force_x, force_y)
    if size > limit:
        scale = limit / size
        force_x *= scale
        force_y *= scale
        new_x = force_x / stiffness_x if stiffness_x > 0.0 else 0.0
        new_y = force_y / stiffness_y if stiffness_y > 0.0 else 0.0
    deflection[0], deflection[1] = new_x, new_y
    speed = max(renewal, _SLOWEST_M_S)
    result[NORMAL], result[FORCE_X], result[FORCE_Y] = normal, force_x, force_y
    result[SLIP_RATIO], result[SLIP_ANGLE] = -slide_x / speed, math.atan2(-slide_y, speed)
    result[SPRING] = 0.5 * (parameters[STIFFNESS] * depth**2 + stiffness_x * new_x**2 + stiffness_y * new_y**2)
