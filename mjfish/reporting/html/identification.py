"""The figures of an identification: on one page, or a file each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjfish.estimation.intervals import Profile
from mjfish.estimation.residual import Residual, agreement
from mjfish.estimation.residual_tests import ALL, ResidualTests
from mjfish.files.writing import make_folder
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.formats import CHANNEL_NAMES, channel_name, p_value
from mjfish.reporting.html import readings
from mjfish.reporting.html.figures import (
    autocorrelation_figure,
    cross_correlation_figure,
    profile_figure,
    residual_figure,
)
from mjfish.reporting.html.pages import Block, Section, write_figures


def write_identification_figures(
    folder: Path,
    name: str,
    residuals: Sequence[Residual],
    tests: ResidualTests,
    profiles: Sequence[Profile] = (),
) -> tuple[Path, ...]:
    """Write the figures of an identification to a folder, which is made where it is not there.

    Args:
        folder: to write to.
        name: of the dataset, for titles.
        residuals: of the trials, fitted and held out.
        tests: of the residuals of the fit.
        profiles: of parameters, if any.

    Returns:
        The files: ``simulated.html``; ``autocorrelation.html`` and ``cross_correlation.html`` where residuals were
        tested; ``profiles.html`` where there are profiles.

    Raises:
        InputError: a file cannot be written.
    """
    make_folder(folder)
    found = sections(name, residuals, tests, profiles)
    for file, section in found.items():
        write_figures(folder / file, section)
    return tuple(folder / file for file in found)


def sections(
    name: str, residuals: Sequence[Residual], tests: ResidualTests, profiles: Sequence[Profile] = ()
) -> dict[str, Section]:
    """Return the figures of an identification by the name of their file; arguments as above."""
    found = {"simulated.html": _simulated(name, residuals)}
    if tests.status != "untested":
        found["autocorrelation.html"] = _autocorrelation(name, tests)
        found["cross_correlation.html"] = _cross_correlation(name, tests)
    if profiles:
        found["profiles.html"] = Section(
            f"{name}: profile likelihoods",
            "How much worse the best fit gets as one parameter is held elsewhere. The line is the 95 % threshold; the "
            "parabola is what estimate and standard error say.",
            {"nominal": "profile"},
            (Block("Profiles", "", profile_figure(profiles)),),
            readings.PROFILE,
        )
    return found


def _simulated(name: str, residuals: Sequence[Residual]) -> Section:
    blocks: list[Block] = []
    for residual in residuals:
        fits = {score.channel: score.fit for score in agreement([residual], horizons=()) if score.part == "whole"}
        listed = (f"{CHANNEL_NAMES[c]} {f'{fits[c]:.1f} %' if c in fits else 'not measured'}" for c in CHANNELS)
        remark = "the rollout diverged" if residual.diverged else f"fit: {', '.join(listed)}"
        heading = f"{residual.trial.name}{' (held out)' if residual.role == 'held_out' else ''}"
        blocks.append(Block(heading, remark, residual_figure(residual), len(blocks) < 3))
    return Section(
        f"{name}: measured against simulated",
        "Simulated curves are drawn where samples count. Fit: 100 % is perfect, 0 % no better than the mean.",
        {"measured": "measured", "nominal": "simulated, and measured − simulated"},
        tuple(blocks),
        readings.TRIAL,
    )


def _autocorrelation(name: str, tests: ResidualTests) -> Section:
    found = [f"{channel_name(test.channel)} p {p_value(test.p_value)}" for test in tests.whiteness if test.trial == ALL]
    return Section(
        f"{name}: is the residual white?",
        "Autocorrelation of the residual over all trials (thick) and of each (thin). The band holds 99 % of the values "
        "over all trials where the residual is white. Intervals that take a coloured residual for white are too "
        "narrow; the model need not be at fault.",
        {"nominal": "all trials", "measured": "one trial"},
        (Block("All trials", ", ".join(found), autocorrelation_figure(tests.whiteness)),),
        readings.AUTOCORRELATION,
    )


def _cross_correlation(name: str, tests: ResidualTests) -> Section:
    blocks: list[Block] = []
    for trial in [ALL, *dict.fromkeys(test.trial for test in tests.independence if test.trial != ALL)]:
        found = [test.p_value for test in tests.independence if test.trial == trial]
        least = min((p for p in found if np.isfinite(p)), default=np.nan)
        blocks.append(
            Block(
                "All trials" if trial == ALL else trial,
                f"smallest p {p_value(least)} of {len(found)}",
                cross_correlation_figure(tests.independence, trial),
                trial == ALL,
            )
        )
    return Section(
        f"{name}: is the residual independent of the input?",
        "Cross-correlation of the residual with the command of the last joint and with its square. The band holds 99 % "
        "of the values where they are independent. Outside it, the model misses something that the drive does. The p "
        "value over all trials lets each trial have a response of its own: it may be small where the curve of their "
        "sum is inside the band.",
        {"nominal": "residual with input, and band"},
        tuple(blocks),
        readings.CROSS_CORRELATION,
    )
