"""A saved diagnosis: it says and shows what the diagnosis did, and a file that is none is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosed import diagnosis, learned_diagnosis
from schema_check import complaints

import mjfish
from mjfish.cli.diagnosis_text import show
from mjfish.data import Sensor
from mjfish.diagnosis import Diagnosis, DiagnosisData, Estimate, SensorOverlay
from mjfish.diagnosis.held_out import RunGain
from mjfish.effects import find
from mjfish.errors import InputError
from mjfish.files import checksummed_json
from mjfish.inspection import Finding, Inspection
from mjfish.reporting.html.diagnosis import render_diagnosis

FINDING = Finding("clock-jump", "blocks", "slow, 1 s", "a jump", "none", "mend it", trials=("slow",))


def _full() -> Diagnosis:
    """Return a diagnosis with what others lack: findings, corrections, random causes, gains by run."""
    found = diagnosis("cannot_tell")
    first, second, *_ = (row for row in found.table.rows)
    errors = {"surge": 0.1, "sway": 0.2, "yaw_rate": np.nan, "pooled": 0.3}
    assert found.gain is not None
    return replace(
        found,
        checks=Inspection((FINDING,)),
        table=replace(found.table, corrections=(replace(first, names=("clock-jump",)),), random=(second,)),
        gain=replace(found.gain, by_run=(RunGain("fast", errors, errors, (0.1, 0.2)),)),
        failures={"munk_moment": "no number"},
        candidates=(replace(found.candidates[0], failure="no number", row=None), *found.candidates[1:]),
    )


def _of_another_name() -> Diagnosis:
    """Return a diagnosis that names a learned form, by which its mechanism is not called."""
    known = {
        p.short: Estimate(p.default, p.default - 0.1, p.default + 0.1, p.unit) for p in find("roll_law").parameters
    }
    return diagnosis(cause="roll_law", parameters=known)


def _late() -> Diagnosis:
    """Return a diagnosis of servos that says how late the joints are, with a size of which the runs say nothing."""
    found = diagnosis()
    (cause,) = found.causes
    sizes = {name: replace(value, settled=False) for name, value in cause.parameters.items()}
    delays = {
        "1.1 Hz": Estimate(19.3, 19.0, 19.6, "ms"),
        "2.23 Hz": Estimate(12.5, 1.0, 24.0, "ms", settled=False),
    }
    table = found.table.described(lambda row: replace(row, delays=delays) if row.names == found.best else row)
    first, *rest = found.candidates
    late = replace(first, row=next(row for row in table.rows if row.names == found.best))
    return replace(found, causes=(replace(cause, parameters=sizes),), table=table, candidates=(late, *rest))


def _of_places() -> Diagnosis:
    """Return a diagnosis in which places were compared, and no velocity was measured."""
    found = diagnosis()
    blind = []
    for overlay in found.overlays:
        places = np.cumsum(np.ones((9, 2)), axis=0)
        sensor = Sensor("tag", "position", np.arange(9.0), places)
        read = SensorOverlay(sensor, places + 0.1, places + 0.01)
        trial = replace(overlay.trial, velocity=np.full_like(overlay.trial.velocity, np.nan))
        blind.append(replace(overlay, trial=trial, sensors=(read,)))
    return replace(found, overlays=tuple(blind), setup=replace(found.setup, velocities=False, plannable=False))


CASES: dict[str, Callable[[], Diagnosis]] = {
    **{verdict: lambda verdict=verdict: diagnosis(verdict)  # type: ignore[misc]
       for verdict in ("named", "nothing_wrong", "cannot_tell", "unexplained")},
    "nothing held out": lambda: diagnosis(held_out=False),
    "learned": learned_diagnosis,
    "learned, of another name": _of_another_name,
    "all there is": _full,
    "late joints": _late,
    "places": _of_places,
}  # fmt: skip


def _text(result: DiagnosisData, capsys: pytest.CaptureFixture[str], **options: bool) -> str:
    show(result, "pool", **options)
    return "".join(capsys.readouterr())


#: Cases for the slow tests.
LESS = ("nothing_wrong", "cannot_tell", "unexplained", "nothing held out", "learned, of another name")


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow) if c in LESS else c for c in CASES])
def test_text_page_and_curves_are_the_same_after_a_round_trip(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found, path = CASES[case](), tmp_path / "diagnosis.json"
    found.save(path)
    loaded = mjfish.load_diagnosis(path)
    assert loaded.summary() == found.summary()
    assert loaded.next == found.next == tuple(loaded.content["next"])
    assert (loaded.delays, loaded.caution, loaded.held_out) == (found.delays, found.caution, found.held_out)
    for verbose in (False, True):
        assert _text(loaded, capsys, verbose=verbose) == _text(found, capsys, verbose=verbose)
    assert render_diagnosis(loaded) == render_diagnosis(found)
    assert loaded.plot() == found.plot()
    assert loaded.write_curves(tmp_path / "a") == tuple(
        tmp_path / "a" / file.name for file in found.write_curves(tmp_path / "b")
    )
    assert not complaints("diagnosis-5", loaded.to_dict())
    loaded.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_what_joints_lag_and_what_is_not_settled_are_there(tmp_path: Path) -> None:
    _late().save(tmp_path / "diagnosis.json")
    loaded = mjfish.load_diagnosis(tmp_path / "diagnosis.json")
    assert loaded.delays == ("19.30 ms (19.00 to 19.60) at 1.1 Hz", "12 ms (these runs do not settle it) at 2.23 Hz")
    assert [value.settled for cause in loaded.causes for value in cause.parameters.values()] == [False]


def test_measured_and_simulated_velocities_are_there(tmp_path: Path) -> None:
    found = diagnosis()
    found.save(tmp_path / "diagnosis.json")
    for own, overlay in zip(mjfish.load_diagnosis(tmp_path / "diagnosis.json").overlays, found.overlays, strict=True):
        np.testing.assert_array_equal(own.trial.velocity, overlay.trial.velocity)
        np.testing.assert_array_equal(own.extended, overlay.extended)
        assert (own.trial.name, own.held_out) == (overlay.trial.name, overlay.held_out)


def test_a_file_is_small_beside_its_page(tmp_path: Path) -> None:
    found = diagnosis()
    found.save(tmp_path / "diagnosis.json")
    samples = sum(len(overlay.trial.time) for overlay in found.overlays)
    assert len(json.dumps(found.to_dict()["overlays"])) < 400 * samples
    lines = (tmp_path / "diagnosis.json").read_text().splitlines()
    assert len(lines) < 20 * samples, "numbers stand in lines of their own"


def _signed(content: dict[str, Any]) -> dict[str, Any]:
    own = {key: value for key, value in content.items() if key != "sha256"}
    return {**own, "sha256": checksummed_json.digest(own)}


SLIPS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "a list": (lambda _: [], "is no diagnosis, expected one of schema 5"),
    "another kind of result": (lambda _: {"schema": 5, "status": "ok"}, "is no diagnosis"),
    "an older version": (lambda told: {**told, "schema": 4}, "has the schema 4, expected one of schema 5"),
    "a changed field": (lambda told: {**told, "message": "x"}, "its content does not fit its hash"),
    "a field less": (lambda told: _signed({k: v for k, v in told.items() if k != "fits"}), "KeyError.'fits'"),
    "a field of another type": (lambda told: _signed({**told, "causes": 3}), "has other keys than expected"),
}  # fmt: skip


@pytest.mark.parametrize("slip", SLIPS)
def test_what_is_no_diagnosis_of_this_version_is_refused_with_its_name_and_what_to_do(
    slip: str, tmp_path: Path
) -> None:
    change, said = SLIPS[slip]
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(change(diagnosis().to_dict())))
    with pytest.raises(
        InputError, match=f"diagnosis.json: .*{said}.*; write it by 'mjfish diagnose DATASET --json FILE'"
    ):
        mjfish.load_diagnosis(path)


def test_a_file_that_is_cut_off_or_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    with pytest.raises(InputError, match="no such file; write it by"):
        mjfish.load_diagnosis(path)
    diagnosis().save(path)
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(InputError, match=r"cannot be read as JSON: .*; write it by"):
        mjfish.load_diagnosis(path)


def test_a_saved_diagnosis_has_no_log(tmp_path: Path) -> None:
    diagnosis().save(tmp_path / "diagnosis.json")
    with pytest.raises(InputError, match="SavedDiagnosis"):
        mjfish.load_diagnosis(tmp_path / "diagnosis.json").log(tmp_path / "fish.rrd")
