"""``mjfish dataset new``: CSV files of a laboratory become a dataset; what they do not say is asked for, or given."""

from __future__ import annotations

import glob
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from mjfish.cli import console
from mjfish.errors import InputError

if TYPE_CHECKING:
    from mjfish.data import Dataset
    from mjfish.data.importers import ImportReport
    from mjfish.data.importers.mapping import PosesMap, VelocitiesMap
    from mjfish.data.importers.recognition import Kind
    from mjfish.data.tables import Layout

#: Where the mapping of the columns stands, for messages.
_PLACE = Path("mjfish dataset new")
_UNITS = {
    "time": ("s", "ms", "us", "ns"),
    "length": ("m", "cm", "mm"),
    "angle": ("rad", "deg"),
    "joint": ("rad", "deg"),
}
_FLAGS = {
    "time": "--time", "surge": "--surge", "sway": "--sway", "yaw_rate": "--yaw-rate", "x": "--x", "y": "--y",
    "yaw": "--heading",
}  # fmt: skip
_CHANGES = (
    "What may be changed or added here (docs/datasets.md has all keys):",
    '  role = "held_out" or "fit" in [[trials]]',
    '  joints = "commanded" in [[trials]], if its joint angles are those that the servos were told, with hold = "zero"',
    '  or "linear" between them',
    "  from_rest = true in [[trials]], if the fish is at rest in the water at its first sample",
    "  [noise] with surge, sway [m/s], yaw_rate [rad/s]: standard deviation of one sample, if known",
    '  [filter] kind = "gaussian", sd = 0.02: what the velocities were smoothed by [s], if known',
)

#: Text of an option that may be given once for all files, or once a file.
_PER_FILE = "once for all files, or once a file, in their order"


