"""`make real`: its settings, its scores, what it says where the files are not; and its page, where they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.data.importers import HEADERS
from mjfish.diagnosis import Candidate, Split, SplitMechanism, Splits
from mjfish.diagnosis.table import Comparison, Table
from mjfish.errors import InputError, UnknownNameError
from mjfish.files import tomlfile
from studies.markdown import table
from studies.measured_fish import __main__ as command
from studies.measured_fish import causes, page, pictures, runs
from studies.measured_fish.runs import Outcome, Settings

_PAGE = Path(__file__).parents[2] / "docs" / "real-fish.md"


@pytest.fixture(scope="module")
def settings() -> Settings:
    return tomlfile.read(runs.SETTINGS, Settings)


@pytest.fixture(scope="module")
def real(settings: Settings, fishsim: Path) -> Outcome:
    del fishsim  # skips where there are no files
    return runs.run(settings, splits=True)


def test_without_the_files_it_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(runs.VARIABLE, str(tmp_path))
    monkeypatch.setattr("sys.argv", ["measured_fish", "--out", str(tmp_path / "out")])
    assert command.main() == 2
    said = capsys.readouterr().err
    for part in (
        str(tmp_path),
        "markers_f0_50.csv",
        "git clone",
        "https://github.com/srl-ethz/fishsim",
        "MJFISH_FISHSIM",
    ):
        assert part in said, (part, said)
    assert not (tmp_path / "out").exists()


def test_without_a_folder_in_the_settings_the_variable_is_asked_for(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(runs.VARIABLE, raising=False)
    with pytest.raises(InputError, match=r"^MJFISH_FISHSIM must name .* git clone .* it is not set"):
        runs.folder(settings.model_copy(update={"folder": None}))


def test_what_cannot_be_written_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "run", lambda *_, **__: pytest.fail("ran"))
    (tmp_path / "file").write_text("")
    (tmp_path / "images").write_text("")
    fine, target = str(tmp_path / "out"), str(tmp_path / "page.md")
    for given, message in (
        (["--out", str(tmp_path / "file")], "file: is a file, expected a folder"),
        (["--out", fine, "--page", str(tmp_path / "no" / "page.md")], "there is no folder"),
        (["--out", fine, "--page", target], "images: is a file, expected a folder"),
    ):
        monkeypatch.setattr("sys.argv", ["measured_fish", *given])
        assert command.main() == 2
        assert message in capsys.readouterr().err


@pytest.mark.real
def test_what_is_held_out_is_not_fitted_and_gives_no_noise(settings: Settings, fishsim: Path) -> None:
    assert not set(settings.fit) & set(settings.held_out)
    made, tracks = runs.dataset(settings, fishsim)
    assert {run.name: run.role for run in made.trials} == {"f0_50": "fit", "f1_00": "fit", "f1_25": "held_out"}
    squares, weights = [np.square(file.noise) for file in tracks.files[:2]], [len(run.time) for run in made.trials[:2]]
    np.testing.assert_allclose(made.noise, np.sqrt(np.average(squares, axis=0, weights=weights)))
    told = table(page._TOLD, ([row[HEADERS.index(n)] for n in page._TOLD] for row in tracks.rows()))
    assert told in _PAGE.read_text(encoding="utf-8"), "python -m studies.measured_fish --page docs/real-fish.md"


def test_settings_take_effect_or_are_refused(settings: Settings, tmp_path: Path) -> None:
    assert set(settings.model_copy(update={"candidates": ("*_drag", "roll")}).causes()) == {
        "exponential_drag", "keulegan_carpenter_drag", "linear_drag", "power_drag", "reynolds_drag", "roll",
        "whole_speed_drag",
    }  # fmt: skip
    with pytest.raises(UnknownNameError, match="unknown cause 'rol'"):
        settings.model_copy(update={"candidates": ("rol",)}).causes()
    broken, text = tmp_path / "broken.toml", runs.SETTINGS.read_text(encoding="utf-8")
    for old, new, message in (
        ("seed = 0", "seeds = 0", r"seeds.*unknown key"),
        ('held_out = ["f1_25"]', "held_out = []", r"held_out: .*at least 1"),
    ):
        assert old in text
        broken.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=message):
            tomlfile.read(broken, Settings)


def test_scores_leave_out_what_start_velocities_were_fitted_to(settings: Settings) -> None:
    """Catches a held-out score over its first quarter, an error of the wrong sign, and models that are exchanged."""
    made = diagnosis()
    overlay = made.overlays[1]
    trial = overlay.trial
    late = (trial.time > 0.25 * trial.time[-1]) & (np.abs(trial.time - 1.2) > 0.03)  # nor beside the step of the drive
    off = np.where(trial.time[:, None] > 0.25 * trial.time[-1], [0.02, 0.0, 0.1], 9.0)
    overlay = replace(overlay, nominal=trial.velocity + off, extended=trial.velocity + 0.5 * off)
    made = replace(made, overlays=(made.overlays[0], overlay))
    nominal, extended = runs.scores(made)[2:]
    assert (nominal.role, nominal.model, extended.model) == ("held out", "nominal", "extended")
    assert nominal.error == pytest.approx(0.02)
    assert nominal.nrmse == pytest.approx(np.array([0.02, 0.0, 0.1]) / np.ptp(trial.velocity, axis=0))
    assert nominal.speed == pytest.approx(trial.velocity[late, 0].mean())
    assert runs.reached(Outcome(settings, None, made)) == pytest.approx((0.01, extended.nrmse[2]))  # type: ignore[arg-type]


def test_causes_rank_by_fall_or_score_and_coarse_refits_are_told_apart() -> None:
    """Catches a negative fall in the table, and a cause that ranks by its score but was not refitted left out."""
    best, second, third, _ = diagnosis().candidates
    by_score = Candidate("wake_memory", True, score=200.0)
    assert third.row is not None
    coarse = replace(third, score=151.0, row=replace(third.row, gain=-11.0))
    made = replace(diagnosis(), candidates=(best, coarse, by_score, second))
    assert [row[:3] for row in causes.rows(made)] == [
        (best.name, "903", "812"), (second.name, "640", "812"), ("wake_memory", "", "200"),
    ]  # fmt: skip
    assert "tail_compliance (score 151)" in causes.left_out(made)
    assert causes.left_out(diagnosis()) == ""


def test_what_held_out_runs_do_not_prefer_is_said() -> None:
    made = diagnosis()
    assert made.gain is not None
    own = made.gain.extended["pooled"]
    rows = [candidate.row for candidate in made.candidates if candidate.row is not None]

    def said(one: float, other: float) -> str:
        errors = (own, one * own, other * own)
        scored = [replace(row, held_out_error=error) for row, error in zip(rows, errors, strict=True)]
        return causes.preferred(replace(made, table=Table(0.0, Comparison({row.names: row for row in scored}))))

    assert "smaller with time_offset" in said(0.99, 1.01)
    assert "larger by at most 2 % with tail_compliance" in said(0.99, 1.01)
    assert "does not prefer" in said(0.99, 1.5)
    assert "does not prefer" in said(1.01, 1.5)
    assert "does not prefer" not in said(1.03, 1.5)


def test_sway_that_lacks_is_that_of_the_model_without_roll(settings: Settings) -> None:
    """Catches the residual of a model that has the wobble already, and a wobble of the wrong sign."""
    made = diagnosis()
    overlay = made.overlays[0]
    time = overlay.trial.time
    beat = 2.0 * np.pi / (time[-1] - time[0]) * 5.0
    trial = replace(overlay.trial, roll=0.1 * np.sin(beat * time))
    wobble = -0.2 * 0.1 * beat * np.cos(beat * time)
    nominal = trial.velocity - np.column_stack([0.0 * time, wobble + 0.01, 0.0 * time])
    overlay = replace(overlay, trial=trial, nominal=nominal, extended=trial.velocity)
    left, made_of_roll = pictures.lacking(Outcome(settings, None, made), overlay, 0.2)  # type: ignore[arg-type]
    inside = np.isfinite(left)
    np.testing.assert_allclose(made_of_roll[inside], wobble[inside], atol=0.02 * np.ptp(wobble))
    np.testing.assert_allclose(left[inside] - wobble[inside], (left - wobble)[inside].mean(), atol=1e-9)


def test_splits_are_told_with_their_errors_and_those_without_a_verdict_by_their_message(settings: Settings) -> None:
    made = diagnosis()
    named = Split(("a", "b"), ("c",), True, "named", "", (SplitMechanism("roll", "form"),), made.gain)
    failed = Split(("b", "c"), ("a",), False, None, "too few numbers")
    told = page._splits(Outcome(settings, None, made, Splits(made, 3, (failed, named))))  # type: ignore[arg-type]
    assert told["shares"].splitlines()[2:] == ["| roll | 1 of 1 | 1 | 0 | 0 |"]
    assert told["splits"].splitlines()[2:] == [
        "| a | b, c |  | not diagnosed: too few numbers |  |  |",
        "| c (this page) | a, b | named | roll (form) | 0.031 to 0.012 | 62 % (57 to 66 %) |",
    ]
    assert not any(page._splits(Outcome(settings, None, made)).values())  # type: ignore[arg-type]
    assert not any(page._without(Outcome(settings, None, made)).values())  # type: ignore[arg-type]
    taken = page._without(Outcome(settings, None, made, None, made))  # type: ignore[arg-type]
    assert made.message in taken["said_without"]
    assert taken["taken"]


@pytest.mark.slow
@pytest.mark.real
def test_the_held_out_run_is_predicted_as_well_as_was_asked(real: Outcome) -> None:
    got = runs.reached(real)
    assert got[0] < real.settings.goal.speed
    assert got[1] < real.settings.goal.yaw_rate


@pytest.mark.slow
@pytest.mark.real
def test_the_page_is_what_the_tool_writes(real: Outcome, capsys: pytest.CaptureFixture[str]) -> None:
    assert page.page(real) == _PAGE.read_text(encoding="utf-8")
    command.tell(real)
    assert real.diagnosis.message[:40] in capsys.readouterr().out
