"""The layers of a recording: each draws one subject, and nothing where the streams it needs are absent."""

from __future__ import annotations

from viz.layers.estimates import draw_estimates
from viz.layers.field_and_wheels import draw_field_strength, draw_wheel_speeds
from viz.layers.ground import draw_ground
from viz.layers.machine import draw_machine
from viz.layers.measurements import draw_measured_positions
from viz.layers.pictures import draw_pictures
from viz.layers.plots import draw_motion_plots, draw_row_speed_plots
from viz.layers.receivers import draw_receivers
from viz.layers.scans import draw_scans
from viz.layers.seeds import draw_population_plot, draw_seeds
from viz.layers.states import draw_states
from viz.layers.surroundings import draw_surroundings
from viz.layers.text import draw_events, draw_page
from viz.layers.trails import draw_row_trails
from viz.sheet import Layer

LAYERS: tuple[Layer, ...] = (
    draw_ground,
    draw_surroundings,
    draw_machine,
    draw_row_trails,
    draw_measured_positions,
    draw_estimates,
    draw_seeds,
    draw_row_speed_plots,
    draw_motion_plots,
    draw_population_plot,
    draw_field_strength,
    draw_wheel_speeds,
    draw_scans,
    draw_pictures,
    draw_receivers,
    draw_states,
    draw_events,
    draw_page,
)
"""In the order in which panels appear. A machine with more to show adds its layers here."""
