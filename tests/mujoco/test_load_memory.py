"""Loads with hidden states, and loads that read the place of their link, in MuJoCo."""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from wet_models import PLATE, PLATE_LINK, TREE, full_state, stirred, tree_links

from mjfish.errors import InputError
from mjfish.hydro.load import Load, load, memory_of
from mjfish.mujoco import StripFluid
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.memory import PREFIX, make_room
from mjfish.numerics.arrays import FloatArray
from proofs import reference

TAU = 0.05
Loads = tuple[tuple[Load, tuple[float, ...]], ...]


@load(memory=1)
def late(link: Any, parameters: Any) -> tuple[float, ...]:
    """A push across that follows the velocity with a lag."""
    return 0.0, -parameters[0] * link.memory[0], 0.0, (link.v - link.memory[0]) / TAU


@load(memory=2, shared=True)
def swinging(link: Any, parameters: Any) -> tuple[float, ...]:
    """A pendulum of the whole fish that the speeds of all links drive; it pushes along."""
    back = -9.0 * link.memory[0] - link.memory[1] if link.last == 1.0 else 0.0
    return parameters[0] * link.memory[0], 0.0, 0.0, link.memory[1] * link.last, link.u + back


@load
def placed(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return where it is."""
    return parameters[0] * link.x, parameters[0] * link.y, parameters[0] * link.heading


@load(memory=1)
def rising(link: Any, parameters: Any) -> tuple[float, ...]:
    """Rise to one, whatever happens."""
    return 0.0, 0.0, 0.0, (1.0 - link.memory[0]) / TAU


#: Between two that remember, one that does not.
ALL: Loads = ((late, (0.7,)), (placed, (0.3,)), (swinging, (2.0,)))


def wet(
    xml: str, links: list[dict[str, Any]], loads: Loads, integrator: str = "RK4", coupling: Coupling | None = None
) -> StripFluid:
    """Return a model in water with room for what its loads remember."""
    spec = mujoco.MjSpec.from_string(xml)
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    make_room(spec, memory_of(loads, len(links)))
    return StripFluid(compile_aside(spec), links, loads=loads, coupling=coupling)


@pytest.mark.parametrize(("integrator", "order"), [("RK4", 4.0), ("Euler", 1.0), ("implicitfast", 1.0)])
def test_a_hidden_state_converges_at_the_order_of_the_integrator(integrator: str, order: float) -> None:
    """1 - exp(-t / tau); catches a state that is advanced once a step, or between the stages of RK4 not at all."""
    errors = []
    for steps in (20, 40):
        fluid = wet(PLATE, [PLATE_LINK], ((rising, ()),), integrator)
        fluid.model.opt.timestep = 0.1 / steps
        data = mujoco.MjData(fluid.model)
        with fluid.installed():
            for _ in range(steps):
                mujoco.mj_forward(fluid.model, data)  # once more at the same time: nothing happens twice
                mujoco.mj_step(fluid.model, data)
        errors.append(abs(data.act[0] - (1.0 - np.exp(-0.1 / TAU))))
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.15
    assert errors[1] < 1e-2


def test_a_plate_is_pushed_by_what_it_remembers() -> None:
    """The closed form of the linear system m v' = -k z, tau z' = v - z, without other forces, to the order of RK4."""
    link = {**PLATE_LINK, "c_d": 0.0, "c_m": 0.0}
    fluid = wet(PLATE, [link], ((late, (3.0,)),))
    data = mujoco.MjData(fluid.model)
    data.qvel[0] = 0.6
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=200)
    mass = fluid.model.body("plate").mass[0]
    rates, modes = np.linalg.eig(np.array([[0.0, 3.0 / mass], [-1.0 / TAU, -1.0 / TAU]]))  # of v, and z: starboard
    expected = (modes @ (np.exp(rates * data.time) * np.linalg.solve(modes, [0.6, 0.0]))).real
    np.testing.assert_allclose([data.qvel[0], data.act[0]], expected, rtol=1e-7)
    assert data.qvel[0] < 0.5


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_place_and_memory_act_as_in_the_readable_ones(coupling: Coupling, seed: int) -> None:
    """Forces and rates of the tree, turned in space, in a current. Catches states of another link or another load."""
    fluid = wet(TREE, tree_links(), ALL, coupling=coupling)
    model = fluid.model
    model.opt.wind[:] = (0.3, -0.2, 0.1)
    found, plain = stirred(model, seed), stirred(model, seed)
    found.act[:] = plain.act[:] = np.random.default_rng(seed).normal(size=model.na)
    with fluid.installed():
        mujoco.mj_forward(model, found)
        rates = found.ctrl.copy()
    mujoco.mj_forward(model, plain)
    expected = reference.solve(model, plain)
    np.testing.assert_allclose(found.qacc, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(rates, plain.ctrl, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.act_dot, rates[model.nu - model.na :])
    trunk, tail = (reference.velocity_of(model, plain, link) for link in _records(fluid))
    np.testing.assert_allclose(rates[2], (trunk[1] - found.act[0]) / TAU, atol=1e-12)
    np.testing.assert_allclose(rates[3], (tail[1] - found.act[1]) / TAU, atol=1e-12)
    np.testing.assert_allclose(rates[4], found.act[3], atol=1e-12)
    np.testing.assert_allclose(rates[5], trunk[0] + tail[0] - 9.0 * found.act[2] - found.act[3], atol=1e-12)


def _records(fluid: StripFluid) -> Any:
    from mjfish.mujoco.block import block_of

    return block_of(fluid.model).links


def test_a_load_reads_the_place_of_its_strips_and_the_heading_against_them() -> None:
    """A plate at (1, -2), its bow turned by 2.5 rad to port; its stations begin 0.1 m behind its origin."""
    xml = PLATE.replace('<body name="plate">', '<body name="plate" pos="1 -2 0.3" euler="0 0 143.2394487827058">')
    fluid = StripFluid(
        mujoco.MjModel.from_xml_string(xml), [{**PLATE_LINK, "origin": (-0.1, 0, 0)}], loads=[(placed, (1.0,))]
    )
    data = mujoco.MjData(fluid.model)
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    axes = np.column_stack([[-np.cos(2.5), -np.sin(2.5)], [np.sin(2.5), -np.cos(2.5)]])  # of the strips
    place = np.array([1.0, -2.0]) - 0.1 * np.array([np.cos(2.5), np.sin(2.5)])
    wrench = fluid.wrenches(data)["loads"][0]
    np.testing.assert_allclose(wrench[:2], axes @ place, atol=1e-12)
    arm = np.append(place, 0.3) - data.xipos[1]
    np.testing.assert_allclose(wrench[5], 2.5 + np.cross(arm, wrench[:3])[2], atol=1e-12)


def test_hidden_states_are_saved_copied_and_reset_with_the_state() -> None:
    """A run goes on from a saved state to the last bit, in another mjData, in threads; a reset forgets."""
    fluid = wet(TREE, tree_links(), ALL)
    model, data = fluid.model, stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(model, data, nstep=20)
        assert np.abs(data.act).min() > 1e-6
        saved, ctrl = full_state(model, data), np.tile(data.ctrl, (4, 30, 1))
        copied = mujoco.MjData(model)
        mujoco.mj_copyData(copied, model, data)
        for one in (data, copied):
            mujoco.mj_step(model, one, nstep=30)
        with mujoco.rollout.Rollout(nthread=2) as pool:
            states, _ = pool.rollout(model, [mujoco.MjData(model) for _ in range(2)], np.tile(saved, (4, 1)), ctrl)
    ended = full_state(model, data)
    np.testing.assert_array_equal(full_state(model, copied), ended)
    np.testing.assert_array_equal(states[:, -1], np.tile(ended, (4, 1)))
    mujoco.mj_resetData(model, data)
    np.testing.assert_array_equal(data.act, 0.0)


def test_hidden_states_are_stepped_by_batches() -> None:
    """To the last bit as in a loop."""
    batches = pytest.importorskip("mujoco.batch", reason="MuJoCo has batches from 4.0 on")
    fluid = wet(TREE, tree_links(), ALL)
    model, data, start = fluid.model, stirred(fluid.model), stirred(fluid.model)
    batch = batches.Batch(model, nsim=3, nthread=2)
    for field in ("qpos", "qvel", "ctrl"):
        batch.bind(field)[:] = getattr(start, field)
    with fluid.installed():
        mujoco.mj_step(model, data, nstep=50)
        batched = batch.rollout(50, record=[kind := mujoco.mjtState.mjSTATE_FULLPHYSICS])[kind]
    np.testing.assert_array_equal(batched[:, -1], np.tile(full_state(model, data), (3, 1)))


def test_wrenches_leave_the_rates_alone_and_show_what_is_remembered() -> None:
    fluid = wet(PLATE, [PLATE_LINK], ((late, (3.0,)),))
    data = mujoco.MjData(fluid.model)
    data.act[0] = 0.2
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
        data.ctrl[0] = 7.0
        assert fluid.wrenches(data)["loads"][0, 1] == pytest.approx(3.0 * 0.2)  # the strips' y is starboard
        assert data.ctrl[0] == 7.0


def test_outside_the_block_hidden_states_stand_still() -> None:
    """Catches rates that MuJoCo goes on with when there is no water any more."""
    fluid = wet(PLATE, [PLATE_LINK], ((rising, ()),))
    data = mujoco.MjData(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=5)
    reached = data.act[0]
    mujoco.mj_step(fluid.model, data, nstep=5)
    assert data.act[0] == reached > 0.01


@load(memory=1)
def exploding(link: Any, parameters: Any) -> tuple[float, ...]:
    """A state that pushes nothing and grows without bound."""
    return 0.0, 0.0, 0.0, 1e4 * (1.0 + link.memory[0])


def test_a_hidden_state_that_diverges_is_seen() -> None:
    """MuJoCo sets all of ctrl to zero then, and the motion itself stays one of numbers."""
    fluid = wet(PLATE, [PLATE_LINK], ((exploding, ()),))
    data = mujoco.MjData(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data)
        assert fluid.state(data).status == "ok"
        mujoco.mj_step(fluid.model, data, nstep=20)
    assert fluid.state(data).status == "diverged"


def test_linear_models_hold_the_hidden_states() -> None:
    """mjd_transitionFD: the lag of a state, and what it does to the plate, in the matrix."""
    fluid = wet(PLATE, [PLATE_LINK], ((late, (3.0,)),), "Euler")
    model, data = fluid.model, mujoco.MjData(fluid.model)
    matrix: FloatArray = np.zeros((3, 3))
    with fluid.installed():
        mujoco.mjd_transitionFD(model, data, 1e-6, True, matrix, None, None, None)
    h = model.opt.timestep
    np.testing.assert_allclose(matrix[2], [0.0, -h / TAU, 1.0 - h / TAU], atol=1e-8)
    assert matrix[1, 2] > 1e-4


def _plate(*actuators: str, flags: str = "") -> mujoco.MjModel:
    xml = PLATE.replace('axis="0 1 0"', 'name="sway" axis="0 1 0"').replace("<option", f"<option {flags}")
    return mujoco.MjModel.from_xml_string(
        xml.replace("</mujoco>", f"<actuator>{''.join(actuators)}</actuator></mujoco>")
    )


def _room(number: int, more: str = 'gainprm="0"', dyntype: str = "integrator") -> str:
    return f'<general name="{PREFIX}{number}" joint="sway" dyntype="{dyntype}" {more}/>'


SERVO = '<position name="servo" joint="sway"/>'
ROOMS: dict[str, tuple[mujoco.MjModel, str]] = {
    "none": (
        _plate(),
        r"actuators: found 0 named 'strip_fluid/memory/1' and so on, expected 2, .*add <general "
        r'name="strip_fluid/memory/1" joint="sway" dyntype="integrator" gainprm="0"/> .*make_room\(spec, 2\)',
    ),
    "one": (_plate(_room(1)), "found 1 named"),
    "pushes": (_plate(_room(1), _room(2, "")), "memory/2' pushes, .*set gaintype"),
    "filter": (_plate(_room(1, dyntype="filter"), _room(2)), "memory/1' is no integrator, .*set dyntype"),
    "limited": (_plate(_room(1), _room(2, 'gainprm="0" ctrlrange="-1 1"')), "memory/2' is limited, .*take out"),
    "apart": (_plate(_room(1), SERVO, _room(2)), "memory/2' is not next to the one before"),
    "disabled": (
        _plate(_room(1), _room(2, 'gainprm="0" group="3"'), flags='actuatorgroupdisable="3"'),
        "memory/2' is disabled",
    ),
}


@pytest.mark.parametrize("actuators", [("servo",), ("servo", "room")])
def test_a_tag_on_a_model_with_other_actuators_spoils_the_step(actuators: tuple[str, ...]) -> None:
    """It would read activations that are not there, or write rates into the command of a servo."""
    fluid = wet(PLATE, [PLATE_LINK], ((late, (3.0,)),))
    other = _plate(*({"servo": SERVO, "room": _room(1)}[kind] for kind in actuators))
    other.opt.o_solimp[:] = fluid.model.opt.o_solimp
    other.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    data = mujoco.MjData(other)
    with fluid.installed():
        mujoco.mj_forward(other, data)
    assert np.isnan(data.qacc).all()


@pytest.mark.parametrize("name", ROOMS)
def test_a_model_without_room_for_hidden_states_is_refused(name: str) -> None:
    model, message = ROOMS[name]
    with pytest.raises(InputError, match=message):
        StripFluid(model, [PLATE_LINK], loads=[(late, (1.0,)), (rising, ())])


def test_room_is_found_wherever_it_stands_and_servos_are_left_alone() -> None:
    """Between two servos, by hand; catches rates written into a servo's command."""
    model = _plate(SERVO, _room(1), _room(2), SERVO.replace("servo", "more"))
    fluid = StripFluid(model, [PLATE_LINK], loads=[(late, (1.0,)), (rising, ())])
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.5
    with fluid.installed():
        mujoco.mj_step(model, data, nstep=3)
        np.testing.assert_array_equal(data.ctrl[[0, 3]], 0.5)
    assert data.act[1] == pytest.approx(1.0 - np.exp(-data.time / TAU), rel=0.1)
    model.opt.disableactuator = 1
    with pytest.raises(InputError, match="is disabled"), fluid.installed():
        pass
