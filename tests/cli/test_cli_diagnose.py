"""``mjfish diagnose``, from a synthetic dataset to a fish that swims with what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from diagnosed import diagnosis

import mjfish
from mjfish.data import read_table
from mjfish.diagnosis import Diagnosis
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model, extended
from mjfish.numerics.arrays import FloatArray

_FEW = {name: find(name) for name in ("servo_lag", "tail_compliance", "time_offset")}


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three candidates: the whole catalogue takes long."""
    monkeypatch.setattr("mjfish.effects.catalogue", lambda files=(): _FEW)


def _velocity(folder: Path) -> FloatArray:
    table = read_table(folder / "rollout.csv")
    return np.column_stack([table[name] for name in ("surge", "sway", "yaw_rate")])


@pytest.mark.filterwarnings("ignore:pike. its coefficients were not fitted to such drives")
def test_the_fish_that_is_written_swims_as_the_one_that_was_measured(run: Run, tmp_path: Path, pike: Fish) -> None:
    """In both engines. Catches a written fish without its cause, with another size, or with nominal coefficients."""
    hidden = "--effect servo_lag:time_constant=0.03 --set c_d.tail=2.1"
    run(f"generate --modes v1,v3,v1-t2 --duration 6 {hidden} --held-out v3 --seed 3 --out a")
    shown = run("diagnose a --jobs 1 --extended extended.toml").stdout
    assert "named  The cause is servo_lag" in shown
    back = extended.load(tmp_path / "extended.toml")
    record = back.model.fish.identified
    assert record is not None
    assert record.outcome.startswith("named: The cause is servo_lag")
    low, high = record.intervals["servo_lag.time_constant"]
    assert low < back.values["servo_lag.time_constant"] < high
    assert record.intervals["c_d.tail"][0] <= back.values["c_d.tail"] <= record.intervals["c_d.tail"][1]
    np.testing.assert_allclose(back.values["servo_lag.time_constant"], 0.03, rtol=0.05)
    lag = Model(pike, (find("servo_lag"),))
    extended.write(tmp_path / "truth.toml", lag, {"servo_lag.time_constant": 0.03, "c_d.tail": 2.1})
    for engine in ("ode", "mujoco"):
        for name, fish in (("found", "extended.toml"), ("truth", "truth.toml"), ("pike", "pike")):
            run(f"simulate --fish {fish} --mode v7 --duration 2 --engine {engine} --out {engine}_{name}")
        truth = _velocity(tmp_path / f"{engine}_truth")
        found, pike_ = (_velocity(tmp_path / f"{engine}_{name}") - truth for name in ("found", "pike"))
        assert np.all(np.std(found, axis=0) < 0.1 * np.std(pike_, axis=0)), engine


def test_a_cause_that_was_not_named_is_said_to_be_none_in_the_file(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever opens the file later does not see the verdict otherwise."""
    monkeypatch.setattr(mjfish, "diagnose", lambda dataset, **rest: diagnosis(verdict))
    run("generate --modes v1,v3 --duration 2 --out a")
    told = {}
    for verdict, code in (("named", 0), ("unexplained", 1), ("nothing_wrong", 0)):
        run(f"diagnose a --extended {verdict}.toml", exit_code=code)
        told[verdict] = (tmp_path / f"{verdict}.toml").read_text(encoding="utf-8")
        assert f'\noutcome = "{verdict}: Something to say about {verdict}.' in told[verdict]
    assert 'unexplained. Not named: servo_lag, which explains most."\n' in told["unexplained"]
    assert "Not named" not in told["named"] + told["nothing_wrong"]
    assert "[effects" not in told["nothing_wrong"]


def test_a_folder_gets_an_extended_fish_only_where_the_model_was_extended(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a cause is in it that was not named, that is said. Catches a fish of an earlier diagnosis taken for new."""
    nothing = diagnosis("nothing_wrong")
    alone = replace(diagnosis("unexplained"), best=(), extended=nothing.extended, extended_model=nothing.extended_model)
    cases = {"nothing": nothing, "alone": alone, "named": diagnosis("named"), "closest": diagnosis("unexplained")}
    now = [nothing]
    monkeypatch.setattr(mjfish, "diagnose", lambda dataset, **rest: now[0])
    for other in ("report", "log"):  # other files of the folder
        monkeypatch.setattr(Diagnosis, other, lambda _self, path: Path(path).write_bytes(b""))
    run("generate --modes v1,v3 --duration 2 --out a")
    said = {}
    for name, now[0] in cases.items():
        shown = run(f"diagnose a --out {name}", exit_code=int(now[0].verdict == "unexplained")).stdout
        assert (tmp_path / name / "extended.toml").is_file() == bool(now[0].best)
        said[name] = " ".join(shown.split())
    missing = "extended No extended.toml was written: the model was not extended"
    assert f"{missing}." in said["nothing"]
    assert f"{missing}." in said["alone"]
    assert "nRMSE 3.14 % of the nominal model, which was not extended" in said["alone"]
    assert "extended.toml has servo_lag, which explains most and is not named." in said["closest"]
    assert "extended.toml has" not in said["named"]
    now[0] = nothing
    shown = " ".join(run("diagnose a --out named").stdout.split())
    assert f"{missing}; the one that is there is of an earlier diagnosis." in shown
    shown = " ".join(run("diagnose a --extended fitted.toml").stdout.split())
    assert "fitted.toml has the fitted coefficients and no cause" in shown


def test_a_fish_that_could_not_be_written_is_refused_before_the_work(refuse: Callable[[str], str], run: Run) -> None:
    run("generate --modes v1,v3 --duration 2 --out a")
    assert "extended.xml: the name ends in '.xml', expected .toml" in refuse("diagnose a --extended extended.xml")
    assert "there is no folder" in refuse("diagnose a --extended absent/extended.toml")
