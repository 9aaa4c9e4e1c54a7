"""Write docs/real-fish.md and its pictures from what `make real` found."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np

from mjfish.data.importers import HEADERS
from mjfish.diagnosis import Estimate
from mjfish.files.writing import make_folder, write_text
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray
from studies.markdown import table, wrapped
from studies.measured_fish import causes, pictures
from studies.measured_fish.runs import Outcome, Score, alone, crossed, reached, refitted, scores, told

#: Columns of the importer's report that are told.
_TOLD = ("file", "frames", "usable", "beat [Hz]", "mean speed [m/s]", "sigma yaw_rate [rad/s]", "sigma joints [rad]")


def write(outcome: Outcome, path: Path) -> None:
    """Write the page, and its pictures to the folder ``images`` beside it."""
    images = path.parent / "images"
    make_folder(images)
    write_text(images / "real-fish-run.svg", pictures.swum(outcome))
    write_text(images / "real-fish-beat.svg", pictures.over_the_beat(outcome))
    if "roll" in outcome.diagnosis.best:
        write_text(images / "real-fish-roll.svg", pictures.rolled(outcome))
    write_text(path, page(outcome))


def page(outcome: Outcome) -> str:
    """Return the page."""
    found = outcome.diagnosis
    parts = {
        "fitted": _list(outcome.settings.fit),
        "held": _list(outcome.settings.held_out),
        "tracks": table(_TOLD, ([row[HEADERS.index(n)] for n in _TOLD] for row in outcome.tracks.rows())),
        "verdict": found.verdict.replace("_", " ").capitalize(),
        "message": found.message,
        "best": _list([f"`{name}`" for name in found.best]),
        "certain": _list([f"`{name}`" for name in found.certain]),
        "roll": "roll" in found.best,
        "candidates": table(causes.HEAD, causes.rows(found)),
        "coarse": causes.left_out(found),
        "preferred": causes.preferred(found),
        "gains": _gains(outcome),
        "crossed": _scores(tuple(crossed(outcome))),
        **_splits(outcome),
        **_without(outcome),
        "bound": _list([name for name, one in told(outcome).items() if one.at_bound]) or "none",
        "coefficients": _coefficients(outcome),
        **_results(outcome),
        **(_rolled(outcome) if "roll" in found.best else {}),
    }
    template = Path(__file__).with_name("page.md.j2").read_text(encoding="utf-8")
    made = jinja2.Template(template, undefined=jinja2.StrictUndefined, trim_blocks=True).render(**parts)
    return wrapped(made)


def _results(outcome: Outcome) -> dict[str, str]:
    """Return errors of both models."""
    every, goal = scores(outcome.diagnosis), outcome.settings.goal
    speed, yaw_rate = reached(outcome, "extended")
    plain_speed, plain_yaw_rate = reached(outcome, "nominal")
    fitted = [one for one in every if one.role == "fitted" and one.model == "nominal"]
    files = outcome.tracks.files[: len(outcome.settings.fit)]
    beats = [file.beat or np.nan for file in files]
    return {
        "speed": f"{speed:.4f}",
        "yaw_rate": f"{yaw_rate:.3f}",
        "goal_speed": f"{goal.speed:.3f}",
        "goal_yaw_rate": f"{goal.yaw_rate:.2f}",
        "nominal_speed": f"{plain_speed:.4f}",
        "nominal_yaw_rate": f"{plain_yaw_rate:.3f}",
        "count": {1: "one"}.get(len(outcome.settings.held_out), str(len(outcome.settings.held_out))),
        "scores": _scores(every),
        "wrong_sway": _list([f"{100 * one.nrmse[1]:.0f} %" for one in fitted]),
        "wrong_yaw_rate": _list([f"{100 * one.nrmse[2]:.0f} %" for one in fitted]),
        "wrong_speed": _list([f"{1e3 * one.error:+.1f}" for one in fitted]),
        "slow_beat": f"{min(beats):.2f}",
        "fast_beat": f"{max(beats):.2f}",
        "growth": f"{max(file.speed for file in files) / min(file.speed for file in files):.1f}",
        "sway_fitted": _list([_fall(every, run, 1) for run in outcome.settings.fit]),
        "sway_held": _list([_fall(every, run, 1) for run in outcome.settings.held_out]),
        "left_surge": _list([f"{100 * one.nrmse[0]:.0f} %" for one in every if one.model == "extended"]),
    }


def _without(outcome: Outcome) -> dict[str, str]:
    """Return what is said without the causes that were found; nothing where that was not asked."""
    if outcome.without is None:
        return {"taken": "", "said_without": "", "errors_without": ""}
    found, gain = outcome.without, outcome.without.gain
    errors = "" if gain is None else f"{gain.nominal['pooled']:.3f} to {gain.extended['pooled']:.3f}"
    said = f"**{found.verdict.replace('_', ' ').capitalize()}.** {found.message}"
    return {"taken": _list(sorted(outcome.diagnosis.best)), "said_without": said, "errors_without": errors}


def _fall(every: Sequence[Score], run: str, channel: int) -> str:
    """Return the nRMSE of a channel of a run, of the nominal and of the extended model."""
    return " to ".join(f"{one.nrmse[channel]:.3f}" for one in every if one.run == run)


def _rolled(outcome: Outcome) -> dict[str, str | bool]:
    """Return what speaks for roll: its height, and how alike what is lacking and what it makes are."""
    found = outcome.diagnosis
    layout = tomllib.loads((resources.files("mjfish.data.importers") / "layouts" / "fishsim.toml").read_text())
    below = next(plane["below"] for plane in layout["planes"] if "below" in plane)
    height = found.extended["roll.height"]
    fitted = [overlay for overlay in found.overlays if not overlay.held_out]
    alike = [_correlation(*pictures.lacking(outcome, one, height.estimate)) for one in fitted]
    each = [one.values["roll.height"] for _, one in alone(outcome, "extended")]
    both = refitted(outcome, "extended", found.dataset.split()[0])[1].values["roll.height"]
    apart = not all(height.low <= one <= height.high for one in (*each, both))
    rolls = [overlay.trial.roll for overlay in found.overlays if overlay.trial.roll is not None]
    return {
        "wobble": _list([f"{1e3 * below * np.sqrt(2.0) * float(roll.std()):.0f}" for roll in rolls]),
        "below": f"{1e3 * below:.0f}",
        "height": f"{1e3 * height.estimate:.0f}",
        "height_low": f"{1e3 * height.low:.0f}",
        "height_high": f"{1e3 * height.high:.0f}",
        "heights": _list([f"{1e3 * one:.0f}" for one in each]),
        "height_both": f"{1e3 * both:.0f}",
        "apart": apart,
        "alike": _list([f"{r:.2f} in {one.trial.name}" for r, one in zip(alike, fitted, strict=True)]),
    }


def _correlation(left: FloatArray, wobble: FloatArray) -> float:
    inside = np.isfinite(left)
    return float(np.corrcoef(left[inside], wobble[inside])[0, 1])


def _gains(outcome: Outcome) -> str:
    gain = outcome.diagnosis.gain
    if gain is None:
        return "Nothing is extended."
    channels = [f"{c.replace('_', ' ')} {gain.nominal[c]:.3f} to {gain.extended[c]:.3f}" for c in CHANNELS]
    return (
        f"On the held-out run, nRMSE of {_list(channels)}; together {100 * gain.relative_reduction:.0f} % less (95 %: "
        f"{100 * gain.low:.0f} to {100 * gain.high:.0f} %, by a block bootstrap); "
        f"error of the mean speed {gain.mean_speed_error[0]:.4f} to {gain.mean_speed_error[1]:.4f} m/s."
    )


def _splits(outcome: Outcome) -> dict[str, str]:
    """Return what comes of the runs divided anew; empty where they were not."""
    found = outcome.splits
    if found is None:
        return {"headline": "", "shares": "", "splits": ""}
    known = len(found.diagnosed)
    shares = [
        (one.name, f"{one.count} of {known}", f"{one.form}", f"{one.certain}", f"{one.not_named}")
        for one in found.mechanisms
    ]
    rows = []
    for split in found.splits:
        errors, less = "", ""
        if split.gain is not None:
            errors = f"{split.gain.nominal['pooled']:.3f} to {split.gain.extended['pooled']:.3f}"
            ends = f"{100 * split.gain.low:.0f} to {100 * split.gain.high:.0f} %"
            less = f"{100 * split.gain.relative_reduction:.0f} % ({ends})"
        held_out = f"{', '.join(split.held_out)}{' (this page)' if split.declared else ''}"
        verdict = (split.verdict or "").replace("_", " ")
        rows.append((held_out, ", ".join(split.fitted), verdict, split.summary(), errors, less))
    named = ("mechanism", "named", "with its form", "certain beside rivals", "not named, part of the best")
    heads = ("held out", "fitted", "verdict", "mechanisms", "nRMSE held out", "less by (95 %)")
    return {"headline": found.headline(), "shares": table(named, shares), "splits": table(heads, rows)}


def _coefficients(outcome: Outcome) -> str:
    found = outcome.diagnosis
    rows = ((name, _said(found.nominal.get(name)), _said(one), one.unit) for name, one in told(outcome).items())
    return table(("coefficient (bold: at a bound)", "nominal", "extended", "unit"), rows)


def _said(one: Estimate | None) -> str:
    if one is None:
        return ""
    return f"**{one.estimate:.3g}**" if one.at_bound else f"{one.estimate:.3g}"


def _scores(found: Sequence[Score]) -> str:
    head = ("run", "role", "model", *(name.replace("_", " ") for name in CHANNELS), "speed [m/s]", "error [m/s]")
    return table(
        head,
        (
            (one.run, one.role, one.model, *(f"{e:.3f}" for e in one.nrmse), f"{one.speed:.4f}", f"{one.error:+.4f}")
            for one in found
        ),
    )


def _list(parts: Sequence[str]) -> str:
    """Return parts as one would say them."""
    return " and ".join(filter(None, (", ".join(parts[:-1]), *parts[-1:])))
