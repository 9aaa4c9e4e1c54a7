"""Whatever a user gives a command or a public function, it begins to work or says what is wrong: never a traceback."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Callable, Iterator
from contextlib import chdir, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import typer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import mjfish
from mjfish.cli import application, console, dataset, identify, study
from mjfish.data import save
from mjfish.errors import MjfishError
from mjfish.simulation import parse_wave
from mjfish.simulation.run import sample_times

JOINTS = ",".join(f"joint_{k} [rad]" for k in range(1, 5))
TETHER = """
from mjfish import Effect, Parameter
from mjfish.hydro.load import load

@load
def pull(link, parameters):
    {line}
    return -parameters[0] * link.u, 0.0, 0.0

class Tether(Effect):
    name, domain, summary = "tether", "water", "a tether pulls"
    parameters = (Parameter("tether.c", "N s/m", 0.0, 0.0, 5.0, 0.0, 0.1),)
    source, signature, confirm = "bench", "surge is too fast", "take it off"
    load = pull
"""
PLATE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="plate"><joint type="slide" axis="0 1 0"/>
<geom type="box" size=".15 .002 .1" pos="-.15 0 0" density="2000"/></body></worldbody></mujoco>"""
LINK = {"body": "plate", "length": 0.3, "height": 0.2, "width": 0.004}


#: The command line, made once: it takes longer to make than to run.
COMMAND = typer.main.get_command(application())


class _BeganError(Exception):
    """The work began: what was given was taken."""


def _begin(*_: Any, **__: Any) -> Any:
    raise _BeganError


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset, a recording, causes in files, and what is none of these."""
    folder = tmp_path_factory.mktemp("made")
    save(mjfish.generate("pike", ["v1", "v3"], noise=(0.01, 0.01, 0.05), duration=2.0), folder / "pool")
    time = np.arange(0.0, 2.0, 0.02)
    angles = 0.3 * np.sin(6.0 * time[:, None] + np.arange(4))
    rows = np.column_stack([time, 0.1 * time, 0.0 * time, 0.1 * np.sin(time), angles])
    np.savetxt(folder / "run.csv", rows, delimiter=",", header=f"time [s],x [m],y [m],yaw [rad],{JOINTS}", comments="")
    (folder / "tether.py").write_text(TETHER.format(line="pass"))
    (folder / "import_inside.py").write_text(TETHER.format(line="import math"))
    (folder / "broken.py").write_text("import no_such_module\n")
    (folder / "empty.toml").write_text("")
    (folder / "broken.json").write_text("{")
    (folder / "bytes").write_bytes(bytes(range(256)))
    return folder


@pytest.fixture(autouse=True)
def _there(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in that folder; what takes long begins and ends at once."""
    monkeypatch.chdir(made)
    monkeypatch.setattr("mjfish.diagnosis.diagnosis._diagnosed", _begin)
    monkeypatch.setattr("mjfish.estimation.identification.multistart", _begin)
    monkeypatch.setattr("mjfish.design.planning._planned", _begin)
    monkeypatch.setattr("mjfish.design.planning.diagnose", _begin)


@pytest.fixture
def told(capfd: pytest.CaptureFixture[str]) -> Callable[[list[str]], str]:
    """Run a command line, and return what it complains of; empty where it takes what it is given."""

    def run(line: list[str]) -> str:
        code: object = 0
        try:
            COMMAND(line)
        except SystemExit as left:
            code = left.code
        except _BeganError:
            pass
        except Exception as error:
            raise AssertionError(f"{line}: {type(error).__name__}: {error}") from error
        said = " ".join("".join(capfd.readouterr()).split())
        assert code in (0, 1, 2), line
        assert "Traceback" not in said, line
        return said if code else ""

    return run


