"""Reading a Parquet file that anybody may have written, without letting it fill the memory."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

MOST_CELLS = 500_000_000
"""Of one file: 4 GB of numbers."""


def read_table(path: Path, *, most_cells: int = MOST_CELLS) -> pa.Table:
    """Read a Parquet file, unless its own footer says that it holds more than ``most_cells`` values.

    Raises:
        OSError: it is not there or cannot be read.
        pa.ArrowException: it is not Parquet.
        ValueError: it is too large.
    """
    with pq.ParquetFile(path) as file:
        cells = file.metadata.num_rows * file.metadata.num_columns
        if cells > most_cells:
            raise ValueError(f"{cells:.3g} values; at most {most_cells:.3g} are read")
        return file.read()
