"""The fish from TOML: what ships, what is refused, how values change."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

import mjfish
from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.errors import InputError, ParameterError, UnknownNameError
from mjfish.fish import Fish, load_fish, shipped
from mjfish.parameters import Parameter

PIKE = shipped()["pike"].read_text(encoding="utf-8")


def _write(folder: Path, *changes: tuple[str, str], name: str = "mine.toml") -> Path:
    """Write the pike's file with the first occurrence of each text replaced."""
    text = PIKE
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_the_pike_is_table_one_of_the_paper(pike: Fish) -> None:
    assert [link.mass for link in pike.links] == [1.528, 0.159, 0.159, 0.171, 0.091]
    assert [link.length for link in pike.links] == [0.291, 0.062, 0.062, 0.062, 0.137]
    assert [link.com for link in pike.links] == [0.18, 0.044, 0.044, 0.045, 0.037]
    assert [link.inertia for link in pike.links] == pytest.approx([290e-4, 1.8e-4, 1.8e-4, 2.0e-4, 1.6e-4])
    assert [link.group for link in pike.links] == ["head", "body", "body", "body", "tail"]
    assert (pike.joints, pike.length, pike.density, pike.munk_moment) == (4, pytest.approx(0.614), 1000.0, 0.0)


def test_the_oscillators_are_table_two(pike: Fish) -> None:
    assert pike.cpg is not None
    assert pike.cpg.amplitude == (8.70, 19.07, 25.49, 40.39)
    assert (pike.cpg.h1, pike.cpg.h2, pike.cpg.beta) == (4.0, 5.0, 60.0)
    assert np.degrees(pike.cpg.phase) == pytest.approx(70.0)


def test_the_nine_coefficients_are_table_three_in_its_order(pike: Fish) -> None:
    assert [p.name for p in pike.parameters] == list(COEFFICIENTS)
    assert [p.default for p in pike.parameters] == [0.01, 0.07, 0.06, 4.0, 1.5, 2.5, 0.02, 0.02, 0.02]
    assert [p.start for p in pike.parameters] == [0.5] * 3 + [2.0] * 3 + [0.01] * 3
    assert [(p.low, p.high) for p in pike.parameters] == [(0.01, 3.0)] * 3 + [(0.1, 4.0)] * 3 + [(0.001, 0.02)] * 3
    assert all(p.scale > 0.0 for p in pike.parameters)


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_fish_is_found_by_its_file_name_and_carries_it(name: str) -> None:
    fish = load_fish(name)
    assert fish.name == name
    assert fish.about
    assert [fish.values[p.name] for p in fish.parameters] == [p.default for p in fish.parameters]


def test_a_users_own_file_works_the_same(tmp_path: Path, pike: Fish) -> None:
    """By absolute path, relative to a folder, and as input of the engine, to the last bit."""
    path = _write(tmp_path)
    mine = load_fish(path)
    assert mine == pike
    assert load_fish("mine.toml", relative_to=tmp_path) == pike
    motion = cpg.joint_motion(mine.cpg, modes.drive("v1"), 0.5, 0.005)
    assert np.array_equal(ode.simulate(mine, motion).state, ode.simulate(pike, motion).state)


def test_a_fish_of_other_size_swims_too(tmp_path: Path) -> None:
    """Three links and no CPG: nothing is fixed at five."""
    text = tomllib.loads(PIKE)
    text["links"] = [text["links"][0], text["links"][1], text["links"][4]]
    text["sections"] = [{"from": 0.0, "to": 0.49, "height": [0.08, 0.04], "width": [0.05, 0.01]}]
    del text["cpg"], text["servo"]
    fish = Fish.model_validate(text)
    assert (fish.joints, fish.cpg) == (2, None)
    time = np.linspace(0.0, 0.5, 101)
    wave = np.sin(10.0 * time[:-1, None, None]) * np.ones((1, 3, 2))
    motion = cpg.JointMotion(time, 0.1 * wave, 0.0 * wave, 0.0 * wave)
    assert ode.simulate(fish, motion).status == "ok"


def test_a_changed_file_is_read_anew(tmp_path: Path) -> None:
    """What was read is kept, but never longer than the file."""
    path = _write(tmp_path)
    assert load_fish(path) is load_fish(path)
    assert load_fish(path).density == 1000.0
    _write(tmp_path, ("density = 1000.0", "density = 1025.0"))
    assert load_fish(path).density == 1025.0


