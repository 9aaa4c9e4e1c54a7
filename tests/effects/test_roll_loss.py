"""A rolling fish pushes less to the side."""

from __future__ import annotations

import numpy as np
import pytest
from link_forces import STATES, VALUES, moving
from link_velocities import link_velocities
from recovery import derivative_error
from scipy import integrate
from scipy.interpolate import CubicSpline

from mjfish.data import Trial
from mjfish.effects import Effect
from mjfish.effects.roll_loss import RollLoss
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.force import drag
from mjfish.hydro.load import ANSWER, LoadBuffers, load_rows, loads_on
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.rollout import Rollout

SQUARE, OMEGA, ZETA, KAPPA = 4.0, 9.0, 0.3, 0.6


@pytest.fixture(scope="module")
def effect(pike: Fish) -> Effect:
    """The cause as the pike has it."""
    own = RollLoss().for_fish(pike)
    assert own is not None
    return own


def _side_forces(fish: Fish, rollout: Rollout) -> tuple[FloatArray, FloatArray]:
    """Return what drag and added momentum are across the head, summed over the links, (n,), of 600 strips a link."""
    velocity = link_velocities(fish, rollout)
    angle = np.concatenate([rollout.motion.angle[:, 0], rollout.motion.angle[-1:, 2]])[: len(velocity)]
    bend = np.concatenate([np.zeros((len(angle), 1)), np.cumsum(angle, axis=1)], axis=1)
    pushed, momentum = np.zeros((2, len(velocity)))
    for i, (link, outline) in enumerate(zip(fish.links, outlines(fish), strict=True)):
        v, w = velocity[:, i, 1], velocity[:, i, 2]
        edges = np.linspace(0.0, 1.0, 601) ** 2 * link.length  # as fine as a blunt nose asks for
        r, dr = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
        h = np.interp(r, link.length * (np.arange(129) / 128) ** 2, outline.node_height)
        q = v[:, None] + w[:, None] * r
        aside = 1000.0 * np.cos(bend[:, i])
        pushed -= 0.5 * aside * VALUES[f"c_d.{link.group}"] * np.sum(h * np.abs(q) * q * dr, axis=1)
        momentum += VALUES[f"c_m.{link.group}"] * aside * np.pi / 4.0 * np.sum(h**2 * q * dr, axis=1)
    return pushed, momentum


@pytest.mark.parametrize("drive", ["straight", "turning"])
def test_the_fish_leans_as_the_pendulum_of_the_docstring(
    pike: Fish, effect: Effect, drive: str, request: pytest.FixtureRequest
) -> None:
    """With the side force F from the velocities of the run, by another solver.

    Up to the step of the drive, where the momentum jumps. Catches p' of the wrong sign, or that of one link lost.
    """
    model, trial = Model(pike, (effect,)), request.getfixturevalue(drive)
    sizes = {
        "roll_loss.square": SQUARE,
        "roll_loss.frequency": OMEGA,
        "roll_loss.damping": ZETA,
        "roll_loss.inertial": KAPPA,
    }
    rollout = model.predict(trial, VALUES | sizes).rollout
    assert rollout.memory is not None
    assert rollout.memory.shape[2] == 2
    until = rollout.time < 1.49 if drive == "turning" else rollout.time < 2.0
    time = rollout.time[until]
    pushed, momentum = (sums[until] for sums in _side_forces(pike, rollout))
    force, added = CubicSpline(time, pushed), CubicSpline(time, momentum)
    weight = 9.81 * sum(link.mass for link in pike.links)

    def swing(t: float, state: FloatArray) -> list[float]:
        lean, rate = state
        side = float(force(t)) - KAPPA * float(added(t, 1))
        return [rate, OMEGA**2 * (side / weight - lean) - 2.0 * ZETA * OMEGA * rate]

    begun = [0.0, -(OMEGA**2) * KAPPA * momentum[0] / weight]  # s = psi' + omega^2 sum kappa p / (m g) is zero
    solved = integrate.solve_ivp(swing, (0.0, time[-1]), begun, t_eval=time, rtol=1e-8, atol=1e-10, max_step=0.005)
    lean = np.concatenate([rollout.memory[:, 0, 0], rollout.memory[-1:, 1, 0]])[until]
    assert np.abs(lean).max() > 0.02
    np.testing.assert_allclose(lean, solved.y[0], rtol=0.0, atol=5e-3 * np.abs(lean).max())
    s = np.concatenate([rollout.memory[:, 0, 1], rollout.memory[-1:, 1, 1]])[until]
    expected = solved.y[1] + OMEGA**2 * KAPPA * momentum / weight
    np.testing.assert_allclose(s, expected, rtol=0.0, atol=1e-2 * np.abs(expected).max())


def _call(fish: Fish, state: tuple[float, float, float], lean: float, square: float) -> tuple[FloatArray, FloatArray]:
    """Return what the load adds to the third link, and the drag that it has there."""
    records = moving(fish, state)
    assert RollLoss.load is not None
    table = load_rows([(RollLoss.load, (square, OMEGA, ZETA, KAPPA, 0.0, 0.0, 50.0))], 5)
    buffers = LoadBuffers(np.zeros(ANSWER), np.array([lean, 0.7]), np.zeros(2))
    return np.array(loads_on(records, 2, 2, table, False, buffers)), np.array(drag(records[2]))


@pytest.mark.parametrize("lean", [0.0, 0.2, -0.5, 1.0])
def test_of_the_drag_across_cos_squared_of_the_roll_is_left(pike: Fish, lean: float) -> None:
    """The roll is lambda psi, lambda^2 the parameter; friction along the body stays."""
    for state in STATES:
        lost, whole = _call(pike, state, lean, SQUARE)
        left = np.cos(np.sqrt(SQUARE) * lean) ** 2
        np.testing.assert_allclose((lost + whole)[1:], left * whole[1:], rtol=1e-12, atol=1e-14)
        assert lost[0] == 0.0


def test_at_its_null_nothing_is_lost_however_it_leans(pike: Fish) -> None:
    for state in STATES:
        lost, _ = _call(pike, state, 0.8, 0.0)
        assert not lost.any()


def test_it_leans_by_the_weight_of_its_fish(pike: Fish, effect: Effect, straight: Trial) -> None:
    """Links twice as heavy are another weight; the catalogue's own is no fish's."""
    *others, weight = effect.constants(straight)
    assert others == [0.0, 0.0]
    assert weight == pytest.approx(9.81 * sum(link.mass for link in pike.links))
    heavy = pike.model_copy(update={"links": tuple(l.model_copy(update={"mass": 2.0 * l.mass}) for l in pike.links)})  # noqa: E741
    other = RollLoss().for_fish(heavy)
    assert other is not None
    assert other.constants(straight)[-1] == pytest.approx(2.0 * weight)


@pytest.mark.parametrize("short", ["square", "frequency", "damping", "inertial"])
def test_its_derivatives(pike: Fish, effect: Effect, turning: Trial, short: str) -> None:
    """Tangents of the two states that all links share, against differences of whole rollouts."""
    given = {"square": 0.25 * SQUARE, "frequency": OMEGA, "damping": ZETA, "inertial": KAPPA}
    assert derivative_error(pike, turning, effect, given, short) < 1e-6
