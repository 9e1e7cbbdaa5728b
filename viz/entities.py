"""Every entity path, title and colour of a recording, in one place.

``world/...`` is spatial (ENU, m), ``plots/<panel>/<series>`` are time series, ``state/...`` are lanes of states,
``events`` is the log and ``page`` the text about the scenario and its verdict. There is one timeline, :data:`TIME`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from viz.legible import legible

Colour = tuple[int, int, int]

APPLICATION_ID = "agtwin"
TIME = "time"
"""The timeline: simulated time since the start of the run, integer ns."""

# --- world -----------------------------------------------------------------------------------------------------------

WORLD = "world"
"""Root of everything spatial and name of the root frame (no leading slash: UrdfTree escapes one)."""
TERRAIN = "world/terrain"
GRID = "world/grid"
PLANNED_PATH = "world/planned_path"
FOCUS = "world/focus"
"""An invisible point that moves with the machine and that the camera follows."""
TRUNKS = "world/orchard/trunks"
CROWNS = "world/orchard/crowns"
IRON = "world/iron"
PLATES = "world/signs/plates"
POSTS = "world/signs/posts"


def machine(robot: str) -> str:
    """Root of the machine's geometry; ``robot`` is the name in the URDF."""
    return f"{WORLD}/{robot}"


def collision_geometries(robot: str) -> str:
    """Root of the machine's collision geometry, which is hidden."""
    return f"{machine(robot)}/collision_geometries"


def base_pose() -> str:
    """Pose of the machine's root link."""
    return f"{WORLD}/base_pose"


def joint(name: str) -> str:
    """Transform of one joint of the machine."""
    return f"{WORLD}/joints/{name}"


def magnet(index: int) -> str:
    """A magnet."""
    return f"{WORLD}/magnets/{index}"


def magnetic_reach(piece: int) -> str:
    """Discs on the ground in which a magnet or a piece of iron is felt; magnets are counted first."""
    return f"{WORLD}/magnetic_reach/{piece}"


SURFACE = "world/surface"
"""The field to be levelled, in tiles."""
AREA = "world/area"
"""Outline of the part of the field whose flatness is judged."""
HEIGHT_LEGEND = "world/height_legend"
"""What the colours of heights mean; it goes with the machine, and so stays in its place of the picture."""
LOAD = "world/load"
"""Soil that the blade carries."""


def surface_tile(index: int) -> str:
    """A tile of the field to be levelled."""
    return f"{SURFACE}/{index}"


def true_trail(row: int | None = None) -> str:
    """Where a row unit truly went, or else the reference point."""
    return f"{WORLD}/truth/trail" if row is None else f"{WORLD}/truth/row_{row}"


def measured_points(sensor: str) -> str:
    """Positions a sensor reported."""
    return f"{WORLD}/measurements/{sensor}"


def scan(sensor: str) -> str:
    """Points of a lidar's latest turn."""
    return f"{WORLD}/scan/{sensor}"


def lost_beams(sensor: str) -> str:
    """Where beams of the latest turn met a tree and did not come back."""
    return f"{WORLD}/scan_lost/{sensor}"


def wrong_beams(sensor: str) -> str:
    """Points of the latest turn at ranges that mean nothing."""
    return f"{WORLD}/scan_wrong/{sensor}"


def estimated_trail(estimator: str) -> str:
    """Where an estimator thought the reference point went."""
    return f"{WORLD}/estimates/{estimator}/trail"


def estimated_row_trail(estimator: str, row: int) -> str:
    """Where an estimator thought a row unit went."""
    return f"{WORLD}/estimates/{estimator}/row_{row}"


def estimated_pose(estimator: str) -> str:
    """Arrow from the estimated position along the estimated heading."""
    return f"{WORLD}/estimates/{estimator}/pose"


def estimated_rows(estimator: str) -> str:
    """Bar from the first to the last row unit, where an estimator thought they were."""
    return f"{WORLD}/estimates/{estimator}/rows"


def covariance_ellipse(estimator: str) -> str:
    """95 % ellipse of the estimated position."""
    return f"{WORLD}/estimates/{estimator}/ellipse_95"


def seeds(estimator: str) -> str:
    """Seeds that an estimator's row speeds put in the ground."""
    return f"{WORLD}/seeds/{estimator}"


def seed_map(estimator: str) -> str:
    """Map of the seeds in one turn."""
    return f"seed_map/{estimator}"


def height_map(which: str) -> str:
    """Map of the field's heights, before or after."""
    return f"height_map/{which}"


def track_map(which: str) -> str:
    """Map of a log's track: the whole, or a close-up."""
    return f"track_map/{which}"


def globe_track(sensor: str) -> str:
    """A receiver's track in latitude and longitude."""
    return f"geo/{sensor}"


COVERAGE_MAP = "coverage_map"
"""Map of what the implement covered."""


# --- pictures ---------------------------------------------------------------------------------------------------------

PICTURES = "pictures"


def picture(sensor: str) -> str:
    """What a camera saw."""
    return f"{PICTURES}/{sensor}"


def sign_box(sensor: str) -> str:
    """Where the detector found a stop sign in a camera's picture."""
    return f"{PICTURES}/{sensor}/sign"


# --- dial ------------------------------------------------------------------------------------------------------------

DIAL = "dial"
"""A compass dial with the headings of all estimators and the truth's."""
DIAL_FACE = "dial/face"
DIAL_TRUTH = "dial/truth"


def dial_needle(estimator: str) -> str:
    """Arrow along an estimator's heading."""
    return f"{DIAL}/needle/{estimator}"


