"""Blunt bodies: Lamb's ellipsoids, Kirchhoff's equations, one solution by two programs, what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from wet_models import PLATE_LINK, PUSHES, TREE, compiled, skip_without_fourth_order, stirred, tree_links, with_custom

from mjfish.errors import InputError
from mjfish.hydro.blunt_force import ellipsoid_added_mass, ellipsoid_turning
from mjfish.mujoco import BluntLink, StripFluid, StripLink
from mjfish.mujoco.block import records
from mjfish.numerics.arrays import FloatArray
from proofs import reference

_RHO = 1000.0
_FREE = """<mujoco><option gravity="0 0 0" integrator="RK4" timestep="0.001"/><worldbody>
<body name="hull"><freejoint/><inertial pos=".01 -.02 .03" mass="3" fullinertia=".05 .06 .07 .01 .005 -.004"/></body>
</worldbody></mujoco>"""


def _full_matrix(seed: int = 5) -> FloatArray:
    """Return a matrix of added mass in which everything is coupled."""
    root = np.random.default_rng(seed).normal(size=(6, 6)) * [1.5, 1.5, 1.5, 0.2, 0.2, 0.2]
    return np.asarray(root.T @ root)


def _blunt(**keys: Any) -> dict[str, Any]:
    return {"body": "hull", "added_mass": _full_matrix(), "area": (0.02, 0.03, 0.05), "volume": 0.004, **keys}


@pytest.mark.parametrize("ratio", [1.05, 1.5, 2.0, 3.99, 9.97])
def test_prolate_ellipsoids_have_the_inertia_of_lambs_closed_form(ratio: float) -> None:
    """[Lamb, art. 114, 115], with e the eccentricity: as parts of mass and moment of inertia of the displaced water."""
    b = 0.1
    a = ratio * b
    mass = 4.0 / 3.0 * np.pi * _RHO * a * b**2
    moment = mass * (a**2 + b**2) / 5.0
    e = np.sqrt(1.0 - 1.0 / ratio**2)
    alpha = 2.0 * (1.0 - e**2) / e**3 * (np.arctanh(e) - e)
    beta = 1.0 / e**2 - (1.0 - e**2) / e**3 * np.arctanh(e)
    turned = e**4 * (beta - alpha) / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (beta - alpha)))
    found = ellipsoid_added_mass([a, b, b], _RHO)
    expected = [alpha / (2.0 - alpha), *[beta / (2.0 - beta)] * 2, 0.0, turned, turned]
    np.testing.assert_allclose(found / [mass, mass, mass, 1.0, moment, moment], expected, rtol=1e-9)
    np.testing.assert_allclose(ellipsoid_added_mass([b, b, a], _RHO)[[2, 1, 0, 5, 4, 3]], found, rtol=1e-12)


@pytest.mark.parametrize("semiaxes", [(0.2, 0.11, 0.07), (0.05, 0.3, 0.31), (0.1, 0.1, 0.02)])
def test_any_ellipsoid_has_the_inertia_that_mujoco_computes(semiaxes: tuple[float, float, float]) -> None:
    """MuJoCo integrates numerically; it then uses these numbers for the gyroscopic force only."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body><freejoint/><geom type="ellipsoid" size="{semiaxes[0]} {semiaxes[1]} {semiaxes[2]}"
        fluidshape="ellipsoid"/></body></worldbody></mujoco>"""
    )
    expected = model.geom_fluid[0, 6:12]
    found = ellipsoid_added_mass(semiaxes, 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-12 * expected.max())


def test_turning_is_that_of_a_plate_where_the_ellipsoid_is_one_and_none_for_a_sphere() -> None:
    """INT h |x|^3 dx over a plate that is an ellipse."""
    a, c = 0.3, 0.1
    x = np.linspace(-a, a, 200001)
    expected = np.trapezoid(2.0 * c * np.sqrt(1.0 - (x / a) ** 2) * np.abs(x) ** 3, x)
    assert ellipsoid_turning([a, 1e-9, c])[2] == pytest.approx(expected, rel=1e-6)
    np.testing.assert_array_equal(ellipsoid_turning([a, a, a]), 0.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_sphere_is_half_as_heavy_again_in_every_direction(coupling: Any, axis: int) -> None:
    """Along its first axis too, where strips have no added mass; and it comes to rest by c_d of its disc."""
    radius, mass, force = 0.1, 2.0, 3.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option integrator="RK4" timestep="0.01"/><worldbody><body name="hull" pos="0 0 1">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
        <inertial pos="1e-6 0 0" mass="{mass}" diaginertia="1 1 1"/></body></worldbody></mujoco>"""
    )
    fluid = StripFluid(model, [{"body": "hull", "semiaxes": [radius] * 3, "c_d": 0.5}], coupling=coupling)
    data = mujoco.MjData(model)
    displaced = 4.0 / 3.0 * np.pi * _RHO * radius**3
    data.qfrc_applied[2] = (mass - displaced) * 9.81  # afloat
    data.qfrc_applied[axis] += force
    with fluid.installed():
        mujoco.mj_forward(model, data)
        expected = np.zeros(3)
        expected[axis] = force / (mass + 0.5 * displaced)
        np.testing.assert_allclose(data.qacc, expected, atol=1e-12)
        mujoco.mj_step(model, data, nstep=6000)
    terminal = np.sqrt(force / (0.5 * _RHO * 0.5 * np.pi * radius**2))
    assert data.qvel[axis] == pytest.approx(terminal, rel=1e-9)


