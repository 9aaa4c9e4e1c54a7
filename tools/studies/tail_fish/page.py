"""The page on the one-joint fish."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

import jinja2
import numpy as np

from importers.tail_fish import Study
from studies.markdown import table, wrapped
from studies.tail_fish.runs import means


def page(answer: Mapping[str, Any], study: Study) -> str:
    """Return the page from what the diagnosis said (`studies.tail_fish.runs.told`)."""
    template = resources.files(__package__).joinpath("page.md.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False, trim_blocks=True)  # noqa: S701
    return wrapped(
        environment.from_string(template).render(
            errors=_errors(answer, study),
            answer=answer,
            study=study,
            coefficients=_coefficients(answer),
            far=[message for message in answer["findings"] if "sd away" in message],
            walk=answer["walk"],
            wander=f"{np.median(answer['wander']):.2f}",
            most=f"{np.max(answer['wander']):.2f}",
        )
    )


def _errors(answer: Mapping[str, Any], study: Study) -> str:
    models = ("nominal", "extended") if answer["by_run"] else ()
    rows = [(study.called, model, *_numbers(means(answer["by_run"], model))) for model in models]
    rows += [(f"other runs: {name}", "reference", *_numbers(values)) for name, values in study.reference.items()]
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
