"""The sealed world against the solver: another formulation, the same physics wherever their definitions agree."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import catalogue, find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.ode import rollout
from studies.battery.generator import body, camera, draft, oscillator, servos
from studies.battery.generator.classes import CAUSES, GAUGES, LISTED
from studies.battery.generator.plans import Run
from studies.battery.generator.world import COARSE, FINE, Accuracy, swim

TIME = np.arange(301) / 50.0
EXACT = [cause for cause in (*LISTED, *GAUGES) if cause.exact]
#: The size of a cause at which the two worlds are compared.
SIZE = 1.5


def _trial(mode: str, yaw: float = 0.0) -> Trial:
    pose = np.zeros((len(TIME), 3))
    pose[:, 2] = yaw
    return Trial("a", None, TIME, np.zeros((len(TIME), 3)), modes.drive(mode), pose=pose)


def _start(fish: Fish) -> dict[str, float]:
    return {parameter.name: parameter.start for parameter in fish.parameters}


def _relative(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean((ours - theirs) ** 2, axis=0) / np.mean(theirs**2, axis=0))


@pytest.mark.parametrize("mode", ["v1", "v7", "v5-v1", "v3-t2"])
def test_without_effect_and_noise_the_world_swims_as_the_solver(pike: Fish, mode: str) -> None:
    """A slip in a momentum, the Munk share, a frame or the CPG."""
    theta = {**_start(pike), "c_m.tail": 1.1, "c_d.body": 0.7}
    ours = swim(pike, Run("a", modes.drive(mode), 6.0), theta, {}).at(TIME)[:, :3]
    theirs = Model(pike, step=0.001).predict(_trial(mode), theta).velocity
    assert np.all(_relative(ours, theirs) < 1e-4)


def test_its_error_falls_with_strips_and_step(pike: Fish) -> None:
    """What is left of the difference is the generator's own midpoint rule, and nothing physical."""
    theta = _start(pike)
    exact = Model(pike, step=0.0005).predict(_trial("v5-v1"), theta).velocity
    run = Run("a", modes.drive("v5-v1"), 6.0)
    coarse, fine, finest = (
        _relative(swim(pike, run, theta, {}, accuracy).at(TIME)[:, :3], exact)
        for accuracy in (COARSE, FINE, Accuracy(0.0005, 400))
    )
    assert np.all(fine < 0.3 * coarse)
    assert np.all(finest < 0.1 * fine)


@pytest.mark.parametrize("cause", EXACT, ids=lambda cause: cause.name)
def test_a_cause_of_the_same_definition_does_the_same_in_both(pike: Fish, cause) -> None:  # type: ignore[no-untyped-def]
    """A slip in the sign, the unit or the place of a cause in either of the two."""
    rng = np.random.default_rng(3)
    psi = cause.sized(cause.draw(rng), SIZE)
    theta = _start(pike)
    yaw = 0.7
    run = Run("a", modes.drive("v3-t2"), 6.0, (0.4, -0.2, yaw))
    ours = camera.velocity(swim(pike, run, theta, psi), run, psi, TIME)
    plain = camera.velocity(swim(pike, run, theta, {}), run, {}, TIME)
    model = Model(pike, (find(cause.name),), step=0.001)
    theirs = model.predict(_trial("v3-t2", yaw), {**model.values(theta), **psi}).velocity
    change = np.sqrt(np.mean((ours - plain) ** 2))
    assert change > 20.0 * np.sqrt(np.mean((ours - theirs) ** 2)), (
        "the two differ by more than a twentieth of the effect"
    )