def _solved(fluid: StripFluid, data: mujoco.MjData) -> FloatArray:
    """Return the acceleration by the dense NumPy equation."""
    plain = mujoco.MjData(fluid.model)
    plain.qpos[:], plain.qvel[:], plain.ctrl[:] = data.qpos, data.qvel, data.ctrl
    mujoco.mj_forward(fluid.model, plain)
    return reference.solve(fluid.model, plain)


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_compiled_and_dense_solution_agree(coupling: Any) -> None:
    """A tree with strips and a blunt link on one body, a blunt link off its origin on another, gravity and current."""
    blunt = _blunt(origin=(-0.1, 0.02, 0.03), turning=(1e-4, 2e-4, 3e-4), c_m=0.8, c_d=1.2, munk_moment=0.6)
    links = [*tree_links(), {**blunt, "body": "tail"}, {"body": "trunk", "semiaxes": (0.2, 0.1, 0.05)}]
    fluid = StripFluid(compiled(TREE), links, coupling=coupling)
    fluid.model.opt.wind[:] = (0.3, -0.2, 0.1)
    for seed in range(3):
        data = stirred(fluid.model, seed)
        expected = _solved(fluid, data)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
            applied = data.xfrc_applied[fluid.model.body("tail").id].copy()
        np.testing.assert_allclose(data.qacc, expected, atol=1e-11 * np.abs(expected).max())
        parts = fluid.wrenches(data)
        assert all(np.abs(parts[name][2]).max() > 0.0 for name in ("drag", "added_mass", "munk", "buoyancy"))
        water = parts["total"][2] + parts["total"][1]  # both links of the tail
        if coupling == "xfrc":
            np.testing.assert_allclose(applied, water, atol=1e-9 * np.abs(water).max())