def new(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="New folder of the dataset.")],
    files: Annotated[list[Path] | None, typer.Argument(help="CSV files, one a run; left out: asked for.")] = None,
    fish: Annotated[str | None, typer.Option(help="A fish TOML, or a shipped fish.")] = None,
    held_out: Annotated[
        list[str] | None,
        typer.Option(help="Run not to be fitted, by its file's name without .csv; repeatable. Default every third."),
    ] = None,
    time: Annotated[str | None, typer.Option(help="Column of the time.")] = None,
    surge: Annotated[str | None, typer.Option(help="Column of the velocity forward.")] = None,
    sway: Annotated[str | None, typer.Option(help="Column of the velocity to port.")] = None,
    yaw_rate: Annotated[str | None, typer.Option(help="Column of the yaw rate, positive to port.")] = None,
    x: Annotated[str | None, typer.Option(help="Column of x in the tank, in place of velocities.")] = None,
    y: Annotated[str | None, typer.Option(help="Column of y.")] = None,
    heading: Annotated[str | None, typer.Option(help="Column of the heading.")] = None,
    joints: Annotated[str | None, typer.Option(help="Columns of the joint angles, head first, with commas.")] = None,
    frequency: Annotated[
        list[str] | None, typer.Option(help=f"Frequency of the drive [Hz], in place of joint angles; {_PER_FILE}.")
    ] = None,
    amplitude: Annotated[
        list[str] | None, typer.Option(help=f"Amplitudes of the joints, with commas; {_PER_FILE}.")
    ] = None,
    phase: Annotated[list[str] | None, typer.Option(help=f"Phases of the joints, with commas; {_PER_FILE}.")] = None,
    joints_are: Annotated[
        str | None, typer.Option(help="commanded: what the servos were told; or measured.", show_default="measured")
    ] = None,
    hold: Annotated[
        str | None,
        typer.Option(help="What a commanded angle does until the next: linear or zero.", show_default="linear"),
    ] = None,
    from_rest: Annotated[
        bool, typer.Option("--from-rest", help="The fish is at rest in the water at the first row of every file.")
    ] = False,
    synchronised: Annotated[
        bool,
        typer.Option("--synchronised", help="Drive and record have one clock; else frequency and phase are fitted."),
    ] = False,
    time_unit: Annotated[
        str | None, typer.Option(help="s, ms, us or ns.", show_default="named in the header, or s")
    ] = None,
    length_unit: Annotated[
        str | None, typer.Option(help="m, cm or mm, also per second.", show_default="named in the headers")
    ] = None,
    angle_unit: Annotated[
        str | None, typer.Option(help="rad or deg, also per second.", show_default="named in the headers")
    ] = None,
    joint_unit: Annotated[
        str | None,
        typer.Option(
            help="Unit of joints, amplitude and phase.", show_default="named in the headers, or the angle unit"
        ),
    ] = None,
    separator: Annotated[str | None, typer.Option(help="Of columns: , ; tab or |.", show_default="recognised")] = None,
    decimal: Annotated[str | None, typer.Option(help="Mark in numbers: . or ,", show_default="recognised")] = None,
    encoding: Annotated[
        str | None, typer.Option(help="Of the text, e.g. cp1252, utf-16-le.", show_default="recognised")
    ] = None,
    skip: Annotated[int | None, typer.Option(help="Lines above the header.", show_default="recognised")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Another key of a mapping file (docs/import-fishsim.md): sway_to=starboard, behind_nose=0.05, "
            "joints.sign=-1, wave.ramp=0.5; repeatable.",
        ),
    ] = None,
) -> None:
    """Make a dataset of CSV files. In a terminal, what is neither given nor clear from the headers is asked for."""
    from mjfish.data import save
    from mjfish.data.importers.recognition import units as unit_names
    from mjfish.data.importers.tables import import_mapped
    from mjfish.data.tables import DATES
    from mjfish.files.writing import check_new_folder
    from mjfish.fish import load_fish

    check_new_folder(folder)
    questions = _Questions(asking=console.is_asking(), everything=not files)
    paths = list(files or ())
    if not paths and questions.asking:
        paths = _files(_prompt("CSV files, one a run", "*.csv" if any(Path().glob("*.csv")) else None))
    dialect = {"separator": separator, "decimal": decimal, "encoding": encoding, "skip": skip}
    layout = _layout(paths, dialect)
    headers = layout.headers
    named = questions.ask(fish, None, "Fish: a TOML, or a shipped one", "--fish")
    given = {
        "time": time, "surge": surge, "sway": sway, "yaw_rate": yaw_rate, "x": x, "y": y, "yaw": heading,
    }  # fmt: skip
    columns = _columns(headers, given, questions, paths[0])
    drive = _drive(headers, joints, {"frequency": frequency, "amplitude": amplitude, "phase": phase}, questions)
    stated = {"time": time_unit, "length": length_unit, "angle": angle_unit, "joint": joint_unit}
    units = _units(columns.of, drive, stated, questions)
    if held_out is None and questions.everything and questions.asking:
        runs = ", ".join(path.stem for path in paths)
        held_out = list(console.names(_prompt(f"Runs held out, of {runs} (none: every third)", "")))
    questions.check(headers)
    options = {"joints.are": joints_are, "joints.hold": hold, "from_rest": "true" if from_rest else None}
    told = [f"{key}={value}" for key, value in options.items() if value is not None]
    table = _mapping(
        columns, units, drive, paths, synchronised=synchronised, other=[*told, *(set_ or ())], dialect=dialect
    )
    dataset, report = import_mapped(paths, held_out or (), table, load_fish(named), _PLACE)
    dates = [note for note in report.files[0].notes if note.startswith(DATES)]
    assumed = time_unit is None and not dates and not unit_names({"time": columns.of["time"]})
    taken = [
        *_taken(columns, drive, units, assumed=assumed),
        *_joints_taken(table, dataset, joints_are),
        _signs(table),
        _held_out(dataset, held_out),
        f"fish      {named}",
        *(f"files     {note}" for note in (*layout.notes, *dates)),
    ]
    made = f"Made by mjfish dataset new of {shlex.join(map(str, paths))}, whose columns are:"
    lines = [f"  {line}" for line in taken]
    path = save(replace(dataset, name=folder.resolve().name), folder, comments=[made, *lines, *_CHANGES])
    console.say(f"wrote {folder / path.name} with {len(dataset.trials)} trials", *lines)
    console.say(*_cut(report), f"next: {console.program()} inspect {folder}")


