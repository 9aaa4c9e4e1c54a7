"""``mjfish diagnose``, ``mjfish demo`` and ``mjfish effects``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.padding import Padding
from rich.table import Table

import mjfish
from mjfish.cli import console
from mjfish.errors import InputError
from mjfish.files import check_file, check_folder, make_folder
from mjfish.reporting.words import CHANNEL_NAMES, NONE, estimate, interval, named_as, number, p_value, percent

if TYPE_CHECKING:
    from mjfish.diagnosis import Diagnosis, Splits
    from mjfish.effects import Effect

#: The datasets that ship with the package; what is hidden in them is not said here.
DEMO = Path(__file__).parents[1] / "demo"
LEARNED = DEMO / "learned"
#: What is written to a folder: numbers, report, rerun log, extended fish.
_FILES = ("diagnosis.json", "report.html", "fish.rrd", "extended.toml")
#: Standard errors by which a coefficient must move to be listed.
_MOVED = 2.0
_COLOURS = {"named": "green", "nothing_wrong": "green", "cannot_tell": "yellow", "unexplained": "red"}
#: What to do about a status that is not ok.
_REMEDIES = {
    "fit_not_converged": "a fit stopped before its optimum, and the numbers may be off; look for a better optimum with "
    "'mjfish identify DATASET --starts 16', and start from it (table [start] of dataset.toml)"
}

Own = Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")]


def diagnose(
    dataset: Annotated[Path, typer.Argument(help="Folder with dataset.toml.")],
    effects: Own = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write diagnosis.json here.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write the HTML report here.")] = None,
    rrd: Annotated[Path | None, typer.Option(help="Write the rerun log here.")] = None,
    curves: Annotated[
        Path | None, typer.Option(help="Folder for the curves of the named mechanisms, a CSV each.")
    ] = None,
    extended: Annotated[Path | None, typer.Option(help="Write the extended model as a fish TOML to simulate.")] = None,
    splits: Annotated[
        int | None,
        typer.Option(
            min=1, help="Divide the runs anew so many times, diagnose each split, and say what comes how often."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for all of these files under the names of the demo, and splits.json.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the simulated null distributions, and of the splits.", min=0)] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default one a processor.")] = None,
) -> None:
    """Find what the simulation gets wrong on measured data, name the cause, and measure the gain on held-out trials."""
    known = _catalogue(effects)
    for file in (json_, report, rrd, extended):
        if file is not None:
            check_file(file)
    for folder in (curves, out):
        if folder is not None:
            check_folder(folder)
    if extended is not None and extended.suffix != ".toml":
        raise InputError(f"--extended: {extended} ends in '{extended.suffix}', expected .toml; rename it")
    measured, divided = mjfish.load_dataset(dataset), None
    with console.progress_bar() as tell:
        if splits is None:
            result = mjfish.diagnose(measured, effects=known, seed=seed, jobs=jobs, progress=tell)
        else:
            from mjfish.diagnosis import diagnose_splits

            divided = diagnose_splits(measured, splits, effects=known, seed=seed, jobs=jobs, progress=tell)
            result = divided.diagnosis
    if out is not None:
        make_folder(out)
        json_, report, rrd, extended = (
            given or out / name for given, name in zip((json_, report, rrd, extended), _FILES, strict=True)
        )
        curves = curves or out / "curves"
        if divided is not None:
            divided.save(out / "splits.json")
    _write(result, json_, report, rrd, extended, splits=divided)
    written = None if curves is None else result.write_curves(curves)
    show(result)
    if divided is not None:
        show_splits(divided)
    if written == ():
        console.say(f"No curve was written to {curves}: no mechanism is named whose form is a curve.")
    _leave(result)


def demo(
    learned: Annotated[
        bool, typer.Option("--learned", help="Another dataset: what it hides has a form that no formula has.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for diagnosis.json, report.html, fish.rrd, extended.toml and the curves.",
            show_default="out/demo; with --learned out/learned",
        ),
    ] = None,
) -> None:
    """Run the main job on a shipped dataset with a hidden effect."""
    out = out or Path("out/learned" if learned else "out/demo")
    check_folder(out)
    with console.progress_bar() as tell:
        result = mjfish.diagnose(mjfish.load_dataset(LEARNED if learned else DEMO), progress=tell)
    make_folder(out)
    _write(result, *(out / name for name in _FILES))
    curves = result.write_curves(out / "curves")
    show(result)
    program = console.program()
    console.say(
        f"\nThe numbers:  {out}/diagnosis.json",
        f"The report:   {out}/report.html  (open it in a browser)",
        *([f"The curves:   {out}/curves"] if curves else []),
        f"The swimming: {program} view {out}/fish.rrd",
        f"The fish now: {program} simulate --fish {out}/extended.toml --out {out}/swim",
    )
    _leave(result)


def effects(effects: Own = None) -> None:
    """List the causes that can be named, with their parameters."""
    for effect in _catalogue(effects).values():
        console.out.print(f"{effect.name}: {effect.summary}", style="bold")
        rows = Table.grid(padding=(0, 2))
        rows.add_column(no_wrap=True)
        rows.add_column()
        for p in effect.parameters:
            rows.add_row(f"{p.name} [{p.unit}]", f"{p.about}; {p.low:g} to {p.high:g}")
        rows.add_row("leaves in the residual", effect.signature)
        rows.add_row("would be confirmed by", effect.confirm)
        console.out.print(Padding(rows, (0, 0, 1, 2)))


def _catalogue(files: list[Path] | None) -> dict[str, Effect]:
    from mjfish.effects import catalogue

    return dict(catalogue(tuple(files or ())))


def _write(
    result: Diagnosis,
    json_: Path | None,
    report: Path | None,
    rrd: Path | None,
    extended: Path | None,
    *,
    splits: Splits | None = None,
) -> None:
    if json_ is not None:
        result.save(json_)
    if report is not None:
        (splits or result).report(report)
    if rrd is not None:
        result.log(rrd)
    if extended is not None:
        from mjfish.model.extended import write

        write(extended, result.fish.model, result.fish.values, _origin(result))


def _origin(result: Diagnosis) -> list[str]:
    """Return where the numbers of an extended fish come from, and whether its causes were named."""
    lines = [f"Fitted by mjfish diagnose to {result.dataset.name}.", f"{result.verdict}: {result.message}"]
    if result.best and result.verdict != "named":
        lines.append(f"Not named: {', '.join(result.best)}. It is in this fish as what explains most.")
    return lines


def _leave(result: Diagnosis) -> None:
    if result.verdict == "unexplained" or result.status != "ok":
        raise typer.Exit(console.NOT_GOOD)


def show(result: Diagnosis) -> None:
    """Print a diagnosis: verdict, mechanisms, cause, gain, rivals, candidates, where the misfit is, what is unseen."""
    console.out.print(result.verdict, style=f"bold {_COLOURS[result.verdict]}", end="  ")
    console.say(result.message)
    if result.status != "ok":
        console.complain(result.status, _REMEDIES.get(result.status, "take the numbers with care"))
    for mechanism in result.mechanisms:
        console.say(named_as(mechanism), *(f"  {curve.summary()}" for curve in mechanism.curves))
    if result.best and (sizes := _cause(result)).row_count:  # a curve alone has been told
        console.out.print(sizes)
    if result.gain is not None:
        console.out.print(_gain(result))
    _experiments(result)
    if result.candidates:
        console.out.print(_candidates(result))
    _biased(result)
    _where(result)
    _undetectable(result)
    console.say(*(f"Data, {finding.severity}: {finding.message}" for finding in result.checks.findings))
    console.say(*(f"Remark: {remark}" for remark in result.remarks))


def show_splits(result: Splits) -> None:
    """Print how often each mechanism is named and each verdict came, and what every split says."""
    known = len(result.diagnosed)
    title = "Mechanisms, by the splits in which they are named"
    table = console.table(
        title,
        ("mechanism", "named", "with its form", "certain beside rivals", "not named, part of the best"),
        ("mechanism",),
    )
    for share in result.mechanisms:
        table.add_row(share.name, f"{share.count} of {known}", *map(str, (share.form, share.certain, share.not_named)))
    if table.row_count:
        console.out.print(table)
    texts = ("held out", "fitted", "verdict", "mechanisms")
    table = console.table("Splits", (*texts, "held-out error less by"), texts)
    for split in result.splits:
        gain, verdict = NONE, (split.verdict or NONE).replace("_", " ")
        if split.gain is not None:
            ends = f"{percent(split.gain.low, 2)} to {percent(split.gain.high, 2)}"
            gain = f"{percent(split.gain.relative_reduction, 2)}  ({ends})"
        held_out = f"{', '.join(split.held_out)}{' (as divided)' if split.declared else ''}"
        table.add_row(held_out, ", ".join(split.fitted), verdict, split.summary(), gain)
    table.caption = "The splits share runs: how often something comes is no probability."
    console.out.print(table)
    console.say(result.headline())


def _cause(result: Diagnosis) -> Table:
    from mjfish.diagnosis.curves import knots_of

    title = "Cause" if result.verdict == "named" else "Best of the rivals" if result.rivals else "Closest candidate"
    if result.verdict != "named" and not result.rivals:
        title += ", not named"
    headings = ("parameter", "estimate", "95 % interval", "unit")
    table = console.table(title, headings, headings)
    knots = knots_of(result.effects.values())
    own = {name: value for name, value in result.extended.items() if name.partition(".")[0] in result.best}
    for name, value in own.items():
        if name not in knots:
            table.add_row(name, estimate(value), interval(value) or "on its bound", value.unit)
    if unread := len(knots.intersection(own)):
        table.caption = f"and {unread} values of smooth curves, which --json writes"
    return table


def _gain(result: Diagnosis) -> Table:
    gain = result.gain
    assert gain is not None  # noqa: S101 - checked by the caller
    title = "Held-out trials: nRMSE before and after"
    table = console.table(title, ("channel", "nominal", "extended", "reduction"), ("channel",))
    for channel in gain.nominal:
        before, after = gain.nominal[channel], gain.extended[channel]
        reduction = percent(1.0 - after / before) if before > 0.0 else ""
        if channel == "pooled":
            reduction += f"  ({percent(gain.low)} to {percent(gain.high)})"
        table.add_row(CHANNEL_NAMES[channel], percent(before), percent(after), reduction)
    table.add_row("mean speed error [m/s]", *map(number, gain.mean_speed_error), "")
    return table


def _candidates(result: Diagnosis) -> Table:
    headings = ("cause", "LR", "p", "held out", "rival p", "fit p", "confounded")
    table = console.table("Candidates, each fitted together with the coefficients", headings, ("cause",))
    table.columns[0].no_wrap = True
    for candidate in result.candidates:
        if candidate.applicable:
            scores = (number(candidate.statistic), p_value(candidate.p_value), number(candidate.held_out_gain))
            chances = (p_value(candidate.rival_p), p_value(candidate.fit_p))
            table.add_row(candidate.name, *scores, *chances, percent(candidate.confounded, 2))
    table.caption = (
        "LR: fall of the sum of squares; held out: log-likelihood gained there; rival p: of the margin to the best; "
        "fit p: of what is left; confounded: share of its signature that a refit of the coefficients removes"
    )
    return table


def _experiments(result: Diagnosis) -> None:
    names = [cause.name for cause in result.causes] or [name for group in result.rivals for name in group]
    if result.rivals:
        apart = " from ".join(names)
        console.say(f"To tell {apart}: `mjfish plan` on this dataset ranks runs by how far they set them apart.")
    console.say(*(f"To confirm {name}: {result.effects[name].confirm}." for name in names))


def _biased(result: Diagnosis) -> None:
    """List the coefficients that the missing cause had biased by more than their standard error."""
    from mjfish.estimation.fit import Z95

    moved = []
    for name, before in result.nominal.items() if result.best else ():
        after = result.extended.get(name)
        if after is None:
            continue
        error = max((after.high - after.low) / (2.0 * Z95), 1e-300)
        if abs(after.estimate - before.estimate) > _MOVED * error:
            moved.append(f"{name} {number(before.estimate)} to {number(after.estimate)}")
    if moved:
        console.say(f"Coefficients that had absorbed part of it, without and with the cause: {', '.join(moved)}.")


def _where(result: Diagnosis) -> None:
    """Say where the misfit sits, how it scales, and what describes it where nothing explains it."""
    if (where := result.where) is not None:
        console.say(
            f"The misfit is densest in {CHANNEL_NAMES[where.channel]} ({percent(where.channels[where.channel], 2)} of "
            f"it), trial {where.trial}, {where.part}, {where.phase} of the beat, {where.speed} of the surge, "
            f"{where.turn} of the yaw rate."
        )
    if result.force:
        surge, sway, yaw = (percent(max(shares), 2) for shares in zip(*(f.share for f in result.force), strict=True))
        console.say(
            f"The missing force is {surge} in surge, {sway} in sway and {yaw} in yaw moment of what moves the fish "
            "(root mean squares, each in the trial where it is most)."
        )
    if (measured := result.fingerprint) is not None and (measured.exponent is not None or measured.odd is not None):
        parts = []
        if measured.exponent is not None:
            predicted = measured.predicted.exponent
            expected = "" if predicted is None else f", predicted {predicted:g}"
            ends = f"{number(measured.low, 2)} to {number(measured.high, 2)}"
            parts.append(f"goes as frequency to the {number(measured.exponent, 2)} ({ends}{expected})")
        if measured.odd is not None:
            parts.append(f"{percent(measured.odd, 2)} of it breaks the left-right symmetry")
        console.say(f"What the best explanation adds {'; '.join(parts)}.")
    if (described := result.description) is not None and described.terms:
        terms = "; ".join(f"{term.what} (size {number(term.size, 2)} SI per metre)" for term in described.terms)
        console.say(f"A description, not a cause, of {percent(described.explained, 2)} of the misfit: {terms}.")


def _undetectable(result: Diagnosis) -> None:
    """List the causes that these data cannot show, and the minimum detectable effects of the others."""
    console.say(*(f"Undetectable: {name}, {reason}." for name, reason in result.undetectable.items()))
    sizes = [
        f"{name} {number(size, 2)}"
        for candidate in result.candidates
        if candidate.applicable and candidate.name not in result.undetectable
        for name, size in (candidate.minimum_detectable or {}).items()
    ]
    if sizes:
        console.say(f"Minimum detectable effects: {', '.join(sizes)}.")