def test_a_matrix_of_strips_is_strips() -> None:
    """Signs, order and point of the matrix, coupled entries and Kirchhoff's moments: catches any that is turned."""
    strips = StripLink(
        body="hull", length=0.5, height=(0.05, 0.2), width=(0.1, 0.04), origin=(-0.2, 0.01, 0.02), axis=(1.0, 0.0, 0.0),
        c_d=0.0, c_f=0.0, munk_moment=1.0,
    )  # fmt: skip
    (record,) = records([strips], _RHO)
    center = tuple(record["center"].tolist())
    matrix = reference.inertia_of(record)
    blunt = BluntLink(
        body="hull", added_mass=matrix, area=(0, 0, 0), volume=float(record["volume"]), origin=strips.origin,
        buoyancy_center=center,
    )  # fmt: skip
    found = []
    for link in (strips, blunt):
        fluid = StripFluid(compiled(_FREE), [link])
        fluid.model.opt.gravity[2], fluid.model.opt.wind[:] = -9.81, (0.2, 0.1, -0.3)
        data = stirred(fluid.model)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
        found.append(data.qacc.copy())
    np.testing.assert_allclose(found[1], found[0], atol=1e-12 * np.abs(found[0]).max())


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_energy_and_impulse_of_a_body_without_drag_stay(coupling: Any) -> None:
    """Kirchhoff's equations with a full matrix, but for RK4's own error; without the Munk moment the energy changes."""
    skip_without_fourth_order()
    drift = {}
    for munk in (1.0, 0.0):
        fluid = StripFluid(
            compiled(_FREE), [_blunt(c_d=0.0, munk_moment=munk, origin=(0.1, -0.05, 0.02))], coupling=coupling
        )
        model = fluid.model
        data = stirred(model)
        kept = []
        with fluid.installed():
            for _ in range(5):
                dry = mujoco.MjData(model)
                dry.qpos[:], dry.qvel[:] = data.qpos, data.qvel
                mujoco.mj_fwdPosition(model, dry)  # without water
                inertia = reference.inertia(model, dry)
                momentum = inertia @ data.qvel
                kept.append([0.5 * data.qvel @ momentum, *momentum[:3]])  # dofs 0 to 2 push along the world's axes
                mujoco.mj_step(model, data, nstep=200)
        drift[munk] = np.ptp(kept, axis=0) / np.abs(kept[0]).max()
    assert drift[1.0].max() < 1e-9
    assert drift[0.0][0] > 1e-4


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"semiaxes": (0.1, 0.1)},
            "link 'hull': semiaxes: expected three numbers x, y, z in the body's frame, found 2",
        ),
        ({"semiaxes": (0.1, 0.1, 0.0)}, "link 'hull': semiaxes.3: must be at least 1e-06; correct it (found 0.0)"),
        (
            {"added_mass": (1.0,) * 6, "volume": 1.0},
            "area: this key is missing, as there are no 'semiaxes'; add either",
        ),
        (
            _blunt(added_mass=(1.0,) * 5),
            "added_mass: expected six numbers, a diagonal, or a matrix of 6 x 6; correct it",
        ),
        (_blunt(added_mass=np.ones((6, 7))), "added_mass: expected six numbers, a diagonal, or a matrix of 6 x 6"),
        (_blunt(added_mass=(1.0, 1.0, "1", 1.0, 1.0, [])), "added_mass: expected six numbers, a diagonal, or a matrix"),
        (_blunt(added_mass=np.triu(np.ones((6, 6)))), "added_mass: expected a symmetric matrix; take the mean of it"),
        (_blunt(added_mass=(1, 1, 1, 1, 1, -1)), "added_mass: found a negative eigenvalue, expected none; correct its"),
        (_blunt(area=(1.0, -1.0, 1.0)), "area.2: must be at least 0; correct it (found -1.0)"),
        (_blunt(c_d=-1.0), "c_d: -1 is outside its bounds [0, 100]; choose one inside"),
        (_blunt(c_f=1.0), "link 'hull': c_f: unknown key; remove it or correct its spelling"),
    ],
)
def test_bad_keys_are_refused_by_name(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        BluntLink(**{"body": "hull", **keys})


def test_a_blunt_link_stands_in_toml_and_mjcf_beside_strips(tmp_path: Path) -> None:
    matrix = _full_matrix()
    outline = {key: PLATE_LINK[key] for key in ("length", "height", "width")}
    numerics: dict[str, Any] = {f"strip_fluid/tail/{key}": value for key, value in outline.items()}
    numerics |= {"strip_fluid/trunk/semiaxes": [0.3, 0.1, 0.1], "strip_fluid/trunk/added_mass": matrix.ravel()}
    by_mjcf = StripFluid(with_custom(numerics))
    lines = [f"{key} = {value}" for key, value in outline.items()]
    text = "\n".join(
        ["[[links]]", 'body = "tail"', *lines, "[[links]]", 'body = "trunk"', "semiaxes = [0.3, 0.1, 0.1]",
         f"added_mass = {matrix.tolist()}"]
    )  # fmt: skip
    (tmp_path / "water.toml").write_text(text, encoding="utf-8")
    by_toml = StripFluid.from_toml(compiled(TREE), tmp_path / "water.toml")
    assert set(by_mjcf.links) == set(by_toml.links)
    assert {type(link) for link in by_toml.links} == {StripLink, BluntLink}
    (tmp_path / "water.toml").write_text(text.replace("0.3, 0.1, 0.1", "0.3"), encoding="utf-8")
    with pytest.raises(InputError, match=r"water\.toml: links\.2: link 'trunk': semiaxes: expected three numbers"):
        StripFluid.from_toml(compiled(TREE), tmp_path / "water.toml")


def test_loads_on_a_body_without_strips_are_refused() -> None:
    with pytest.raises(InputError, match="loads act on strips, which 'hull' has none of; drop the loads, or describe"):
        StripFluid(compiled(_FREE), [_blunt()], loads=PUSHES)


def test_coefficients_of_a_blunt_link_are_set_as_if_built_anew() -> None:
    """What strips alone have is passed over."""
    links = [*tree_links(), {**_blunt(), "body": "tail"}]
    fluid = StripFluid(compiled(TREE), links)
    fluid.set(c_d=[0.6, 1.8, 0.7], c_m=0.9, c_f=0.02, munk_moment=0.4)
    changed = [{**link, "c_m": 0.9, "munk_moment": 0.4, "c_f": 0.02} for link in links[:2]]
    changed.append({**links[2], "c_m": 0.9, "c_d": 0.7, "munk_moment": 0.4})
    new = StripFluid(compiled(TREE), changed)
    assert fluid.links == new.links
    np.testing.assert_array_equal(fluid._block.links, new._block.links)
