"""``mjfish identify``: the hydrodynamic coefficients from a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import mjfish
from mjfish.cli import console
from mjfish.cli.fish import SUFFIXES as FISH
from mjfish.cli.fish import write
from mjfish.errors import InputError, UnknownNameError
from mjfish.files.writing import write_json
from mjfish.numerics.formats import number, p_value, percent

if TYPE_CHECKING:
    from rich.table import Table

    from mjfish.estimation.identification import Assessment, Identification
    from mjfish.estimation.intervals import Profile


def identify(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    free: Annotated[list[str] | None, typer.Option(help="Pattern of what is fitted, e.g. 'c_d.*'; repeatable.")] = None,
    fix: Annotated[
        list[str] | None, typer.Option(help="Not fitted: NAME, or NAME=VALUE; patterns too; repeatable.")
    ] = None,
    bounds: Annotated[list[str] | None, typer.Option(help="NAME=LOW:HIGH, one may be left out; repeatable.")] = None,
    start: Annotated[list[str] | None, typer.Option(help="NAME=VALUE where the fit starts; repeatable.")] = None,
    loss: Annotated[str, typer.Option(help="One of linear, soft_l1, huber, cauchy, arctan.")] = "linear",
    weights: Annotated[str, typer.Option(help="'noise', or 'paper' for its weight matrix.")] = "noise",
    starts: Annotated[int, typer.Option(min=1, help="Fits from a Latin hypercube over the bounds.")] = 16,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the hypercube.")] = 0,
    profiled: Annotated[
        list[str] | None, typer.Option("--profile", help="Profile the likelihood of this parameter; repeatable.")
    ] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")] = None,
    table: Annotated[Path | None, typer.Option(help="Write the coefficients as CSV or Parquet.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for figures, HTML.")] = None,
    fish: Annotated[Path | None, typer.Option(help="Write the identified fish, .toml or .xml (MuJoCo).")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
    cluster: console.Cluster = None,
) -> bool:
    """Fit the hydrodynamic coefficients to all fit trials at once, say what the data say, score held-out trials."""
    from mjfish.data.tables import SUFFIXES
    from mjfish.estimation.identification import pose
    from mjfish.estimation.settings import Settings
    from mjfish.execution import executing

    console.check_outputs(json_, table, fish, suffixes=[(fish, FISH), (table, SUFFIXES)])
    settings = Settings(
        free=tuple(free or ("*",)),
        fixed={
            **dict.fromkeys(text.strip() for text in fix or [] if "=" not in text),
            **console.assignments([text for text in fix or [] if "=" in text], "--fix"),
        },
        bounds=dict(_bounds(text) for text in bounds or []),
        start=console.assignments(start or [], "--start"),
        loss=loss,  # type: ignore[arg-type]  # refused by Settings where unknown
        weights=weights,  # type: ignore[arg-type]
        starts=starts,
        seed=seed,
    )
    measured = mjfish.load_dataset(dataset)
    known = [p.name for p in pose(measured, settings).parameters]
    for name in profiled or []:
        if name not in known:
            raise UnknownNameError("free parameter of --profile", name, known)
    with console.progress_bar() as tell, console.workers(cluster, jobs) as executor, executing(jobs, executor):
        result = mjfish.identify(measured, settings, tell=lambda done: tell("fitting", done))
        profiles = _profiles(result, profiled or [], tell)
    _show(result, profiles)
    if written := _write(result, profiles, json_, table, figures, fish):
        console.say(f"wrote {', '.join(map(str, written))}")
    if result.fit.status != "converged":
        console.complain(result.fit.status, result.fit.message)
    return result.fit.status == "converged"


def _bounds(text: str) -> tuple[str, tuple[float | None, float | None]]:
    name, _, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    if not (name and colon and (low or high)):
        raise InputError(f"--bounds: found '{text}', expected NAME=LOW:HIGH, e.g. c_d.head=0.5:3; correct it")
    what = f"--bounds {name}"
    return name, tuple(console.numbers(end, 1, what)[0] if end else None for end in (low, high))  # type: ignore[return-value]


def _profiles(result: Identification, names: list[str], tell: Any) -> list[Profile]:
    from mjfish.estimation.intervals import profiles

    if result.assessment is None:
        return []
    found: list[Profile] = []
    for profile in profiles(result.problem, result.fit, names, known=result.assessment.intervals):
        found.append(profile)
        tell("profiling", len(found) / len(names))
    return found


def _write(
    result: Identification,
    profiles: list[Profile],
    json_: Path | None,
    table: Path | None,
    figures: Path | None,
    fish: Path | None,
) -> list[Path]:
    """Write what was asked for and return the files; there are no figures of a fit that diverged."""
    from mjfish.data.tables import write_rows
    from mjfish.estimation.intervals import coefficient_rows
    from mjfish.files.plain_data import plain

    assessment = result.assessment
    intervals = None if assessment is None else assessment.intervals
    written: list[Path] = []
    console.write(
        written,
        (json_, lambda path: write_json(path, {**result.to_dict(), "profiles": plain(profiles)})),
        (table, lambda path: write_rows(path, coefficient_rows(result.fit, intervals))),
    )
    if figures is not None and assessment is not None:
        from mjfish.reporting.html.identification import write_identification_figures

        name, residuals = result.dataset.name, assessment.residuals
        written += write_identification_figures(figures, name, residuals, assessment.residual_tests, profiles)
    console.write(written, (fish, lambda path: write(path, result.fish)))
    return written


def _show(result: Identification, profiles: Sequence[Profile]) -> None:
    """Print the coefficients with intervals and remarks, the agreement per trial, and what the data say in words."""
    console.show(_coefficients(result))
    if result.assessment is not None:
        console.show(_agreement(result, result.assessment))
        console.show(_fits(result.assessment))
    if result.sensor_scores:
        console.show(_sensors(result))
    for text in _words(result, profiles):
        console.item("-", text)


def _coefficients(result: Identification) -> Table:
    headings = ("parameter", "estimate", "low", "high", "standard error")
    fit = result.fit
    table = console.table(f"{result.dataset.name}: estimates with 95 % intervals", headings, ("parameter",))
    for p in fit.parameters:
        found = (fit.values[p.name], *result.interval(p.name), result.sigma[p.name])
        table.add_row(p.name.replace(":", ":\n"), *(number(value, 4) for value in found))
    if held := [p.name for p, at_bound in zip(fit.parameters, fit.at_bound, strict=True) if at_bound]:
        table.caption = f"at its bound: {', '.join(held)}"
    return table


def _agreement(result: Identification, assessment: Assessment) -> Table:
    """RMSE and nRMSE of every velocity of whole trials."""
    from mjfish.fish.frames import CHANNELS

    table = console.table(
        "simulated: RMSE / nRMSE, in m/s and rad/s, over the range", ("trial", "role", *CHANNELS), ("trial", "role")
    )
    found = {(a.trial, a.channel): a for a in assessment.agreement if a.part == "whole" and a.horizon is None}
    for score in result.scores:
        own = (found.get((score.trial, channel)) for channel in CHANNELS)
        cells = ("not measured" if a is None else f"{a.rmse:.3f} / {a.nrmse:.3f}" for a in own)
        table.add_row(score.trial, score.role, *cells)
    return table


def _sensors(result: Identification) -> Table:
    """RMSE and nRMSE of every channel of every sensor."""
    headings = ("trial", "role", "sensor", "channel", "RMSE", "unit", "nRMSE")
    table = console.table("sensors: RMSE, and over the range", headings, ("trial", "role", "sensor", "channel", "unit"))
    for s in result.sensor_scores:
        table.add_row(s.trial, s.role, s.sensor, s.channel, number(s.rmse, 3), s.unit, number(s.nrmse, 3))
    return table


def _fits(assessment: Assessment) -> Table:
    """Fit percentages of whole trials: simulated, and predicted some samples ahead."""
    from mjfish.estimation.residual import HORIZONS
    from mjfish.fish.frames import CHANNELS

    headings = ("trial", "channel", "simulated", *(f"{horizon} ahead" for horizon in HORIZONS))
    table = console.table("fit in percent: simulated, and samples ahead", headings, ("trial", "channel"))
    scores = {(a.trial, a.channel, a.horizon): a.fit for a in assessment.agreement if a.part == "whole"}
    for trial in dict.fromkeys(a.trial for a in assessment.agreement):
        for channel in (c for c in CHANNELS if (trial, c, None) in scores):
            fits = (number(scores.get((trial, channel, horizon))) for horizon in (None, *HORIZONS))
            table.add_row(trial, channel, *fits)
    return table


def _words(result: Identification, profiles: Sequence[Profile]) -> Iterator[str]:
    from mjfish.estimation.residual import PREFIX

    assessment = result.assessment
    if assessment is not None:
        yield from (weakness.text for weakness in assessment.weaknesses)
        yield assessment.stability.text
        if scattered := {name: tau for name, tau in assessment.stability.scatter.items() if tau > 0.0}:
            listed = ", ".join(f"{name} {number(tau, 2)}" for name, tau in scattered.items())
            yield f"scatter from trial to trial beyond the errors (standard deviations): {listed}"
        tests, rank = assessment.residual_tests, assessment.criteria
        yield (
            f"residuals: {tests.status}; p value of whiteness {p_value(tests.p_white)}, of independence of the "
            f"drive {p_value(tests.p_independent)}"
        )
        if rank.samples:
            yield f"AICc {rank.aicc:.6g}, BIC {rank.bic:.6g}, FPE {rank.fpe:.4g} with {rank.parameters} parameters"
        else:
            yield "no AICc, BIC, FPE: they are those of surge, sway and yaw rate together"
        held = [r.trial for r in assessment.residuals if r.role == "held_out"]
        seen = (s.free_clock or s.kind in ("position", "heading") for trial in held for s in trial.sensors)
        if any(not trial.starts_at_rest for trial in held) or any(seen):
            yield (
                f"what belongs to a held-out trial alone was fitted on its first {percent(PREFIX, 2)}, "
                "which is not scored"
            )
    for profile in profiles:
        yield (
            f"profile of {profile.name}: {number(profile.estimate, 4)}, 95 % from {number(profile.low, 4)} "
            f"({profile.low_side}) to {number(profile.high, 4)} ({profile.high_side}); {profile.status}"
        )
    yield from result.remarks
    if result.starts > 1:
        yield f"{round(result.reached * result.starts)} of {result.starts} starts reached the best optimum"
    yield f"fit {result.fit.status} after {result.fit.evaluations} evaluations"
