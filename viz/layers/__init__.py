"""The layers of a recording: each draws one subject, and nothing where the streams it needs are absent."""

from __future__ import annotations

from viz.layers.coverage_map import draw_coverage_map
from viz.layers.dial import draw_dial
from viz.layers.estimates import draw_estimates
from viz.layers.field_and_wheels import draw_field_strength, draw_wheel_speeds
from viz.layers.field_maps import draw_field_maps
from viz.layers.ground import draw_ground
from viz.layers.guidance import draw_cross_track_plot
from viz.layers.heights import draw_height_plots
from viz.layers.lane import draw_lane_plot
from viz.layers.load import draw_load
from viz.layers.machine import draw_machine
from viz.layers.measurements import draw_measured_positions
from viz.layers.pictures import draw_pictures
from viz.layers.plots import draw_motion_plots, draw_row_speed_plots
from viz.layers.receivers import draw_receivers
from viz.layers.scans import draw_scans
from viz.layers.seeds import draw_population_plot, draw_seeds
from viz.layers.soil import draw_soil_plots
from viz.layers.states import draw_states
from viz.layers.surface import draw_surface
from viz.layers.surroundings import draw_surroundings
from viz.layers.text import draw_events, draw_page
from viz.layers.trails import draw_row_trails
from viz.sheet import Layer

LAYERS: tuple[Layer, ...] = (
    draw_ground,
    draw_surroundings,
    draw_machine,
    draw_load,
    draw_surface,
    draw_row_trails,
    draw_measured_positions,
    draw_estimates,
    draw_dial,
    draw_seeds,
    draw_field_maps,
    draw_coverage_map,
    draw_cross_track_plot,
    draw_height_plots,
    draw_row_speed_plots,
    draw_motion_plots,
    draw_lane_plot,
    draw_population_plot,
    draw_field_strength,
    draw_wheel_speeds,
    draw_scans,
    draw_pictures,
    draw_receivers,
    draw_soil_plots,
    draw_states,
    draw_events,
    draw_page,
)
"""In the order in which panels appear. A machine with more to show adds its layers here."""
