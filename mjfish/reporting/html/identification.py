"""The figures of an identification, written to a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjfish.estimation.agreement import agreement
from mjfish.estimation.residuals.residual import Residual
from mjfish.estimation.residuals.residual_tests import ResidualTests
from mjfish.estimation.residuals.whiteness import ALL
from mjfish.estimation.uncertainty.profile import Profile
from mjfish.files import make_folder
from mjfish.frames import CHANNELS
from mjfish.reporting.html.profiles import profile_figure
from mjfish.reporting.html.residuals import autocorrelation_figure, cross_correlation_figure, simulated_figure
from mjfish.reporting.html.sheet import Block, Sheet, write_sheet
from mjfish.reporting.html.words import CHANNEL_NAMES, chance


def write_identification_figures(
    folder: Path,
    name: str,
    residuals: Sequence[Residual],
    tests: ResidualTests,
    profiles: Sequence[Profile] = (),
) -> tuple[Path, ...]:
    """Write the figures of an identification to a folder, which is made where it is not there.

    Args:
        folder: where to.
        name: of the dataset, for titles.
        residuals: of the trials, fitted and held out.
        tests: of the residuals of the fit.
        profiles: of parameters, if any.

    Returns:
        The files: ``simulated.html``; ``autocorrelation.html`` and ``cross_correlation.html`` where a rollout could be
        tested; ``profiles.html`` where there are profiles.

    Raises:
        InputError: a file cannot be written.
    """
    make_folder(folder)
    sheets = {"simulated.html": _simulated(name, residuals)}
    if tests.status != "untested":
        sheets["autocorrelation.html"] = _autocorrelation(name, tests)
        sheets["cross_correlation.html"] = _cross_correlation(name, tests)
    if profiles:
        sheets["profiles.html"] = Sheet(
            f"{name}: profile likelihoods",
            "How much worse the best fit gets as one parameter is held elsewhere; the line is the 95 % threshold, the "
            "parabola behind it what estimate and standard error say.",
            {"nominal": "profile"},
            (Block("Profiles", "", profile_figure(profiles)),),
        )
    for file, sheet in sheets.items():
        write_sheet(folder / file, sheet)
    return tuple(folder / file for file in sheets)


def _simulated(name: str, residuals: Sequence[Residual]) -> Sheet:
    blocks: list[Block] = []
    for residual in residuals:
        fits = [a.fit for a in agreement([residual], horizons=()) if a.part == "whole"]
        told = ", ".join(f"{CHANNEL_NAMES[c]} {fit:.1f} %" for c, fit in zip(CHANNELS, fits, strict=True))
        remark = "the rollout diverged" if residual.diverged else f"fit: {told}"
        held = " (held out)" if residual.role == "held_out" else ""
        blocks.append(Block(residual.trial.name + held, remark, simulated_figure(residual), len(blocks) < 3))
    return Sheet(
        f"{name}: measured against simulated",
        "Simulated curves are drawn where samples count. Fit: 100 % is perfect, 0 % no better than the mean.",
        {"measured": "measured", "nominal": "simulated, and measured − simulated"},
        tuple(blocks),
    )


def _autocorrelation(name: str, tests: ResidualTests) -> Sheet:
    told = [f"{CHANNEL_NAMES[t.channel]} p {chance(t.p_value)}" for t in tests.whiteness if t.trial == ALL]
    return Sheet(
        f"{name}: is the residual white?",
        "Autocorrelation of the residual over all trials (thick) and of each (thin), with the band that holds 99 % of "
        "the values over all trials where the residual is white. A residual that is not white makes intervals that "
        "take it for white too narrow; it need not be the model's fault.",
        {"nominal": "all trials", "measured": "one trial"},
        (Block("All trials", ", ".join(told), autocorrelation_figure(tests.whiteness)),),
    )


def _cross_correlation(name: str, tests: ResidualTests) -> Sheet:
    blocks: list[Block] = []
    for trial in [ALL, *dict.fromkeys(t.trial for t in tests.independence if t.trial != ALL)]:
        own = [t for t in tests.independence if t.trial == trial]
        least = min((t.p_value for t in own if np.isfinite(t.p_value)), default=np.nan)
        heading = "All trials" if trial == ALL else trial
        blocks.append(
            Block(
                heading,
                f"smallest p {chance(least)} of {len(own)}",
                cross_correlation_figure(tests.independence, trial),
                trial == ALL,
            )
        )
    return Sheet(
        f"{name}: is the residual independent of the input?",
        "Cross-correlation of the residual with the command of the last joint and with its square, with the band that "
        "holds 99 % of the values where they are independent. Outside it, the model misses something that the drive "
        "does. The p value over all trials lets each trial have a response of its own: it may be small where the "
        "curve of their sum is inside the band.",
        {"nominal": "residual with input, and band"},
        tuple(blocks),
    )
