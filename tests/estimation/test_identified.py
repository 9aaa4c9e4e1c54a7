"""What leaves an identification: the fish as TOML and MJCF, tables as CSV and Parquet."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import problem, swimming

import mjfish
from mjfish.data import Dataset
from mjfish.data.tables import write_rows
from mjfish.errors import InputError
from mjfish.estimation import Fit, fit
from mjfish.estimation.identification import Identification
from mjfish.estimation.intervals import coefficient_rows, intervals
from mjfish.estimation.residual import agreement, fitted
from mjfish.files.plain_data import plain
from mjfish.fish import Fish, load_fish, write_fish
from mjfish.model.origin import covered
from mjfish.mujoco import export

FIXED = {"c_m.head": 0.5}


@pytest.fixture(scope="module")
def synthetic(pike: Fish) -> Dataset:
    """Bounds and starts are not the fish's own, one bound is in the way."""
    bounded = {p.name: p.rebound(high=1.3, start=1.1) for p in pike.parameters if p.name == "c_d.head"}
    return replace(swimming(pike, ("v1", "v5"), duration=3.0), fish=pike.with_coefficients(bounded))


@pytest.fixture(scope="module")
def found(synthetic: Dataset) -> Fit:
    declared = {p.name: p.rebound(low=0.4, start=0.9) for p in synthetic.fish.parameters if p.name == "c_d.tail"}
    one = fit(problem(synthetic, fixed=FIXED, declared=declared))
    assert one.status == "converged"
    assert one.at_bound[[p.name for p in one.parameters].index("c_d.head")]
    return one


def _identification(synthetic: Dataset, found: Fit) -> Identification:
    """Return what was found without an assessment, the coefficients of `FIXED` told."""
    return Identification(synthetic, found, np.ones(3), (), (), problem=problem(synthetic, fixed=FIXED))


def test_the_identified_fish_has_values_starts_and_bounds_of_the_fit(synthetic: Dataset, found: Fit) -> None:
    fish = _identification(synthetic, found).fish
    assert fish.values == {**found.values, **FIXED}
    declared = {p.name: p for p in fish.parameters}
    assert (declared["c_d.tail"].low, declared["c_d.tail"].start) == (0.4, 0.9)
    assert (declared["c_d.head"].high, declared["c_d.head"].default) == (1.3, 1.3)
    for old, new in zip(synthetic.fish.parameters, fish.parameters, strict=True):
        if new.name != "c_d.tail":
            assert (new.start, new.low, new.high) == (old.start, old.low, old.high)
    untouched = fish.model_copy(update={"coefficients": synthetic.fish.coefficients, "identified": None})
    assert untouched == synthetic.fish


def test_it_goes_through_toml_and_mjcf_with_its_origin(synthetic: Dataset, found: Fit, tmp_path: Path) -> None:
    """The way that a user goes: identify, write, load in MuJoCo."""
    fish = _identification(replace(synthetic, name="pool --\n"), found).fish
    write_fish(tmp_path / "fish.toml", fish)
    assert load_fish(tmp_path / "fish.toml") == fish
    export.write(tmp_path / "fish.xml", fish)
    fluid = mjfish.StripFluid(mujoco.MjModel.from_xml_path(str(tmp_path / "fish.xml")))
    assert [link.c_d for link in fluid.links] == [fish.values[f"c_d.{link.group}"] for link in fish.links]
    start = fluid.model.text_adr[mujoco.mj_name2id(fluid.model, mujoco.mjtObj.mjOBJ_TEXT, "strip_fluid/identified")]
    assert fish.identified is not None
    assert fluid.model.text_data[start:].decode().split("\0")[0] == fish.identified.model_dump_json()
    told = tomllib.loads((tmp_path / "fish.toml").read_text(encoding="utf-8"))["identified"]
    assert told["by"] == f"mjfish {version('mjfish')}"
    assert told["dataset"] == "pool --\n"
    assert told["outcome"].startswith("converged: ")
    assert told["geometry"] == synthetic.fish.geometry
    assert told["intervals"].keys() == {*COEFFICIENTS} - FIXED.keys()
    assert told["intervals"]["c_d.tail"] == list(found.interval("c_d.tail"))
    assert told["intervals"]["c_d.head"][1] == 1.3, "it rests on its bound"


