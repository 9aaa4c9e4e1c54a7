"""What the nominal fit shows of the data: lost frames, a drifting clock, fine label swaps, an odd run, filters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bad_data import SIGMA, good, only, remarked, spoiled, wrong
from true_values import TRUTH

from mjfish.data import Dataset, Trial
from mjfish.effects import catalogue
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.nominal import nominal_problem
from mjfish.inspection import Inspection, inspect_fit
from mjfish.model import Model
from mjfish.noise import DifferentiationNoise
from mjfish.numerics.arrays import readonly
from mjfish.simulation.synthetic import generate


def _after(dataset: Dataset) -> Inspection:
    """Fit from the truth, a few steps: what a fit would find."""
    fitted, held = dataset.split()
    posed = Problem(Model(dataset.fish), fitted, Noise.white(readonly(SIGMA)))
    return inspect_fit(posed, fit(posed, posed.start(TRUTH), evaluations=4), catalogue(), held)


def test_good_data_are_not_complained_of_after_the_fit() -> None:
    """Catches a check that sees ghosts."""
    assert wrong(_after(good())) == []


@pytest.mark.parametrize("count", [2, 5])
def test_lost_frames_are_counted_and_placed(count: int) -> None:
    """The rows are gone and the times closed up. Catches the opposite sense, and a clock offset in their place."""

    def lose(trial: Trial) -> Trial:
        kept = np.delete(trial.velocity, np.s_[180 : 180 + count], axis=0)
        return replace(trial, time=readonly(trial.time[: len(kept)]), velocity=readonly(kept))

    found = only(_after(spoiled(lose, "v3")), "clock")
    assert found.severity == "blocks"
    assert found.trials == ("v3",)
    assert f"about {count} frames were lost" in found.found
    assert float(found.place.split()[-2]) == pytest.approx(3.6, abs=0.1)


def test_a_clock_that_drifts_is_named_with_its_rate() -> None:
    """A frame rate that is 1.5 % off. Catches a drift that is called a jump."""
    found = only(_after(spoiled(lambda t: replace(t, time=readonly(t.time / 1.015)), "v5")), "clock")
    assert found.trials == ("v5",)
    assert "+1." in found.found


def test_a_swap_that_only_turns_show_is_found() -> None:
    """v1 and v1-t1 beat alike. Catches a comparison by the power of the beat."""
    drives = {"v1": "v1-t1", "v1-t1": "v1"}
    by_name = {trial.name: trial.drive for trial in good().trials}
    swapped = spoiled(lambda t: replace(t, drive=by_name[drives[t.name]]), *drives)
    found = only(_after(swapped), "labels")
    assert set(found.trials) == set(drives)


def test_differentiated_data_are_said_so() -> None:
    """Of the noise that the diagnosis found; catches the remark that is not made, or made of any noise."""
    fitted, held = good().split()
    posed = Problem(Model(good().fish), fitted, Noise.white(readonly(SIGMA)))
    found = fit(posed, posed.start(TRUTH), evaluations=3)
    rough = DifferentiationNoise(readonly(SIGMA), window=9)
    said = remarked(inspect_fit(replace(posed, noise=rough), found, catalogue(), held), "velocity-differentiated")
    assert [("9 samples" in one.found, "time_offset" in one.cannot_tell) for one in said] == [(True, True)]
    assert remarked(inspect_fit(posed, found, catalogue(), held), "velocity-differentiated") == []


def test_a_start_that_rests_on_its_bound_is_found() -> None:
    """The first place of a run is 8 m off; a start is looked for within 5 m of it."""
    posed = generate("pike", ["v1", "v3"], observe="pose", duration=1.5, noise=(1e-3, 1e-3, 0.01), seed=1)
    place, *others = posed.trials[1].sensors
    values = place.values.copy()
    values[0, 0] += 8.0
    astray = replace(posed.trials[1], sensors=(replace(place, values=values), *others))
    for trials, expected in ((posed.trials, []), ((posed.trials[0], astray), [("v3",)])):
        posing = nominal_problem(replace(posed, trials=trials), trials, Noise.white(np.full(3, np.nan)))
        found = inspect_fit(posing, fit(posing, posing.start(TRUTH)), catalogue())
        assert [finding.trials for finding in found.findings if finding.code == "start-on-bound"] == expected
