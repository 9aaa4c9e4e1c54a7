"""What the water must know of a body: three ways to say it, and every way to say it badly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from wet_models import PLATE, PLATE_LINK, TREE, compiled, with_custom

from mjfish.errors import InputError
from mjfish.hydro.load import load
from mjfish.mujoco import StripFluid, StripLink
from mjfish.mujoco.block import block_of
from mjfish.numerics.arrays import FloatArray

_FULL = {
    "body": "trunk",
    "length": 0.4,
    "station": [0.0, 0.1, 0.4],
    "height": [0.0, 0.12, 0.06],
    "width": [0.0, 0.08, 0.03],
    "origin": [0.01, 0.0, -0.002],
    "axis": [-1.0, 0.1, 0.0],
    "up": [0.0, 0.2, 1.0],
    "c_m": 0.9,
    "c_d": 0.7,
    "c_f": 0.03,
    "munk_moment": 0.5,
    "roll_damping": 1.3,
    "kc": 5.0,
    "kc_power": 0.4,
    "volume": 0.0021,
    "buoyancy_center": [-0.2, 0.0, 0.003],
}
_SHORT = {"body": "tail", "length": 0.2, "height": [0.05, 0.12], "width": 0.004}
_DENSITY = 1025.0


def _toml(folder: Path) -> Path:
    tables = [
        "[[links]]\n" + "\n".join(f"{key} = {value!r}" for key, value in link.items()) for link in (_FULL, _SHORT)
    ]
    path = folder / "water.toml"
    path.write_text("\n".join([f"schema = 1\ndensity = {_DENSITY}", *tables]).replace("'", '"'), encoding="utf-8")
    return path


def _custom(*links: dict[str, Any], **water: float) -> mujoco.MjModel:
    entries: dict[str, Any] = {f"strip_fluid/{key}": value for key, value in water.items()}
    for link in links:
        entries |= {f"strip_fluid/{link['body']}/{key}": value for key, value in link.items() if key != "body"}
    return with_custom(entries)


def test_python_toml_and_custom_give_the_same_numbers(tmp_path: Path) -> None:
    """Bit for bit, in the order of the model's bodies; catches a key that one of the three drops."""
    made = StripFluid(compiled(TREE), [_FULL, StripLink(**_SHORT)], density=_DENSITY)
    read = StripFluid.from_toml(compiled(TREE), _toml(tmp_path), current=(0.1, 0.0, -0.2))
    assert read.model.opt.wind.tolist() == [0.1, 0.0, -0.2]
    custom = StripFluid(_custom(_FULL, _SHORT, density=_DENSITY))
    assert made.links == read.links == custom.links
    assert made.density == read.density == custom.density == _DENSITY
    expected = block_of(made.model).links
    np.testing.assert_array_equal(block_of(read.model).links, expected)
    np.testing.assert_array_equal(block_of(custom.model).links, expected)
    record = expected[0]
    assert set(StripLink.model_fields) == {*_FULL, "sections", "start"}, "a new field is missing in this test"
    assert (record["c_m"], record["c_d"], record["c_f"], record["munk"]) == (0.9, 0.7 * (5.0 / 3.0) ** -0.4, 0.03, 0.5)
    assert (record["roll_damping"], record["volume"], record["density"]) == (1.3, 0.0021, _DENSITY)
    np.testing.assert_array_equal(record["center"], _FULL["buoyancy_center"])


@pytest.mark.parametrize("keys", [{"kc": 24.0}, {"kc": 0.5, "kc_power": 1.0}, {"kc": 3.0}, {}])
def test_drag_across_falls_with_the_keulegan_carpenter_number(keys: dict[str, float]) -> None:
    """1/2 rho c_d (KC / 3)^-n h L v^2, n = 1/3 unless given; friction along, and what a load sees, alike in either."""
    fluid = StripFluid(compiled(PLATE), [{**PLATE_LINK, "c_d": 1.9, **keys}], loads=[(_seen_drag, [])])
    data = mujoco.MjData(fluid.model)
    data.qvel[0] = 0.8
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    c_d = 1.9 * (keys.get("kc", 3.0) / 3.0) ** -keys.get("kc_power", 1.0 / 3.0)
    expected = -0.5 * 1000.0 * c_d * 0.2 * 0.3 * 0.8**2
    parts = fluid.wrenches(data)
    np.testing.assert_allclose(parts["drag"][0, 1], expected, rtol=1e-12)
    np.testing.assert_allclose(-parts["loads"][0, 1], c_d, rtol=1e-12)


@load
def _seen_drag(link: Any, parameters: Any) -> tuple[float, float, float]:
    return 0.0, link.c_d, 0.0