def test_the_range_is_that_of_the_fitted_runs(synthetic: Dataset, found: Fit) -> None:
    """Catches a range of the held-out runs, of the start-up, in degrees, or a swing that a bias adds to."""
    v1, v5 = (replace(trial, role="fit") for trial in synthetic.trials)
    cpg, ranges = synthetic.fish.cpg, []
    assert cpg is not None
    for other in (v5, replace(v5, role="held_out")):
        record = _identification(replace(synthetic, trials=(v1, other)), found).fish.identified
        assert record is not None
        ranges.append(record.range)
    for trial, at in ((v1, 0), (v5, 1)):
        quarters = np.array([part.mean() for part in np.array_split(trial.velocity[:, 0], 4)])
        assert ranges[0]["speed"][at] == pytest.approx((quarters[2:].mean(), quarters.max())[at])
        assert ranges[0]["beat"][at] == pytest.approx(trial.drive[0].omega / (2.0 * np.pi))
    assert ranges[1]["beat"] == (ranges[0]["beat"][0],) * 2
    assert ranges[1]["speed"][1] < ranges[0]["speed"][1]
    peak = cpg.beta * cpg.unit * max(cpg.amplitude) ** 0.5  # radius of the limit cycle of a Hopf oscillator
    assert ranges[1]["amplitude"][0] == pytest.approx(peak, rel=0.1)
    assert covered([replace(v1, velocity=np.full_like(v1.velocity, np.nan))], cpg).keys() == {"beat", "amplitude"}


def test_a_fit_that_stopped_early_says_so(synthetic: Dataset) -> None:
    record = _identification(synthetic, fit(problem(synthetic), evaluations=1)).fish.identified
    assert record is not None
    assert record.outcome.startswith("stopped: the most evaluations were used, 1")


def _csv(path: Path) -> list[dict[str, Any]]:
    return pa.csv.read_csv(path).to_pylist()


def _parquet(path: Path) -> list[dict[str, Any]]:
    with pa.parquet.ParquetFile(path) as file:
        return file.read().to_pylist()


@pytest.mark.parametrize(("suffix", "read"), [(".csv", _csv), (".parquet", _parquet)])
def test_tables_are_read_back_to_the_last_bit(
    synthetic: Dataset, found: Fit, tmp_path: Path, suffix: str, read: Callable[[Path], list[dict[str, Any]]]
) -> None:
    """Words, numbers, truth values; a simulation's horizon is an empty cell."""
    posed = problem(synthetic, fixed=FIXED)
    own = intervals(posed, found)
    write_rows(tmp_path / f"coefficients{suffix}", coefficient_rows(found, own))
    table = read(tmp_path / f"coefficients{suffix}")
    assert table == coefficient_rows(found, own)
    assert [row["parameter"] for row in table] == list(COEFFICIENTS[1:])
    assert {row["parameter"]: row["estimate"] for row in table} == found.values
    assert [row["parameter"] for row in table if row["at_bound"]] == ["c_d.head"]
    for row in table:
        assert row["low"] <= row["estimate"] <= row["high"]
        assert (row["plain_low"], row["plain_high"]) == pytest.approx(found.interval(row["parameter"]), rel=1e-12)
    scores = agreement(fitted(posed, found.x), horizons=[1])
    write_rows(tmp_path / f"scores{suffix}", plain(scores))
    table = read(tmp_path / f"scores{suffix}")
    assert table == plain(scores)
    assert {row["horizon"] for row in table} == {None, 1}
    assert all(np.isfinite(row["nrmse"]) for row in table)


def test_without_intervals_there_are_the_plain_ones(found: Fit, tmp_path: Path) -> None:
    write_rows(tmp_path / "coefficients.csv", coefficient_rows(found))
    header = (tmp_path / "coefficients.csv").read_text(encoding="utf-8").splitlines()[0]
    assert '"plain_low"' in header
    assert '"low"' not in header


def test_a_table_of_another_suffix_is_refused(found: Fit, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"coefficients\.xlsx: the name ends in '\.xlsx', expected \.csv or \.parquet"):
        write_rows(tmp_path / "coefficients.xlsx", coefficient_rows(found))