def dial_name(estimator: str) -> str:
    """Line of the list beside the dial."""
    return f"{DIAL}/name/{estimator}"


def dial_bar(estimator: str) -> str:
    """An estimator's error as a bar."""
    return f"{DIAL}/bar/{estimator}"


# --- plots -----------------------------------------------------------------------------------------------------------

PLOTS = "plots"
TRUTH_SERIES = "truth"


def plot(panel: str, series: str | None = None) -> str:
    """A plot panel, or one series in it."""
    return f"{PLOTS}/{panel}" if series is None else f"{PLOTS}/{panel}/{series}"


def band(entity: str) -> str:
    """Series beside ``entity`` that holds its claimed standard deviation."""
    return f"{entity}_sigma"


# --- lanes and text --------------------------------------------------------------------------------------------------

STATE = "state"
EVENTS = "events"
PAGE = "page"


def lane(name: str) -> str:
    """One lane of states."""
    return f"{STATE}/{name}"


def event_log(source: str) -> str:
    """Log of one source of events."""
    return f"{EVENTS}/" + re.sub(r"[^A-Za-z0-9_.-]", "_", source)


# --- colours ---------------------------------------------------------------------------------------------------------

TRUTH_COLOUR: Colour = (240, 240, 240)
MEASURED_COLOUR: Colour = (125, 125, 125)
PLANNED_COLOUR: Colour = (250, 225, 130)
LIMIT_COLOUR: Colour = (205, 70, 70)
"""Of lines at a limit that is to be kept."""

MAP_COLOUR: Colour = (58, 46, 36)
"""Of the ground on maps."""

CALM_COLOUR: Colour = (52, 60, 66)
TURN_COLOUR: Colour = (140, 85, 165)
FAULT_COLOUR: Colour = (190, 60, 60)
TRUSTED_COLOUR: Colour = (50, 115, 80)
LEARNING_COLOUR: Colour = (70, 95, 140)
RECOVERING_COLOUR: Colour = (170, 120, 40)
_STRAIGHT_COLOUR: Colour = (70, 120, 70)
_OTHER_COLOUR: Colour = (110, 95, 80)

# The first five are Okabe and Ito's, which people who cannot tell red from green can read, in the order that separates
# best on both the dark plots and the soil; the others lie far from them, from one another and from grey.
_ESTIMATORS: tuple[Colour, ...] = (
    (86, 180, 233),
    (240, 150, 20),
    (220, 125, 185),
    (0, 190, 140),
    (240, 228, 66),
    (250, 65, 75),
    (180, 85, 255),
    (110, 245, 70),
    (90, 115, 255),
    (175, 120, 70),
)

SCAN_NEAR_COLOUR: Colour = (255, 120, 40)
SCAN_FAR_COLOUR: Colour = (60, 200, 255)
SCAN_LOST_COLOUR: Colour = (235, 30, 60)
SCAN_WRONG_COLOUR: Colour = (235, 60, 235)
"""Of a lidar's points: from near to far, where a beam was lost, and where one gave a wrong range."""

QUALITY_LABELS = {4: "RTK fixed", 5: "RTK float", 2: "DGPS", 1: "single", 6: "dead reckoning", 0: "no fix"}
"""NMEA GGA quality, field 6."""
QUALITY_COLOURS: dict[int, Colour] = {
    4: (60, 200, 90),
    5: (245, 190, 50),
    2: (240, 130, 40),
    1: (225, 60, 60),
    6: (190, 90, 200),
    0: (140, 140, 140),
}
EVEN_COLOUR: Colour = (232, 236, 215)
DENSE_COLOUR: Colour = (40, 105, 255)
SPARSE_COLOUR: Colour = (255, 130, 0)
DOUBLE_COLOUR: Colour = (225, 50, 225)
GAP_COLOUR: Colour = (225, 25, 25)
SEED_LEGEND: tuple[tuple[str, Colour], ...] = (
    ("25 % too many", DENSE_COLOUR),
    ("as many as wanted", EVEN_COLOUR),
    ("25 % too few", SPARSE_COLOUR),
    ("double", DOUBLE_COLOUR),
    ("behind a gap", GAP_COLOUR),
)
COVERAGE_LEGEND: tuple[tuple[str, Colour], ...] = (
    ("skipped", (245, 245, 245)),
    ("covered once", (30, 110, 90)),
    ("overlapped", (240, 150, 20)),
)
"""By how many passes went over a cell: none, one, two or more."""
LEVEL_NAMES = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


def estimator_colours(estimators: Sequence[str]) -> dict[str, Colour]:
    """Return one colour per estimator, the same wherever the estimator is drawn; repeats after ten."""
    return {name: _ESTIMATORS[index % len(_ESTIMATORS)] for index, name in enumerate(estimators)}


def legend_name(series: str) -> str:
    """Name of a series for people: ``radar_only`` reads ``radar only``."""
    return legible(series.replace("_", " "))


def dimmed(colour: Colour) -> Colour:
    """A darker shade, for what accompanies a line."""
    red, green, blue = colour
    return red * 6 // 10, green * 6 // 10, blue * 6 // 10


def segment_colour(label: str) -> Colour:
    """Colour of a path segment by what its label says it is."""
    words = label.lower()
    if "stopped" in words:
        return LEARNING_COLOUR
    if "driving" in words:
        return _STRAIGHT_COLOUR
    if "turn" in words:
        return TURN_COLOUR
    return _STRAIGHT_COLOUR if "straight" in words else _OTHER_COLOUR
