"""What ``twin list`` prints, on a terminal and to a file."""

import io
from collections.abc import Callable

import pytest
from rich.console import Console

from twin.cli.listing import first_sentence, print_lists, tables
from twin.formats.csv_mapping import MAPPINGS
from twin.scenario import bundled
from twin.sensors.presets import preset_files

NAMES = {*bundled(), *preset_files(), *(path.stem for path in MAPPINGS.glob("*.toml"))}


def _on_a_terminal_of_80_columns() -> None:
    out = io.StringIO()
    console = Console(file=out, width=80, color_system=None)
    for table in tables():
        console.print(table)
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    print(out.getvalue())


@pytest.mark.parametrize("shown", [_on_a_terminal_of_80_columns, print_lists], ids=["terminal", "file"])
def test_names_are_whole(
    shown: Callable[[], None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown()
    told = capsys.readouterr().out
    assert set(told.split()) >= NAMES
    assert "…" not in told


@pytest.mark.parametrize(
    ("toml", "sentence"),
    [
        ("# A receiver, 10 Hz,\n# that steps.\n# More.\nkind = 1\n", "A receiver, 10 Hz, that steps."),
        ("# With 2.5 m, e.g. here: no end. Then more.\nkind = 1\n# other\n", "With 2.5 m, e.g. here: no end."),
        ("# No full stop\nkind = 1\n", "No full stop"),
        ("kind = 1\n# not at the top\n", ""),
    ],
)
def test_a_preset_is_described_by_its_first_sentence(toml: str, sentence: str) -> None:
    assert first_sentence(toml) == sentence


def test_every_preset_has_a_whole_sentence() -> None:
    for name, path in preset_files().items():
        assert first_sentence(path.read_text(encoding="utf-8")).endswith("."), name
