"""``mjfish simulate``, ``check``, ``export``, ``view`` and ``sample``: fish that swim, and files of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import mjfish
from mjfish.cli import console
from mjfish.cli.fish import write
from mjfish.drive.modes import DURATION, MODES
from mjfish.errors import InputError
from mjfish.files.writing import check_new_folder, make_folder, write_json
from mjfish.numerics.formats import NONE

if TYPE_CHECKING:
    from mjfish.simulation import Simulation


#: Checked where no mode is named: a straight run, a change of frequency, a turn.
CHECKED = ("v1", "v5-v1", "v3-t2")

FishOption = Annotated[str, typer.Option(help="A shipped fish or a fish TOML, its effects included.")]


def simulate(
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for rollout.csv and rollout.rrd.", show_default="needed but for --viewer"),
    ] = None,
    fish: FishOption = "pike",
    mode: Annotated[str, typer.Option(help=f"One of {', '.join(MODES)}.")] = "v1",
    engine: Annotated[Literal["ode", "mujoco"], typer.Option(help="Head-frame ODE or MuJoCo.")] = "ode",
    effect: Annotated[
        list[str] | None, typer.Option(help="NAME:PARAM=VALUE[,PARAM=VALUE], see `mjfish effects`; repeatable.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Coefficient or EFFECT.PARAM, e.g. c_d.head=2 or munk_moment.kappa=1; repeatable."),
    ] = None,
    effects: console.Own = None,
    wave: Annotated[
        str | None,
        typer.Option(
            help="Instead of a mode, a sinusoid a joint: 'frequency=1.5, amplitude=[0.1, 0.3], phase=[0, -1]', "
            "in Hz and rad; bias [rad] and ramp [s] if any."
        ),
    ] = None,
    joints: Annotated[
        Path | None, typer.Option(help="Instead of a mode, joint angles: CSV of time [s], joint_1 [rad], ...")
    ] = None,
    duration: Annotated[float, typer.Option(help="Length of the run [s].")] = DURATION,
    free: Annotated[bool, typer.Option("--free", help="Free to roll, pitch and sink; --engine mujoco only.")] = False,
    draws: Annotated[
        Path | None,
        typer.Option(help="Folder of `mjfish sample`: simulate its fish too and write their band, band.csv."),
    ] = None,
    viewer: Annotated[
        bool,
        typer.Option("--viewer", help="Write nothing: open MuJoCo's viewer, with sliders for drive and coefficients."),
    ] = False,
) -> bool:
    """Simulate a fish with its effects and write rollout.csv and rollout.rrd, or watch it in MuJoCo's viewer."""
    if out is None and not viewer:
        raise typer.BadParameter("give a folder, or --viewer", param_hint="'--out'")
    from mjfish.effects import catalogue, of_fish
    from mjfish.fish import read as read_fish
    from mjfish.simulation import parse_wave

    if wave is not None and joints is not None:
        raise InputError("--wave: found with --joints, expected one drive; drop one")
    if viewer and (out is not None or draws is not None):
        raise InputError(
            f"--viewer: found with {'--out' if draws is None else '--draws'}, but writes nothing; drop one"
        )
    console.check_outputs(folders=[out])
    known = of_fish(catalogue(effects), read_fish(fish)[0])
    values = {**console.assignments(set_ or [], "--set"), **console.effect_settings(effect or [], known)}
    drive = joints if wave is None else parse_wave(wave)
    if out is None:
        from mjfish.mujoco.viewer import check_display, show
        from mjfish.simulation.run import tank

        check_display()
        console.say("sliders: panel Control on the right", "arrows: force of the water, key B; close the window to end")
        show(tank(fish, mode, values=values, effects=known, drive=drive, free=free))
        return True
    others = [] if draws is None else sorted(draws.glob("*.toml"))
    if draws is not None and not others:
        raise InputError(f"--draws: no fish TOML in {draws}; write some by 'mjfish sample DIAGNOSIS --out {draws}'")

    def swim(fish: str | Path) -> Simulation:
        return mjfish.simulate(
            fish, mode, engine=engine, values=values, effects=known, drive=drive, duration=duration, free=free
        )

    run = swim(fish)
    diverged = 0
    if others and run.status == "ok":
        with console.progress_bar() as tell:
            swum = []
            for done, other in enumerate(others):
                tell("simulating the draws", done / len(others))
                swum.append(swim(other))
        diverged = sum(other.status != "ok" for other in swum)
        run = run.with_band(swum)
    make_folder(out)
    table, log = out / "rollout.csv", out / "rollout.rrd"
    written = str(table)
    run.write_table(table)
    run.log(log)
    if run.band is not None:
        run.band.write_table(out / "band.csv")
        written += f", {out / 'band.csv'}"
    if run.status != "ok":
        console.complain(run.status, run.message)
        return False
    console.say(run.summary(), f"wrote {written} and {log} (open it with: {console.program()} view {log})")
    if diverged:
        console.complain("diverged", f"{diverged} of {len(others)} draws, which the band leaves out")
    return not diverged


