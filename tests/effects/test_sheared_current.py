"""A current that is linear in the place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from link_forces import LINKS, STATES, VALUES, moving
from recovery import derivative_error
from scipy import integrate

from mjfish.data import Dataset, Trial
from mjfish.drive.wave import Wave
from mjfish.effects import Effect, find
from mjfish.effects.sheared_current import ShearedCurrent
from mjfish.fish import Fish, frames
from mjfish.hydro.force import drag
from mjfish.hydro.load import (
    ANSWER,
    PARAMETERS,
    PLACES,
    SLOPES,
    LoadBuffers,
    load_rows,
    loads_on,
)
from mjfish.hydro.load_derivatives import gradient_on
from mjfish.model import Model, Prediction
from mjfish.numerics.arrays import FloatArray, readonly

SHEARED, UNIFORM = find("sheared_current"), find("ambient_current")
#: Current at the origin [m/s], its shears [1/s], the place [m] and heading [rad] where a run begins.
C, G_X, G_Y = np.array([0.12, -0.07]), 0.25, -0.14
GRADIENT = np.array([[0.0, G_X], [G_Y, 0.0]])
PLACE = (0.6, -0.4, 0.7)
SIZES = {"x": C[0], "y": C[1], "shear_x": G_X, "shear_y": G_Y}


def _water(place: FloatArray, c: FloatArray = C, gradient: FloatArray = GRADIENT) -> FloatArray:
    return np.asarray(c + gradient @ place)


def _predict(
    fish: Fish, trial: Trial, effect: Effect = SHEARED, velocity: FloatArray | None = None, **sizes: float
) -> Prediction:
    model = Model(fish, (effect,))
    named = {f"{effect.name}.{short}": size for short, size in sizes.items()}
    return model.predict(trial, model.values(VALUES | named), velocity=velocity)


def _placed(trial: Trial, place: tuple[float, float, float] = PLACE) -> Trial:
    return replace(trial, pose=readonly(np.tile(place, (len(trial.time), 1))))


def _limp(place: tuple[float, float, float], *, from_rest: bool) -> Trial:
    """Return a trial of a fish that is straight and does nothing: let go, or recorded on its way."""
    time = readonly(np.linspace(0.0, 3.0, 151))
    still = readonly(np.zeros((151, 3)))
    wave = Wave(1.0, (0.0,) * 4, (0.0,) * 4, (0.0,) * 4, ramp=0.5)
    drive = {"wave": wave} if from_rest else {"joint_angle": readonly(np.zeros((151, 4)))}
    return _placed(Trial("limp", None, time, still, **drive), place)  # type: ignore[arg-type]


def _call(
    fish: Fish, state: tuple[float, float, float], pose: tuple[float, float, float], clock: float, index: int,
    numbers: tuple[float, ...],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return what the load adds to the force of still water on a link, and the rate of its clock."""
    records = moving(fish, state)
    records["munk"] = 0.6
    records["x"], records["y"], records["heading"] = pose
    assert ShearedCurrent.load is not None
    table, rates = load_rows([(ShearedCurrent.load, numbers)], 5), np.zeros(1)
    buffers = LoadBuffers(np.zeros(ANSWER), np.array([clock]), rates)
    return np.array(loads_on(records, index, index, table, False, buffers)), rates