def test_every_cause_of_the_list_is_in_the_catalogue_under_the_same_names() -> None:
    """A truth whose parameters the solver could never name."""
    known = catalogue()
    for cause in (*LISTED, *GAUGES):
        parameters = {parameter.name: parameter for parameter in known[cause.name].parameters}
        drawn = cause.sized(cause.draw(np.random.default_rng(1)), cause.high)
        assert set(drawn) <= set(parameters)
        for name, value in drawn.items():
            assert parameters[name].low - 1e-12 <= value <= parameters[name].high + 1e-12, name
    for cause in CAUSES.values():
        assert cause.listed or cause.name not in known or cause.name == "wall_effect"  # no tank in the datasets


def test_the_servo_of_second_order_is_late_by_its_time_constant(pike: Fish) -> None:
    """A delay that is not the solver's time constant, where both are small against the beat."""
    assert pike.cpg is not None
    delay = 0.004
    run = Run("a", modes.drive("v1"), 6.0)
    asked = oscillator.command(pike.cpg, run.drive, 6.0, 0.001)
    (got,) = servos.joints(asked, run, {"servo_lag.time_constant": delay})
    time = got.start + got.step * np.arange(got.steps)
    late = np.interp(time - delay, time, asked[0].angle[:, 0, 2])
    steady = time > 3.0
    error = np.abs(got.angle[steady, 0, 2] - late[steady]).max()
    assert error < 0.03 * np.abs(asked[0].angle[steady, 0, 2] - late[steady]).max()
    assert np.all(got.rate[0, 0] == 0.0)


def test_joints_with_play_are_half_a_gap_behind_their_command_either_way(pike: Fish) -> None:
    """Play without a memory: a joint whose place depends on the command alone, and not on where it came from."""
    assert pike.cpg is not None
    run = Run("a", modes.drive("v1"), 6.0)
    asked = oscillator.command(pike.cpg, run.drive, 6.0, 0.001)
    (got,) = servos.joints(asked, run, {f"servo_backlash.joint_{i}": 0.1 for i in range(1, 5)})
    behind = got.angle[3000:, 0, 3] - asked[0].angle[3000:, 0, 3]
    rate = asked[0].rate[3000:, 0, 3]
    fast = np.abs(rate) > 0.8 * np.abs(rate).max()
    assert np.allclose(behind[fast], -0.05 * np.sign(rate[fast]), atol=0.01)
    assert got.angle[3000:, 0, 3].max() == pytest.approx(asked[0].angle[3000:, 0, 3].max() - 0.05, abs=0.01)


def test_limited_joints_turn_no_faster(pike: Fish) -> None:
    """A limit on the wrong quantity, or one that the catch-up breaks."""
    assert pike.cpg is not None
    run = Run("a", modes.drive("v1"), 6.0)
    asked = oscillator.command(pike.cpg, run.drive, 6.0, 0.001)
    (got,) = servos.joints(asked, run, {"servo_rate_limit.slowness": 0.2})
    assert np.abs(asked[0].rate).max() > 8.0
    assert np.abs(got.rate).max() <= 5.0 + 1e-12
    assert np.abs(np.diff(got.angle[:, 0], axis=0)).max() <= 5.0 * got.step + 1e-9


def test_angle_and_rate_of_every_servo_belong_together(pike: Fish) -> None:
    """A rate that is not the derivative of its angle pumps momentum into the fish."""
    assert pike.cpg is not None
    run = Run("a", modes.drive("v3-t2"), 6.0)
    asked = oscillator.command(pike.cpg, run.drive, 6.0, 0.001)
    for name in (
        "servo_saturation",
        "servo_lag",
        "servo_backlash",
        "sticking_joint",
        "fading_battery",
        "frequency_gain",
    ):
        cause = CAUSES[name]
        psi = cause.sized(cause.draw(np.random.default_rng(2)), min(20.0, cause.high))
        for part in servos.joints(asked, run, psi):
            risen = np.diff(part.angle[:, [0, 2]], axis=1)[:, 0]
            simpson = part.step / 6.0 * (part.rate[:, 0] + 4.0 * part.rate[:, 1] + part.rate[:, 2])
            assert np.abs(risen - simpson).max() < 1e-4, name