#: Mistakes on the command line, and a part of what is said of each.
LINES = {
    "dataset new out run.csv --fish pike --set axes=y_down --set joints=commanded": "joints is a table",
    "dataset new out run.csv --fish pike --set joints=[]": "joints is a table",
    "dataset new out run.csv --fish pike --set wave=2": "wave is a table",
    "dataset new out run.csv --fish pike --set axes.x=1": "axes: expected 'y_up' or 'y_down'",
    "diagnose pool --effects import_inside.py": "import_inside.py: the load 'pull' cannot be compiled: Use of",
    "effects --effects import_inside.py": "put imports at the top of its file",
    "effects --effects broken.py": "broken.py: line 1: running the file failed: ModuleNotFoundError",
    "effects --effects pool": "pool: no such file of effects",
    f"effects --effects {'x' * 300}": "File name too long; give another file or folder",
    f"inspect {'x' * 300}": "File name too long",
    f"diagnose pool --out {'x' * 300}": "File name too long",
    "generate --out out --duration 1e12": "expected more than 0 and at most 10000 s",
    "generate --out out --rate 1e300": "at most 1e+07 samples",
    "generate --out out --effect servo_lag:time_constant=0.01 --effect servo_lag:time_constant=0.02": "is set twice",
    "simulate --out out --duration 1e300": "expected more than 0 and at most 10000 s",
    "simulate --out out --wave 'frequency=1e300,amplitude=[1,1,1,1],phase=[0,0,0,0]'": "frequency: must be at most",
    "simulate --out out --wave 'frequency=1,amplitude=[1e300,1,1,1],phase=[0,0,0,0]'": "amplitude.1: must be at most",
    "simulate --out out --wave 'frequency=1,amplitude=[1,1,1,1],phase=[0,0,0,0],ramp=1e300'": "ramp: must be at most",
    "fish new carp --length 1e300 --mass 1 --joints 3 --height 0.1": "must be at most 10000",
    "fish new carp --length 0.5 --mass 1 --joints 3 --height 0.1 --density nan": "'carp': density: expected a finite",
}


@pytest.mark.parametrize("line", LINES)
def test_mistakes_on_the_command_line_are_said(line: str, told: Callable[[list[str]], str]) -> None:
    assert LINES[line] in told(shlex.split(line))
    assert not Path("out").exists()


#: Command lines that work, to put mistakes into.
COMMANDS = {
    "simulate": "--out out --duration 0.1", "export": "pike out.xml", "check": "--mode v1", "inspect": "pool",
    "generate": "--out out --modes v1 --duration 1 --rate 20", "import": "poses run.csv --out out", "effects": "",
    "compare": "pool --against pool", "identify": "pool", "diagnose": "pool", "sample": "broken.json --out out",
    "plan": "pool", "study": "empty.toml --out out", "render": "empty.toml --out out.png",
    "fish new": "carp --length 0.5 --mass 1 --joints 3 --height 0.1", "fish show": "pike",
    "dataset new": "out run.csv --fish pike",
}  # fmt: skip
WORDS = ("", "a\0b", "no/such", "empty.toml", "bytes", "nan", "-1", "1e300", "x" * 300, "a=b", "a:b=c", "[")


def _options(command: str) -> Iterator[str]:
    found: Any = COMMAND
    for word in command.split():
        found = found.commands[word]
    for option in found.params:
        waits = option.name == "cluster"  # for an answer
        if option.param_type_name == "option" and not option.is_flag and not waits:
            yield option.opts[0]


