"""Foreign forms of the sealed generator: nothing at size zero, forces as their equations say, drawn as promised."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mjfish.drive import modes
from mjfish.effects import catalogue
from mjfish.effects.mechanism import MECHANISMS as KNOWN
from mjfish.fish import Fish
from studies.battery.generator import body, camera, classes, foreign, oscillator, other_servos, other_water, rolling
from studies.battery.generator.case import make_case
from studies.battery.generator.causes import Cause
from studies.battery.generator.foreign import FOREIGN
from studies.battery.generator.plans import Run
from studies.battery.generator.water import numbers, spring
from studies.battery.generator.world import swim

TIME = np.arange(151) / 50.0
#: Velocity of a joint along and across, and its turn: forward, backward, at rest but turning.
MOTIONS = ((-0.4, 0.3, 2.0), (0.3, -0.2, 1.5), (0.0, 0.0, -3.0))


def _start(fish: Fish) -> dict[str, float]:
    return {parameter.name: parameter.start for parameter in fish.parameters}


def _drawn(name: str, size: float = 1.0) -> dict[str, float]:
    cause = classes.CAUSES[name]
    return cause.sized(cause.draw(np.random.default_rng(5)), size)


def _excess(fish: Fish, link: int, psi: dict[str, float], motion: tuple[float, float, float]) -> np.ndarray:
    whole, w = body.body(fish, _start(fish), {}, body.FINE), numbers(**classes.water(fish, psi))
    first = len(w) - (1 + 2 * other_water.KNOTS)
    strips = (part[link] for part in (whole.r, whole.across, whole.height, whole.ring))
    last = link == len(whole.links) - 1
    return np.array(other_water.excess(last, whole.links[link], 1000.0, *strips, *motion, int(w[first - 1]), w[first:]))


@pytest.mark.parametrize("cause", FOREIGN, ids=lambda cause: cause.name)
def test_a_form_of_no_size_is_none_and_at_size_it_changes_the_swimming(pike: Fish, cause: Cause) -> None:
    """A form whose switch is another number than its size."""
    run, theta = Run("a", modes.drive("v3-t2"), 3.0), _start(pike)

    def seen(psi: dict[str, float]) -> np.ndarray:
        return camera.velocity(swim(pike, run, theta, psi), run, psi, TIME)

    plain = seen({})
    direction = cause.draw(np.random.default_rng(5))
    assert np.array_equal(seen(cause.sized(direction, 0.0)), plain)
    assert np.abs(seen(cause.sized(direction, 2.0)) - plain).max() > 1e-3


def test_forms_have_names_of_their_own_and_known_mechanisms() -> None:
    """A mechanism or a twin that the solver does not have, and so could never name."""
    known = catalogue()
    for cause in FOREIGN:
        assert cause.name not in known
        assert all(known[twin].mechanism == classes.MECHANISMS[cause.name] for twin in cause.twins)
    for name, mechanism in classes.MECHANISMS.items():
        assert mechanism in KNOWN
        assert name not in known or known[name].mechanism == mechanism


def test_the_solver_is_not_in_the_foreign_forms() -> None:
    """The inverse crime: a form that is foreign by name only."""
    for module in (foreign, other_water, other_servos):
        assert module.__file__ is not None
        text = Path(module.__file__).read_text(encoding="utf-8")
        imports = [row for row in text.splitlines() if row.startswith(("from", "import")) and "mjfish" in row]
        assert set(imports) <= {"from mjfish.numerics.arrays import FloatArray"}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ["random_drag", "reynolds_decay", "whole_speed_power", "drag_crisis"])
def test_laws_of_drag_are_their_equations(pike: Fish, name: str, motion: tuple[float, float, float]) -> None:
    """A strip that is counted twice, or a speed that is not the one that was meant."""
    psi = _drawn(name, 2.0)
    theta, (u, v, om), link = _start(pike), motion, 2
    whole = body.body(pike, theta, {}, body.FINE)
    q = v + om * whole.r[link]
    speed = np.hypot(u, q)
    own = {key.partition(".")[2]: value for key, value in psi.items()}
    if name == "random_drag":
        knots = 0.3 * np.exp(-4.2 + 0.35 * np.arange(19))
        across, along = (np.array([own[f"{side}_{k}"] for k in range(19)]) for side in ("across", "along"))
        more, friction = (
            np.expm1(own["size"] * np.interp(np.log(np.abs(at) + 1e-9), np.log(knots), values))
            for at, values in ((q, across), (u, along))
        )
    elif name == "reynolds_decay":
        fall = np.exp(-speed * whole.height[link] / 1e-6 / own["number"])
        more, friction = own["pressure"] * fall, own["friction"] * np.average(fall, weights=whole.ring[link])
    elif name == "whole_speed_power":
        ratio = np.maximum(speed, 0.003) / 0.3
        more = ratio ** own["pressure"] - 1.0
        friction = np.average(ratio ** own["friction"] - 1.0, weights=whole.ring[link])
    else:
        more = own["size"] / (1.0 + (np.abs(q) / own["across"]) ** (2.0 / own["width"]))
        friction = own["size"] * own["share"] / (1.0 + (abs(u) / own["along"]) ** (2.0 / own["width"]))
    d = -whole.across[link] * more * np.abs(q) * q
    expected = [-whole.links[link, 7] * friction * abs(u) * u, d.sum(), d @ whole.r[link]]
    # Between knots the random curve is cubic, here linear.
    tolerance = 0.2 if name == "random_drag" else 1e-9
    assert _excess(pike, link, psi, motion) == pytest.approx(expected, rel=tolerance, abs=1e-4)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ["random_lift", "stalling_fin", "body_stream_lift"])
def test_lift_is_across_the_stream_where_it_acts(pike: Fish, name: str, motion: tuple[float, float, float]) -> None:
    """Lift that takes or gives power, or sits on the wrong links."""
    psi = _drawn(name)
    link = 1 if name == "body_stream_lift" else 4
    own = {key.partition(".")[2]: value for key, value in psi.items()}
    whole = body.body(pike, _start(pike), {}, body.FINE)
    place = own["place"] * whole.links[link, 0]
    u, q = motion[0], motion[1] + place * motion[2]
    angle, square = np.arctan2(q, abs(u)), u * u + q * q
    if name == "random_lift":
        c = own["size"] * sum(own[f"harmonic_{k}"] * np.sin(2.0 * k * angle) for k in range(1, 5))
    else:
        c = own["slope"] * np.sin(2.0 * angle) * (1.0 - own.get("stall", 0.0) * np.sin(angle) ** 2)
    fx, fy, mz = _excess(pike, link, psi, motion)
    assert fx * u + fy * q == pytest.approx(0.0, abs=1e-12)
    assert np.hypot(fx, fy) == pytest.approx(500.0 * whole.links[link, 9] * square * abs(c))
    assert fy * c <= 0.0
    assert mz == pytest.approx(place * fy)
    assert np.all(_excess(pike, 5 - link, psi, motion) == 0.0) or link == 1


@pytest.mark.parametrize("motion", MOTIONS)
def test_added_momentum_acts_as_the_equations_say(pike: Fish, motion: tuple[float, float, float]) -> None:
    u, v, om = motion
    links = body.body(pike, _start(pike), {}, body.FINE).links
    kappa = _drawn("munk_of_body")["munk_of_body.kappa"]
    for link in range(4):
        munk = [0.0, 0.0, -kappa * u * (links[link, 4] * v + links[link, 5] * om)]
        assert _excess(pike, link, _drawn("munk_of_body"), motion) == pytest.approx(munk)
    assert np.all(_excess(pike, 4, _drawn("munk_of_body"), motion) == 0.0)
    height, length = pike.sections[-1].height[1], links[4, 0]
    m = 0.1 * 250.0 * np.pi * _start(pike)["c_m.tail"] * height**2
    q = v + om * length
    side = m * q * min(u, 0.0)
    expected = [-0.5 * m * q**2, side, length * side]
    assert _excess(pike, 4, _drawn("shed_momentum"), motion) == pytest.approx(expected)
    assert np.all(_excess(pike, 2, _drawn("shed_momentum"), motion) == 0.0)


def test_springs_of_the_tail_harden(pike: Fish) -> None:
    bend = np.linspace(-0.2, 0.2, 9)
    for name in ("cubic_tail", "stiffening_tail"):
        own = {key.partition(".")[2]: value for key, value in _drawn(name).items()}
        w = numbers(**classes.water(pike, _drawn(name)))
        more = own.get("hardening", 0.0) * bend**2 + own.get("gain", 0.0) * np.tanh(bend / own.get("bend", 1.0)) ** 2
        assert [spring(b, w) for b in bend] == pytest.approx(bend * (1.0 + more) / own["compliance"])


def test_a_dead_time_shifts_the_command(pike: Fish) -> None:
    """A delay that forgets what was asked before a change of the drive."""
    assert pike.cpg is not None
    asked = oscillator.command(pike.cpg, modes.drive("v5-v1"), 6.0, 0.002)
    assert len(asked) > 1
    time = np.concatenate([part.start + part.step * np.arange(part.steps) for part in asked])
    before, after = (
        np.concatenate([part.angle[:, 0, 1] for part in got]) for got in (asked, other_servos.delayed(asked, 0.05))
    )
    assert after == pytest.approx(np.interp(time - 0.05, time, before), abs=1e-3)


def test_servos_start_from_rest_and_keep_their_limits(pike: Fish) -> None:
    assert pike.cpg is not None
    asked = oscillator.command(pike.cpg, modes.drive("v1"), 6.0, 0.001)
    for name in ("plant_with_inertia", "limited_loop", "two_lags", "limit_then_lag"):
        (got,) = other_servos.joints(asked, _drawn(name, 2.0))
        assert np.array_equal(got.angle[0, 0], asked[0].angle[0, 0])
        assert np.all(got.rate[0, 0] == 0.0)
        risen = np.diff(got.angle[:, [0, 2]], axis=1)[:, 0]
        simpson = got.step / 6.0 * (got.rate[:, 0] + 4.0 * got.rate[:, 1] + got.rate[:, 2])
        assert np.abs(risen - simpson).max() < 2e-4, name
        if name.startswith("limit"):
            assert np.abs(got.rate).max() <= 5.0 + 1e-9


def test_a_rolling_fish_slips_and_the_camera_reads_no_roll(pike: Fish) -> None:
    """The roll that is recorded is the one that takes the drag; the camera's velocity is that of the nose."""
    run, psi = Run("a", modes.drive("v3-t2"), 3.0), _drawn("roll_slip", 3.0)
    moved = swim(pike, run, _start(pike), psi)
    assert np.array_equal(camera.velocity(moved, run, psi, TIME), moved.at(TIME)[:, :3])
    roll = rolling.rolled(moved, psi).at(TIME)[:, 0]
    assert np.abs(roll).max() > 0.02
    assert np.array_equal(roll, moved.at(TIME)[:, 8])


def test_forms_are_drawn_by_mechanism_and_half_are_random_functions() -> None:
    rng = np.random.default_rng(1)
    drawn = [foreign.draw_form(rng) for _ in range(1200)]
    for mechanism, forms in foreign.BY_MECHANISM.items():
        own = [name for name in drawn if classes.MECHANISMS[name] == mechanism]
        assert len(own) == pytest.approx(200, abs=50)
        assert set(own) == {form.name for form in forms}
    free = [name in foreign.RANDOM for name in drawn if classes.MECHANISMS[name] in ("drag_law", "lift")]
    assert np.mean(free) == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
def test_a_foreign_case_has_the_strength_asked_for() -> None:
    case = make_case(3, "foreign", cause="stalling_fin", strength=200.0, noise_kind="white")
    assert case.truth.kind == "foreign"
    assert case.truth.strength["stalling_fin"] == pytest.approx(200.0, rel=0.1)
    drawn = [make_case(seed, "foreign", noise_kind="white").truth for seed in (1, 2)]
    assert all(truth.kind == "foreign" for truth in drawn)
