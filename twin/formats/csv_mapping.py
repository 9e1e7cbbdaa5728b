"""What the columns of CSV files mean: a small TOML file.

    title = "..."

    [[tables]]                        # one sensor; several tables may be about one file
    kind = "gnss"                     # gnss, imu, odometry, yaw_gyro or angle_transducer: also the sensor's name
    file = "fix.csv"                  # a plain name, in the log's folder; left out, the log itself
    time = { column = "t", unit = "s", since = "unix" }

    [tables.columns]                  # of the simulated sensor; receivers have latitude_deg, longitude_deg, height_m
    latitude_deg = { column = "lat" }                       # and course_deg for position and course over
    sigma_e_m = { column = "cov_xx_m2", unit = "m2" }       # ground, clockwise from north; "m2" is a variance
    speed_m_s = { column = "inches", unit = "in", over = "seconds", scale = 0.98 }
    quality = { column = "status", values = { "-1" = 0, "0" = 1 } }
    satellites = { constant = 8 }

It is data: names of columns, units and numbers, no paths and no expressions.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from twin.config import Config, Vector3
from twin.errors import BadInputError
from twin.formats.gnss_fixes import GNSS, Fix
from twin.formats.nmea import KMH_M_S, KNOT_M_S
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.paths import ASSETS, plain_name
from twin.signals import SPEED, YAW_RATE
from twin.validation import did_you_mean, explain

MAPPINGS = ASSETS / "logs"
"""Mappings that come with the package."""
ODOMETRY = "odometry"
_LARGEST_FILE = 100_000
_MOST_TABLES = 32

IMU_COLUMNS = (
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "gyro_x_rad_s",
    "gyro_y_rad_s",
    "gyro_z_rad_s",
)
COLUMNS: Mapping[str, tuple[str, ...]] = {
    GNSS: Fix._fields[2:],
    "imu": IMU_COLUMNS,
    ODOMETRY: (SPEED, YAW_RATE),
    "yaw_gyro": (YAW_RATE,),
    "angle_transducer": ("steering_angle_rad",),
}
"""What the columns of a table can be, by kind of sensor."""
Kind = Literal["gnss", "imu", "odometry", "yaw_gyro", "angle_transducer"]

_LENGTHS = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "in": 0.0254}
_ANGLES_RAD = {"rad": 1.0, "deg": math.pi / 180.0}
_UNITS: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("_rad_s", {"rad/s": 1.0, "deg/s": math.pi / 180.0}),
    ("_m_s2", {"m/s2": 1.0, "g": STANDARD_GRAVITY_M_S2}),
    ("_m_s", {"m/s": 1.0, "km/h": KMH_M_S, "kn": KNOT_M_S, "mph": 0.44704}),
    ("_deg", {"deg": 1.0, "rad": 180.0 / math.pi}),
    ("_rad", _ANGLES_RAD),
    ("_m", _LENGTHS),
    ("_s", {"s": 1.0, "ms": 1e-3}),
    ("", {"": 1.0}),
)
"""Units by the ending of a column's name; the first of each is the twin's own."""
VARIANCE = "m2"


class TimeColumn(Config):
    """Where a row's time stands."""

    column: str
    unit: Literal["s", "ms", "us", "ns"] = "s"
    since: Literal["unix", "gps", "start"] = "unix"
    """1970 in UTC, 1980 in GPS time (ahead of UTC by the leap seconds since), or some moment nobody knows."""


class Source(Config):
    """Where a value comes from: a column of the file, or a constant."""

    column: str | None = None
    constant: float | None = None
    unit: str | None = None
    """The twin's own if not given; of a constant always that."""
    scale: float = 1.0
    """Factor on it, -1 for an axis that points the other way."""
    over: str | None = None
    """Column of seconds by which it is divided: a distance over the time it took."""
    values: Mapping[str, float] | None = None
    """What its words stand for; others are out of range."""

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if (self.column is None) == (self.constant is None):
            raise ValueError("needs either column or constant")
        if self.constant is not None and self.model_fields_set != {"constant"}:
            raise ValueError("a constant has no unit, scale, over or values")
        if self.values is not None and (self.unit is not None or self.over is not None):
            raise ValueError("words that stand for values have no unit and are not divided")
        return self


