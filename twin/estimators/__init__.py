"""Estimators: measurements in, estimates out; they never see the truth.

``EstimatorConfigUnion`` is the discriminated union of every kind's configuration, :func:`build_estimator` makes the
estimator of one. Importing this package is light; filterpy is imported when an estimator first needs it.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from twin.estimators.adapter import AdaptedEstimator, PluginConfig, load_class, load_entry_point
from twin.estimators.ins_build import RowSpeedInsConfig
from twin.estimators.row_speed_ekf import RowSpeedEkf, RowSpeedEkfConfig
from twin.estimators.row_speed_ins import RowSpeedIns
from twin.estimators.speed_only import GnssSpeedOnlyConfig, RadarOnlyConfig, SpeedOnly
from twin.signals import Estimator, EstimatorSetup

__all__ = [
    "AdaptedEstimator",
    "EstimatorConfigUnion",
    "GnssSpeedOnlyConfig",
    "PluginConfig",
    "RadarOnlyConfig",
    "RowSpeedEkfConfig",
    "RowSpeedInsConfig",
    "build_estimator",
    "load_class",
    "load_entry_point",
]

AnyEstimatorConfig = RowSpeedEkfConfig | RowSpeedInsConfig | RadarOnlyConfig | GnssSpeedOnlyConfig | PluginConfig
EstimatorConfigUnion = Annotated[AnyEstimatorConfig, Field(discriminator="kind")]


def build_estimator(config: AnyEstimatorConfig, setup: EstimatorSetup) -> Estimator:
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
        case PluginConfig():
            return AdaptedEstimator(load_entry_point(config.name), setup, config.options)
