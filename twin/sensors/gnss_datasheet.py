"""What the owner of a GNSS receiver knows of it: figures of its data sheet and of tests with it, never a drawn error.

The figures of the usual state (RTK fixed, where there is one) have plain names; a lesser state's begin with its name.
How fast positions wander, and how far, nobody reads in a data sheet, but a receiver left standing for an hour tells;
so it does how often they step. Horizontal figures are those of one axis, the mean of east and north.
"""

from __future__ import annotations

import math

from twin.config import Vector3
from twin.fix_quality import STATES
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.gnss_states import FixState

_UP = 2


def datasheet(config: GnssConfig) -> dict[str, float]:
    """Figures by name, in SI units; those of outputs and states that the receiver lacks are missing."""
    return {
        **_outputs(config),
        **_height_of_the_usual_state(config),
        **_heights_of_lesser_states(config),
        **_horizontal(config.usual_state, ""),
        **_ageing(config),
        **_options(config),
    }


def _outputs(config: GnssConfig) -> dict[str, float]:
    state = config.usual_state
    east, north, up = state.reported_sigma_m
    sheet = {
        "position_noise_m": math.sqrt((east * east + north * north) / 2.0),
        "height_noise_m": up,
        "speed_noise_m_s": state.velocity_noise_m_s,
        "speed_noise_ratio": state.velocity_noise_ratio,
        "velocity_lag_s": config.velocity_lag_s,
        "latency_s": config.latency_s,
    }
    if config.vertical_speed is not None:
        sheet["vertical_speed_noise_m_s"] = config.vertical_speed.white_sigma_m_s
        sheet["vertical_speed_correlated_m_s"] = config.vertical_speed.correlated_sigma_m_s
        sheet["vertical_speed_correlation_s"] = config.vertical_speed.correlation_s
    if config.heading is not None:
        sheet["heading_noise_rad"] = config.heading.reported_sigma_rad
    return sheet


def _height_of_the_usual_state(config: GnssConfig) -> dict[str, float]:
    state = config.usual_state
    sheet = {
        "height_correlated_sigma_m": state.correlated_sigma_m[_UP],
        "height_correlation_s": state.correlation_s[_UP],
        "height_white_sigma_m": state.white_sigma_m[_UP],
    }
    if state.until_age_s is not None:
        sheet["until_age_s"] = state.until_age_s
    return sheet


def _ageing(config: GnssConfig) -> dict[str, float]:
    """How the usual state's error grows with the age of corrections."""
    drift = config.usual_state.age_drift_m_s
    return {
        "height_age_drift_m_s": drift[_UP],
        "position_age_drift_m_s": _level(drift),
        "age_drift_correlation_s": config.age_drift_correlation_s,
    }


def _heights_of_lesser_states(config: GnssConfig) -> dict[str, float]:
    sheet: dict[str, float] = {}
    for state in config.states.values():
        name = STATES.get(state.quality)
        if name is not None:
            sheet |= _height(state, name) | _horizontal(state, f"{name}_")
    return sheet


def _height(state: FixState, name: str) -> dict[str, float]:
    """One state's height: its whole error, of it what is new in every sample, and how long the rest lasts."""
    return {
        f"{name}_height_sigma_m": float(state.total_sigma_m()[_UP]),
        f"{name}_height_white_sigma_m": state.white_sigma_m[_UP],
        f"{name}_height_correlation_s": state.correlation_s[_UP],
    }


def _level(east_north_up: Vector3) -> float:
    """Root mean square of east and north."""
    return math.sqrt((east_north_up[0] ** 2 + east_north_up[1] ** 2) / 2.0)


def _horizontal(state: FixState, prefix: str) -> dict[str, float]:
    """One state's horizontal error along one axis: what wanders, how long it lasts, what steps, what is always new."""
    return {
        f"{prefix}position_correlated_sigma_m": _level(state.correlated_sigma_m),
        f"{prefix}position_correlation_s": 0.5 * (state.correlation_s[0] + state.correlation_s[1]),
        f"{prefix}position_jump_sigma_m": _level(state.jump_sigma_m),
        f"{prefix}position_white_sigma_m": _level(state.white_sigma_m),
    }


def _options(config: GnssConfig) -> dict[str, float]:
    """What only some receivers have; the lag of a filter is in m per m/s^2 of acceleration."""
    east, north, _ = config.resolution_m
    sheet = {"east_resolution_m": east, "north_resolution_m": north}
    if config.jump_interval_s is not None:
        sheet["jump_interval_s"] = config.jump_interval_s
    if config.internal_filter is not None:
        sheet["filter_lag_s2"] = config.internal_filter.lag_s2(1.0 / config.rate_hz)
    return sheet