def test_a_keulegan_carpenter_number_that_cannot_be_is_refused() -> None:
    for keys, message in (
        ({"kc": 0.0}, r"link 'plate'.*kc"),
        ({"kc": float("inf")}, r"link 'plate'.*kc"),
        ({"kc": 2.0, "kc_power": 3.0}, r"link 'plate'.*kc_power"),
        ({"kc_power": 0.5}, "'kc_power' is a power of 'kc', which is missing; add it"),
        ({"kc": 1e-9}, r"kc 1e-09 makes c_d 1442.25, expected 100 at most; correct kc, kc_power or c_d"),
    ):
        with pytest.raises(InputError, match=message):
            StripLink(**PLATE_LINK, **keys)


def test_custom_numerics_of_other_packages_are_left_alone() -> None:
    model = with_custom(
        {"strip_fluid_of_mine": 3.0, "strip_fluid/tail/length": 0.2, "other/tail/c_d": 9.0}
        | {f"strip_fluid/tail/{key}": _SHORT[key] for key in ("height", "width")}
    )
    fluid = StripFluid(model)
    assert [(link.body, link.c_d) for link in fluid.links] == [("tail", 1.0)]
    assert fluid.density == 1000.0


def test_density_given_in_python_goes_before_that_of_the_model() -> None:
    assert StripFluid(_custom(_SHORT, density=_DENSITY), density=998.0).density == 998.0


def test_arrays_and_numbers_of_numpy_are_taken() -> None:
    plain = StripLink(**_FULL)
    assert StripLink(**{key: value if key == "body" else np.array(value) for key, value in _FULL.items()}) == plain
    single = StripLink(
        body="tail", length=np.float32(0.5), height=[np.float32(0.25), np.float64(0.5)], width=np.int64(1)
    )
    assert single == StripLink(body="tail", length=0.5, height=(0.25, 0.5), width=1.0)


def _slab(**keys: Any) -> Any:
    return block_of(StripFluid(compiled(PLATE), [{**PLATE_LINK, **keys}]).model).links[0]


def test_integrals_of_a_slab_are_those_on_paper() -> None:
    """A_k = rho pi/4 h^2 L^(k+1)/(k+1) across the height, w^2 across the width; volume pi/4 h w L."""
    h, w, L = 0.2, 0.004, 0.3
    record = _slab()
    powers = np.array([L, L**2 / 2, L**3 / 3])
    np.testing.assert_allclose(record["added"], 1000.0 * np.pi / 4 * h**2 * powers, rtol=1e-12)
    np.testing.assert_allclose(record["added_width"], 1000.0 * np.pi / 4 * w**2 * powers, rtol=1e-12)
    assert record["added_roll"] == pytest.approx(1000.0 * np.pi / 128 * (h**2 - w**2) ** 2 * L, rel=1e-12)
    assert record["volume"] == pytest.approx(np.pi / 4 * h * w * L, rel=1e-12)
    np.testing.assert_allclose(record["center"], [-L / 2, 0, 0], atol=1e-15)


def test_two_heights_without_stations_are_those_of_the_ends() -> None:
    given = _slab(height=[0.1, 0.2], station=[0.0, 0.3])
    np.testing.assert_array_equal(_slab(height=[0.1, 0.2]), given)
    assert _slab(height=[0.2, 0.1])["added"][1] < given["added"][1]


def test_links_may_share_one_outline() -> None:
    """A piece of the outline from `start` on is the same water as its own description."""
    sections = [{"from": 0.0, "to": 0.5, "height": [0.1, 0.2], "width": [0.02, 0.02]}]
    shared = StripLink(body="plate", length=0.25, sections=sections, start=0.25)
    own = StripLink(body="plate", length=0.25, height=[0.15, 0.2], width=0.02)
    records = [block_of(StripFluid(compiled(PLATE), [link]).model).links for link in (shared, own)]
    for field in ("added", "added_width", "added_roll", "volume", "wetted", "height_moment", "strip_r", "center"):
        np.testing.assert_allclose(records[0][field], records[1][field], rtol=1e-9, atol=1e-15, err_msg=field)


@pytest.mark.parametrize(
    ("axis", "up", "frame"),
    [
        ((-1, 0, 0), (0, 0, 1), [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]),
        ((0, 0, 2), (3, 0, 1), [[0, 0, 1], [0, -1, 0], [1, 0, 0]]),
        ((1, 1, 0), (0, 0, 5), [[0.5**0.5, 0.5**0.5, 0], [-(0.5**0.5), 0.5**0.5, 0], [0, 0, 1]]),
    ],
)
def test_frame_of_the_strips_is_right_handed_and_up_is_made_square(axis: Any, up: Any, frame: FloatArray) -> None:
    link = StripLink(**{**PLATE_LINK, "axis": axis, "up": up})
    np.testing.assert_allclose(link.frame, frame, atol=1e-15)
    assert np.linalg.det(link.frame) == pytest.approx(1.0)