def test_a_fish_written_out_and_read_back_is_the_same(pike: Fish) -> None:
    assert Fish.model_validate(pike.model_dump(by_alias=True)) == pike
    assert hash(Fish.model_validate(pike.model_dump(by_alias=True))) == hash(pike)


#: Changes to the pike's file, and what the complaint says: the key, what was found, what to do.
BROKEN = {
    "unknown key": ([("density = ", "viscosity = 1.0\ndensity = ")], "viscosity: unknown key; remove it or correct"),
    "unknown key of a link": ([("mass = 1.528", "mas = 1.528")], "links.1.mas: unknown key"),
    "missing key": ([("mass = 1.528\n", "")], "links.1.mass: this key is missing; add it"),
    "negative mass": (
        [("mass = 0.171", "mass = -0.171")],
        "mass: must be at least 1e-09; correct it (found -0.171)",
    ),
    "mass zero": ([("mass = 0.171", "mass = 0.0")], "links.4.mass: must be at least 1e-09"),
    "length absurd": (
        [("length = 0.291", "length = 1e300")],
        "length: must be at most 10000; correct it",
    ),
    "mass absurd": ([("mass = 0.171", "mass = 1e300")], "links.4.mass: must be at most 1e+09"),
    "mass of nothing": ([("mass = 0.171", "mass = 1e-300")], "links.4.mass: must be at least 1e-09"),
    "mass NaN": ([("mass = 0.171", "mass = nan")], "links.4.mass: expected a finite number"),
    "mass quoted": ([("mass = 0.171", 'mass = "0.171"')], "links.4.mass: expected a number; write it without quotes"),
    "inertia": ([("inertia = 290e-4", "inertia = -1")], "links.1.inertia: must be at least 1e-18"),
    "density": ([("density = 1000.0", "density = 0")], "density: must be above 0"),
    "schema": ([("schema = 1", "schema = 2")], "schema: expected 1 (found 2)"),
    "group": ([('group = "body"', 'group = "neck"')], "coefficients.c_m has no 'neck', a group of the links; add it"),
    "group with a dot": ([('group = "body"', 'group = "a.b"')], "links.2.group: "),
    "shared name": ([('"body_2"', '"body_1"')], "two links share a name; give each its own"),
    "headless": (
        [('group = "head"', 'group = "body"')],
        "coefficients.c_m.head: no link is of this group; the links have body, tail",
    ),
    "gap": (
        [("from = 0.291", "from = 0.3")],
        "sections leave a gap or overlap between 0.291 and 0.3 m; let each",
    ),
    "overlap": ([("from = 0.291", "from = 0.28")], "gap or overlap between 0.291 and 0.28 m"),
    "late nose": ([("from = 0.0\n", "from = 0.01\n")], "sections must begin at the nose (from = 0), not at 0.01 m"),
    "short outline": ([("to = 0.614", "to = 0.6")], "sections end at 0.6 m, the links at 0.614 m"),
    "long link": ([("length = 0.137", "length = 0.2")], "sections end at 0.614 m, the links at 0.677 m; make both"),
    "reversed section": ([("to = 0.477", "to = 0.2")], "sections.3: a section must end ('to' = 0.2) behind its start"),
    "negative height": (
        [("height = [0.096, 0.060]", "height = [0.096, -0.06]")],
        "sections.3.height: both ends",
    ),
    "flat outline": (
        [("height = [0.096, 0.060]", "height = [0, 0]")],
        "sections.3.height: both ends must be",
    ),
    "one end": ([("height = [0.096, 0.060]", "height = [0.096]")], "sections.3.height.2: this key is missing"),
    "profile": ([('profile = "elliptic"', 'profile = "round"')], "sections.1.profile: expected 'linear' or 'elliptic'"),
    "amplitudes": (
        [("[8.70, 19.07, 25.49, 40.39]", "[8.70, 19.07]")],
        "amplitude has 2 numbers, the fish has 4",
    ),
    "negative amplitude": ([("[8.70, ", "[-8.70, ")], "cpg.amplitude.1: must be above 0"),
    "bounds": (
        [("low = 0.1, high = 4.0", "low = 4.0, high = 0.1")],
        "c_d.head: bounds [4, 0.1] are empty",
    ),
    "value outside": (
        [("value = 4.0,", "value = 5.0,")],
        "coefficients.c_d.head: default 5 - is outside its bounds",
    ),
    "start outside": (
        [("start = 2.0", "start = 9.0")],
        "coefficients.c_d.head: start 9 - is outside its bounds",
    ),
    "negative coefficient": ([("value = 0.07", "value = -0.07")], "coefficients.c_m.body.value: must be at least 0"),
    "coefficient left out": (
        [("tail = { value = 0.06", "tial = { value = 0.06")],
        "coefficients.c_m has no 'tail', a group of the links; add it",
    ),
    "no links": ([("[[links]]", "[links]")], "not valid TOML"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_refuses_by_file_key_and_remedy(case: str, tmp_path: Path) -> None:
    changes, complaint = BROKEN[case]
    path = _write(tmp_path, *changes)
    with pytest.raises(InputError) as caught:
        load_fish(path)
    message = str(caught.value)
    assert str(path) in message
    assert complaint in message
    assert "pydantic" not in message


def test_a_fish_of_one_link_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "stump.toml"
    head = PIKE[: PIKE.index("[[links]]", PIKE.index("[[links]]") + 1)]
    path.write_text(head + PIKE[PIKE.index("# Outline") :], encoding="utf-8")
    with pytest.raises(InputError, match="links: expected at least 2 entries, found 1"):
        load_fish(path)


def test_an_unknown_fish_is_refused_with_the_shipped_ones_and_the_way_to_give_a_file() -> None:
    with pytest.raises(UnknownNameError, match=r"'salmon'; known: .*pike.*; or give the path of a fish TOML"):
        load_fish("salmon")


def test_a_missing_file_is_refused_by_its_path(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"salmon\.toml: no such fish file; shipped fish: .*pike"):
        load_fish(tmp_path / "salmon.toml")
    with pytest.raises(InputError, match="no such fish file"):
        load_fish(tmp_path)


def test_values_change_by_name_within_their_bounds(pike: Fish) -> None:
    changed = pike.with_values({"c_d.head": 1.25, "c_m.tail": 0.4})
    assert changed.values == {**pike.values, "c_d.head": 1.25, "c_m.tail": 0.4}
    assert pike.values["c_d.head"] == 4.0
    assert changed.with_values({"c_d.head": 4.0, "c_m.tail": 0.06}) == pike


def test_a_value_outside_its_bounds_is_refused(pike: Fish) -> None:
    with pytest.raises(ParameterError, match=r"c_f\.tail: value 0\.3 - is outside its bounds \[0\.001, 0\.02\]"):
        pike.with_values({"c_f.tail": 0.3})


@pytest.mark.parametrize("name", ["c_d.nose", "c_x.head", "c_d", "mass"])
def test_an_unknown_coefficient_is_refused_with_the_known_ones(pike: Fish, name: str) -> None:
    with pytest.raises(UnknownNameError, match=r"known: c_d\.body, c_d\.head"):
        pike.with_values({name: 1.0})
    with pytest.raises(UnknownNameError, match=f"unknown coefficient '{name}'"):
        pike.with_coefficients({name: pike.parameters[0]})


def test_bounds_of_a_dataset_replace_those_of_the_fish(pike: Fish) -> None:
    """On other fish c_f above 0.02 is normal: bounds belong to data or fish, never to the code."""
    wide = Parameter("c_f.tail", "-", default=0.3, low=0.0, high=1.0, start=0.1, scale=0.01)
    changed = pike.with_coefficients({"c_f.tail": wide})
    entry = dict(zip(COEFFICIENTS, changed.parameters, strict=True))["c_f.tail"]
    assert (entry.default, entry.low, entry.high, entry.start) == (0.3, 0.0, 1.0, 0.1)
    assert changed.parameters[:-1] == pike.parameters[:-1]


def test_the_shipped_files_are_found_without_listing_anything_else() -> None:
    for name, path in shipped().items():
        assert path.name == f"{name}.toml"
        assert path.parent == Path(mjfish.__file__).parent / "fish" / "fishes"
    assert "pike" in shipped()


def test_the_order_of_groups_in_the_file_does_not_matter(pike: Fish) -> None:
    """Equal fish have equal hashes: what was computed with one is found with the other."""
    told = pike.model_dump(by_alias=True)
    told["coefficients"]["c_d"] = dict(reversed(told["coefficients"]["c_d"].items()))
    other = Fish.model_validate(told)
    assert other == pike
    assert hash(other) == hash(pike)
    assert other.coefficient_names == pike.coefficient_names
