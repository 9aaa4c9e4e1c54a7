"""The identified fish: the fish of a dataset with the values, starts and bounds of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version

from mjfish.estimation.fit import Fit
from mjfish.fish import COEFFICIENTS, Fish


def identified_fish(fish: Fish, fit: Fit, fixed: Mapping[str, float] | None = None) -> Fish:
    """Return the fish with what was found; `mjfish.fish_toml` and `mjfish.mujoco.export` write it.

    Args:
        fish: of the dataset.
        fit: its estimates become values, the starts and bounds it had become the fish's.
        fixed: coefficients that the fit was told, with their values. Parameters of causes and of single trials are no
            part of a fish; they are left out, here and in the fit.
    """
    declared = {p.name: p for p in (*fish.parameters, *fit.parameters) if p.name in COEFFICIENTS}
    values = {name: value for name, value in {**(fixed or {}), **fit.values}.items() if name in declared}
    return fish.with_coefficients({name: replace(declared[name], default=value) for name, value in values.items()})


def origin(dataset: str, fit: Fit, fixed: Mapping[str, float] | None = None) -> list[str]:
    """Return lines that say where the numbers of the identified fish come from, for the top of its file.

    Args:
        dataset: its name.
        fit: of the fish.
        fixed: coefficients that the fit was told.
    """
    lines = [
        f"Coefficients identified from the dataset '{dataset}' by mjfish {version('mjfish')}: {fit.status},",
        f"sum of squares {fit.sse:.6g} of {len(fit.residual)} weighted samples. Estimate +- standard error:",
    ]
    for name in COEFFICIENTS:
        if name in fit.values:
            at_bound = fit.at_bound[[p.name for p in fit.parameters].index(name)]
            error = "at its bound" if at_bound else f"+- {fit.sigma[name]:.2g}"
            lines.append(f"  {name} = {fit.values[name]:.6g} {error}")
        else:
            where = "held fixed" if name in (fixed or {}) else "not fitted"
            lines.append(f"  {name} {where}")
    if fit.status != "converged":
        lines.append(f"The fit {fit.status}: {fit.message}")
    return lines