def _brute_force(
    fish: Fish, state: tuple[float, float, float], pose: tuple[float, float, float], clock: float, index: int
) -> FloatArray:
    """Return the same from Morison's equation with the velocity through the water, all rates by differences.

    Of a link that keeps its velocity in its own frame: what the moving water adds to what still water does.
    """
    link = moving(fish, state)[index]
    link["munk"] = 0.6
    u, v, w = state
    frame = _water(np.array(PLACE[:2]))
    mass = link["c_m"] * link["added"]

    def through(dt: float) -> tuple[float, float, float]:
        """Return velocity along and across and its slope, less the water's, a little later."""
        heading = pose[2] + w * dt
        middle = pose[2] + 0.5 * w * dt
        way = dt * (frame + _world((u, v), middle))
        origin = np.array(pose[:2]) + clock * frame + way
        stations = (0.0, 0.5 * link["length"], link["length"])
        axis = np.array([np.cos(heading), np.sin(heading)])
        water = [_link_axes(_water(origin - r * axis) - frame, heading) for r in stations]
        slope = (water[2][1] - water[0][1]) / link["length"]
        return u - water[1][0], v - water[0][1], w - slope

    def momentum(dt: float) -> FloatArray:
        _, across, slope = through(dt)
        return np.array([mass[0] * across + mass[1] * slope, mass[1] * across + mass[2] * slope])

    h = 1e-4
    pushed = -(momentum(h) - momentum(-h)) / (2.0 * h)
    slip, across, slope = through(0.0)
    here, still = link.copy(), np.array(drag(link))
    here["u"], here["v"], here["w"] = slip, across, slope
    found = np.array(drag(here)) - still
    p, p_still = momentum(0.0)[0], mass[0] * v + mass[1] * w
    found += [w * (p - p_still), pushed[0], pushed[1] - 0.6 * (slip * p - u * p_still)]
    axis = np.array([np.cos(pose[2]), np.sin(pose[2])])
    middle = np.array(pose[:2]) + clock * frame - link["com"] * axis
    c = _water(middle)
    gained = (_water(middle + h * c) - _water(middle - h * c)) / (2.0 * h)
    along, aside = link["mass"] * _link_axes(gained, pose[2])
    return found + np.array([along, aside, link["com"] * aside])


def _link_axes(world: FloatArray, heading: float) -> FloatArray:
    """Return a vector of the world along a link, to its tail, and across it."""
    return -frames.to_body(world, np.array(heading))


def _world(link: tuple[float, float], heading: float) -> FloatArray:
    return -frames.to_world(np.array(link), np.array(heading))


@pytest.mark.parametrize("clock", [0.0, 1.3])
def test_the_force_is_that_of_the_velocity_through_the_water(pike: Fish, clock: float) -> None:
    """On every link. Catches an added mass that feels the ground, a gradient left out, a place that does not drift."""
    numbers = (*C, 0.0, G_X, G_Y, *PLACE[:2])
    largest = 0.0
    for k, state in enumerate(STATES):
        pose = (0.9 - 0.1 * k, 0.3 * k - 0.8, 0.4 + 1.1 * k)
        for index in LINKS:
            found, rates = _call(pike, state, pose, clock, index, numbers)
            expected = _brute_force(pike, state, pose, clock, index)
            scale = np.abs(expected).max()
            largest = max(largest, scale)
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * scale)
            assert rates[0] == (1.0 if index == 4 else 0.0)
    assert largest > 0.1


