"""Table IV for any dataset: rows, groups, the paper's numbers, files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from synthetic_swimming import TRUTH, as_measured, problem, swimming

from mjfish.drive.cpg import DriveSegment
from mjfish.drive.modes import MODES
from mjfish.errors import InputError
from mjfish.estimation.residual import Residual, fitted
from mjfish.estimation.table_iv import PAPER, Row, group_of, mode_of, table_iv, text
from mjfish.estimation.tables import write_rows
from mjfish.fish import Fish

#: Ranges of the paper's measurements, RMSE over normalised RMSE, as they can be read off Figs. 4 to 6 and the model.
RANGES = {"v1": (0.412, 0.894, 4.96), "v5-v1": (0.559, 1.118, 7.08), "v3-t2": (0.479, 1.019, 6.57)}


@pytest.fixture(scope="module")
def residuals(pike: Fish) -> tuple[Residual, ...]:
    posed = problem(swimming(pike, ("v1", "v3", "v1-t1"), duration=6.0, held_out=()))
    first, second, third = fitted(posed, posed.start(TRUTH))
    return first, replace(second, role="held_out"), third


def test_the_papers_numbers_are_there_for_all_ten_modes_and_agree_with_its_ranges() -> None:
    """RMSE / nRMSE is a range. Catches columns in another order, a digit misread."""
    assert set(PAPER) == set(MODES)
    for mode, expected in RANGES.items():
        np.testing.assert_allclose(np.divide(*PAPER[mode]), expected, rtol=1e-3)
    ranges = np.array([np.divide(*PAPER[mode]) for mode in MODES])
    assert np.all((ranges > (0.35, 0.75, 4.9)) & (ranges < (0.68, 1.13, 7.4)))


def test_every_trial_has_a_row_in_order_and_groups_have_means(residuals: tuple[Residual, ...]) -> None:
    rows = table_iv(residuals)
    assert [row.name for row in rows] == ["v1", "v3", "v1-t1", "mean of forward", "mean of all"]
    assert [row.mode for row in rows[:3]] == ["v1", "v3", "v1-t1"]
    assert [row.group for row in rows] == ["forward", "forward", "turning", "forward", ""]
    assert [row.role for row in rows] == ["fit", "held_out", "fit", "", ""]
    np.testing.assert_allclose(rows[3].rmse, np.mean([rows[0].rmse, rows[1].rmse], axis=0))
    np.testing.assert_allclose(rows[3].paper_nrmse, ((0.097 + 0.105) / 2, (0.047 + 0.043) / 2, (0.051 + 0.056) / 2))
    assert rows[4].trials == 3


def test_the_numbers_of_a_row_are_those_of_the_paper_s_definition(residuals: tuple[Residual, ...]) -> None:
    row, one = table_iv(residuals)[0], residuals[0]
    error = (one.trial.velocity - one.predicted)[one.scored]
    np.testing.assert_allclose(row.rmse, np.sqrt(np.mean(error**2, axis=0)))
    np.testing.assert_allclose(row.nrmse, np.array(row.rmse) / np.ptp(one.trial.velocity, axis=0))
    assert (row.paper_rmse, row.paper_nrmse) == PAPER["v1"]


def test_a_drive_that_is_no_mode_of_the_paper_has_a_group_but_no_numbers_of_it(
    residuals: tuple[Residual, ...], pike: Fish
) -> None:
    odd = replace(residuals[0].trial, name="odd", drive=(DriveSegment(0.0, 19.0, (0.0, 0.1, 0.0, 0.0)),))
    assert (mode_of(odd), group_of(odd)) == ("", "turning")
    free = as_measured(residuals[0].trial, pike)
    assert (mode_of(free), group_of(free)) == ("", "")
    rows = table_iv([replace(residuals[0], trial=odd), residuals[2]])
    assert rows[0].paper_rmse is None
    assert rows[-1].name == "mean of all"
    assert rows[-1].paper_rmse is None


def test_a_mode_is_known_by_its_drive_not_by_the_name_of_the_trial(residuals: tuple[Residual, ...]) -> None:
    assert mode_of(replace(residuals[0].trial, name="v7")) == "v1"


def test_cells_read_as_the_paper_prints_them() -> None:
    assert text(0.0404, 0.0968) == "0.040 / 0.097"
    assert text(np.nan, np.nan) == "–"


def test_a_trial_that_diverged_stays_in_the_table_without_numbers(residuals: tuple[Residual, ...]) -> None:
    gone = replace(residuals[0], predicted=np.full_like(residuals[0].predicted, np.nan))
    rows = table_iv([gone, *residuals[1:]])
    assert np.all(np.isnan(rows[0].rmse))
    assert np.all(np.isfinite(rows[1].rmse))


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_table_is_written_and_read_back(residuals: tuple[Residual, ...], tmp_path: Path, suffix: str) -> None:
    rows: list[Row] = list(table_iv(residuals))
    path = tmp_path / f"table.{suffix}"
    write_rows(path, [row.to_dict() for row in rows])
    table = pyarrow.csv.read_csv(path) if suffix == "csv" else pyarrow.parquet.read_table(path)
    assert table.column("name").to_pylist() == [row.name for row in rows]
    assert table.column("rmse_yaw_rate [rad/s]").to_pylist() == [row.rmse[2] for row in rows]
    assert table.column("paper_nrmse_surge [-]").to_pylist()[0] == 0.097
    assert list(tmp_path.iterdir()) == [path]


def test_a_table_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 rows"):
        write_rows(tmp_path / "table.csv", [])
    with pytest.raises(InputError, match="same columns"):
        write_rows(tmp_path / "table.csv", [{"a": 1}, {"b": 1}])
    with pytest.raises(InputError, match=r"\.parquet"):
        write_rows(tmp_path / "table.txt", [{"a": 1}])
    with pytest.raises(InputError, match="cannot be written"):
        write_rows(tmp_path / "nowhere" / "table.csv", [{"a": 1}])
    assert list(tmp_path.iterdir()) == []