def check(
    fish: FishOption = "pike",
    mode: Annotated[list[str] | None, typer.Option(help=f"One of {', '.join(MODES)}; repeatable.")] = None,
    coriolis: Annotated[
        Literal["corrected", "printed"], typer.Option(help="The paper's printed form must be seen to fail.")
    ] = "corrected",
    json_: Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")] = None,
    effects: console.Own = None,
) -> bool:
    """Cross-check MuJoCo with the fluid force against the head-frame ODE, on the joint motion that MuJoCo realised."""
    from mjfish import simulation
    from mjfish.drive.modes import drive
    from mjfish.files.plain_data import fields_of
    from mjfish.fish.frames import CHANNELS, UNITS
    from mjfish.model import extended

    extended_fish = extended.load(fish, effects)
    console.say(*extended_fish.described())
    names = mode or CHECKED
    for name in names:
        drive(name)  # refuses an unknown mode before any work is done
    console.check_outputs(json_)
    simulation.cpg_of(extended_fish.fish)
    results = []
    with console.progress_bar() as tell:
        for done, name in enumerate(names):
            tell(f"checking {name}", done / len(names))
            results.append(simulation.check(extended_fish, name, coriolis=coriolis))
    table = console.table(
        f"{extended_fish.fish.name}: largest difference ODE - MuJoCo, relative to each channel's range",
        ("mode", "step [ms]", *(f"{c} [{UNITS[c]}]" for c in CHANNELS), "of the bound", "order"),
        left=("mode",),
    )
    for result in results:
        for level, order in zip(result.levels, (math.nan, *result.orders), strict=False):
            table.add_row(
                result.drive,
                f"{1e3 * level.step:g}",
                *(f"{level.ratio[channel]:.1e}" for channel in CHANNELS),
                f"{level.worst / result.bound:.2g}",
                NONE if math.isnan(order) else f"{order:.2f}",
            )
        table.add_section()
    console.show(table)
    for result in results:
        console.item(f"{result.drive}: {result.status}", result.message, f"bold {'green' if result.passed else 'red'}")
    passed = all(result.passed for result in results)
    if json_ is not None:
        entries = [{**fields_of(result), "passed": result.passed} for result in results]
        write_json(json_, {"schema": 1, "passed": passed, "checks": entries})
    return passed


def export(
    fish: Annotated[str, typer.Argument(help="A shipped fish or a fish TOML.")],
    out: Annotated[Path, typer.Argument(help="File to write: .xml for MuJoCo, or .toml.")],
    set_: Annotated[list[str] | None, typer.Option("--set", help="Coefficient, e.g. c_d.head=2.0; repeatable.")] = None,
    free: Annotated[bool, typer.Option("--free", help="Free to roll, pitch and sink; .xml only.")] = False,
) -> None:
    """Write a fish as an MJCF with its water, which MuJoCo loads (mjfish.StripFluid lets it act), or as a TOML."""
    body = mjfish.load_fish(fish).with_values(console.assignments(set_ or [], "--set"))
    comments = [f"The fish {body.name}, written by mjfish {mjfish.__version__}.", body.about]
    if free and out.suffix.lower() == ".toml":
        raise InputError("--free: a fish TOML is neither planar nor free; write an .xml, or leave out --free")
    write(out, body, comments[:1] if out.suffix.lower() == ".toml" else comments, free=free)
    console.say(f"wrote {out}")


def view(file: Annotated[Path, typer.Argument(help="A .rrd file.")]) -> None:
    """Open a log in the rerun viewer."""
    from mjfish.reporting.log import view as open_log

    open_log(file)


def sample(
    diagnosis: Annotated[
        Path, typer.Argument(help="JSON of `mjfish diagnose` or `identify`, or a folder with diagnosis.json.")
    ],
    out: Annotated[Path, typer.Option(help="New folder for the fish TOMLs.")],
    n: Annotated[int, typer.Option("--n", min=1, help="How many fish.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draws.")] = 0,
    effects: console.Own = None,
) -> None:
    """Draw fish whose coefficients and effects have the error of the fit and the scatter from run to run."""
    from mjfish.model.posterior import write_draws

    check_new_folder(out)
    draws = mjfish.sample(diagnosis, n, seed=seed, effects=effects)
    files = write_draws(out, draws, [f"Drawn by mjfish sample from {diagnosis.name}, {n} draws, seed {seed}."])
    console.say(
        f"wrote {len(files)} fish to {out}",
        f"Their band in a run: {console.program()} simulate --fish FISH --draws {out} --out DIR",
    )