@dataclass
class _Questions:
    """What is neither given nor clear: it is asked for in a terminal, else said in one message.

    Attributes:
        asking: whether somebody is there to answer.
        everything: whether to ask for what is clear, too.
        lacking: what nobody said.
    """

    asking: bool
    everything: bool
    lacking: list[str] = field(default_factory=list)

    def ask(self, given: str | None, guessed: str | None, question: str, flag: str, choices: Sequence[str] = ()) -> str:
        """Return what was given, else what is clear, else the answer; empty where there is none."""
        if given is not None:
            if choices and given not in choices:
                raise InputError(f"{flag}: found '{given}', expected {' or '.join(choices)}; correct it")
            return given
        if guessed is not None and not (self.asking and self.everything):
            return guessed
        if not self.asking:
            self.lacking.append(f"{question} ({flag}{' ' + '|'.join(choices) if choices else ''})")
            return ""
        return _prompt(question, guessed, choices)

    def check(self, headers: Sequence[str]) -> None:
        """Refuse to go on where something is lacking."""
        if self.lacking:
            raise InputError(
                f"not given and not clear from the headers {', '.join(headers)}:\n"
                + "\n".join(f"    {what}" for what in self.lacking)
                + "\ngive these options (for places of a camera --x, --y and --heading in place of velocities), or run "
                "the command in a terminal without files to be asked"
            )