def test_the_fish_rolls_as_the_solver_has_it(pike: Fish) -> None:
    """A roll of the wrong sign or phase, or one that a jump of the sway kicks."""
    theta = _start(pike)
    psi = {"roll.height": 0.05, "roll.frequency": 9.0, "roll.damping": 0.2}
    run = Run("a", modes.drive("v3-t2"), 6.0)
    moved = swim(pike, run, theta, psi)
    ours = camera.velocity(moved, run, psi, TIME)
    model = Model(pike, (find("roll"),), step=0.001)
    theirs = model.predict(_trial("v3-t2"), {**model.values(theta), **psi}).velocity
    change = np.sqrt(np.mean((ours - moved.at(TIME)[:, :3]) ** 2))
    assert change > 10.0 * np.sqrt(np.mean((ours - theirs) ** 2))


def test_a_wall_changes_the_swimming_of_a_fish_that_comes_near(pike: Fish) -> None:
    """Walls in the kernel's mirrored frame: the fish swims to +x and must feel the wall there, and no other."""
    run = Run("a", modes.drive("v1"), 6.0, (0.5, 0.0, 0.0))
    theta = _start(pike)
    far = {"x0": -99.0, "x1": 99.0, "y0": -99.0, "y1": 99.0}

    def speed(**wall: float) -> float:
        psi = {f"wall_effect.{key}": value for key, value in {"size": 3.0, "reach": 0.2, **far, **wall}.items()}
        return float(swim(pike, run, theta, psi).at(TIME)[-50:, 0].mean())

    free = float(swim(pike, run, theta, {}).at(TIME)[-50:, 0].mean())
    assert speed() == pytest.approx(free, rel=1e-6)
    assert speed(x0=-2.0) == pytest.approx(free, rel=1e-3)
    assert abs(speed(x1=2.5) - free) > 0.02 * free  # thrust grows as well as drag


def test_a_wake_that_forgets_at_once_is_none(pike: Fish) -> None:
    """Memory that adds drag instead of delaying it."""
    run = Run("a", modes.drive("v1"), 6.0)
    theta = _start(pike)
    free = swim(pike, run, theta, {}).at(TIME)[:, :3]
    quick, slow = (
        swim(pike, run, theta, {"wake_memory.share": 0.5, "wake_memory.time": time}).at(TIME)[:, :3]
        for time in (0.002, 0.15)
    )
    assert np.all(_relative(quick, free) < 0.03)
    assert np.any(_relative(slow, free) > 0.15)


def test_strips_integrate_the_outline(pike: Fish) -> None:
    """Sections that are cut at the wrong station: the integrals of the nominal fish are known."""
    cut = body.outline(pike.sections, tuple(link.length for link in pike.links), body.FINE)
    known = [0.0243389299, 0.00558, 0.004836, 0.004092, 0.00804875]
    assert np.allclose(np.sum(cut.height * cut.dr, axis=1), known, rtol=1e-4)


def test_the_draft_swims_its_runs_from_their_place_in_the_tank() -> None:
    """A pose whose rate is not the velocity that is recorded."""
    made = draft.draft(2, pose=True)
    moved = made.motion(0, {}, FINE)
    run, time = made.plan.runs[0], made.time(0)
    path = camera.pose(moved, run, {}, time)[:: camera.FINER]
    assert np.allclose(path[0], run.start)
    assert np.allclose(path, moved.at(time)[:, 3:6], atol=2e-3)


def test_the_solver_is_not_in_the_generator() -> None:
    """The inverse crime: physics that both sides share."""
    modules = [vars(part).values() for part in (body, camera, draft, oscillator, servos)]
    names = {getattr(item, "__module__", "") or "" for values in modules for item in values}
    assert not [
        name for name in names if name.startswith(("mjfish.ode", "mjfish.hydro", "mjfish.model", "mjfish.effects"))
    ]
    assert FINE.step != rollout.STEP
