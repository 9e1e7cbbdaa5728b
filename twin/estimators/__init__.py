"""Estimators: measurements in, estimates out; they never see the truth.

``EstimatorConfigUnion`` is the discriminated union of every kind's configuration, :func:`build_estimator` makes the
estimator of one. Importing this package is light; filterpy is imported when an estimator first needs it.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from twin.estimators.adapter import AdaptedEstimator, PluginConfig, load_class, load_entry_point
from twin.estimators.guidance_filter import GuidanceFilter, GuidanceFilterConfig
from twin.estimators.guidance_gps import GuidanceGps, GuidanceGpsConfig
from twin.estimators.guidance_imm import GuidanceImm, GuidanceImmConfig
from twin.estimators.guidance_kinematic import GuidanceKinematic, GuidanceKinematicConfig
from twin.estimators.guidance_pv import GuidancePv, GuidancePvConfig
from twin.estimators.heading_complementary import HeadingComplementary, HeadingComplementaryConfig
from twin.estimators.heading_filter import HeadingFilter, HeadingFilterConfig
from twin.estimators.heading_kalman import HeadingKalman, HeadingKalmanConfig
from twin.estimators.heading_madgwick import HeadingMadgwick, HeadingMadgwickConfig
from twin.estimators.height_filter import HeightFilter, HeightFilterConfig
from twin.estimators.height_hold import HeightHold, HeightHoldConfig
from twin.estimators.height_vpkf import HeightVpkf, HeightVpkfConfig
from twin.estimators.ins_build import RowSpeedInsConfig
from twin.estimators.row_filter import RowFilter, RowFilterConfig
from twin.estimators.row_speed_ekf import RowSpeedEkf, RowSpeedEkfConfig
from twin.estimators.row_speed_ins import RowSpeedIns
from twin.estimators.speed_only import GnssSpeedOnlyConfig, RadarOnlyConfig, SpeedOnly
from twin.estimators.tree_distances import TreeDistances, TreeDistancesConfig
from twin.estimators.wheel_odometry import WheelOdometry, WheelOdometryConfig
from twin.signals import Estimator, EstimatorSetup

__all__ = [
    "AdaptedEstimator",
    "EstimatorConfigUnion",
    "GnssSpeedOnlyConfig",
    "GuidanceFilterConfig",
    "GuidanceGpsConfig",
    "GuidanceImmConfig",
    "GuidanceKinematicConfig",
    "GuidancePvConfig",
    "HeadingComplementaryConfig",
    "HeadingFilterConfig",
    "HeadingKalmanConfig",
    "HeadingMadgwickConfig",
    "HeightFilterConfig",
    "HeightHoldConfig",
    "HeightVpkfConfig",
    "PluginConfig",
    "RadarOnlyConfig",
    "RowFilterConfig",
    "RowSpeedEkfConfig",
    "RowSpeedInsConfig",
    "TreeDistancesConfig",
    "WheelOdometryConfig",
    "build_estimator",
    "load_class",
    "load_entry_point",
]

HeadingFilterUnion = (
    HeadingComplementaryConfig | HeadingMadgwickConfig | HeadingKalmanConfig | HeadingFilterConfig | WheelOdometryConfig
)
RowSpeedUnion = RowSpeedEkfConfig | RowSpeedInsConfig | RadarOnlyConfig | GnssSpeedOnlyConfig
LaneUnion = RowFilterConfig | TreeDistancesConfig
HeightUnion = HeightHoldConfig | HeightVpkfConfig | HeightFilterConfig
GuidanceUnion = (
    GuidanceGpsConfig | GuidancePvConfig | GuidanceFilterConfig | GuidanceKinematicConfig | GuidanceImmConfig
)
AnyEstimatorConfig = RowSpeedUnion | HeadingFilterUnion | LaneUnion | HeightUnion | GuidanceUnion | PluginConfig
EstimatorConfigUnion = Annotated[AnyEstimatorConfig, Field(discriminator="kind")]


def build_estimator(  # noqa: C901, PLR0911, PLR0912 - one case per kind
    config: AnyEstimatorConfig, setup: EstimatorSetup
) -> Estimator:
    """Make the estimator a configuration describes, for the sensors and runs of ``setup``.

    Raises:
        BadInputError: the configuration does not fit the sensors, or a plug-in cannot be loaded.
    """
    match config:
        case RowSpeedEkfConfig():
            return RowSpeedEkf(config, setup)
        case RowSpeedInsConfig():
            return RowSpeedIns(config, setup)
        case RadarOnlyConfig() | GnssSpeedOnlyConfig():
            return SpeedOnly(config, setup)
        case HeadingComplementaryConfig():
            return HeadingComplementary(config, setup)
        case HeadingMadgwickConfig():
            return HeadingMadgwick(config, setup)
        case HeadingKalmanConfig():
            return HeadingKalman(config, setup)
        case HeadingFilterConfig():
            return HeadingFilter(config, setup)
        case WheelOdometryConfig():
            return WheelOdometry(config, setup)
        case RowFilterConfig():
            return RowFilter(config, setup)
        case TreeDistancesConfig():
            return TreeDistances(config, setup)
        case HeightHoldConfig():
            return HeightHold(config, setup)
        case HeightVpkfConfig():
            return HeightVpkf(config, setup)
        case HeightFilterConfig():
            return HeightFilter(config, setup)
        case GuidanceGpsConfig():
            return GuidanceGps(config, setup)
        case GuidancePvConfig():
            return GuidancePv(config, setup)
        case GuidanceFilterConfig():
            return GuidanceFilter(config, setup)
        case GuidanceKinematicConfig():
            return GuidanceKinematic(config, setup)
        case GuidanceImmConfig():
            return GuidanceImm(config, setup)
        case PluginConfig():
            return AdaptedEstimator(load_entry_point(config.name), setup, config.options)
