"""Pictures go to disk and come back, and what is not ours is refused before it is decoded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from twin import jpeg
from twin.errors import BadInputError
from twin.jpeg import EncodedPicture
from twin.pictures import Pictures, load_pictures, save_pictures


def picture(value: int = 90, width: int = 40, height: int = 30) -> bytes:
    rgb = np.full((height, width, 3), value, dtype=np.uint8)
    rgb[:, : width // 2] = (200, 30, 40)
    return jpeg.encode(rgb)


def taken(*jpegs: bytes) -> Pictures:
    return Pictures.of([EncodedPicture(t_ns=100 * k, jpeg=each) for k, each in enumerate(jpegs)])


def stated(data: bytes, width: int, height: int) -> bytes:
    """The same file with another size in its frame header."""
    at = data.index(b"\xff\xc0")
    return data[: at + 5] + height.to_bytes(2) + width.to_bytes(2) + data[at + 9 :]


def test_a_picture_keeps_size_and_colours() -> None:
    data = picture()
    assert jpeg.size_px(data) == (40, 30)
    shown = jpeg.decode(data)
    np.testing.assert_allclose(shown[5, 5], (200, 30, 40), atol=6)
    np.testing.assert_allclose(shown[5, 35], (90, 90, 90), atol=6)
    assert jpeg.encode(jpeg.decode(data)) == jpeg.encode(jpeg.decode(data))


def test_what_is_no_picture_is_refused() -> None:
    good = picture()
    for bad, message in (
        (b"", "not a JPEG"),
        (b"\x89PNG\r\n\x1a\n" + b"0" * 50, "not a JPEG"),
        (good[:30], "without a frame header"),
        (b"\xff\xd8" + b"\xff\xe0\x00\x00" * 20, "without a frame header"),
        (stated(good, 60_000, 60_000), "60000 x 60000 pixels; at most 4096"),
        (stated(good, 0, 30), "0 x 30 pixels"),
        (good + b"0" * 5_000_000, "bytes; at most"),
    ):
        with pytest.raises(BadInputError, match=message):
            jpeg.size_px(bad)
        with pytest.raises(BadInputError, match=message):
            jpeg.decode(bad)
    # A header alone.
    with pytest.raises(BadInputError, match="cannot be decoded"):
        jpeg.decode(good[: good.index(b"\xff\xda")])


def test_pictures_of_one_run_have_one_size() -> None:
    with pytest.raises(BadInputError, match="picture 1 has 20 x 30 pixels; the first has 40 x 30"):
        taken(picture(), picture(width=20))


def test_pictures_come_back_and_equal_ones_make_equal_files(tmp_path: Path) -> None:
    pictures = taken(picture(10), picture(20))
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_pictures({"front": pictures}, tmp_path / name)
    path = Path("pictures/front.parquet")
    assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes()
    back = load_pictures(tmp_path / "a")["front"]
    assert back.jpeg == pictures.jpeg
    np.testing.assert_array_equal(back.t_ns, [0, 100])
    assert (back.width_px, back.height_px) == (40, 30)
    np.testing.assert_array_equal(back.rgb(1), jpeg.decode(picture(20)))
    (tmp_path / "none").mkdir()
    assert load_pictures(tmp_path / "none") == {}


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t_ns": [0.5]}, "expected the columns t_ns, jpeg, width, height"),
        ({"jpeg": [b"nothing"]}, "not a JPEG"),
        ({"jpeg": pa.array([None], pa.binary())}, "a value is missing"),
        ({"width": pa.array([41], pa.int32())}, "do not have the size that is stated"),
        ({"jpeg": [stated(picture(), 50_000, 30)]}, "50000 x 30 pixels"),
    ],
)
def test_a_file_that_is_not_ours_is_named(tmp_path: Path, columns: dict[str, Any], message: str) -> None:
    (tmp_path / "pictures").mkdir()
    good = {"t_ns": [0], "jpeg": [picture()], "width": pa.array([40], pa.int32()), "height": pa.array([30], pa.int32())}
    pq.write_table(pa.table(good | columns), tmp_path / "pictures" / "front.parquet")
    with pytest.raises(BadInputError, match=f"front.parquet: cannot be read as pictures .*{message}"):
        load_pictures(tmp_path)
    (tmp_path / "pictures" / "front.parquet").write_bytes(b"PAR1 nothing")
    with pytest.raises(BadInputError, match=r"front\.parquet: cannot be read as pictures"):
        load_pictures(tmp_path)


def test_a_small_file_that_unfolds_to_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pictures").mkdir()
    count = 1_000
    sides = {"width": pa.array([40] * count, pa.int32()), "height": pa.array([30] * count, pa.int32())}
    table = pa.table({"t_ns": list(range(count)), "jpeg": [picture()] * count, **sides})
    path = tmp_path / "pictures" / "front.parquet"
    pq.write_table(table, path)
    assert path.stat().st_size < 40_000
    monkeypatch.setattr("twin.pictures._LARGEST_BYTES", 100_000)
    with pytest.raises(BadInputError, match=r"more than .* bytes of them"):
        load_pictures(tmp_path)
