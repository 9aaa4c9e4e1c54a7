"""What is known beforehand counts in a plan: it makes visible what a refit of everything would hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_trials import swum, synthetic

from mjfish.data import Dataset
from mjfish.design.fitted_models import FittedModels
from mjfish.design.information import detection, separations
from mjfish.diagnosis.evidence import gather
from mjfish.effects import catalogue, find
from mjfish.estimation import fit
from mjfish.execution.progress import silent
from mjfish.fish import Fish, load_fish


def _pike(relative: float | None) -> Fish:
    """Return the pike with wide bounds; its coefficients are known to a share of their values, or not."""
    pike = load_fish("pike").model_dump()
    for groups in pike["coefficients"].values():
        for number in groups.values():
            number["sd"] = None if relative is None else relative * number["value"]
            number |= {"start": number["value"], "low": 0.1 * number["value"], "high": 10.0 * number["value"]}
    return Fish.model_validate(pike)


def _dataset(size: float, relative: float | None) -> Dataset:
    return replace(synthetic("mass_error", {"mass_error.error": size}), fish=_pike(relative))


def test_what_coefficients_hide_has_a_size_once_they_are_known() -> None:
    """That of the score tests, and what a refit leaves of the sum of squares, 18."""
    cause, name = find("mass_error"), "mass_error.error"
    known = FittedModels.undiagnosed(_dataset(0.0, 0.02), catalogue())
    size = detection(known.estimate(None), [cause], ()).sizes("mass_error")[name]
    evidence = gather(known.problem, fit(known.problem, tolerance=1e-6), [cause])
    assert size == pytest.approx(evidence.minimum_detectable("mass_error")[name], rel=0.01)

    hidden = tuple(swum(trial, "mass_error", {name: size}) for trial in known.dataset.trials)
    assert fit(replace(known.problem, trials=hidden), tolerance=1e-6).sse == pytest.approx(18.0, rel=0.1)

    unknown = FittedModels.undiagnosed(_dataset(0.0, None), catalogue()).estimate(None)
    assert detection(unknown, [cause], ()).sizes("mass_error") == {name: np.inf}


def test_rivals_differ_by_what_is_known_too() -> None:
    """Predicted from one fit each; measured by the margin of the two fits."""
    known = FittedModels.undiagnosed(_dataset(0.03, 0.02), catalogue())
    rivals = known.estimates([find("mass_error"), find("time_offset")], silent)
    (apart,) = separations(rivals, ())
    assert apart.margin > 5.0
    assert apart.noncentrality_of("mass_error") == pytest.approx(apart.margin, rel=0.1)
