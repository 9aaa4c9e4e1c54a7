"""Coefficients stay with the body and the runs that they were fitted to."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

import mjfish
from mjfish.errors import InputError
from mjfish.fish import Fish, load_fish, write_fish
from mjfish.fish.fish import ANY
from mjfish.model import Model, extended
from mjfish.model.origin import with_origin
from mjfish.simulation.synthetic import generate

INTERVALS = {"c_d.tail": (2.4, 2.6), "c_m.head": (0.0, 0.1), "servo_lag.time_constant": (0.01, 0.02)}


@pytest.fixture(scope="module")
def identified(pike: Fish) -> Fish:
    """As it comes from a fit to v1."""
    return with_origin(pike, generate(pike, ["v1"], duration=6.0, name="pool"), "converged", INTERVALS)


@pytest.fixture
def written(identified: Fish, tmp_path: Path) -> Path:
    write_fish(tmp_path / "mine.toml", identified)
    return tmp_path / "mine.toml"


def _edit(path: Path, old: str, new: str) -> Path:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


BODIES = {
    "length": ("length = 0.137", "length = 0.137000001"),
    "mass": ("mass = 1.528", "mass = 1.6"),
    "com": ("com = 0.037", "com = 0.04"),
    "inertia": ("inertia = 0.029", "inertia = 0.028"),
    "height": ("height = [0.03, 0.11]", "height = [0.03, 0.12]"),
    "group": ('name = "body_3"\ngroup = "body"', 'name = "body_3"\ngroup = "tail"'),
}


@pytest.mark.parametrize("body", BODIES)
def test_coefficients_on_another_body_are_refused_unless_asked_for(body: str, written: Path) -> None:
    """By every reader: a fish, a simulation, a dataset. Catches a digest that leaves a part of the body out."""
    old, new = BODIES[body]
    _edit(written, old, new)
    if body == "length":
        _edit(written, "to = 0.614", "to = 0.614000001")
    refused = r"mine\.toml: identified\.geometry: .*dataset 'pool' on another body, .*geometry = \"any\""
    with pytest.raises(InputError, match=refused):
        load_fish(written)
    with pytest.raises(InputError, match=refused):
        mjfish.simulate(written, duration=0.5)
    with pytest.raises(InputError, match=refused):
        mjfish.generate(str(written), ["v1"], duration=0.5)
    asked = "\n".join(
        'geometry = "any"' if line.startswith("geometry") else line
        for line in written.read_text(encoding="utf-8").splitlines()
    )
    written.write_text(asked, encoding="utf-8")
    fish = load_fish(written)
    assert fish.values["c_d.tail"] == 2.5
    assert fish.with_values({"c_d.tail": 2.4}).identified is not None
    assert fish.with_values({"c_d.tail": 2.4}).identified.geometry == ANY  # type: ignore[union-attr]


def test_what_is_no_part_of_the_body_may_change(written: Path, identified: Fish) -> None:
    """Its name, the water, names of links; and the number that is written otherwise is the same."""
    _edit(written, 'name = "pike"', 'name = "mine"')
    _edit(written, 'name = "body_2"', 'name = "middle"')
    _edit(written, "density = 1000.0", "density = 1025.0")
    _edit(written, "mass = 0.159", "mass = 1.59e-1")
    assert load_fish(written).identified == identified.identified


def test_a_coefficient_that_is_set_by_hand_has_no_interval(identified: Fish) -> None:
    record = identified.with_values({"c_d.tail": 3.0}).identified
    assert record is not None
    assert record.intervals == {name: ends for name, ends in INTERVALS.items() if name != "c_d.tail"}


def test_a_draw_with_another_body_is_read_back(identified: Fish, tmp_path: Path) -> None:
    """A free mass is fitted with the coefficients: a draw has another, and its coefficients belong to that."""
    raw = identified.model_dump(by_alias=True, exclude={"identified"})
    head = {**raw["links"][0], "mass": {"value": 1.528, "sd": 0.1}}
    free = Fish(**{**raw, "links": (head, *raw["links"][1:])}).model_copy(update={"identified": identified.identified})
    extended.write(tmp_path / "draw.toml", Model(free), {"mass.head": 1.7})
    back = load_fish(tmp_path / "draw.toml")
    assert back.links[0].mass == 1.7
    assert back.identified is not None
    assert back.identified.geometry == back.geometry != identified.geometry


def test_a_run_outside_the_fitted_range_is_warned_of_once(identified: Fish, pike: Fish, written: Path) -> None:
    """Both engines, by name of what is outside. Catches ends that are mixed up, and a warning of the fitted run."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mjfish.simulate(identified, "v1", duration=8.0)
        mjfish.simulate(identified, "v1", duration=1.0)
        mjfish.simulate(pike, "v7", duration=4.0)
        assert [str(one.message) for one in told] == []
        mjfish.simulate(written, "v7", engine="mujoco", duration=6.0)
        (one,) = told
    assert str(one.message) == (
        "pike: its coefficients were not fitted to such drives: beat 4.8 to 4.8 Hz, fitted 2.9 to 2.9 Hz"
    )


@pytest.mark.filterwarnings("ignore:pike. its coefficients were not fitted to such drives")
def test_a_run_of_two_samples_has_a_speed(identified: Fish) -> None:
    """Quarters of it are empty."""
    assert mjfish.simulate(identified, "v1", duration=0.01).status == "ok"


@pytest.mark.parametrize(("scale", "outside"), [(0.5, True), (1.02, False), (1.5, True)])
def test_joints_that_swing_otherwise_are_warned_of(scale: float, outside: bool, identified: Fish) -> None:
    assert identified.cpg is not None
    cpg = identified.cpg.model_copy(update={"beta": scale * identified.cpg.beta})
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mjfish.simulate(identified.model_copy(update={"cpg": cpg}), "v1", duration=6.0)
    assert any("amplitude" in str(one.message) for one in told) == outside
