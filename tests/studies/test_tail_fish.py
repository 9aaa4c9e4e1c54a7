"""The study of the one-joint fish: divisions, the wander of a phase, the page; the data where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mjfish.errors import InputError
from studies.tail_fish import runs
from studies.tail_fish.page import page

RUN = {
    "trial": "Amp25Bias0",
    "nominal": {"surge": 0.1, "sway": 0.2, "yaw_rate": 0.3, "pooled": 0.2},
    "extended": {"surge": 0.05, "sway": 0.1, "yaw_rate": 0.2, "pooled": 0.12},
    "mean_speed_error": {"nominal": 0.006, "extended": 0.004, "unit": "m/s"},
}
ANSWER = {
    "verdict": "cannot_tell",
    "message": "These data cannot tell.",
    "mechanisms": [],
    "domain": None,
    "remarks": [],
    "coefficients": {
        "nominal": {
            "c_d.head": {"estimate": 1.5, "unit": "-", "known": {"mean": 2.0, "sd": 2.0, "deviation": -0.4}},
            "free": {"estimate": 0.25, "unit": "m", "known": None},
        }
    },
    "by_run": [RUN, RUN],
    "findings": ["mass.head: the data alone put it at 2 kg, expected 0.7 with an sd of 0.3 (4.0 sd away); measure it"],
    "wander": [0.2, 0.3],
    "walk": [{"gain": 1758.2, "clock_wander.size": {"estimate": 0.04, "low": 0.0356, "high": 0.0442, "unit": "s^0.5"}}],
}


def test_the_runs_of_one_amplitude_are_held_out() -> None:
    recorded = [Path(f"Amp{a}Bias{b}.txt") for a in (15, 20, 25) for b in (-20, 0, 20)]
    assert runs.held_out(recorded, runs.settings()) == ["Amp25Bias-20", "Amp25Bias0", "Amp25Bias20"]


def test_files_that_are_no_division_or_of_another_robot_are_refused(tmp_path: Path) -> None:
    recorded = [tmp_path / f"Amp15Bias{b}.txt" for b in (-20, 0, 20)]
    with pytest.raises(InputError, match="0 of 3 files are the runs of 25 degrees, expected some of them and"):
        runs.divided(recorded, runs.settings())
    other = [tmp_path / name for name in ("Amp15Bias0.txt", "Amp25Bias0.txt")]
    for path in other:
        path.write_text("frame,x,y\n1,2,3\n")
    with pytest.raises(InputError, match=r"Amp15Bias0.txt: .*expected rows of seven numbers: time"):
        runs.divided(other, runs.settings())


def test_the_wander_of_a_phase_is_measured() -> None:
    time = np.arange(0.0, 8.0, 1.0 / 30.0)
    beat = 2.0 * np.pi * 2.0 * time
    slow = 0.3 * np.sin(2.0 * np.pi * time / 8.0)
    assert runs.wander(time, np.sin(beat + slow), np.sin(beat), 2.0) == pytest.approx(0.3 / np.sqrt(2.0), rel=0.1)
    assert runs.wander(time, np.sin(beat + 0.7), np.sin(beat), 2.0) < 0.02


def test_the_page_has_errors_coefficients_and_findings() -> None:
    text = page(ANSWER, runs.settings())
    assert "| the runs of 25 degrees | extended | 0.050 | 0.100 | 0.200 | 0.0040 |" in text
    assert "| c_d.head | 1.5 | - | 2 ± 2 | -0.4 |" in text
    assert "4.0 sd away" in text
    assert "0.25 rad" in text
    assert "0.040 s (0.036 to 0.044) after a second" in " ".join(text.split())


def test_where_the_files_are_must_be_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(runs.VARIABLE, raising=False)
    with pytest.raises(InputError, match="MJFISH_TAILFISH must name the folder"):
        runs.files()
    monkeypatch.setenv(runs.VARIABLE, str(tmp_path))
    with pytest.raises(InputError, match="MJFISH_TAILFISH must name the folder"):
        runs.files()


def test_files_under_another_licence_are_refused_before_any_work(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "repository" / "data"
    folder.mkdir(parents=True)
    for bias in (-20, 0, 20):
        (folder / f"Amp15Bias{bias}.txt").touch()
    monkeypatch.setenv(runs.VARIABLE, str(folder))
    licence = tmp_path / "repository" / "LICENSE"
    licence.write_text("Permission is hereby granted, free of charge,\nto any person obtaining a copy of\n")
    assert len(runs.files()) == 3
    licence.write_text("All rights reserved.\n")
    with pytest.raises(InputError, match="LICENSE: not the MIT licence that the files were published under; read it"):
        runs.files()