@pytest.mark.parametrize("command", COMMANDS)
def test_no_option_of_any_command_leads_to_a_traceback(
    command: str, told: Callable[[list[str]], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("simulate", "generate", "check"):
        monkeypatch.setattr(mjfish, name, _begin)
    monkeypatch.setattr("mjfish.simulation.check", _begin)
    options = list(_options(command))
    assert options or command == "fish show"
    for option in options:
        for word in WORDS:
            told([*command.split(), *shlex.split(COMMANDS[command]), f"{option}={word}"])


def _model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(PLATE)


@functools.cache
def _inspection() -> Any:
    return mjfish.inspect("pool")


def _written(method: str, path: Any) -> None:
    """Write a result, in a folder where nothing is lost."""
    result = _inspection()
    Path("saved").mkdir(exist_ok=True)
    with chdir("saved"):
        getattr(result, method)(path)


@functools.cache
def _loaded() -> mjfish.Dataset:
    return mjfish.load_dataset("pool")


#: Calls of public functions and classes that work, to put mistakes into.
CALLS: dict[str, tuple[Callable[..., Any], Callable[[], dict[str, Any]]]] = {
    "load_dataset": (lambda **given: mjfish.load_dataset(**given), lambda: {"path": "pool"}),
    "load_diagnosis": (lambda **given: mjfish.load_diagnosis(**given), lambda: {"path": "broken.json"}),
    "save of a result": (lambda path: _written("save", path), lambda: {"path": "saved.json"}),
    "report of a result": (lambda path: _written("report", path), lambda: {"path": "saved.html"}),
    "Fish": (
        lambda **given: mjfish.Fish(**given),
        lambda: mjfish.load_fish("pike").model_dump(by_alias=True),
    ),
    "load_fish": (lambda **given: mjfish.load_fish(**given), lambda: {"name_or_path": "pike", "relative_to": None}),
    "new_fish": (
        lambda **given: mjfish.new_fish(**given),
        lambda: {"name": "carp", "length": 0.5, "mass": 1.0, "joints": 3, "height": 0.1, "width": 0.1, "density": 1e3},
    ),
    "simulate": (
        lambda **given: mjfish.simulate(**given),
        lambda: {
            "fish": "pike", "mode": "v1", "engine": "ode", "values": None, "effects": None, "drive": None,
            "duration": 0.1, "free": False,
        },
    ),
    "generate": (
        lambda **given: mjfish.generate(**given),
        lambda: {
            "fish": "pike", "modes": ["v1"], "values": None, "effects": (), "noise": (0.01, 0.01, 0.05), "seed": 0,
            "held_out": (), "rate": 20.0, "duration": 0.2, "name": "x", "tank": None, "places": (), "sensors": (),
            "observe": "pose", "joints": "measured", "joint_noise": 0.0,
        },
    ),
    "check": (
        lambda **given: mjfish.check(**given),
        lambda: {"fish": "pike", "mode": "v1", "duration": 0.05, "step": 0.01, "halvings": 0, "bound": 0.1},
    ),
    "inspect": (lambda **given: mjfish.inspect(**given), lambda: {"dataset": "pool", "effects": None}),
    "identify": (
        lambda **given: mjfish.identify(**given),
        lambda: {"dataset": _loaded(), "settings": None, "starts": 1, "jobs": 1, "executor": None, "tell": None},
    ),
    "diagnose": (
        lambda **given: mjfish.diagnose(**given),
        lambda: {
            "dataset": _loaded(), "effects": None, "seed": 0, "jobs": 1, "executor": None, "resume": None,
            "limit": None,
        },
    ),
    "sample": (
        lambda **given: mjfish.sample(**given),
        lambda: {"diagnosis": "broken.json", "n": 1, "seed": 0, "effects": None},
    ),
    "plan": (
        lambda **given: mjfish.plan(**given),
        lambda: {"diagnosis": _loaded(), "rivals": (), "causes": ["servo_lag"], "effects": None, "menu": None},
    ),
    "compare": (lambda **given: mjfish.compare(**given), lambda: {"dataset": _loaded(), "against": [], "bound": None}),
    "save": (lambda **given: save(**given), lambda: {"dataset": _loaded(), "folder": "pool", "comments": ()}),
    "Dataset": (
        lambda **given: mjfish.Dataset(**given),
        lambda: {"name": "x", "fish": mjfish.load_fish("pike"), "trials": ()},
    ),
    "Dataset[]": (lambda name: _loaded()[name], lambda: {"name": "v1"}),
    "Model": (lambda **given: mjfish.Model(**given), lambda: {"fish": mjfish.load_fish("pike"), "effects": ()}),
    "Parameter": (
        lambda **given: mjfish.Parameter(**given),
        lambda: {
            "name": "a.b", "unit": "-", "default": 0.0, "low": -1.0, "high": 1.0, "start": 0.0, "scale": 0.1,
            "sd": None, "mean": None,
        },
    ),
    "StripLink": (lambda **given: mjfish.StripLink(**given), lambda: {**LINK, "c_d": 1.0, "origin": (0.0, 0.0, 0.0)}),
    "BluntLink": (
        lambda **given: mjfish.BluntLink(**given),
        lambda: {"body": "plate", "semiaxes": [0.4, 0.2, 0.2], "added_mass": None, "area": None},
    ),
    "StripFluid": (
        lambda **given: mjfish.StripFluid(**given),
        lambda: {"model": _model(), "links": [LINK], "density": None, "commanded": False, "loads": ()},
    ),
    "StripFluid.from_toml": (
        lambda **given: mjfish.StripFluid.from_toml(**given),
        lambda: {"model": _model(), "path": "empty.toml"},
    ),
}  # fmt: skip
VALUES = (
    None, "", "nope", "no/such/file.toml", "pool", "tether.py", "import_inside.py", "run.csv", Path("nope"), "x" * 5000,
    "a\0b", Path("a\0b"), 10**29, 3, -1, 0, 1.5, -2.5, float("nan"), float("inf"), 1e300, True, b"x", [], {}, (),
    [1, 2], ["nope"], [None], ["v1", 3], [[1, 2], [3]], ["tether.py"], {"nope": 1.0}, {"c_d.head": None},
    {"c_d.head": float("nan")}, {"c_d.head": "x"}, {3: 4.0}, {1, 2}, object(), print, np.zeros((2, 2)),
    np.full(3, np.nan), np.array(["a"]),
)  # fmt: skip


@pytest.mark.filterwarnings("ignore:link 'plate' is:UserWarning")
@pytest.mark.parametrize("call", CALLS)
def test_no_argument_of_any_public_call_leads_to_a_traceback(call: str) -> None:
    function, working = CALLS[call]
    for name in working():
        for value in VALUES:
            try:
                with suppress(_BeganError):
                    function(**{**working(), name: value})
            except MjfishError:
                continue
            except Exception as error:
                raise AssertionError(f"{call}({name}={value!r:.60}): {type(error).__name__}: {error}") from error


class _Empty(mjfish.Effect):
    name = "empty"


#: Mistakes in Python, and a part of what is said of each.
SAID = {
    "a word for a number": (
        lambda: mjfish.simulate(duration="long"),
        r"^simulate: duration: found 'long' \(str\), expected float; correct it$",
    ),
    "an unknown option": (
        lambda: mjfish.generate("pike", ["v1"], rat=20.0),
        "^unknown argument of generate 'rat'; known: duration, joint_noise, .*rate",
    ),
    "no engine": (lambda: mjfish.simulate(engine="od"), "engine: found 'od' .*'ode', 'mujoco'"),
    "a value that is no number": (lambda: mjfish.simulate(values={"c_d.head": "x"}), "values: found {'c_d.head': 'x'}"),
    "no effects": (lambda: mjfish.diagnose("pool", effects={"a": 1}), "effects: found {'a': 1}"),
    "a cause that declares nothing": (
        lambda: mjfish.diagnose("pool", effects={"empty": _Empty()}),
        "^effect _Empty: attribute 'domain' is missing or empty; declare it$",
    ),
    "no file of effects": (lambda: mjfish.diagnose("pool", effects="no.py"), "^no.py: no such file of effects"),
    "no file of effects for an inspection": (
        lambda: mjfish.inspect("pool", effects=["no.py"]),
        "^no.py: no such file of effects",
    ),
    "a dataset without trials": (
        lambda: mjfish.diagnose(replace(_loaded(), trials=())),
        "no trial to fit, expected one or more; add one, or hold out fewer$",
    ),
    "a dataset without fitted trials": (
        lambda: mjfish.identify(replace(_loaded(), trials=(replace(_loaded()["v1"], role="held_out"),))),
        "no trial to fit, expected one or more",
    ),
    "more starts than anybody waits for": (
        lambda: mjfish.identify("pool", starts=10**29),
        "^starts is 1000000000.*, expected 1 to 1000000; correct it$",
    ),
    "NUL in a name": (
        lambda: mjfish.diagnose("pool", resume="a\0b"),
        "^the name of a file or folder holds a character NUL, which none can have; correct it$",
    ),
    "a fish of unknown keys": (
        lambda: mjfish.Fish(**mjfish.load_fish("pike").model_dump(by_alias=True), fins=2),
        "^Fish: fins: unknown key; remove it or correct its spelling",
    ),
    "an import in a load": (
        lambda: mjfish.diagnose("pool", effects="import_inside.py"),
        "^import_inside.py: the load 'pull' cannot be compiled: .* put imports at the top of its file$",
    ),
    "a trial that is not there": (
        lambda: mjfish.load_dataset("pool")["v11"],
        r"^unknown trial 'v11'; known: v1, v3; did you mean v1\?$",
    ),
    "a run of six hours": (lambda: sample_times(2e4, 1.0), "duration 20000 s at 1 Hz: expected .* at most 10000 s"),
    "more samples than fit": (lambda: sample_times(1e4, 1e4), "and at most 1e.07 samples; correct it$"),
    "no mode": (lambda: mjfish.generate("pike", []), "modes: found none"),
    "a noise of angles below zero": (
        lambda: mjfish.generate("pike", ["v1"], joint_noise=-0.1),
        "joint_noise is -0.1 rad, expected a finite number of at least 0",
    ),
    "no step": (lambda: mjfish.check("pike", step=0.0), "expected a step and a bound above 0"),
    "a fish of no numbers": (lambda: mjfish.new_fish("a", length=1, mass=1e300, joints=1, height=0.1), "fish 'a': "),
}


def test_an_inspection_takes_a_file_of_effects() -> None:
    assert mjfish.inspect("pool", effects="tether.py").findings == mjfish.inspect("pool").findings


@pytest.mark.parametrize("mistake", SAID)
def test_mistakes_in_python_are_said(mistake: str) -> None:
    call, said = SAID[mistake]
    with pytest.raises(MjfishError, match=said):
        call()


def test_what_the_compiler_says_of_a_load_is_one_line(tmp_path: Path) -> None:
    """It says twenty, in colours, and the first is always the same."""
    (tmp_path / "own.py").write_text(TETHER.format(line="nothing(link)"))
    with pytest.raises(
        MjfishError, match="'pull' cannot be compiled: NameError: name 'nothing' is not defined;"
    ) as said:
        mjfish.simulate(effects=tmp_path / "own.py", duration=0.1)
    assert "\n" not in str(said.value)
    assert "\x1b" not in str(said.value)


@pytest.mark.parametrize("given", ["tether.py", Path("tether.py"), ["tether.py"]], ids=repr)
def test_effects_of_a_file_act_in_python_as_on_the_command_line(given: Any) -> None:
    run = mjfish.simulate(values={"tether.c": 5.0}, effects=given, duration=0.2)
    assert run.effects == ("with tether: c = 5 N s/m",)
    slow = mjfish.generate("pike", ["v1"], values={"tether.c": 5.0}, effects=given, duration=2.0)
    free = mjfish.generate("pike", ["v1"], duration=2.0)
    assert slow["v1"].velocity[-1, 0] < free["v1"].velocity[-1, 0]


def test_a_diagnosis_has_the_effects_of_a_file_beside_the_shipped_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def noted(begun: Any) -> Any:
        seen.extend(begun.known)
        raise _BeganError

    monkeypatch.setattr("mjfish.diagnosis.diagnosis._diagnosed", noted)
    with pytest.raises(_BeganError):
        mjfish.diagnose("pool", effects="tether.py")
    assert {"tether", "servo_lag"} <= set(seen)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=40) | st.from_regex(r"[a-z_.*]{1,8}[=:][-0-9a-z.,:=\[\]{}]{0,12}", fullmatch=True))
def test_any_text_of_an_option_is_read_or_refused(text: str) -> None:
    for read in (
        lambda: console.assignments([text], "--set"),
        lambda: console.effect_settings([text], {}),
        lambda: console.numbers(text, 1, "--omega"),
        lambda: dataset._other([text]),
        lambda: identify._bounds(text),
        lambda: study._shard(text),
        lambda: parse_wave(text),
    ):
        with suppress(MjfishError):
            read()
