"""Missing samples: refused unless they are declared, and only where the joints are known without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from recordings import ROWS, STEP, TOML, cell, cpg_csv, lines, refusal, write_folder

from mjfish import data as trial

_GAPS = TOML.replace('role = "fit"\n', 'role = "fit"\ngaps = true\n')


def _broken(text: str) -> str:
    """Three rows lost, an empty cell, and one that MATLAB writes as NaN."""
    text = cell(30, 2, "NaN")(cell(20, 1, "")(text))
    return lines(lambda all_: all_[:11] + all_[14:])(text)


def test_missing_rows_and_velocities_are_left_out_where_they_are_declared(tmp_path: Path) -> None:
    one = trial.load_dataset(write_folder(tmp_path, toml=_GAPS, cpg=_broken(cpg_csv()))).trials[0]
    lost = {10, 11, 12, 19, 29}
    np.testing.assert_allclose(one.time, [k * STEP for k in range(ROWS) if k not in lost], atol=1e-12)
    assert one.gaps
    assert np.all(np.isfinite(one.velocity))


def test_a_dataset_with_gaps_is_saved_and_read_again(tmp_path: Path) -> None:
    first = trial.load_dataset(write_folder(tmp_path / "a", toml=_GAPS, cpg=_broken(cpg_csv())))
    trial.save(first, tmp_path / "b")
    again = trial.load_dataset(tmp_path / "b")
    assert [one.gaps for one in again.trials] == [True, False]
    np.testing.assert_array_equal(again.trials[0].time, first.trials[0].time)


def test_gaps_where_joints_were_measured_are_refused(tmp_path: Path) -> None:
    toml = TOML.replace('role = "held_out"\n', 'role = "held_out"\ngaps = true\n')
    message = refusal(write_folder(tmp_path, toml=toml))
    assert "trials.2.gaps: samples may be missing only where a CPG drives the fish" in message
    assert "cut the recording" in message


def test_an_infinite_velocity_is_no_missing_one(tmp_path: Path) -> None:
    message = refusal(write_folder(tmp_path, toml=_GAPS, cpg=cell(7, 3, "-inf")(cpg_csv())))
    assert "row 7 (line 8), column 'yaw_rate [rad/s]': -inf" in message
