"""Tables as laboratories write them: the files in ``dialects`` hold one track, each written in another way.

A row has a time, x and y [mm] and a heading [deg]. What cannot be read is refused by file, row and line, with the
option that helps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mjfish.data import importers, read_table
from mjfish.data.importers import FileReport
from mjfish.data.importers.mapping import PosesMap
from mjfish.data.importers.recognition import guess, units
from mjfish.data.tables import read_sheet
from mjfish.data.trial import Trial
from mjfish.errors import MjfishError
from mjfish.files.tomlfile import parse

FILES = Path(__file__).parent / "dialects"
ROWS = np.arange(24)
#: The track, as rounded in the files: time [s], x and y [m], heading [rad].
TIME = 0.04 * ROWS
PLACE = 1e-3 * np.column_stack([np.round(100.0 * np.sin(0.3 * ROWS) - 20.0, 2), 5.5 * ROWS - 60.0])
HEADING = np.radians(np.round(12.0 * np.cos(0.4 * ROWS), 3))
MAP = 'schema = 1\nkind = "poses"\nfish = "pike"\nyaw = "heading"\nlength_unit = "mm"\nangle_unit = "deg"\n'
WAVE = "[wave]\nfrequency = 2.0\namplitude = [0.1, 0.1, 0.1, 0.1]\nphase = [0.0, 0.0, 0.0, 0.0]\n"
FREE = WAVE + "free = true\n"


def _import(name: str, folder: Path, keys: str = "", wave: str = FREE) -> tuple[Trial, FileReport]:
    mapping = folder / "map.toml"
    mapping.write_text(MAP + keys + wave, encoding="utf-8")
    dataset, report = importers.import_files("poses", [FILES / name], mapping=mapping)
    return dataset.trials[0], report.files[0]


#: Keys of the mapping file, the first time [s], and what the report says of how the file was read.
READ: dict[str, tuple[str, float, tuple[str, ...]]] = {
    "points.csv": ("", 0.0, ()),
    "windows_lines.csv": ("", 0.0, ()),
    "semicolons.csv": ("", 0.0, ("columns separated by semicolons",)),
    "tabs.tsv": ("", 0.0, ("columns separated by tabs",)),
    "bars.csv": ("", 0.0, ("columns separated by bars",)),
    "semicolons_decimal_commas.csv": ("", 0.0, ("columns separated by semicolons", "decimal commas")),
    "tabs_decimal_commas.tsv": ("", 0.0, ("columns separated by tabs", "decimal commas")),
    "quoted_decimal_commas.csv": ("", 0.0, ("decimal commas",)),
    "utf8_with_mark.csv": ("", 0.0, ()),
    "utf16.csv": ("", 0.0, ("text read as utf-16",)),
    "utf16_other_order.csv": ("", 0.0, ("text read as utf-16", "columns separated by tabs")),
    "utf16_without_mark.csv": ('encoding = "utf-16-le"\n', 0.0, ("text read as utf-16-le",)),
    "latin1.csv": ("", 0.0, ("text read as cp1252", "columns separated by semicolons", "decimal commas")),
    "mac_roman.csv": ('encoding = "mac_roman"\n', 0.0, ("text read as mac_roman",)),
    "units_line.csv": ("", 0.0, ("units from line 2",)),
    "units_in_brackets.csv": ("", 0.0, ("units from line 2", "decimal commas")),
    "preamble.csv": ("", 0.0, ("4 lines above the header left out",)),
    "preamble_and_units.csv": ("", 0.0, ("3 lines above the header left out", "units from line 5")),
    "preamble_tabs.tsv": ("", 0.0, ("3 lines above the header left out",)),
    "numbers_above.csv": ("skip = 2\n", 0.0, ("2 lines above the header left out",)),
    "unicode_minus.csv": ("", 0.0, ()),
    "epoch_s.csv": ("", 0.0, ("times are dates: they count from the first row, 2024-05-01T12:00:00.000 UTC",)),
    "epoch_ms.csv": ('time_unit = "ms"\n', 0.0, ("times are dates: they count from the first row, 2024-05-01T12:00",)),
    "epoch_us.csv": ('time_unit = "us"\n', 0.0, ("times are dates: they count from the first row, 2024-05-01T12:00",)),
    "epoch_ns.csv": ('time_unit = "ns"\n', 0.0, ("times are dates: they count from the first row, 2024-05-01T12:00",)),
    "boot_s.csv": ("", 5000.0, ()),
    "boot_ms.csv": ('time_unit = "ms"\n', 5000.0, ()),
    "boot_us.csv": ('time_unit = "us"\n', 5000.0, ()),
    "boot_ns.csv": ('time_unit = "ns"\n', 5000.0, ()),
    "iso.csv": ("", 0.0, ("times are dates: they count from the first row, 2024-05-01T12:00:00.000 UTC",)),
    "iso_zone.csv": ("", 0.0, ("times are dates: they count from the first row, 2024-05-01T10:00:00.000 UTC",)),
    "iso_commas.csv": ("", 0.0, ("times are dates", "decimal commas")),
    "repeated_row.csv": ("", 0.0, ("1 repeated rows left out",)),
}


@pytest.mark.parametrize("name", READ)
def test_a_dialect_is_read_right_and_said(name: str, tmp_path: Path) -> None:
    keys, first, said = READ[name]
    trial, report = _import(name, tmp_path, keys)
    place, heading = trial.sensors
    for sensor in (place, heading):
        np.testing.assert_allclose(sensor.time, first + TIME, rtol=0.0, atol=3e-7)  # epochs in ns as float64
    np.testing.assert_allclose(place.values, PLACE, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(heading.values[:, 0], HEADING, rtol=0.0, atol=1e-12)
    notes = report.notes[: report.notes.index("a sample every 40 ms")]
    for text in said:
        assert any(text in note for note in notes), notes
    assert bool(notes) == bool(said), notes


#: Keys of the mapping file, and parts of the message.
REFUSED: dict[str, tuple[str, tuple[str, ...]]] = {
    "bare_decimal_commas.csv": (
        "",
        ("row 1 (line 2): 8 cells, expected 4 (time to heading)", "give --separator", "decimal commas need another"),
    ),
    "mixed_decimals.csv": ("", ("decimal comma, '", "and with a decimal point, '", "give --decimal")),
    "thousands.csv": ("", ("row 6 (line 7), column 'x': '1.234,5' is not a number such as -0,25", "--decimal")),
    "spaces.txt": ("", ("no table of numbers, found 'time x y heading' in line 1", "give --separator")),
    "utf16_without_mark.csv": ("", ("byte 2 is zero", "in UTF-16 without its mark", "give --encoding")),
    "no_header.csv": ("", ("4 columns without a header line", "put a line with their names", "give --skip")),
    "numbers_above.csv": ("", ("4 columns without a header line", "give --skip")),
    "same_time.csv": ("", ("row 11 (line 12), column 'time': 0.36 s repeats that of row 10", "the row is repeated")),
    "backwards.csv": ("", ("row 11 (line 12), column 'time': 0.16 s is before the 0.36 s of row 10", "sort the rows")),
    "epoch_ms.csv": ("", ("24 rows over 920 s", "or their unit (--time-unit")),
    "boot_us.csv": ("", ("24 rows over 920000 s", "or their unit (--time-unit")),
    "iso_broken.csv": ("", ("row 7 (line 8), column 'time': '2024-05-01T12:00:61' is no date", "correct it or")),
    "text_below_preamble.csv": ("", ("row 7 (line 11), column 'x [mm]': 'lost' is not a number", "correct it")),
    "no_time.csv": ("", ("row 8 (line 9), column 'time': the cell is empty", "fill it in")),
    "two_columns.csv": ("", ("2 columns 'x', expected one; rename the others",)),
    "short_row.csv": ("", ("row 4 (line 6): 2 cells, expected 4", "complete or remove the row")),
    "semicolons.csv": ('separator = ","\n', ("found 'time;x;y;heading' in line 1; give --separator",)),
    "points.csv": ("skip = 90\n", ("has no line 91, expected the table below 90 lines; correct --skip",)),
    "preamble.csv": ("skip = 3\n", ("line 4 is empty, expected the headers of the columns", "give --skip")),
    "latin1.csv": ('encoding = "utf-8"\n', ("line 1 is no utf-8 text; give --encoding",)),
    "mac_roman.csv": ('encoding = "idna"\n', ("line 1 is no idna text; give --encoding",)),
    "utf16.csv": ('encoding = "utf-99"\n', ("no encoding 'utf-99', expected e.g. utf-8 or cp1252; correct --enc",)),
    "tabs.tsv": ('separator = "space"\n', ("map.toml: separator: expected ',', ';', 'tab' or '|'",)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_mistake_is_refused_by_its_place_and_the_option(name: str, tmp_path: Path) -> None:
    keys, parts = REFUSED[name]
    with pytest.raises(MjfishError) as caught:
        _import(name, tmp_path, keys)
    for part in parts:
        assert part in str(caught.value), str(caught.value)
    assert name in str(caught.value) or "map.toml" in str(caught.value)


def test_every_file_is_read_or_refused() -> None:
    assert {file.name for file in FILES.iterdir()} == {*READ, *REFUSED}


@pytest.mark.parametrize("first", ["inf", "1e300"])
def test_a_time_beyond_all_dates_is_refused(first: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time,x\n" + f"{first},1\n" * 3, encoding="utf-8")
    with pytest.raises(MjfishError, match=r"row 1 \(line 2\), column 'time': .*, expected a finite number up to 1e"):
        read_sheet(path).seconds("time", 1.0)


def test_dates_are_no_clock_of_a_drive(tmp_path: Path) -> None:
    """A drive that is synchronised starts at 0 of the file. Catches a phase that counts from 1970."""
    with pytest.raises(MjfishError, match=r"iso\.csv: column 'time': times are dates: .* the clock of the drive, 0"):
        _import("iso.csv", tmp_path, wave=WAVE)


def test_a_column_without_its_unit_is_the_one_with_a_unit(tmp_path: Path) -> None:
    trial, _ = _import("latin1.csv", tmp_path, 'x = "x"\n')
    assert trial.sensors[1].values[0, 0] == pytest.approx(np.radians(12.0), abs=1e-15)


def test_a_file_of_a_dataset_may_have_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time [s];surge [m/s]\n0;0,25\n0,02;−0,5\n", encoding="utf-8")
    assert {name: values.tolist() for name, values in read_table(path).items()} == {
        "time": [0.0, 0.02],
        "surge": [0.25, -0.5],
    }


@pytest.mark.parametrize(
    ("header", "unit"), [("time [µs]", "us"), ("t (μs)", "us"), ("timestamp_ns", "ns"), ("t [msec]", "ms"), ("t", None)]
)
def test_a_header_names_the_unit_of_its_times(header: str, unit: str | None) -> None:
    """Catches a micro sign that is dropped, which makes seconds of microseconds."""
    assert guess([header]).columns == {"time": header}
    assert units({"time": header}) == ({} if unit is None else {"time": {unit}})


def test_the_options_are_keys_of_a_mapping_file() -> None:
    table = {"schema": 1, "kind": "poses", "fish": "pike", "wave": {"frequency": 1, "amplitude": [1], "phase": [0]}}
    found = parse({**table, "separator": "tab", "decimal": ",", "encoding": "cp1252", "skip": 3}, PosesMap, "map.toml")
    assert (found.separator, found.decimal, found.encoding, found.skip) == ("tab", ",", "cp1252", 3)
