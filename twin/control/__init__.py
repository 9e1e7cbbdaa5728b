"""Control: from what is known of the machine to what is asked of it.

``DriverConfigUnion`` is the union of every kind of driver's configuration, :func:`build_driver` makes the driver of
one. ``ImplementConfigUnion`` and :func:`build_implement` are the same for whoever holds the implement.
"""

from __future__ import annotations

from typing import Annotated, Any, Protocol

from pydantic import Discriminator, Tag

from twin.control.heading_hold import HeadingHold, HeadingHoldConfig
from twin.control.lane_following import LaneFollowing, LaneFollowingConfig
from twin.control.lane_keeping import LaneDriverConfig
from twin.control.levelling import LevellingControl, LevellingControlConfig
from twin.control.path_following import PathDriver, PathDriverConfig
from twin.control.reciprocation import Reciprocation, ReciprocationConfig
from twin.control.tree_distances import TreeDistancesDriver, TreeDistancesDriverConfig
from twin.geometry import Path
from twin.signals import Command, Knowledge

__all__ = [
    "CONTROL_HZ",
    "DEFAULT_DRIVER",
    "AnyDriverConfig",
    "Driver",
    "DriverConfigUnion",
    "HeadingHoldConfig",
    "ImplementConfigUnion",
    "ImplementController",
    "LaneDriverConfig",
    "LaneFollowingConfig",
    "LevellingControlConfig",
    "PathDriverConfig",
    "ReciprocationConfig",
    "TreeDistancesDriverConfig",
    "build_driver",
    "build_implement",
    "is_blind",
]

CONTROL_HZ = 50.0
"""How often a driver is asked."""
DEFAULT_DRIVER = "path"
"""Kind of a driver whose section names none."""


class Driver(Protocol):
    """Whoever commands the machine, asked at :data:`CONTROL_HZ`."""

    path: Path
    """What is planned, for the middle of the axle that does not steer."""
    segment: int
    """What the driver is at: place in ``segment_names``."""

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Pieces of the path, or states of the driver."""

    def command(self, knowledge: Knowledge, interval_s: float) -> Command:
        """Return what the driver asks of the machine now; called every ``interval_s``."""


class ImplementController(Protocol):
    """Whoever commands the implement, asked after the driver at the same rate."""

    def amend(self, command: Command, knowledge: Knowledge) -> Command:
        """Return the driver's command with what is asked of the implement in it."""


AnyDriverConfig = (
    PathDriverConfig | HeadingHoldConfig | TreeDistancesDriverConfig | LaneFollowingConfig | ReciprocationConfig
)


def _kind(value: Any) -> Any:
    """Kind of a driver's section; one that names none follows a path."""
    return value.get("kind", DEFAULT_DRIVER) if isinstance(value, dict) else getattr(value, "kind", None)


DriverConfigUnion = Annotated[
    Annotated[PathDriverConfig, Tag("path")]
    | Annotated[HeadingHoldConfig, Tag("heading_hold")]
    | Annotated[TreeDistancesDriverConfig, Tag("tree_distances")]
    | Annotated[LaneFollowingConfig, Tag("lane_following")]
    | Annotated[ReciprocationConfig, Tag("reciprocation")],
    Discriminator(_kind),
]


def build_driver(
    config: AnyDriverConfig,
    *,
    start_e_n_heading: tuple[float, float, float],
    wheelbase_m: float,
    seed: int,
    reference_x_m: float = 0.0,
) -> Driver:
    """Make the driver a configuration describes.

    Args:
        config: of the driver.
        start_e_n_heading: where the middle of the axle that does not steer stands at the beginning, m and rad.
        wheelbase_m: of the machine; zero where nothing steers.
        seed: of the world, which decides how a driver wanders.
        reference_x_m: how far before that middle the reference frame is, of which estimates tell; it does not change
            what is planned.
    """
    match config:
        case PathDriverConfig():
            return PathDriver(
                config,
                start_e_n_heading=start_e_n_heading,
                wheelbase_m=wheelbase_m,
                seed=seed,
                reference_x_m=reference_x_m,
            )
        case HeadingHoldConfig():
            return HeadingHold(config, start_e_n_heading=start_e_n_heading)
        case TreeDistancesDriverConfig():
            return TreeDistancesDriver(config, start_e_n_heading=start_e_n_heading)
        case LaneFollowingConfig():
            return LaneFollowing(config, start_e_n_heading=start_e_n_heading)
        case ReciprocationConfig():
            return Reciprocation(config, start_e_n_heading=start_e_n_heading, seed=seed)


def is_blind(driver: Driver) -> bool:
    """Whether a driver that goes by an estimator has nothing to go by now."""
    return isinstance(driver, PathDriver) and driver.blind


ImplementConfigUnion = LevellingControlConfig
"""A second kind makes a union of it."""


def build_implement(config: ImplementConfigUnion) -> ImplementController:
    """Make the controller of the implement that a configuration describes."""
    return LevellingControl(config, interval_s=1.0 / CONTROL_HZ)
