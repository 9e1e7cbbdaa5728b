"""Pictures of a run: in memory, and in the run folder as ``pictures/<sensor>.parquet``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from twin.errors import BadInputError
from twin.jpeg import EncodedPicture, decode, size_px
from twin.signals import IntArray

FOLDER = "pictures"

_LARGEST_BYTES = 2_000_000_000
_MOST_PICTURES = 2_000_000
_BATCH = 16
_SCHEMA = pa.schema(
    [("t_ns", pa.int64()), ("jpeg", pa.binary()), ("width", pa.int32()), ("height", pa.int32())],
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pictures:
    """What one camera saw in one run, in order of time."""

    t_ns: IntArray
    """(T,) when it says they were taken."""
    jpeg: tuple[bytes, ...]
    """T pictures of one size."""
    width_px: int
    height_px: int

    @classmethod
    def of(cls, taken: Sequence[EncodedPicture]) -> Self:
        """Pictures that a sensor took.

        Raises:
            BadInputError: one of them is not a JPEG picture, or has another size than the first.
        """
        sizes = [size_px(picture.jpeg) for picture in taken]
        first = sizes[0] if sizes else (0, 0)
        for index, size in enumerate(sizes):
            if size != first:
                raise BadInputError(
                    f"picture {index} has {size[0]} x {size[1]} pixels; the first has {first[0]} x {first[1]}"
                )
        return cls(
            t_ns=np.array([picture.t_ns for picture in taken], dtype=np.int64),
            jpeg=tuple(picture.jpeg for picture in taken),
            width_px=first[0],
            height_px=first[1],
        )

    def __len__(self) -> int:
        return len(self.jpeg)

    def rgb(self, index: int) -> NDArray[np.uint8]:
        """One picture (height, width, 3).

        Raises:
            BadInputError: it cannot be decoded.
        """
        return decode(self.jpeg[index])

    def to_arrow(self) -> pa.Table:
        """As a table: ``t_ns``, ``jpeg``, ``width``, ``height``."""
        sides = [pa.array([side] * len(self), pa.int32()) for side in (self.width_px, self.height_px)]
        return pa.table([pa.array(self.t_ns), pa.array(self.jpeg, pa.binary()), *sides], schema=_SCHEMA)


def save_pictures(pictures: dict[str, Pictures], folder: Path) -> None:
    """Write the pictures of each sensor into a run folder. The bytes depend on the pictures alone."""
    for name, taken in pictures.items():
        path = folder / FOLDER / f"{name}.parquet"
        path.parent.mkdir(exist_ok=True)
        pq.write_table(taken.to_arrow(), path, compression="none", use_dictionary=False)


def load_pictures(folder: Path) -> dict[str, Pictures]:
    """Read the pictures of a run folder by sensor; there may be none. They are not decoded yet.

    Raises:
        BadInputError: a file is not one of pictures, or too large, or what it holds is not what it says.
    """
    return {path.stem: _load(path) for path in sorted((folder / FOLDER).glob("*.parquet"))}


def _load(path: Path) -> Pictures:
    try:
        return _read(path)
    except (OSError, pa.ArrowException, BadInputError) as error:
        raise BadInputError(f"{path}: cannot be read as pictures ({error})") from error


def _read(path: Path) -> Pictures:
    taken: list[EncodedPicture] = []
    stated: set[tuple[int, int]] = set()
    total = 0
    with pq.ParquetFile(path) as file:
        if file.schema_arrow != _SCHEMA:
            raise BadInputError(f"expected the columns {', '.join(_SCHEMA.names)}")
        # Batch by batch: a small file may unfold to any size.
        for batch in file.iter_batches(batch_size=_BATCH):
            if any(column.null_count for column in batch.columns):
                raise BadInputError("a value is missing")
            stamps, blobs, widths, heights = (column.to_pylist() for column in batch.columns)
            total += sum(map(len, blobs))
            if total > _LARGEST_BYTES or len(taken) + len(blobs) > _MOST_PICTURES:
                raise BadInputError(f"more than {_MOST_PICTURES} pictures or {_LARGEST_BYTES:.3g} bytes of them")
            taken += [EncodedPicture(t_ns=t_ns, jpeg=blob) for t_ns, blob in zip(stamps, blobs, strict=True)]
            stated |= set(zip(widths, heights, strict=True))
    pictures = Pictures.of(taken)
    if taken and stated != {(pictures.width_px, pictures.height_px)}:
        raise BadInputError("the pictures do not have the size that is stated beside them")
    return pictures