class Table(Config):
    """One sensor's columns in one file."""

    kind: Kind
    file: str | None = None
    separator: Annotated[str, Field(min_length=1, max_length=1)] = ","
    time: TimeColumn
    columns: Annotated[Mapping[str, Source], Field(min_length=1)]
    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    """Where the sensor sits, from the machine's reference point forward, left and up."""
    datasheet: Mapping[str, float] = Field(default_factory=dict)
    """What is known of the sensor, by the names that the simulated sensors' data sheets have."""

    @field_validator("file")
    @classmethod
    def _plain(cls, value: str | None) -> str | None:
        try:
            return None if value is None else plain_name(value, what="file")
        except BadInputError as error:
            raise ValueError(str(error)) from None

    @model_validator(mode="after")
    def _columns_of_the_kind(self) -> Self:
        allowed = COLUMNS[self.kind]
        for name, source in self.columns.items():
            if name not in allowed:
                hint = did_you_mean(name, allowed)
                raise ValueError(f"columns.{name}: unknown column{hint} (a {self.kind} has {', '.join(allowed)})")
            units = units_of(name, divided=source.over is not None)
            if source.unit is not None and source.unit not in units:
                raise ValueError(f"columns.{name}: unit = {source.unit!r}; allowed: {', '.join(units) or 'none'}")
        if self.kind == GNSS and not {"latitude_deg", "longitude_deg"} <= set(self.columns):
            raise ValueError("columns: a gnss needs latitude_deg and longitude_deg")
        return self


class CsvMapping(Config):
    """A log of one or several CSV files."""

    title: str = ""
    tables: Annotated[tuple[Table, ...], Field(min_length=1, max_length=_MOST_TABLES, strict=False)]

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        kinds = [table.kind for table in self.tables]
        for kind in kinds:
            if kinds.count(kind) > 1:
                raise ValueError(f"tables: two of the kind {kind!r}; a log has one sensor of each")
        starts = {table.time.since == "start" for table in self.tables}
        if len(starts) > 1:
            raise ValueError("tables: times since 'start' cannot be put beside dated ones")
        return self


def units_of(column: str, *, divided: bool = False) -> Mapping[str, float]:
    """Units that a column may be given in, with their factors; a standard deviation also as variance."""
    if divided:
        return _LENGTHS if column.endswith("_m_s") else _ANGLES_RAD if column.endswith("_rad_s") else {}
    units = next(units for ending, units in _UNITS if column.endswith(ending))
    return {**units, VARIANCE: 1.0} if column.startswith("sigma_") else units


def read_mapping(path: Path) -> CsvMapping:
    """Read a mapping: a file, or the name of one that comes with the package.

    Raises:
        BadInputError: it is not there, too large, no TOML, or says what cannot be.
    """
    bundled = MAPPINGS / f"{path.name}.toml"
    if not path.exists() and path.parent == Path() and bundled.is_file():
        path = bundled
    try:
        if not path.is_file():
            known = ", ".join(sorted(each.stem for each in MAPPINGS.glob("*.toml"))) or "none"
            raise BadInputError(f"{path}: no such mapping (with the package come: {known})")
        if path.stat().st_size > _LARGEST_FILE:
            raise BadInputError(f"{path}: larger than {_LARGEST_FILE} bytes: not a mapping")
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise BadInputError(f"{path}: not valid TOML ({error})") from error
    try:
        return CsvMapping.model_validate(table)
    except ValidationError as error:
        raise BadInputError(explain(error, CsvMapping, str(path))) from error
