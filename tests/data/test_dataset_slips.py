"""One slip in the brackets of dataset.toml is one message, with what to write; a CSV is no dataset."""

from __future__ import annotations

from pathlib import Path

import pytest

from mjfish.data import load_dataset
from mjfish.errors import InputError

HEAD = 'schema = 1\nname = "x"\nfish = "pike"\n'
RUN = '[[trials]]\nname = "a"\nfile = "a.csv"\n'
SEGMENT = "start = 0.0\nomega = 18.0\nbias = [0.0, 0.0, 0.0, 0.0]\n"
WAVE = "frequency = 1.0\namplitude = [0.1, 0.1, 0.1, 0.1]\nphase = [0.0, 0.0, 0.0, 0.0]\n"
SLIPS = {
    "segment as a table": (RUN + "[trials.drive]\n" + SEGMENT, "write [[trials.drive]] in place of [trials.drive]"),
    "wave as a list": (
        RUN + '[[trials.drive]]\nkind = "wave"\n' + WAVE,
        "write [trials.drive] in place of [[trials.drive]]",
    ),
    "wave as a list, no kind": (RUN + "[[trials.drive]]\n" + WAVE, "write [trials.drive] in place of"),
    "no kind": (RUN + "[trials.drive]\n" + WAVE, '[trials.drive] has no kind, expected kind = "wave"; add it'),
    "trials.wave": (RUN + "[trials.wave]\n" + WAVE, 'expected [trials.drive] with kind = "wave"'),
    "one trial": (
        RUN.replace("[[trials]]", "[trials]"),
        "trials: one table, expected a list of them; write [[trials]]",
    ),
    "trial": (RUN.replace("trials", "trial"), "[[trial]] is no table of a dataset, expected [[trials]]"),
    "name in the brackets": ('[trials.a]\nfile = "a.csv"\n', 'expected [[trials]] with name = "a" below it'),
    "one sensor": (RUN + '[trials.sensors]\nkind = "gyro"\nfile = "g.csv"\n', "write [[trials.sensors]] in place of"),
    "drive of nobody": (RUN + "[[drive]]\n" + SEGMENT, "'drive' belongs to a trial, expected [[trials.drive]]"),
    "list of noise": ("[[noise]]\nsurge = 0.1\n" + RUN, "noise: a list of tables, expected one; write [noise]"),
}


@pytest.mark.parametrize(("text", "complaint"), SLIPS.values(), ids=SLIPS)
def test_one_slip_is_one_message(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "dataset.toml").write_text(HEAD + text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_dataset(tmp_path)
    assert complaint in str(caught.value)
    assert str(caught.value).count("dataset.toml: ") == 1, caught.value


def test_a_table_is_no_dataset_and_what_makes_one_of_it_is_said(tmp_path: Path) -> None:
    table = tmp_path / "run1.csv"
    table.write_text("t,u\n0,1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"run1.csv: is a CSV file, .*'mjfish dataset new DIR .*run1.csv'"):
        load_dataset(table)
    with pytest.raises(InputError, match=r"has no dataset.toml, .*'mjfish dataset new DIR .*/\*.csv'"):
        load_dataset(tmp_path)
