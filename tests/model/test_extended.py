"""A fish extended by effects goes through a file, and swims alike in both engines with every cause on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish import fish as fishes
from mjfish import simulation as crosscheck
from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import Effect, catalogue, find
from mjfish.errors import InputError, ParameterError, UnknownNameError
from mjfish.fish import Fish, fish_text, load_fish
from mjfish.model import Model, extended
from mjfish.model.extended import Extended
from mjfish.mujoco import SimRollout, simulate
from studies import engines

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"
SWIMS = [e.name for e in catalogue().values() if e.domain in ("drive", "body", "water") and e.name != "wall_effect"]


def _plain(effect: Effect) -> dict[str, float]:
    """Return values some scales off the null."""
    return {p.name: p.default if p.shape else p.default + 4.0 * p.scale for p in effect.parameters}


def _of(fish: Fish, *names: str) -> Extended:
    effects = tuple(find(name) for name in names)
    given = {key: value for effect in effects for key, value in _plain(effect).items()}
    return Extended(Model(fish, effects), {**VALUES, **given})


def _trial(mode: str = "v3") -> Trial:
    time = np.arange(101) / 50.0
    return Trial(mode, None, time, np.zeros((101, 3)), drive=modes.drive(mode))


def test_a_written_model_is_read_back_and_predicts_the_same_to_the_last_bit(pike: Fish, tmp_path: Path) -> None:
    """Every shipped cause at once, at odd numbers. Catches a rounded number, a lost shape, effects in another order."""
    for names in (tuple(catalogue())[::-1], ("servo_lag",)):
        made = _of(pike, *names)
        values = {name: value * (1.0 - 1e-3 / 3.0) for name, value in made.values.items()}
        extended.write(tmp_path / "extended.toml", made.model, values, ["found by hand"])
        back = extended.load(tmp_path / "extended.toml")
        assert [effect.name for effect in back.model.effects] == list(names)
        assert back.values == values
        assert back.model.fish == pike.with_coefficients(
            {p.name: replace(p, default=values[p.name], high=max(p.high, values[p.name])) for p in pike.parameters}
        )
    found = back.model.predict(_trial(), back.values).velocity
    assert found.tobytes() == made.model.predict(_trial(), values).velocity.tobytes()
    assert (tmp_path / "extended.toml").read_text(encoding="utf-8").startswith("# found by hand\n")


def test_a_fish_without_effects_is_itself(pike: Fish, tmp_path: Path) -> None:
    one = extended.load("pike", given={"c_d.head": 2.0})
    assert one.model == Model(pike)
    assert one.fish == pike.with_values({"c_d.head": 2.0})
    assert (one.active, one.seen, list(one.described())) == ((), (), [])
    extended.write(tmp_path / "plain.toml", Model(pike), {"c_d.head": 2.0})
    assert load_fish(tmp_path / "plain.toml") == one.fish


def test_tables_by_hand_are_read(tmp_path: Path) -> None:
    """As a user writes them, a table an effect; what is absent has its default, what is set goes over it."""
    path = tmp_path / "mine.toml"
    path.write_text(
        fishes.shipped()["pike"].read_text(encoding="utf-8")
        + "\n[effects.tail_compliance]\ncompliance = 0.25\n\n[effects.camera_scale]\nerror = 0\n",
        encoding="utf-8",
    )
    one = extended.load(path, catalogue([OWN]), {"tail_compliance.damping": 0.05})
    assert (one.fish.tail_compliance, one.fish.tail_damping) == (0.25, 0.05)
    assert [effect.name for effect, _ in one.active] == ["tail_compliance"]
    assert list(one.described()) == ["with tail_compliance: compliance = 0.25 rad/(N m), damping = 0.05 N m s/rad"]


BAD: dict[str, tuple[str, type[Exception], str]] = {
    "effect": (
        "[effects.gremlin]\nsize = 1.0",
        UnknownNameError,
        r"effect 'gremlin'; known: .*ambient_current.*--effects",
    ),
    "parameter": (
        "[effects.servo_lag]\ntau = 0.1",
        UnknownNameError,
        "parameter of servo_lag 'tau'; known: time_const",
    ),
    "bound": ("[effects.servo_lag]\ntime_constant = 9.0", ParameterError, r"time_constant.*9"),
    "text": (
        '[effects.servo_lag]\ntime_constant = "0.1"',
        InputError,
        r"time_constant: expected a number; write it wi",
    ),
    "empty": ("[effects.servo_lag]", InputError, r"effects\.servo_lag"),
    "flat": ("[effects]\nservo_lag = 0.1", InputError, r"effects\.servo_lag: expected a table"),
    "no table": ("effects = 1", InputError, "effects: expected a table"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_in_the_table_is_named_with_the_file(name: str, tmp_path: Path, pike: Fish) -> None:
    table, kind, message = BAD[name]
    path, text = tmp_path / "bad.toml", fish_text(pike)
    path.write_text(f"{table}\n{text}" if name == "no table" else f"{text}\n{table}\n", encoding="utf-8")
    with pytest.raises(kind, match=rf"bad\.toml: .*{message}"):
        extended.load(path)


def test_who_knows_no_effects_refuses_a_fish_that_has_some(pike: Fish, tmp_path: Path) -> None:
    """Else a fit or an export would silently be that of another fish."""
    extended.write(tmp_path / "extended.toml", *_pair(_of(pike, "servo_lag")))
    with pytest.raises(InputError, match=r"extended\.toml: has \[effects\], which are lost here"):
        load_fish(tmp_path / "extended.toml")


def _pair(one: Extended) -> tuple[Model, dict[str, float]]:
    return one.model, dict(one.values)


def test_a_coefficient_outside_the_fishs_bounds_widens_them(pike: Fish, tmp_path: Path) -> None:
    """Bounds of the data set may be wider than those of the fish that it was fitted with."""
    extended.write(tmp_path / "wide.toml", Model(pike), {"c_f.tail": 0.5})
    p = extended.load(tmp_path / "wide.toml").model.fish.parameters[-1]
    assert (p.name, p.default, p.high) == ("c_f.tail", 0.5, 0.5)


@pytest.fixture(scope="module")
def nominal(pike: Fish) -> crosscheck.CrossCheck:
    """The cross-check without any cause."""
    return crosscheck.check(_of(pike).fish, "v3", duration=0.8, halvings=1)


@pytest.mark.parametrize("name", SWIMS)
def test_both_engines_swim_alike_with_the_cause_on(pike: Fish, name: str, nominal: crosscheck.CrossCheck) -> None:
    """MuJoCo's own dynamics, moved by its servos, against the ODE on the joints that these realised."""
    one = _of(pike, name)
    found = crosscheck.check(one, "v3", duration=0.8, halvings=1)
    assert found.passed, found.message
    frame = name == "ambient_current"  # a change of frame: nothing of it is in the fish
    assert (found.range == nominal.range) == frame