_SECTION = {"from": 0.0, "to": 0.3, "height": [0.1, 0.1], "width": [0.1, 0.1]}
_NO_EXTENTS = {"height": None, "width": None}
BAD_LINK: dict[str, tuple[dict[str, Any], str]] = {
    "negative height": ({"height": -0.2}, "height is -0.2 m; must be at least 0; correct it"),
    "negative at one end": ({"height": [0.1, -0.2]}, "height is -0.2 m at station 2; must be at least 0; correct it"),
    "no width at all": ({"width": 0.0}, "width is 0 m; must be above 0; correct it"),
    "a piece of nothing": (
        {"station": [0, 0.1, 0.2, 0.3], "height": [0.1, 0, 0, 0.1]},
        "height is 0 m at station 2 and at station 3; must be above 0; correct it",
    ),
    "not to the end": (
        {"station": [0, 0.2], "height": [0.1, 0.1]},
        "given from 0 to 0.2 m, the link runs from 0 to 0.3 m; give them over its whole length",
    ),
    "not from the front": ({"station": [0.1, 0.3]}, "given from 0.1 to 0.3 m, the link runs from 0 to 0.3 m; give"),
    "behind the end": ({"station": [0, 0.4]}, "given from 0 to 0.4 m, the link runs from 0 to 0.3 m; give them"),
    "too few heights": (
        {"station": [0, 0.1, 0.3], "height": [0.1, 0.1]},
        "2 values of height for 3 stations; give one a station",
    ),
    "too many heights": ({"height": [0.1, 0.1, 0.1]}, "3 values of height for 2 stations; give one a station"),
    "stations fall": ({"station": [0, 0.2, 0.1, 0.3]}, "stations must grow; found 0.1 m behind 0.2 m; correct them"),
    "stations repeat": ({"station": [0, 0.3, 0.3]}, "stations must grow; found 0.3 m behind 0.3 m"),
    "one station": ({"station": [0]}, "found one station, 0 m; expected two at least; add the other end"),
    "parallel": ({"axis": [0, 0, 1], "up": [0, 0, -2]}, r"up \(0.* is along axis \(0.*; give another direction"),
    "no axis": ({"axis": [0, 0, 0]}, r"axis \(0.* has no length; give a direction"),
    "no up": ({"up": [0, 0, 0]}, r"up \(0.* has no length; give a direction"),
    "axis in the plane": ({"axis": [1, 0]}, "axis: expected three numbers x, y, z in the body's frame, found 2"),
    "centre in the plane": ({"buoyancy_center": [1, 0]}, "buoyancy_center: expected three numbers x, y, z"),
    "unknown key": ({"heigth": 0.2}, "heigth: unknown key; remove it or correct its spelling"),
    "no length": ({"length": None}, "length: this key is missing; add it"),
    "no height": ({"height": None}, "height: this key is missing; add it"),
    "no width": ({"width": None}, "width: this key is missing; add it"),
    "no sections": (_NO_EXTENTS, "its sections are missing; give height and width, or 'sections'"),
    "sections twice": ({"sections": [_SECTION]}, "found 'sections' beside height, width; give one or the other"),
    "sections with a gap": (
        {**_NO_EXTENTS, "sections": [{**_SECTION, "to": 0.1}, {**_SECTION, "from": 0.2}]},
        "sections leave a gap or overlap between 0.1 and 0.2 m; let each start where the last one ends",
    ),
    "sections too short": ({**_NO_EXTENTS, "sections": [_SECTION], "start": 0.2}, "the link runs from 0.2 to 0.5 m"),
    "start without sections": ({"start": 0.1}, "'start' is a station of 'sections'; without these, stations"),
    "no extent in length": ({"length": 0.0}, r"length: must be at least 1e-06; correct it \(found 0.0\)"),
    "negative volume": ({"volume": -1.0}, r"volume: must be at least 0; correct it \(found -1.0\)"),
    "length of galaxies": ({"length": 1e300}, r"length: must be at most 10000; correct it \(found 1e\+300\)"),
    "length of atoms": ({"length": 1e-10}, r"length: must be at least 1e-06; correct it \(found 1e-10\)"),
    "huge height": ({"height": 1e300}, r"height: found 1e\+300 m, expected at most 10000 m"),
    "tiny height": ({"height": [0.0, 1e-200]}, "height is at most 1e-200 m in the piece from 0 to 0.3 m; expe"),
    "huge sections": (
        {**_NO_EXTENTS, "sections": [{**_SECTION, "width": [0.1, 1e200]}]},
        r"width: found 1e\+200 m, expected at most 10000 m",
    ),
    "huge station": ({"station": [0, 1e300]}, r"station.2: must be at most 10000; correct it"),
    "huge start": ({**_NO_EXTENTS, "sections": [_SECTION], "start": 1e300}, "start: must be at most 10000; correct it"),
    "huge origin": ({"origin": [0, -1e300, 0]}, "origin.2: must be at least -10000; correct it"),
    "huge axis": ({"axis": [1e300, 0, 0]}, "axis.1: must be at most 10000; correct it"),
    "huge volume": ({"volume": 1e300}, r"volume: must be at most 1e\+12; correct it"),
    "huge centre": ({"buoyancy_center": [0, 0, 1e300]}, "buoyancy_center.3: must be at most 10000; correct it"),
    "two lengths": ({"length": [0.1, 0.2]}, "length: expected one number, found 2; correct it"),
    "nan length": ({"length": np.nan}, r"length: expected a finite number; correct it \(found nan\)"),
    "nan height": ({"height": np.nan}, r"height: expected a finite number, or a list .* correct it \(found nan\)"),
    "nan in heights": ({"height": [0.1, np.nan]}, r"height: expected a finite number, .*; found \(0.1, nan\); correct"),
    "nan station": ({"station": [0, np.nan]}, r"station.2: expected a finite number; correct it \(found nan\)"),
    "nan axis": ({"axis": [0, np.inf, 0]}, r"axis.2: expected a finite number; correct it \(found inf\)"),
    "table of heights": ({"height": np.ones((2, 2))}, "height: expected a finite number, or a list of them, one a"),
    "height in words": ({"height": "tall"}, r"height: expected a finite number, .*; correct it \(found 'tall'\)"),
    "height true": ({"height": True}, r"height: expected a finite number, .*; correct it \(found True\)"),
    "coefficient in quotes": ({"c_d": "1"}, r"c_d: expected a number; write it without quotes \(found '1'\)"),
    "nan coefficient": ({"c_d": np.nan}, r"c_d: expected a finite number; correct it \(found nan\)"),
    **{
        f"{name} {value}": ({name: value}, rf"{name}: {value:g} is outside its bounds \[{bounds}\]; choose one inside")
        for name, bounds in (
            ("c_m", "0, 100"), ("c_d", "0, 100"), ("c_f", "0, 1"), ("munk_moment", "-2, 3"), ("roll_damping", "0, 100"),
        )
        for value in (-2.1, 100.5)
    },
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_LINK)
def test_bad_link_is_refused_by_place_expectation_and_remedy(name: str) -> None:
    changes, message = BAD_LINK[name]
    keys = {key: value for key, value in {**PLATE_LINK, **changes}.items() if value is not None}
    with pytest.raises(InputError, match=message) as told:
        StripFluid(compiled(PLATE), [keys])
    lines = str(told.value).splitlines()
    assert len(lines) == 1, "one mistake, one complaint"
    assert lines[0].startswith("link 'plate': ")


