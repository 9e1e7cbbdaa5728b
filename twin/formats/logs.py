"""Opens a log of the outside world, whatever it is."""

from __future__ import annotations

from pathlib import Path

from twin.errors import BadInputError
from twin.formats.csv_log import CsvLog
from twin.formats.csv_mapping import read_mapping
from twin.formats.geodetic import Origin
from twin.formats.lines import require_file
from twin.formats.log import Log
from twin.formats.log_head import FarFromOriginError
from twin.formats.nmea_log import NmeaLog
from twin.formats.rtklib_pos import RtklibLog

_HEAD_BYTES = 1 << 16
_POS_WORDS = (b"GPST", b"UTC", b"JST")


def open_log(path: Path, *, mapping: Path | None = None, origin: Origin | None = None) -> Log:
    """Open a log with the reader that its content asks for.

    A file with a line that begins with ``%`` and names RTKLIB's columns is a solution of RTKLIB; with a mapping, a log
    is CSV; everything else is taken for sentences. A run folder of the twin's own is replayed by :mod:`twin.replay`,
    with its truth.

    Args:
        path: the log; with a mapping also the folder of its files.
        mapping: what the columns of CSV files mean: a TOML file (:mod:`twin.formats.csv_mapping`), or the name of one
            that comes with the package.
        origin: of the local frame; the log's first position if None.

    Raises:
        BadInputError: the file cannot be read, or holds nothing that can be used, or begins far from ``origin``.
    """
    if mapping is not None:
        if not path.exists():
            raise BadInputError(f"{path}: no such file")
        return CsvLog(path, read_mapping(mapping), origin=origin)
    require_file(path)
    if _is_solution(path):
        return RtklibLog(path, origin=origin)
    try:
        return NmeaLog(path, origin=origin)
    except FarFromOriginError:
        raise
    except BadInputError as error:
        if path.suffix.lower() in {".csv", ".txt", ".tsv"}:
            raise BadInputError(f"{error}; a CSV file needs --mapping, which says what its columns are") from error
        raise


def _is_solution(path: Path) -> bool:
    """Whether a file begins like a solution of RTKLIB."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    return any(
        line.startswith(b"%") and line.lstrip(b"% ").startswith(_POS_WORDS)
        for line in head.replace(b"\r", b"\n").split(b"\n")
    )
