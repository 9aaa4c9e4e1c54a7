"""Water that is described badly as a whole: files, custom numerics, bodies, density, models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from wet_models import PLATE, PLATE_LINK, TREE, compiled, with_custom

from mjfish.errors import InputError, UnknownNameError
from mjfish.mujoco import StripFluid, StripLink

_TAIL = """
[[links]]
body = "tail"
length = 0.2
height = [0.05, 0.12]
width = 0.004
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("density = -1.0", r"water.toml: density: must be above 0; correct it \(found -1.0\)"),
        ("density = 1.0", "water.toml: links: this key is missing; add it"),
        ("links = []", "water.toml: links: expected at least 1 entries, found 0"),
        ("density = ", "water.toml: not valid TOML"),
        ("schema = 2", "water.toml: schema: expected 1"),
        (
            "[[links]]\nbody = 'plate'\nlength = -0.3\nheight = 0.1\nwidth = 0.1",
            "water.toml: links.1: link 'plate': len",
        ),
        ("densty = 1.0", "water.toml: densty: unknown key; remove it or correct its spelling"),
    ],
)
def test_bad_toml_is_refused_by_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "water.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        StripFluid.from_toml(compiled(PLATE), path)
    with pytest.raises(InputError, match=r"absent\.toml: no such file"):
        StripFluid.from_toml(compiled(PLATE), tmp_path / "absent.toml")


def test_unknown_body_lists_those_there_are_and_the_file(tmp_path: Path) -> None:
    path = tmp_path / "water.toml"
    path.write_text(_TAIL, encoding="utf-8")
    for body in ("trnk", "world"):
        with pytest.raises(
            UnknownNameError, match=f"unknown body '{body}'; known: tail, trunk, weight; name a body of"
        ):
            StripFluid(compiled(TREE), [{**PLATE_LINK, "body": body}])
    with pytest.raises(UnknownNameError, match=r"unknown body in .*water\.toml 'tail'; known: plate; name"):
        StripFluid.from_toml(compiled(PLATE), path)
    with pytest.raises(UnknownNameError, match="unknown body 'fin'; known: tail, trunk"):
        StripFluid(with_custom({f"strip_fluid/fin/{key}": PLATE_LINK[key] for key in ("length", "height", "width")}))


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({}, "has no custom numeric 'strip_fluid/BODY/KEY'; describe its bodies there, or give the links"),
        ({"strip_fluid/density": 1000.0}, "has no custom numeric 'strip_fluid/BODY/KEY'"),
        (
            {"strip_fluid/densty": 1.0},
            "unknown custom numeric 'strip_fluid/densty'; known: strip_fluid/BODY/KEY, strip_f",
        ),
        ({"strip_fluid/links": 1.0}, "unknown custom numeric 'strip_fluid/links'"),
        ({"strip_fluid/tail/c_dd": 1.0}, "custom numeric strip_fluid: links.1: link 'tail': .*c_dd: unknown key"),
        ({"strip_fluid/tail/length": [0.3, 0.4]}, "link 'tail': length: expected one number, found 2"),
    ],
)
def test_bad_custom_numeric_is_refused_by_name(entries: dict[str, Any], message: str) -> None:
    with pytest.raises((InputError, UnknownNameError), match=f"(?s){message}"):
        StripFluid(with_custom(entries))


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan, np.inf, "1000", True, 1e300])
def test_density_must_be_positive(density: Any) -> None:
    with pytest.raises(
        InputError, match=r"density: found .*, expected a number above 0 and at most 100000 kg/m3; correct it"
    ):
        StripFluid(compiled(PLATE), [PLATE_LINK], density=density)


@pytest.mark.parametrize("current", [1.0, "east", (0.1, 0.2), (0.1, 0.2, np.nan), np.zeros((3, 1))])
def test_current_must_be_three_numbers_and_is_not_set_else(current: Any) -> None:
    model = compiled(PLATE)
    with pytest.raises(InputError, match=r"current: found .*expected"):
        StripFluid(model, [PLATE_LINK], current=current)
    assert not model.opt.wind.any()


@pytest.mark.parametrize(
    ("links", "message"),
    [
        ([], "^links: found none, expected one at least; name a body that the water acts on$"),
        ([5], "^links.1: found 5, expected a link or a table of its keys; correct it$"),
        (PLATE_LINK, "links: found a dict, expected a list of links; put it into brackets"),
        ("plate", "links: found a str, expected a list of links"),
        (StripLink(**PLATE_LINK), "links: found a StripLink, expected a list of links"),
        (7, "links: found a int, expected a list of links"),
    ],
)
def test_links_must_be_a_list_of_links(links: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        StripFluid(compiled(PLATE), links)


@pytest.mark.parametrize("kind", [mujoco.MjSpec.from_string, str])
def test_model_must_be_compiled(kind: Any, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"model: found a (MjSpec|str), expected a compiled mujoco\.MjModel; compile it"
    ):
        StripFluid(kind(PLATE), [PLATE_LINK])
    with pytest.raises(InputError, match=r"expected a compiled mujoco\.MjModel"):
        StripFluid.from_toml(kind(PLATE), tmp_path)


def test_commands_need_room_in_userdata() -> None:
    """Catches reading beyond the end of userdata."""
    with pytest.raises(InputError, match="userdata: found 0 numbers, expected 7 for the commands; set <size nus"):
        StripFluid(compiled(TREE), [{**PLATE_LINK, "body": "tail"}], commanded=True)


def test_a_water_shows_what_it_is_and_where() -> None:
    fluid = StripFluid(compiled(PLATE), [PLATE_LINK, PLATE_LINK], density=1025.0, coupling="inertia")
    assert repr(fluid) == "<StripFluid of 1025 kg/m3 on plate; coupling inertia>"


@pytest.mark.parametrize("length", [0.3, 3.0])
def test_a_strip_of_the_size_of_the_model_is_not_warned_of(length: float) -> None:
    StripFluid(compiled(PLATE), [{**PLATE_LINK, "length": length}])  # a warning is an error here


def test_a_strip_far_longer_than_the_model_is_warned_of() -> None:
    """Catches lengths in centimetres or millimetres."""
    with pytest.warns(
        UserWarning, match=r"link 'plate' is 80 m long, the whole model 0\.\d+ m; give lengths in m"
    ) as told:
        StripFluid(compiled(PLATE), [{**PLATE_LINK, "length": 80.0}])
    assert told[0].filename == __file__


def test_a_model_without_geoms_has_no_size_to_compare_with() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="plate"><freejoint/>
        <inertial pos="1e-6 0 0" mass="1" diaginertia="1e-3 2e-3 3e-3"/></body></worldbody></mujoco>"""
    )
    StripFluid(model, [PLATE_LINK])


def test_loads_are_pairs() -> None:
    with pytest.raises(InputError, match=r"^loads: found "):
        StripFluid(compiled(PLATE), [PLATE_LINK], loads=[3])  # type: ignore[list-item]
