"""`make real`: its settings, its scores, what it says where the files are not; and its page, where they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import real_fish
import real_page
import real_runs
from diagnosed import diagnosis
from real_runs import Outcome, Settings

from mjfish import tomlfile
from mjfish.errors import InputError, UnknownNameError
from mjfish.importers import HEADERS

_PAGE = Path(__file__).parents[2] / "docs" / "real-fish.md"


@pytest.fixture(scope="module")
def settings() -> Settings:
    return tomlfile.read(real_runs.SETTINGS, Settings)


@pytest.fixture(scope="module")
def real(settings: Settings, fishsim: Path) -> Outcome:
    del fishsim  # skips where there are no files
    return real_runs.run(settings)


def test_without_the_files_it_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(real_runs.VARIABLE, str(tmp_path))
    monkeypatch.setattr("sys.argv", ["real_fish.py", "--out", str(tmp_path / "out")])
    assert real_fish.main() == 2
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


@pytest.mark.real
def test_what_is_held_out_is_not_fitted_and_gives_no_noise(settings: Settings, fishsim: Path) -> None:
    assert not set(settings.fit) & set(settings.held_out)
    alone, _ = real_runs.dataset(settings.model_copy(update={"held_out": ()}), fishsim)
    both, tracks = real_runs.dataset(settings, fishsim)
    assert {run.name: run.role for run in both.trials} == {"f0_50": "fit", "f1_00": "fit", "f1_25": "held_out"}
    assert alone.noise is not None
    assert both.noise is not None
    np.testing.assert_array_equal(both.noise, alone.noise)
    told = real_page._table(
        real_page._TOLD, ([row[HEADERS.index(n)] for n in real_page._TOLD] for row in tracks.rows())
    )
    assert told in _PAGE.read_text(encoding="utf-8"), "python tools/real_fish.py --page docs/real-fish.md"


def test_settings_take_effect_or_are_refused(settings: Settings, tmp_path: Path) -> None:
    assert set(settings.model_copy(update={"candidates": ("*_drag", "roll")}).causes()) == {
        "linear_drag", "reynolds_drag", "roll",
    }  # fmt: skip
    with pytest.raises(UnknownNameError, match="unknown cause 'rol'"):
        settings.model_copy(update={"candidates": ("rol",)}).causes()
    broken = tmp_path / "broken.toml"
    broken.write_text(real_runs.SETTINGS.read_text(encoding="utf-8").replace("seed = 0", "seeds = 0"))
    with pytest.raises(InputError, match=r"seeds.*unknown key"):
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
    nominal, extended = real_runs.scores(made)[2:]
    assert (nominal.role, nominal.model, extended.model) == ("held out", "nominal", "extended")
    assert nominal.error == pytest.approx(0.02)
    assert nominal.nrmse == pytest.approx(np.array([0.02, 0.0, 0.1]) / np.ptp(trial.velocity, axis=0))
    assert nominal.speed == pytest.approx(trial.velocity[late, 0].mean())
    assert real_runs.reached(Outcome(settings, None, made)) == pytest.approx((0.01, extended.nrmse[2]))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.real
def test_the_held_out_run_is_predicted_as_well_as_was_asked(real: Outcome) -> None:
    got = real_runs.reached(real)
    assert got is not None
    assert got[0] < real.settings.goal.speed
    assert got[1] < real.settings.goal.yaw_rate


@pytest.mark.slow
@pytest.mark.real
def test_the_page_is_what_the_tool_writes(real: Outcome, capsys: pytest.CaptureFixture[str]) -> None:
    assert real_page.page(real) == _PAGE.read_text(encoding="utf-8")
    real_fish.tell(real)
    assert real.diagnosis.message[:40] in capsys.readouterr().out
