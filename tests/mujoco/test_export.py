"""The fish as an MJCF: MuJoCo loads it, and with its water it is the fish that was written."""

from __future__ import annotations

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjfish
from mjfish import fish as fishes
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish, load_fish
from mjfish.mujoco import StripFluid, Trim, export, mjcf
from mjfish.mujoco.block import block_of

TRIMS = [None, Trim(), Trim(arm=0.0053, drop=0.0017, roll_damping=0.7)]
#: What only geoms, there for looks, decide; and userdata, where commands of mjfish's own rollouts stand.
_LOOKS = {"body_geomadr", "body_geomnum", "dof_length", "body_bvhadr", "body_bvhnum"}


def _fish(name: str) -> Fish:
    """Return a fish with coefficients of 16 digits, each its own."""
    fish = load_fish(name)
    values = {p.name: p.low + (p.high - p.low) / (3.7 + k) for k, p in enumerate(fish.parameters)}
    return fish.with_values(values).model_copy(update={"munk_moment": 1.0 / 3.0, "density": 1025.1})


def _stranger() -> Fish:
    """Return a fish that no file in the package describes, with masses of 16 digits and awkward names."""
    pike = _fish("pike")
    links = [
        link.model_copy(
            update={"name": f'{link.name} & "<{k}>"', "mass": link.mass / 0.9, "inertia": link.inertia / 0.7}
        )
        for k, link in enumerate(pike.links)
    ]
    return pike.model_copy(update={"name": "stranger -- é", "links": tuple(links), "servo": None})


def _swimmer(fish: Fish, trim: Trim | None) -> StripFluid:
    return mjcf.swimmer(fish) if trim is None else mjcf.swimmer(fish, free=trim)


def _written(fish: Fish, trim: Trim | None) -> StripFluid:
    """Write the fish and load it as a user does, in the working folder."""
    export.write("fish.xml", fish, free=trim)
    return mjfish.StripFluid(mujoco.MjModel.from_xml_path("fish.xml"))


FISH = [*map(_fish, sorted(fishes.shipped())), _stranger()]
EVERY = pytest.mark.parametrize(
    ("fish", "trim"), list(itertools.product(FISH, TRIMS)), ids=lambda one: getattr(one, "name", str(one))
)


@EVERY
def test_water_and_bodies_are_those_of_the_swimmer_to_the_last_bit(fish: Fish, trim: Trim | None) -> None:
    """Catches a rounded number, a section whose profile is lost, a trim that is left out."""
    made, read = _swimmer(fish, trim), _written(fish, trim)
    assert read.links == made.links
    assert (read.density, read.coupling) == (made.density, made.coupling)
    for field in block_of(made.model).links.dtype.names or ():
        found, expected = (block_of(one.model).links[field] for one in (read, made))
        np.testing.assert_array_equal(found, expected, err_msg=field)
    for name in dir(made.model):
        if name.partition("_")[0] in ("body", "jnt", "dof", "actuator") and "_" in name and name not in _LOOKS:
            found, expected = getattr(read.model, name), getattr(made.model, name)
            np.testing.assert_array_equal(found, expected, err_msg=name)
    for name in ("timestep", "integrator", "disableflags", "enableflags", "density", "viscosity"):
        assert getattr(read.model.opt, name) == getattr(made.model.opt, name), name
    np.testing.assert_array_equal(read.model.opt.gravity, made.model.opt.gravity)


def _stirred(fluid: StripFluid, joints: int) -> mujoco.MjData:
    random = np.random.default_rng(4)
    data = mujoco.MjData(fluid.model)
    mujoco.mj_integratePos(fluid.model, data.qpos, 0.2 * random.normal(size=fluid.model.nv), 1.0)
    data.qvel[:] = 0.3 * random.normal(size=fluid.model.nv)
    _command(fluid, data, np.zeros(joints))
    return data


def _command(fluid: StripFluid, data: mujoco.MjData, angle: np.ndarray) -> None:
    """Ask for joint angles: by userdata, one for each stage of a step, where the swimmer reads them; else by ctrl."""
    if fluid.model.nuserdata:
        data.userdata[:] = [data.time, *np.tile(angle, 3)]
    else:
        data.ctrl[:] = angle


@EVERY
def test_it_swims_as_the_swimmer_does(fish: Fish, trim: Trim | None) -> None:
    """Accelerations of a bent fish that moves in every way, then half a second of a wave."""
    runs = []
    for fluid in (_swimmer(fish, trim), _written(fish, trim)):
        data = _stirred(fluid, fish.joints)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
            first = data.qacc.copy()
            for _ in range(500):
                phase = 18.0 * data.time - 0.7 * np.arange(fish.joints)
                _command(fluid, data, 0.2 * np.sin(phase))
                mujoco.mj_step(fluid.model, data)
        assert fluid.state(data).status == "ok"
        runs.append((first, data.qpos.copy(), data.qvel.copy()))
    for found, expected, what in zip(runs[1], runs[0], ("qacc", "qpos", "qvel"), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12, err_msg=what)


def test_comparison_of_accelerations_sees_the_profile_of_the_nose(pike: Fish) -> None:
    """A cone in place of the ellipse moves qacc by far more than the tolerance above."""
    cone = pike.model_copy(
        update={"sections": (pike.sections[0].model_copy(update={"profile": "linear"}), *pike.sections[1:])}
    )
    found = []
    for fluid in (_written(pike, None), _written(cone, None)):
        data = _stirred(fluid, pike.joints)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
        found.append(data.qacc.copy())
    assert np.abs(found[1] / found[0] - 1.0).max() > 1e-3


def test_step_and_integrator_are_those_asked_for(pike: Fish) -> None:
    for fish in (pike, FISH[-1]):
        export.write("fish.xml", fish, step=0.0005, integrator="implicitfast")
        option = mujoco.MjModel.from_xml_path("fish.xml").opt
        assert (option.timestep, option.integrator) == (0.0005, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


@pytest.mark.parametrize("fish", FISH, ids=lambda one: str(one.name))
def test_file_can_be_read_by_a_human(fish: Fish) -> None:
    """Comments on top, a row a section, servos by kp and kv, no endless lines."""
    shown = export.text(fish, comments=["identified from 'pool -- 3 -->'\nby mjfish\x07"])
    lines = shown.splitlines()
    assert lines[0] == "<!-- identified from 'pool - - 3 - ->'"
    assert lines[1] == "     by mjfish"
    row = fish.sections[0]
    assert f"      0 {row.end:g} 0 {row.height[1]:g} 0 {row.width[1]:g} 1" in lines
    assert "<position" in shown
    assert "<general" not in shown
    assert max(map(len, lines[lines.index("  <custom>") :])) < 120
    assert "is not in here" not in shown, "the comment of the file without water"


def test_what_mujoco_cannot_have_is_refused_and_nothing_is_written(pike: Fish, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fish\.mjcf: the name ends in '\.mjcf', expected \.xml; rename it"):
        export.write("fish.mjcf", pike)
    with pytest.raises(UnknownNameError, match="integrator 'Heun'"):
        export.write("fish.xml", pike, integrator="Heun")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
