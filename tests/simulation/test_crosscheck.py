"""The two engines agree, at the order of their integrators; and the check sees an error where there is one."""

from __future__ import annotations

from typing import Any

import pytest

from mjfish import simulation as crosscheck
from mjfish.data import Trial
from mjfish.effects import Effect, find, of_fish
from mjfish.effects.roll_loss import RollLoss
from mjfish.effects.wall_effect import WallEffect
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.hydro.load import load
from mjfish.model import Model
from mjfish.model.extended import Extended
from mjfish.parameters import Parameter


@pytest.mark.parametrize("mode", [pytest.param("v5-v1", marks=pytest.mark.slow), "v3-t2"])
def test_engines_agree_and_converge(pike: Fish, mode: str) -> None:
    """Catches any term that one engine has and the other has not; a lagged force shows as order one."""
    found = crosscheck.check(pike, mode)
    assert found.passed, found.message
    assert found.status == "agrees"
    assert [level.step for level in found.levels] == [1e-3, 5e-4, 2.5e-4]
    assert found.levels[0].worst < 1e-3
    assert found.levels[0].worst < 2e-5, "measured: 7.4e-6 at most"
    assert min(found.orders) > 3.8
    assert found.range["yaw_rate"] > 1.0


def test_printed_form_fails_by_a_factor_of_twenty(pike: Fish) -> None:
    """The paper's gamma without U x p; every channel shows it, and no shorter step helps."""
    for mode in ("v1", "v3-t2"):
        found = crosscheck.check(pike, mode, coriolis="printed", halvings=1, duration=6.0)
        assert found.status == "disagrees"
        assert not found.passed
        assert min(found.levels[0].ratio.values()) > 20.0 * found.bound
        assert found.orders[0] < 0.1
        assert "does not fall" in found.message


def test_other_coefficients_agree_too(pike: Fish) -> None:
    """Heavy water and Kirchhoff's moment: where a lagged added mass would diverge."""
    heavy = pike.model_copy(update={"munk_moment": 1.0})
    values = {"c_m.head": 3.0, "c_m.body": 3.0, "c_m.tail": 3.0, "c_d.tail": 0.1}
    found = crosscheck.check(heavy, "v3", values=values, duration=2.0, halvings=1)
    assert found.passed, found.message


def test_disagreement_in_the_water_is_seen(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mutation: MuJoCo in water one per cent denser than the ODE's."""
    simulate = crosscheck.cross_check.simulate

    def denser(fish: Fish, *args: object, **options: object) -> object:
        return simulate(fish.model_copy(update={"density": 1010.0}), *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(crosscheck.cross_check, "simulate", denser)
    found = crosscheck.check(pike, "v1", duration=2.0, halvings=1)
    assert found.status == "disagrees"
    assert found.orders[0] < 0.5


def test_run_that_diverges_is_a_status(pike: Fish) -> None:
    found = crosscheck.check(pike, "v1", duration=0.5, step=0.02)
    assert found.status == "diverged"
    assert "diverged at" in found.message
    assert "c_d.head = 4" in found.message


def test_fish_without_cpg_is_refused(pike: Fish) -> None:
    with pytest.raises(InputError, match="has no CPG"):
        crosscheck.check(pike.model_copy(update={"cpg": None}), "v1")


def test_an_effect_that_the_run_cannot_have_is_named(pike: Fish) -> None:
    """Catches engines that agree because the run of a mode has no walls."""
    one = Extended(Model(pike, (find("wall_effect"),)), {"wall_effect.size": 1.0})
    with pytest.raises(InputError, match="wall_effect: the walls are not known"):
        crosscheck.check(one, "v1")


def test_a_link_knows_how_far_it_is_bent_from_the_head_in_both_engines(pike: Fish) -> None:
    """Catches a bend of the wrong sign or of another link: the side force would lean the fish otherwise."""
    effect = RollLoss().for_fish(pike)
    assert effect is not None
    found = crosscheck.check(
        Extended(Model(pike, (effect,)), {"roll_loss.square": 1.0}), "v1", duration=2.0, halvings=1
    )
    assert found.passed, found.message
    assert found.orders[0] > 3.8


class Tank(WallEffect):
    """Walls near the place where the run of a mode begins."""

    def cannot_act(self, trial: Trial) -> str:
        """The walls are known here."""
        del trial
        return ""

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return the walls."""
        del trial
        return (-0.7, 0.6, -0.1, 0.3)


def test_the_fish_has_its_place_in_the_tank_in_both_engines(pike: Fish) -> None:
    """Catches a place or a heading of another link, or half a turn away: the drag near the walls would be another."""
    model = Model(pike, (Tank(),))
    found = crosscheck.check(Extended(model, {"wall_effect.size": 2.0}), "v3-t2", duration=2.0, halvings=1)
    assert found.passed, found.message
    assert found.orders[0] > 3.8
    assert found.levels[0].worst < 1e-4
    open_water = crosscheck.check("pike", "v3-t2", duration=2.0, halvings=0)
    assert found.range["yaw_rate"] < 0.9 * open_water.range["yaw_rate"]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("wake_memory", {"share": 0.5}),
        ("added_mass_memory", {"share": 0.8}),
        ("keulegan_carpenter_drag", {"power": 0.33}),
        ("roll_loss", {"square": 1.0}),
        ("sheared_current", {"x": 0.1, "shear_x": 0.2, "shear_y": -0.1}),
    ],
)
def test_hidden_states_lose_no_order(pike: Fish, name: str, values: dict[str, float]) -> None:
    """Fourth order, as without them; a state that is held over a step, or a stage late, shows as order one or two."""
    model = Model(pike, (of_fish({name: find(name)}, pike)[name],))
    one = Extended(model, {f"{name}.{short}": value for short, value in values.items()})
    found = crosscheck.check(one, "v1", duration=2.0, halvings=1)
    assert found.orders[0] > 3.8
    assert found.levels[0].worst < 2e-5, "measured: 5e-6 at most"


@load
def _constant_push(link: Any, parameters: Any) -> tuple[float, float, float]:
    return parameters[0] * parameters[1], 0.0 * link.u, 0.0


class Pushed(Effect):
    """A force along each link, whose second factor is a number of the trial."""

    name, domain, summary = "pushed", "water", "something pushes"
    parameters = (Parameter("pushed.force", "N", 0.0, 0.0, 1.0, 0.0, 0.1),)
    source, signature, confirm = "test", "test", "test"
    load = _constant_push

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return the factor of the force."""
        del trial
        return (20.0,)


def test_the_cross_check_gives_loads_what_they_need_to_know_of_the_trial(pike: Fish) -> None:
    """Catches a check that leaves out the constants of an effect: both engines would agree, on a fish without it."""
    model = Model(pike, (Pushed(),))
    with_force = crosscheck.check(Extended(model, {"pushed.force": 0.5}), "v1", duration=0.5, halvings=0)
    without = crosscheck.check("pike", "v1", duration=0.5, halvings=0)
    assert with_force.passed
    assert with_force.range["surge"] > 1.2 * without.range["surge"]