def _prompt(question: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
    """Ask until the answer is one of `choices`, where there are some."""

    def checked(answer: str) -> str:
        if choices and answer not in choices:
            raise typer.BadParameter(f"expected {' or '.join(choices)}")
        return answer

    shown = f"{question} ({', '.join(choices)})" if choices else question
    return str(typer.prompt(shown, default=default, value_proc=checked))


def _files(answer: str) -> list[Path]:
    """Return the files of an answer, in which patterns are expanded."""
    paths = (sorted(glob.glob(part)) or [part] for part in shlex.split(answer))  # noqa: PTH207 - may be absolute
    return [Path(path) for found in paths for path in found]


def _layout(paths: Sequence[Path], dialect: Mapping[str, Any]) -> Layout:
    """Return how the first file is laid out, by what is stated of it."""
    from mjfish.data.importers.recognition import check_once, check_text
    from mjfish.data.tables import Dialect, recognise
    from mjfish.files import tomlfile

    if not paths:
        raise InputError(
            "no files, expected one CSV file a run; name them behind the folder, or run this in a terminal"
        )
    check_once(paths)
    for path in paths:
        check_text(path)
    return recognise(paths[0], tomlfile.parse(dialect, Dialect, str(_PLACE)))


@dataclass(frozen=True)
class _Columns:
    """Which importer reads the columns, and their headers by key; `guessed` by their headers."""

    kind: Kind
    of: Mapping[str, str]
    guessed: frozenset[str]


def _columns(headers: Sequence[str], given: Mapping[str, str | None], questions: _Questions, path: Path) -> _Columns:
    from mjfish.data.importers.recognition import KEYS, guess, named

    found = guess(headers)
    given = {key: None if name is None else named(name, headers) for key, name in given.items()}
    said = {key for key, name in given.items() if name is not None}
    as_velocities, as_poses = (said & set(KEYS[kind]) - {"time"} for kind in ("velocities", "poses"))
    if as_velocities and as_poses:
        raise InputError(
            f"{', '.join(_FLAGS[key] for key in sorted(as_velocities))} beside "
            f"{', '.join(_FLAGS[key] for key in sorted(as_poses))}, expected velocities or places; leave out one kind"
        )
    kind: Kind
    if as_velocities or as_poses:
        kind = "velocities" if as_velocities else "poses"
    elif found.kind is not None and not (questions.asking and questions.everything):
        kind = found.kind
    elif questions.asking:
        console.say(f"{path} has the columns {', '.join(headers)}.")
        kind = cast("Kind", _prompt("What was measured", found.kind, ("velocities", "poses")))
    else:
        kind = "poses" if {"x", "y"} <= set(found.columns) else "velocities"
    of = {
        key: questions.ask(given[key], found.columns.get(key), f"Column of {key.replace('_', ' ')}", _FLAGS[key])
        for key in KEYS[kind]
    }
    guessed = {key for key, name in of.items() if given[key] is None and name == found.columns.get(key)}
    return _Columns(kind, of, frozenset(guessed))


@dataclass(frozen=True)
class _Drive:
    """How the joints move: columns of their angles, or frequency, amplitude and phase, once or once a file."""

    joints: tuple[str, ...] = ()
    wave: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    guessed: bool = False


def _drive(
    headers: Sequence[str], joints: str | None, wave: Mapping[str, list[str] | None], questions: _Questions
) -> _Drive:
    from mjfish.data.importers.recognition import guess, named

    if joints is not None and any(wave.values()):
        raise InputError("--joints beside a drive, expected joint angles or the drive; leave out one of them")
    if joints is not None:
        joints = ",".join(named(name, headers) for name in console.names(joints))
    if not any(wave.values()):
        known = ",".join(guess(headers).joints) or None
        if known is None and questions.asking and joints is None:
            joints = _prompt("Columns of the joint angles, head first (none: a drive)", "")
        elif known is None and joints is None:
            questions.lacking.append("Joints (--joints COLUMNS, or --frequency, --amplitude and --phase of the drive)")
            return _Drive()
        answer = questions.ask(joints, known, "Columns of the joint angles, head first", "--joints")
        if answer:
            return _Drive(joints=console.names(answer), guessed=joints is None and answer == known)
    asked = {
        "frequency": "Frequency of the drive [Hz]",
        "amplitude": "Amplitudes of the joints, head first, with commas",
        "phase": "Phases of the joints, with commas",
    }
    told = {name: wave[name] or [questions.ask(None, None, text, f"--{name}")] for name, text in asked.items()}
    if questions.lacking:
        return _Drive()
    return _Drive(wave={name: [_stated(text, f"--{name}") for text in texts] for name, texts in told.items()})


def _stated(text: str, flag: str) -> Any:
    """Return a frequency, or amplitudes or phases of the joints; or say how to give a frequency a file."""
    count = text.count(",") + 1
    if flag != "--frequency":
        return console.numbers(text, count, flag)
    if count > 1:
        repeated = " ".join(f"{flag} {part.strip()}" for part in text.split(","))
        raise InputError(f"{flag}: found '{text}', expected one number; repeat the option for every file: {repeated}")
    return console.numbers(text, 1, flag)[0]


def _units(
    columns: Mapping[str, str], drive: _Drive, stated: Mapping[str, str | None], questions: _Questions
) -> dict[str, str]:
    """Return the unit of every kind: as stated, else as headers name it; seconds and the unit of angles by default."""
    from mjfish.data.importers.recognition import units as unit_names

    named = unit_names(columns, drive.joints)
    units: dict[str, str] = {}
    defaults = {"time": "s", "joint": stated["angle"]}
    for kind, choices in _UNITS.items():
        own = sorted(named.get(kind, ()))
        if len(own) > 1 and stated[kind] is None:
            raise InputError(
                f"headers name the units {' and '.join(own)} of one kind, expected one; convert a column, or give "
                f"--{kind}-unit"
            )
        # The unit of the other angles may be lacking, or the headers of columns that are lacking may name it.
        lacking = questions.lacking or (kind == "joint" and not units["angle"])
        if lacking and stated[kind] is None and not own:
            units[kind] = ""
            continue
        known = own[0] if own else defaults.get(kind) or (units.get("angle") if kind == "joint" else None)
        units[kind] = questions.ask(stated[kind], known or None, f"Unit of {kind}s", f"--{kind}-unit", choices)
    return units


def _mapping(
    columns: _Columns,
    units: Mapping[str, str],
    drive: _Drive,
    paths: Sequence[Path],
    *,
    synchronised: bool,
    other: Sequence[str],
    dialect: Mapping[str, Any],
) -> PosesMap | VelocitiesMap:
    """Return the mapping of the columns, with other keys ``KEY=VALUE`` as a mapping file has them."""
    from mjfish.data.importers.mapping import MAPS
    from mjfish.files import tomlfile

    raw: dict[str, Any] = {"schema": 1, "kind": columns.kind, "fish": "-", **dialect, **columns.of}
    raw |= {f"{kind}_unit": units[kind] for kind in ("time", "length", "angle")}
    more = _other(other)
    joints, wave = more.pop("joints", {}), more.pop("wave", {})
    spare, driven_by = ("wave", "joint angles") if drive.joints else ("joints", "a drive")
    if {"joints": joints, "wave": wave}[spare]:
        raise InputError(
            f"keys of [{spare}] (--set {spare}.KEY{'' if drive.joints else ', --joints-are, --hold'}) beside "
            f"{driven_by}, expected one of the two; leave them out"
        )
    if drive.joints:
        raw["joints"] = {"columns": drive.joints, "unit": units["joint"], **joints}
    else:
        common = {"unit": units["joint"], "free": not synchronised, **wave}
        laws = {name: _per_file(values, name, paths) for name, values in drive.wave.items()}
        raw["waves"] = {
            glob.escape(path.name): {**{name: values[number] for name, values in laws.items()}, **common}
            for number, path in enumerate(paths)
        }
    raw |= more
    return tomlfile.parse(raw, MAPS[columns.kind], str(_PLACE))


def _per_file(values: Sequence[Any], name: str, paths: Sequence[Path]) -> Sequence[Any]:
    if len(values) not in (1, len(paths)):
        raise InputError(
            f"--{name}: given {len(values)} times for {len(paths)} files, expected once, or once a file; correct it"
        )
    return values if len(values) == len(paths) else [values[0]] * len(paths)


def _other(texts: Sequence[str]) -> dict[str, Any]:
    """Return keys of a mapping file, as TOML has them; text may stand without its quotes."""
    given: dict[str, str] = {}
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise InputError(f"--set: found '{text}', expected KEY=VALUE, e.g. sway_to=starboard")
        given[key] = value if _is_toml(f"{key} = {value}") else f'"{value}"'
    table = "\n".join(f"{key} = {value}" for key, value in given.items())
    if not _is_toml(table):
        raise InputError(f"--set: '{table}' is no KEY=VALUE of a mapping file, e.g. sway_to=starboard; correct it")
    result = tomllib.loads(table)
    for name, example in (("joints", "--joints-are commanded, or joints.sign=-1"), ("wave", "wave.ramp=0.5")):
        if not isinstance(result.get(name, {}), dict):
            raise InputError(
                f"--set: '{name}={result[name]}', but {name} is a table, expected one of its keys: {example}"
            )
    return result


def _is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _taken(columns: _Columns, drive: _Drive, units: Mapping[str, str], *, assumed: bool) -> Iterator[str]:
    """Yield what each column was taken for, a line each, and whether that was guessed."""
    from mjfish.data.importers.recognition import UNIT_OF

    for key, header in columns.of.items():
        rate = "/s" if key in ("surge", "sway", "yaw_rate") else ""
        how = "guessed from its header" if key in columns.guessed else "as given"
        how += "; its unit is assumed" if key == "time" and assumed else ""
        yield f"{key:9} {header} in {units[UNIT_OF[key]]}{rate}, {how}"
    if drive.joints:
        how = "guessed from their headers" if drive.guessed else "as given"
        yield f"joints    {', '.join(drive.joints)} in {units['joint']}, {how}"
    else:
        hertz = ", ".join(f"{value:g}" for value in dict.fromkeys(drive.wave["frequency"]))
        yield f"drive     a wave of {hertz} Hz, amplitude and phase in {units['joint']}, as given"


def _joints_taken(table: PosesMap | VelocitiesMap, dataset: Dataset, stated: str | None) -> Iterator[str]:
    """Yield what the joint angles and the start were taken for."""
    from mjfish.data.importers.mapping import joint_angle_remarks

    assumed = "" if stated else ", which is assumed: --joints-are commanded, if the servos were told them"
    yield from (f"          {line}{assumed}" for line in joint_angle_remarks(table, dataset.trials[0]))
    yield f"start     {'at rest in the water, as given' if table.from_rest else 'free (--from-rest: at rest)'}"


def _signs(table: PosesMap | VelocitiesMap) -> str:
    """Return what is positive, and which point was tracked: what no header says."""
    from mjfish.data.importers.mapping import VelocitiesMap

    if isinstance(table, VelocitiesMap):
        told = f"surge to the {table.surge_to}, sway to {table.sway_to}, yaw rate to {table.turn_to}"
    else:
        up = "anticlockwise" if table.port_positive else "clockwise"
        told = f"{table.axes}, heading {up} from {table.yaw_zero:g} along x"
    fitted, place = "somewhere on the head, fitted (--set behind_nose=METRES fixes it)", table.behind_nose
    return f"positive  {told}; tracked {fitted if place is None else f'{place:g} m behind the nose'}"


def _held_out(dataset: Dataset, stated: Sequence[str] | None) -> str:
    names = ", ".join(trial.name for trial in dataset.split()[1])
    how = "" if stated else " (every third run)"
    return f"held out  {names}{how}" if names else "held out  nothing, for there is one run"


def _cut(report: ImportReport) -> list[str]:
    """Return what was done to files of which something was left out, a line each."""
    return [
        f"  {file.path.name}: {file.kept} of {file.frames} samples kept; "
        + "; ".join([*map(str, file.cuts), *file.notes])
        for file in report.files
        if file.cuts or file.kept < file.frames
    ]
