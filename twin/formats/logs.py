"""Opens a log of the outside world, whatever it is."""

from __future__ import annotations

from pathlib import Path

from twin.errors import BadInputError
from twin.formats.geodetic import Origin
from twin.formats.lines import require_file
from twin.formats.log import Log
from twin.formats.nmea_log import NmeaLog


def open_log(path: Path, *, mapping: Path | None = None, origin: Origin | None = None) -> Log:
    """Open a log with the reader that its content asks for.

    Args:
        path: the log.
        mapping: what the columns of a table mean (:mod:`twin.formats.csv_mapping`).
        origin: of the local frame; the log's first position if None.

    Raises:
        BadInputError: the file cannot be read, or holds nothing that can be used.
    """
    require_file(path)
    if mapping is not None:
        raise BadInputError(f"{path}: a log of sentences has no columns that {mapping} could be about")
    return NmeaLog(path, origin=origin)
