"""The MuJoCo model of the planar fish: hand-written, built, found."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjfish import fish as fishes
from mjfish.errors import UnknownNameError
from mjfish.fish import Fish, load_fish
from mjfish.hydro.link import link_records
from mjfish.mujoco import mjcf
from mjfish.mujoco.block import block_of
from mjfish.mujoco.mjcf import INTEGRATORS

_ROOT = Path(__file__).parents[2]
#: What only the geoms, there for looks, decide.
_LOOKS = {"body_geomadr", "body_geomnum", "dof_length"}


def test_hand_written_and_built_pike_are_the_same_model(pike: Fish) -> None:
    """Catches a number of the XML that was not changed with the fish's TOML, and a wrong frame in the builder."""
    written, built = mjcf.spec(pike).compile(), mjcf.build(pike).compile()
    assert written.geom("fin_upper").id >= 0, "spec() did not take the hand-written file"
    for name in dir(built):
        if name.partition("_")[0] in ("body", "jnt", "dof", "actuator") and "_" in name and name not in _LOOKS:
            np.testing.assert_allclose(getattr(written, name), getattr(built, name), rtol=1e-12, atol=0, err_msg=name)
    for kind in ("body", "joint", "actuator"):
        count = {"body": built.nbody, "joint": built.njnt, "actuator": built.nu}[kind]
        assert [getattr(written, kind)(i).name for i in range(count)] == [
            getattr(built, kind)(i).name for i in range(count)
        ]
    assert (written.opt.disableflags, written.opt.enableflags) == (built.opt.disableflags, built.opt.enableflags)
    np.testing.assert_array_equal(written.opt.gravity, built.opt.gravity)


def test_bodies_carry_the_masses_of_table_i(pike: Fish) -> None:
    model = mjcf.swimmer(pike).model
    for link in pike.links:
        body = model.body(link.name)
        assert body.mass[0] == link.mass
        assert body.inertia[2] == pytest.approx(link.inertia, rel=1e-12)
        np.testing.assert_allclose(body.ipos, [-link.com, 0, 0], atol=1e-15)
    assert np.all(model.geom_contype == 0)


def test_a_fish_of_another_body_is_built_and_not_taken_from_the_file(pike: Fish) -> None:
    heavy = pike.model_copy(update={"links": (pike.links[0].model_copy(update={"mass": 2.0}), *pike.links[1:])})
    assert mjcf.swimmer(heavy).model.body("head").mass[0] == 2.0
    assert mjcf.swimmer(pike).model.body("head").mass[0] == 1.528


@pytest.mark.parametrize("name", sorted(fishes.shipped()))
def test_every_shipped_fish_compiles_with_its_water(name: str) -> None:
    fish = load_fish(name)
    fluid = mjcf.swimmer(fish)
    assert [link.body for link in fluid.links] == [link.name for link in fish.links]
    assert fluid.coupling == "inertia"
    assert fluid.model.nv == mjcf.ROOT + fish.joints
    water, planar_water = block_of(fluid.model).links, link_records(fish)
    names = set(water.dtype.names) & set(planar_water.dtype.names)
    assert {"length", "c_m", "c_d", "c_f", "munk", "density", "added", "wetted", "height_moment"} <= names
    for field in names:
        np.testing.assert_allclose(water[field], planar_water[field], rtol=1e-14, err_msg=field)


def test_default_servo_has_the_stated_decay(pike: Fish) -> None:
    """Catches an inertia without the water, or of the joints alone with the head held."""
    servo = mjcf.default_servo(pike)
    light = mjcf.default_servo(pike.with_values({"c_m.head": 0.01, "c_m.body": 0.01, "c_m.tail": 0.01}))
    heavy = mjcf.default_servo(pike.with_values({"c_m.head": 3.0, "c_m.body": 3.0, "c_m.tail": 3.0}))
    # 13884 1/(kg m2): the fastest mode of the pike under a servo of kv = 0.5 was seen to decay with 6942 / s.
    assert servo.kv == pytest.approx(1000.0 / 13884.0, rel=0.01)
    assert light.kv < servo.kv < heavy.kv
    bare = pike.model_copy(update={"servo": None})
    assert mjcf.build(bare).compile().actuator("servo_1").gainprm[0] == pytest.approx(servo.kp)


def test_file_that_is_not_there_lists_those_that_are() -> None:
    with pytest.raises(UnknownNameError, match=r"'shark\.xml'; known: .*pike_planar\.xml"):
        mjcf.xml("shark.xml")


def test_unknown_integrator_and_coefficient_are_refused(pike: Fish) -> None:
    with pytest.raises(UnknownNameError, match="'Heun'; known: Euler, RK4, discrete, implicit, implicitfast"):
        mjcf.swimmer(pike, integrator="Heun")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"'c_d\.fin'; known: c_d\.body"):
        mjcf.swimmer(pike, values={"c_d.fin": 1.0})


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_every_integrator_takes_the_swimmer(pike: Fish, integrator: mjcf.Integrator) -> None:
    model = mjcf.swimmer(pike, integrator=integrator, step=0.0005).model
    assert mujoco.mjtIntegrator(model.opt.integrator).name.lower() == f"mjint_{integrator}".lower()
    assert model.opt.timestep == 0.0005


@pytest.mark.slow
def test_installed_wheel_finds_the_hand_written_pike(tmp_path: Path) -> None:
    """Catches a wheel without models/xml: in the source tree the fallback would hide that."""
    made = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(_ROOT)]
    subprocess.run(made, check=True)
    with zipfile.ZipFile(next(tmp_path.glob("mjfish-*.whl"))) as wheel:
        wheel.extractall(tmp_path / "site")
    code = (
        "import mjfish; from mjfish.mujoco import mjcf; print(mjfish.__file__);"
        "mjcf.spec(mjfish.load_fish('pike')).compile().geom('fin_upper'); print(mjcf.xml('pike_planar.xml'));"
        "print(mjcf.xml('pike_free.xml'))"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
    )
    assert all(line.startswith(str(tmp_path / "site")) for line in ran.stdout.splitlines())
