"""A formula with limits is nearly each of them at the numbers that it says."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.diagnosis.refit import off_null
from mjfish.effects import catalogue, find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray
from mjfish.simulation.synthetic import generate

#: Numbers of every formula that is the limit of another one.
LIMITS = {
    "servo_lag": {"time_constant": 0.03},
    "servo_rate_limit": {"slowness": 0.15},
    "tail_compliance": {"compliance": 0.2, "damping": 0.03},
    "ambient_current": {"x": 0.03, "y": -0.02, "held": 0.5},
}
PAIRS = [(effect.name, limit) for effect in catalogue().values() for limit in effect.limits]


@pytest.fixture(scope="module")
def trial(pike: Fish) -> Trial:
    """A run with a turn, of known pose."""
    return generate(pike, ["v1-t1"], noise=np.full(3, 1e-9), duration=6.5, seed=1).trials[0]


@pytest.mark.parametrize(("name", "limit"), PAIRS)
def test_a_formula_is_its_limit_there(pike: Fish, trial: Trial, name: str, limit: str) -> None:
    """Its fit starts there: at most a fifth, by rms, of what the limit does is left."""
    like = find(name).like(limit, LIMITS[limit])
    assert find(name).like("another", LIMITS[limit]) == {}
    nominal = Model(pike).predict(trial, Model(pike).values()).velocity
    formula, of_limit = _predicted(pike, trial, name, like), _predicted(pike, trial, limit, LIMITS[limit])
    acts = np.sqrt(np.mean((of_limit - nominal) ** 2))
    assert np.sqrt(np.mean((formula - of_limit) ** 2)) < 0.2 * acts


def _predicted(fish: Fish, trial: Trial, name: str, own: dict[str, float]) -> FloatArray:
    """Return the velocities with numbers inside their bounds, as a fit has them."""
    effect = find(name)
    model, declared = Model(fish, (effect,)), off_null(effect)
    bounded = {p.short: declared.get(p.name, p) for p in effect.parameters}
    values = {bounded[k].name: float(np.clip(v, bounded[k].low, bounded[k].high)) for k, v in own.items()}
    return model.predict(trial, model.values(values)).velocity
