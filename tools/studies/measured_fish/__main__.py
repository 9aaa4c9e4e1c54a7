"""Diagnose the real fish of srl-ethz/fishsim and say what came out; `make real`.

python -m studies.measured_fish [--settings FILE.toml] [--out out/real] [--page docs/real-fish.md]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich import box
from rich.table import Table

from mjfish.data.importers import HEADERS
from mjfish.diagnosis import Estimate
from mjfish.errors import MjfishError
from mjfish.files import tomlfile
from mjfish.files.writing import check_file, check_folder, make_folder
from mjfish.fish.frames import CHANNELS
from mjfish.model.extended import write as write_fish
from studies import console
from studies.measured_fish.runs import SETTINGS, Outcome, Score, Settings, crossed, phases, reached, run, scores, told

#: Phases of the beat that are printed.
BINS = 8


def table(title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]], texts: int = 1) -> Table:
    """Return a table; columns behind the first `texts` to the right."""
    made = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for index, head in enumerate(heads):
        made.add_column(head, justify="left" if index < texts else "right", no_wrap=True)
    for row in rows:
        made.add_row(*(cell for cell in row))
    return made


def imported(outcome: Outcome) -> Table:
    """Return what became of the files."""
    chosen = [HEADERS.index(name) for name in ("file", "frames", "usable", "beat [Hz]", "mean speed [m/s]")]
    rows = [tuple(row[i] for i in chosen) for row in outcome.tracks.rows()]
    return table("Tracks", tuple(HEADERS[i] for i in chosen), rows)


def scored(title: str, found: tuple[Score, ...]) -> Table:
    """Return how well the models do."""
    heads = ("run", "", "model", *CHANNELS, "speed [m/s]", "error [m/s]")
    rows = [
        (one.run, one.role, one.model, *(f"{e:.3f}" for e in one.nrmse), f"{one.speed:.4f}", f"{one.error:+.4f}")
        for one in found
    ]
    return table(title, heads, rows, texts=3)


def estimated(outcome: Outcome) -> Table:
    """Return the coefficients of both models; those at a bound are marked."""
    nominal, wide = outcome.diagnosis.nominal, told(outcome)
    rows = [(name, _said(nominal.get(name)), _said(one), one.unit) for name, one in wide.items()]
    return table("Coefficients (*: at a bound)", ("", "nominal", "extended", "unit"), rows)


def _said(one: Estimate | None) -> str:
    return "" if one is None else f"{one.estimate:.4g}{'*' if one.at_bound else ''}"


def over_the_beat(outcome: Outcome) -> Table:
    """Return the mean residual of the held-out runs over the phase of the beat."""
    overlays = [overlay for overlay in outcome.diagnosis.overlays if overlay.held_out]
    rows = [
        (overlay.trial.name, model, channel, *(f"{1e3 * value:+.0f}" for value in mean[:, k]))
        for overlay in overlays
        for model, mean in phases(outcome, overlay, BINS).items()
        for k, channel in enumerate(CHANNELS)
    ]
    heads = ("run", "model", "channel", *(f"{k / BINS:.2f}" for k in range(BINS)))
    title = "Measured less simulated over the beat in mm/s and mrad/s, from the crest of the last joint on"
    return table(title, heads, rows, texts=3)


def tell(outcome: Outcome) -> None:
    """Print everything."""
    found = outcome.diagnosis
    out = console.out
    out.print(imported(outcome))
    out.print(f"\n{found.verdict}  {found.message}", soft_wrap=True)
    if found.best:
        named = "named" if found.verdict == "named" else "what explains most, not named"
        out.print(f"The extended model has {', '.join(found.best)} ({named}).", soft_wrap=True)
    for remark in found.remarks:
        out.print(f"Remark: {remark}", soft_wrap=True)
    out.print(scored("nRMSE and mean speed of every run", scores(found)))
    out.print(scored("The same, fitted to one run and scored on the other", tuple(crossed(outcome))))
    out.print(estimated(outcome))
    out.print(over_the_beat(outcome))
    goal = outcome.settings.goal
    speed, yaw_rate = reached(outcome)
    out.print(
        f"Held out, extended: error of the mean speed {speed:.4f} m/s (goal {goal.speed:g}), nRMSE of the yaw rate "
        f"{yaw_rate:.3f} (goal {goal.yaw_rate:g}).",
        soft_wrap=True,
    )


def save(outcome: Outcome, folder: Path) -> None:
    """Write the diagnosis, its splits and the extended fish."""
    make_folder(folder)
    outcome.diagnosis.save(folder / "diagnosis.json")
    if outcome.splits is not None:
        outcome.splits.save(folder / "splits.json")
    values = {name: one.estimate for name, one in outcome.diagnosis.extended.items()}
    comments = [f"Fitted by studies.measured_fish to {', '.join(outcome.settings.fit)}.", outcome.diagnosis.message]
    write_fish(folder / "extended.toml", outcome.diagnosis.extended_model, values, comments)


def check(folder: Path, page: Path | None) -> None:
    """Refuse what cannot be written to before anything is fitted.

    Raises:
        InputError: see `mjfish.files.writing`.
    """
    check_folder(folder)
    if page is not None:
        check_file(page)
        check_folder(page.parent / "images")


def main() -> int:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--settings", type=Path, default=SETTINGS, help="settings, as TOML")
    parser.add_argument("--out", type=Path, default=Path("out/real"), help="folder for diagnosis.json and the fish")
    parser.add_argument("--page", type=Path, help="write the page and its pictures too; its splits take long")
    given = parser.parse_args()
    try:
        settings = tomlfile.read(given.settings, Settings)
        check(given.out, given.page)
        with console.progress_bar() as bar:
            outcome = run(settings, splits=given.page is not None, progress=bar)
        save(outcome, given.out)
        tell(outcome)
        if given.page is not None:
            from studies.measured_fish import page

            page.write(outcome, given.page)
    except MjfishError as error:
        console.err.print(str(error), soft_wrap=True)
        return console.MISUSE
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
