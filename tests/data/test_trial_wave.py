"""``[trials.drive]`` of kind ``wave``: read, written, refused, and driving the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mjfish import data as trial
from mjfish import model
from mjfish.data import Dataset, Trial
from mjfish.drive.wave import Wave
from mjfish.errors import InputError
from mjfish.fish import load_fish

WAVE = Wave(0.9, (0.24, 0.21, 0.16, 0.10, 0.18), (0.0, -0.4, -0.8, -1.2, -1.6), (0.03,) * 5, ramp=0.5, free=True)


def _dataset(wave: Wave) -> Dataset:
    time = np.arange(101) / 50
    run = Trial("run", None, time, np.zeros((101, 3)), wave=wave)
    return Dataset("waves", load_fish("eth_tendon"), (run,))


def test_a_wave_reads_back(tmp_path: Path) -> None:
    file = trial.save(_dataset(WAVE), tmp_path / "out")
    assert "wave" in file.read_text()
    assert trial.load_dataset(tmp_path / "out").trials[0].wave == WAVE


def test_a_table_written_by_hand_is_a_wave(tmp_path: Path) -> None:
    file = trial.save(_dataset(WAVE), tmp_path / "out")
    head = file.read_text().partition("[[trials]]")[0]
    file.write_text(
        head + '[[trials]]\nname = "run"\nfile = "run.csv"\n\n[trials.drive]\nkind = "wave"\nfrequency = 0.9\n'
        "amplitude = [0.24, 0.21, 0.16, 0.1, 0.18]\nphase = [0.0, -0.4, -0.8, -1.2, -1.6]\n"
    )
    wave = trial.load_dataset(file).trials[0].wave
    assert wave == Wave(0.9, WAVE.amplitude, WAVE.phase, (0.0,) * 5)


def test_a_ramp_starts_from_rest_and_none_does_not() -> None:
    assert _dataset(WAVE).trials[0].starts_at_rest
    assert not _dataset(Wave(0.9, WAVE.amplitude, WAVE.phase, WAVE.bias)).trials[0].starts_at_rest


def test_the_model_swims_by_it() -> None:
    """The fish starts from rest and swims forward: a wave that runs to the head would swim backward."""
    dataset = _dataset(WAVE)
    nominal = model.Model(dataset.fish)
    predicted = nominal.predict(dataset.trials[0], nominal.values())
    assert predicted.status == "ok"
    np.testing.assert_allclose(predicted.velocity[0], 0.0, atol=1e-12)
    assert predicted.velocity[-1, 0] > 0.02


REFUSED = {
    "a joint too few": (Wave(0.9, (0.2,) * 4, WAVE.phase, WAVE.bias), "drive.amplitude: 4 numbers, expected 5"),
    "degrees": (Wave(0.9, (20.0,) * 5, WAVE.phase, WAVE.bias), "more than half a turn"),
    "too short": (Wave(0.3, WAVE.amplitude, WAVE.phase, WAVE.bias), "expected one beat of 3.333 s"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_waves_that_cannot_be_are_refused(tmp_path: Path, case: str) -> None:
    wave, message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        trial.save(_dataset(wave), tmp_path / "out")