@pytest.mark.parametrize("numbers", [(*C, 0.4, G_X, G_Y, *PLACE[:2]), (*C, 0.4, 0.0, 0.0, *PLACE[:2])])
def test_its_derivatives_are_those_of_the_force(pike: Fish, numbers: tuple[float, ...]) -> None:
    """By velocity, place, heading, clock and parameters, on every link, against central differences."""
    sheared, h = ShearedCurrent.load, 1e-6
    assert sheared is not None
    columns = [*range(PARAMETERS, PARAMETERS + 6), PARAMETERS + PLACES, *range(5)]
    for k, state in enumerate(STATES[1:]):
        here = np.array([*state, 0.9 - 0.1 * k, 0.3 * k - 0.8, 0.4 + 1.1 * k, 1.3, *numbers])
        for index in LINKS:

            def at(place: int, by: float) -> FloatArray:
                moved = here.copy()  # noqa: B023
                moved[place] += by
                one, pose, own = (tuple(moved[part].tolist()) for part in (slice(3), slice(3, 6), slice(7, None)))
                force, rates = _call(pike, one, pose, float(moved[6]), index, own)  # noqa: B023
                return np.array([*force, *rates])

            records = moving(pike, state)
            records["munk"] = 0.6
            records["x"], records["y"], records["heading"] = here[3:6]
            found = np.full((4, SLOPES), np.nan)
            row = load_rows([(sheared, numbers)], 5).rows[0]
            gradient_on(records, index, np.uint64(sheared.address), row, True, here[6:7], np.zeros((2, ANSWER)), found)
            expected = np.stack([(at(place, h) - at(place, -h)) / (2.0 * h) for place in range(12)], axis=1)
            np.testing.assert_allclose(found[:, columns], expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
            assert np.count_nonzero(np.delete(found, columns, axis=1)) == 0


def test_at_its_null_there_is_no_force(pike: Fish) -> None:
    """Nor is there one in a uniform current: the fish swims in its frame."""
    for state in STATES:
        for numbers in ((0.0,) * 7, (*C, 0.5, 0.0, 0.0, *PLACE[:2])):
            for index in LINKS:
                assert not _call(pike, state, (0.3, 0.2, 0.9), 1.3, index, numbers)[0].any()


@pytest.mark.parametrize("held", [0.0, 0.6])
def test_without_shear_it_is_the_uniform_current_to_the_last_bit(pike: Fish, turning: Trial, held: float) -> None:
    sheared, uniform = (_predict(pike, _placed(turning), one, x=C[0], y=C[1], held=held) for one in (SHEARED, UNIFORM))
    assert np.array_equal(sheared.velocity, uniform.velocity)
    assert np.array_equal(sheared.pose, uniform.pose)


@pytest.mark.parametrize("from_rest", [False, True])
def test_a_fish_adrift_in_water_that_turns_as_a_whole_turns_with_it(pike: Fish, *, from_rest: bool) -> None:
    """Around the place where the water is at rest, for good. Catches the pressure that turning water has left out."""
    rate, center = 0.3, np.array([0.1, 0.5])
    x, y = rate * center[1], -rate * center[0]
    trial = _limp(PLACE, from_rest=from_rest)
    begun = None if from_rest else np.array([0.0, 0.0, rate])
    read = _predict(pike, trial, velocity=begun, x=x, y=y, shear_x=-rate, shear_y=rate)
    around = np.array(PLACE[:2]) - center
    angle = rate * trial.time
    turned = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path = center + turned[:, :1] * around + turned[:, 1:] * np.array([-around[1], around[0]])
    np.testing.assert_allclose(read.pose[:, :2], path, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(read.pose[:, 2], PLACE[2] + angle, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(read.velocity[:, 2], rate, rtol=0.0, atol=1e-9)
    speed = rate * np.linalg.norm(around)
    np.testing.assert_allclose(np.linalg.norm(read.velocity[:, :2], axis=1), speed, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0, 1.6])
def test_a_fish_adrift_begins_with_the_water_around_it(pike: Fish, heading: float) -> None:
    """Its middle moves with the water there, and it turns as a line in the water: n (dc/dr) e. Then it goes on so.

    In shear the water slips along a stretched fish, which is why it follows such a line in the mean only.
    """
    trial = _limp((0.6, -0.4, heading), from_rest=True)
    read = _predict(pike, trial, **SIZES)
    e, n = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    half = 0.5 * sum(link.length for link in pike.links)
    turn = n @ GRADIENT @ e
    begun = frames.to_world(read.velocity[0, :2], np.array(heading))
    assert read.velocity[0, 2] == pytest.approx(turn, abs=1e-12)
    at_middle = begun - half * turn * n
    np.testing.assert_allclose(at_middle, _water(np.array([0.6, -0.4]) - half * e), rtol=0.0, atol=1e-12)

    def carried(t: float, state: FloatArray) -> list[float]:
        del t
        axis = np.array([np.cos(state[2]), np.sin(state[2])])
        return [*_water(state[:2]), float(np.array([-axis[1], axis[0]]) @ GRADIENT @ axis)]

    start = [*(np.array([0.6, -0.4]) - half * e), heading]
    solved = integrate.solve_ivp(carried, (0.0, 3.0), start, t_eval=trial.time, rtol=1e-9).y.T
    axis = np.stack([np.cos(read.pose[:, 2]), np.sin(read.pose[:, 2])], axis=1)
    middle = read.pose[:, :2] - half * axis
    went = np.abs(solved - solved[0]).max()
    assert np.abs(middle - solved[:, :2]).max() < 0.05 * went
    assert np.abs(read.pose[:, 2] - solved[:, 2]).max() < 0.1 * went


def test_a_fish_that_was_held_begins_at_rest_for_the_camera(pike: Fish, straight: Trial) -> None:
    trial = _placed(straight)
    held, still = _predict(pike, trial, held=1.0, **SIZES), _predict(pike, trial)
    np.testing.assert_allclose(held.velocity[0], still.velocity[0], rtol=0.0, atol=1e-9)
    assert np.abs(_predict(pike, trial, **SIZES).velocity[0] - still.velocity[0]).max() > 0.05


@pytest.mark.parametrize("held", [0.0, 1.0])
def test_another_origin_is_another_uniform_part(pike: Fish, turning: Trial, held: float) -> None:
    """The same water named from elsewhere; catches a shear that counts from the start of the run."""
    by = np.array([0.5, -0.9])
    here = _predict(pike, _placed(turning), held=held, **SIZES)
    moved = C - GRADIENT @ by
    there = _predict(
        pike, _placed(turning, (PLACE[0] + by[0], PLACE[1] + by[1], PLACE[2])), held=held, x=moved[0], y=moved[1],
        shear_x=G_X, shear_y=G_Y,
    )  # fmt: skip
    np.testing.assert_allclose(there.velocity, here.velocity, rtol=0.0, atol=1e-10)
    elsewhere = _predict(pike, _placed(turning, (1.6, 0.4, PLACE[2])), held=held, **SIZES)
    assert np.abs(elsewhere.velocity - here.velocity).max() > 0.1


def test_the_path_in_the_tank_is_that_of_the_velocity_over_ground(pike: Fish, turning: Trial) -> None:
    read = _predict(pike, _placed(turning), held=0.4, **SIZES)
    ground = frames.to_world(read.velocity[:, :2], read.pose[:, 2])
    path = integrate.cumulative_trapezoid(ground, turning.time, axis=0, initial=0.0)
    np.testing.assert_allclose(read.pose[:, :2] - PLACE[:2], path, rtol=0.0, atol=4e-3)
    without = _predict(pike, _placed(turning), held=0.4, x=C[0], y=C[1])
    assert np.abs(without.pose - read.pose).max() > 0.1


@pytest.mark.parametrize("short", ["x", "y", "held", "shear_x", "shear_y"])
@pytest.mark.parametrize("given", [{**SIZES, "held": 0.7}, {}], ids=["off the null", "at the null"])
def test_its_derivatives(pike: Fish, turning: Trial, given: dict[str, float], short: str) -> None:
    """Through start, load and reading, against differences of whole rollouts; held is a shape, idle at the null."""
    if short == "held" and not given:
        return
    assert derivative_error(pike, _placed(turning), SHEARED, given, short) < (1e-6 if given else 1e-4)


def test_it_needs_the_place_of_every_run(pike: Fish, straight: Trial) -> None:
    """Also from rest, where a uniform current does not. Catches a run that is taken to begin at the origin."""
    said = SHEARED.not_applicable(Dataset("d", pike, (_placed(straight), straight)))
    assert "the place in the tank was not measured (no x, y, yaw) in straight" in said
    yaw_alone = replace(straight, pose=readonly(np.tile([np.nan, np.nan, 0.2], (len(straight.time), 1))))
    assert "not measured" in SHEARED.not_applicable(Dataset("d", pike, (yaw_alone,)))
    assert SHEARED.not_applicable(Dataset("d", pike, (_placed(straight),))) == ""
