"""`mjfish.simulate`: a run of either engine in one call, and what its result offers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mjfish.data import read_table
from mjfish.drive.wave import Wave
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish
from mjfish.simulation import parse_wave, simulate


def test_values_switch_effects_on_in_a_fish_given_as_object_or_by_name(pike: Fish) -> None:
    by_name, as_object = (
        simulate(fish, values={"munk_moment.kappa": 1.0, "c_d.tail": 2.0}, duration=0.5) for fish in ("pike", pike)
    )
    np.testing.assert_array_equal(by_name.velocity, as_object.velocity)
    assert by_name.effects == ("with munk_moment: kappa = 1",)
    with pytest.raises(UnknownNameError, match=r"unknown parameter 'munk_moments.kappa'"):
        simulate(pike, values={"munk_moments.kappa": 1.0})


def test_the_result_is_small_in_a_terminal_and_is_saved_as_json_and_table(pike: Fish, tmp_path: Path) -> None:
    run = simulate(pike, "v3", duration=0.5)
    assert repr(run) == run.summary()
    assert len(run.summary().splitlines()) <= 10
    run.save(tmp_path / "a.json")
    saved = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert (saved["fish"], saved["drive"], saved["engine"], saved["status"]) == ("pike", "v3", "ode", "ok")
    np.testing.assert_allclose(saved["velocity"], run.velocity)
    run.write_table(tmp_path / "a.parquet")
    np.testing.assert_array_equal(read_table(tmp_path / "a.parquet")["surge"], run.velocity[:, 0])
    assert [trace.name for trace in run.plot().data] == ["simulated"] * 3


def test_a_wave_is_read_from_a_line_of_toml() -> None:
    wave = parse_wave("frequency = 1.5, amplitude = [0.2, 0.3], phase = [0.0, -0.8]")
    assert wave == Wave(1.5, (0.2, 0.3), (0.0, -0.8), (0.0, 0.0))
    assert parse_wave("frequency=1,amplitude=[1],phase=[0],bias=[0.1],ramp=2").ramp == 2.0
    with pytest.raises(InputError, match="colour: unknown key"):
        parse_wave("frequency=1,amplitude=[1],phase=[0],colour=2")


def test_a_wave_without_ramp_starts_in_the_middle_of_its_beat(pike: Fish) -> None:
    wave = Wave(1.0, (0.1,) * 4, (0.5,) * 4, (0.0,) * 4)
    run = simulate(pike, drive=wave, duration=0.5)
    np.testing.assert_allclose(run.joint_angle[0], 0.1 * np.sin(0.5), atol=1e-9)
    np.testing.assert_array_equal(run.velocity[0], 0.0)


def test_walls_that_are_not_known_are_refused() -> None:
    """Catches a run that swims as the nominal fish, though an effect was asked for that needs a tank."""
    with pytest.raises(InputError, match="wall_effect: the walls are not known"):
        simulate("pike", values={"wall_effect.size": 1.0}, duration=1.0)