def test_every_mistake_of_a_link_is_told_at_once() -> None:
    with pytest.raises(InputError) as told:
        StripLink(**{**PLATE_LINK, "c_m": -1.0, "c_dd": 1.0, "length": -1.0})
    assert len(str(told.value).splitlines()) == 3


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"body": ""}, "link '': body: must not be empty; give it a text"),
        ({"body": 7}, r"link '7': body: expected text; write it in quotes \(found 7\)"),
    ],
)
def test_link_without_a_name_is_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        StripLink(**{**PLATE_LINK, **keys})


_EXTREME = {
    "long": {"length": 1e4},
    "short": {"length": 1e-6},
    "large": {"height": 1e4, "width": 1e4},
    "thin": {"height": 1e-6, "width": 1e-6},
    "needle": {"length": 1e4, "height": [0.0, 1e-6], "width": 1e4},
    "far": {"length": 1e4, "height": 1e4, "origin": [1e4, -1e4, 1e4], "buoyancy_center": [-1e4] * 3, "volume": 1e12},
    "coefficients": {"c_m": 100.0, "c_d": 100.0, "c_f": 1.0, "munk_moment": 3.0, "roll_damping": 100.0},
}


@pytest.mark.filterwarnings("ignore:link 'trunk' is:UserWarning")
@pytest.mark.parametrize("name", _EXTREME)
@pytest.mark.parametrize("density", [1e-3, 1e5])
def test_what_is_accepted_makes_a_finite_force(name: str, density: float) -> None:
    """At the bounds of every key; catches a size whose square overflows, or whose volume is none."""
    model = compiled(TREE)
    fluid = StripFluid(model, [{**PLATE_LINK, "body": "trunk", **_EXTREME[name]}], density=density)
    assert np.all(np.isfinite(block_of(model).links["added"]))
    data = mujoco.MjData(model)
    data.qvel[:6] = [1.0, -0.5, 0.3, 0.2, -0.1, 0.4]
    with fluid.installed():
        mujoco.mj_forward(model, data)
    assert np.all(np.isfinite(fluid.wrenches(data)["total"]))
    assert np.all(np.isfinite(data.qacc))
