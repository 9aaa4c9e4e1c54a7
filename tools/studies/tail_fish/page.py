"""The page on the one-joint fish."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

import jinja2
import numpy as np

from studies.markdown import table, wrapped
from studies.tail_fish.runs import DIVISIONS, means

#: Errors of a rigid body with quadratic drag and a plate for a tail, eleven numbers for all runs and four a run. Others
#: fitted it to the same 27 runs and scored it on 27 repeats and 18 runs of 30 degrees, which are not among them: surge,
#: sway, yaw rate, mean speed [m/s].
REFERENCE = {
    "repeats of the same conditions": (0.166, 0.225, 0.130, 0.0054),
    "30 degrees": (0.206, 0.260, 0.120, 0.0088),
}


def page(answers: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page from what the divisions' diagnoses said (`studies.tail_fish.runs.told`)."""
    template = resources.files(__package__).joinpath("page.md.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False, trim_blocks=True)  # noqa: S701
    first = answers[next(iter(DIVISIONS))]
    return wrapped(
        environment.from_string(template).render(
            errors=_errors(answers),
            verdicts=[(DIVISIONS[name], answer) for name, answer in answers.items()],
            coefficients=_coefficients(first),
            far=[message for message in first["findings"] if "sd away" in message],
            walk=first["walk"],
            wander=f"{np.median(first['wander']):.2f}",
            most=f"{np.max(first['wander']):.2f}",
        )
    )


def _errors(answers: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for name, answer in answers.items():
        for model in ("nominal", "extended"):
            if answer["by_run"]:
                rows.append((DIVISIONS[name], model, *_numbers(means(answer["by_run"], model))))
    rows += [(f"other runs: {name}", "reference", *_numbers(values)) for name, values in REFERENCE.items()]
    return table(("held out", "model", "surge", "sway", "yaw rate", "mean speed [m/s]"), rows)


def _numbers(values: tuple[float, ...]) -> tuple[str, ...]:
    return (*(f"{value:.3f}" for value in values[:3]), f"{values[3]:.4f}")


def _coefficients(answer: Mapping[str, Any]) -> str:
    rows = []
    for name, one in answer["coefficients"]["nominal"].items():
        known = one["known"]
        told = (f"{known['mean']:.3g} ± {known['sd']:.2g}", f"{known['deviation']:+.1f}") if known else ("", "")
        rows.append((name, f"{one['estimate']:.3g}", one["unit"], *told))
    return table(("number", "estimate", "unit", "known beforehand", "sd away"), rows)
