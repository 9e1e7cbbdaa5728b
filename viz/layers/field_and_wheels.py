"""Plots of a robot that goes by compass and wheels: strength of the measured magnetic field, speeds of the wheels."""

from __future__ import annotations

import numpy as np

from viz import entities
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin

PLOT_HZ = 25.0
_FIELD = ("mag_x_ut", "mag_y_ut", "mag_z_ut")
EARTH_SERIES, _EARTH = "earth_alone", (120, 200, 130)
_LEFT, _RIGHT = (242, 166, 90), (110, 180, 250)


def draw_field_strength(run: Run, sheet: Sheet) -> None:
    """Plot the length of what each magnetometer measured, beside the earth's where magnets or iron are about.

    In an undisturbed field, calibrated, it does not change.
    """
    drawn = False
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        field = run.columns(stream, *_FIELD)
        if field is not None:
            keep = thin(stream.t_ns, PLOT_HZ)
            strength = np.linalg.norm(field[keep], axis=1)
            sheet.line(entities.plot("field_strength", sensor), stream.t_ns[keep], strength, entities.MEASURED_COLOUR)
            drawn = True
    if drawn and run.scene.magnetic.count:
        ends = np.array([0, run.duration_ns], dtype=np.int64)
        earth = np.full(2, run.scene.magnetic.earth_ut)
        sheet.line(entities.plot("field_strength", EARTH_SERIES), ends, earth, _EARTH)
    sheet.panel(PanelKind.PLOT, entities.plot("field_strength"), "Measured field strength [uT]")


def draw_wheel_speeds(run: Run, sheet: Sheet) -> None:
    """Plot the true rates of two driven wheels, and what their speed loops want."""
    truth = run.truth
    if truth is None or len(truth) < 2:
        return
    for side, colour in (("left", _LEFT), ("right", _RIGHT)):
        found = run.columns(truth, f"joint.wheel_{side}_rad", f"wheel_setpoint_{side}_rad_s")
        if found is None:
            return
        keep = thin(truth.t_ns, PLOT_HZ)
        t_ns, angle, wanted = truth.t_ns[keep], found[keep, 0], found[keep, 1]
        rate = np.gradient(angle, (t_ns - t_ns[0]) / 1e9)
        sheet.line(entities.plot("wheel_speed", side), t_ns, rate, colour)
        sheet.line(entities.plot("wheel_speed", f"{side}_wanted"), t_ns, wanted, entities.dimmed(colour))
    sheet.panel(PanelKind.PLOT, entities.plot("wheel_speed"), "Speed of the wheels [rad/s]")