@pytest.mark.parametrize("name", [name for name in SWIMS if find(name).load is not None])
def test_a_load_that_one_engine_lacks_is_seen(pike: Fish, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    one, honest = _of(pike, name), simulate

    def dry(*given: Any, **options: Any) -> SimRollout:
        return honest(*given, **{**options, "loads": ()})

    monkeypatch.setattr(crosscheck.cross_check, "simulate", dry)
    found = crosscheck.check(one, "v3", duration=0.6, halvings=1)
    assert found.status == "disagrees"
    assert found.orders[0] < 0.5


@pytest.mark.parametrize(
    "names",
    [
        ("reynolds_drag", "linear_drag", "fin_lift", "munk_moment", "tail_compliance", "servo_lag"),
        ("wake_memory", "sheared_current"),
    ],
)
def test_prescribed_joints_agree_with_loads_at_the_order_of_every_integrator(
    pike: Fish, names: tuple[str, ...]
) -> None:
    """Both couplings and every integrator of MuJoCo: with a Munk moment and an elastic tail; with place and memory."""
    rows = list(engines.sweep(_of(pike, *names), cases=(engines.CASES[0],), duration=0.6))
    assert [row.status for row in rows] == ["agrees"] * len(engines.ENGINES)
    assert all(row.order > 3.5 for row in rows if row.engine.order == 4)


def test_a_clock_is_said_to_be_of_the_camera_and_a_current_is_not(pike: Fish) -> None:
    one = _of(pike, "ambient_current", "time_offset", "servo_lag")
    assert one.seen == ("time_offset",)
    assert [line.endswith("not the swimming") for line in one.described()] == [False, True, False]
