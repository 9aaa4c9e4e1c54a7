"""The commands and the Python of README and docs run as they stand there."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doc_blocks import ROOT, blocks, commands, run_command, run_python
from gl import skip_without_gl
from own_recordings import write_recordings
from schema_check import complaints

import mjfish
from mjfish.cli import console
from mjfish.data import Dataset, load_dataset
from mjfish.diagnosis import Diagnosis
from mjfish.hydro.load import load
from mjfish.reporting import film

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.fixture(autouse=True)
def _wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no table break a line: what is searched for stands in one."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(console.out, "_width", 200)


@pytest.fixture
def diagnosed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page's commands and its Python diagnose the same folder: each split of its runs is diagnosed once.

    docs/diagnosis.md diagnoses its folder in both ways, and its splits.
    """
    diagnose, results = mjfish.diagnose, {}

    def diagnose_once(dataset: Dataset | Path | str, **options: Any) -> Diagnosis:
        dataset = dataset if isinstance(dataset, Dataset) else load_dataset(dataset)
        fitted, held = dataset.split()
        key = tuple(b"".join(trial.velocity.tobytes() for trial in trials) for trials in (fitted, held))
        if key not in results:
            results[key] = diagnose(dataset, **options)
        return results[key]

    monkeypatch.setattr(mjfish, "diagnose", diagnose_once)
    monkeypatch.setattr("mjfish.diagnosis.splits.diagnose", diagnose_once)


@pytest.mark.usefixtures("diagnosed_once")
def test_readme_commands_and_python_run(tmp_path: Path) -> None:
    """The first command runs as a user runs it, in a process of its own; the others share this one."""
    (tmp_path / "out").mkdir()
    generate, *others = commands(ROOT / "README.md")
    program = [str(Path(sys.executable).with_name("mjfish")), *shlex.split(generate)[1:]]
    subprocess.run(program, cwd=tmp_path, check=True, capture_output=True)
    for command in others:
        printed = run_command(command, tmp_path)
        if " diagnose " in command:
            assert "The cause is servo_lag" in printed
    for name in ("diagnosis.json", "report.html", "fish.rrd", "turn/rollout.csv", "turn/rollout.rrd"):
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    script, plate = blocks(ROOT / "README.md", "python")
    assert run_python(plate, tmp_path) == "0.35 m/s2, added-mass force -0.82 N\n"  # 1 / (0.5 + rho pi/4 h^2 L)
    printed = run_python(script, tmp_path)
    assert "The cause is servo_lag" in printed
    assert re.search(r"servo_lag.time_constant = 0.0(19|20)\d+ ", printed)
    assert "held-out error falls by" in printed
    assert (tmp_path / "out" / "diagnosis.html").stat().st_size > 0


def test_readme_makes_targets_that_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for command in re.findall(r"^make (\S+)", blocks(ROOT / "README.md", "sh")[0], re.MULTILINE):
        assert re.search(rf"^{command}:", makefile, re.MULTILINE), command


def test_the_fish_that_is_described_is_made_and_shown(tmp_path: Path) -> None:
    page = ROOT / "docs" / "fish.md"
    new, show = commands(page)
    run_command(new, tmp_path)
    assert "Nothing is odd" in run_command(show, tmp_path)
    made = mjfish.load_fish(tmp_path / "out" / "trout" / "trout.toml")
    (expression,) = re.findall(r"`mjfish\.(new_fish\(.*?\))`", page.read_text())
    assert eval(expression, {"new_fish": mjfish.new_fish}) == made  # noqa: S307 - our own page


def test_a_newcomer_comes_from_own_csv_files_to_a_verdict(tmp_path: Path) -> None:
    """An empty folder, poses of a camera with y down and commands of slow servos, the page's commands as they stand.

    The camera followed a point 2 cm behind the nose.
    """
    page = ROOT / "docs" / "own-data.md"
    new_fish, *others = commands(page)
    assert len(others) < 6
    run_command(new_fish, tmp_path)
    (shown,) = re.findall(r"^```\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    header, row = shown.splitlines()
    files = write_recordings(tmp_path, tmp_path / "carp.toml", "servo_lag", {"servo_lag.time_constant": 0.05})
    first = files[0].read_text(encoding="utf-8").splitlines()
    assert first[0] == header
    np.testing.assert_allclose(*(np.array(line.split(","), dtype=float) for line in (first[1], row)), atol=0.05)
    made, inspected, diagnosed = (run_command(line, tmp_path) for line in others)
    assert "x         Head_X [mm] in mm, as given" in made
    assert "joint angles as commanded, moving smoothly" in made
    assert "nothing blocks a diagnosis" in inspected
    assert "run1" in (tmp_path / "pictures" / "inspection.html").read_text(encoding="utf-8")
    assert "servo_lag" in diagnosed
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    assert not complaints("diagnosis-5", found)
    lag = found["causes"][0]["parameters"]["time_constant"]
    assert lag["low"] < 0.05 < lag["high"]
    assert found["gain"]["relative_reduction"]["low"] > 0.2
    assert (tmp_path / "found" / "report.html").stat().st_size > 0


@pytest.mark.parametrize(
    ("left_out", "added", "code"),
    [
        ("--set axes=y_down", "", "poses-mirrored"),
        pytest.param("", "--set turn_to=port", "poses-mirrored", marks=pytest.mark.slow),
        pytest.param("", "--set yaw_zero=90", "poses-heading-zero", marks=pytest.mark.slow),
        ("", "--length-unit m", "poses-unit"),
    ],
)
def test_a_newcomer_who_forgets_an_option_is_told_which(tmp_path: Path, left_out: str, added: str, code: str) -> None:
    new_fish, new_dataset, inspect, _ = commands(ROOT / "docs" / "own-data.md")
    run_command(new_fish, tmp_path)
    write_recordings(tmp_path, tmp_path / "carp.toml")
    run_command(f"{new_dataset.replace(left_out, '')} {added}", tmp_path)
    said = " ".join(run_command(inspect, tmp_path, exit_code=1).split())
    assert f"blocks {code}" in said
    assert f"import again with {left_out or added.partition('=')[0]}".partition("=")[0] in said


def test_the_dataset_that_is_described_can_be_read(tmp_path: Path) -> None:
    """Every key of the page, with recordings that fit it; a command writes one as well."""
    page = ROOT / "docs" / "datasets.md"
    (command,) = commands(page)
    run_command(command, tmp_path)
    assert (tmp_path / "out" / "pool" / "dataset.toml").is_file()
    (described,) = blocks(page, "toml")
    (tmp_path / "dataset.toml").write_text(described)
    time = np.arange(0.0, 8.0, 0.02)
    plain = {"time [s]": time, "surge [m/s]": 0.1 * time, "sway [m/s]": 0.0 * time, "yaw_rate [rad/s]": 0.0 * time}
    posed = {**plain, "x [m]": 1.0 + 0.0 * time, "y [m]": 1.0 + 0.0 * time, "yaw [rad]": 0.0 * time}
    joints = {f"joint_{j} [rad]": 0.3 * np.sin(9.0 * time) for j in range(1, 5)}
    for name, columns in (("straight", posed), ("wave", plain), ("angles", {**plain, **joints})):
        table = np.column_stack([*columns.values()])
        rows = np.delete(table, [50, 51], axis=0) if name == "straight" else table
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=",".join(columns), comments="")
    moving = np.column_stack([time, 0.1 * time, np.sin(time), np.cos(time)])
    for name, header in (("tag", "time [s],x [m],y [m]"), ("log", "t,gz,ax,ay")):
        width = header.count(",") + 1
        np.savetxt(tmp_path / f"{name}.csv", moving[:, :width], delimiter=",", header=header, comments="")
    dataset = load_dataset(tmp_path)
    straight, wave, angles, tagged = dataset.trials
    assert [(sensor.name, sensor.link, sensor.free_clock) for sensor in tagged.sensors] == [
        ("tag", 4, False),
        ("imu", 0, True),
    ]
    assert not tagged.measured.any()
    (script,) = blocks(page, "python")
    assert "tag x 0.002 m" in run_python(script, tmp_path)
    assert straight.gaps
    assert len(straight.time) == len(time) - 2
    assert straight.tank is not None
    assert [segment.start for segment in straight.drive] == [0.0, 5.2]
    assert wave.wave is not None
    assert wave.wave.ramp == 0.5
    assert angles.joint_angle is not None
    assert {p.name: p.start for p in dataset.fish.parameters}["c_d.tail"] == 1.8
    described_columns = set(re.findall(r"`([a-z_1]+ \[.*?\])`", page.read_text()))
    assert {header.replace("joint_2", "joint_1") for header in [*posed, "joint_1 [rad]"]} <= described_columns


def test_the_walk_through_an_identification_runs(tmp_path: Path) -> None:
    """Its commands and its Python, in their order; what it says of their output is so."""
    page = ROOT / "docs" / "identification.md"
    (tmp_path / "out").mkdir()
    printed = [run_command(line, tmp_path, exit_code=int(" compare " in line)) for line in commands(page)]
    fitted, compared = printed[1], printed[-1]
    (at_bound,) = re.findall(r"at its bound: ((?:c_[mdf]\.\w+,?\s+)+)", fitted)
    assert len(at_bound.split()) == 5
    assert "residuals: passed" in fitted
    assert "4 of 4 starts reached the best optimum" in fitted
    assert compared.count("absent") == 3
    for name in ("coefficients.csv", "identified.json", "my_fish.toml", "figures/profiles.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    (script,) = blocks(page, "python")
    assert "'c_m.tail': np.float64(0.061)" in run_python(script, tmp_path)


@pytest.mark.usefixtures("diagnosed_once")
@pytest.mark.slow
def test_the_page_of_films_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its commands write the files that it names; small and short films do for that."""
    skip_without_gl()
    for suffix in film.SUFFIXES:
        monkeypatch.setitem(film._SIZES, suffix, (320, 180))
    for suffix in (".mp4", ".gif"):
        monkeypatch.setitem(film._RATES, suffix, 2.0)
    page = ROOT / "docs" / "render.md"
    (tmp_path / "out").mkdir()
    for command in commands(page):
        run_command(command, tmp_path)
        if " render " in command:
            assert (tmp_path / command.rpartition("--out ")[2].split()[0]).stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.usefixtures("diagnosed_once")
def test_the_walk_through_a_diagnosis_runs(tmp_path: Path) -> None:
    """A clock or the servos: the data cannot tell, however they are divided, and the plan knows what would."""
    page = ROOT / "docs" / "diagnosis.md"
    (tmp_path / "out").mkdir()
    _, diagnosed, planned, sampled, swum, divided = (run_command(line, tmp_path) for line in commands(page))
    assert diagnosed.startswith("cannot_tell")
    assert "wrote 20 fish to out/draws" in sampled
    assert "% of 20 draws" in swum
    assert divided.startswith(diagnosed.partition("\nwrote ")[0])
    assert "The verdict cannot_tell came in 3 of 3 splits" in divided
    written = json.loads((tmp_path / "out" / "splits" / "splits.json").read_text())
    assert {"splits", "verdicts", "mechanisms", "agreeing"} <= set(written)
    assert {"message", "gain"} <= set(written["splits"][0])
    assert "plan out/doubt ranks runs" in " ".join(diagnosed.split())
    assert "Verdict" not in planned
    assert "The data cannot tell" in planned
    table, splits, script = blocks(page, "python")
    *rows, strictly = run_python(table, tmp_path).splitlines()
    assert [row.endswith("True") for row in rows] == [True, True, True]
    assert strictly == "named"
    assert "(('v1',), 'cannot_tell')" in run_python(splits, tmp_path)
    printed = run_python(script, tmp_path)
    verdict, *rivals = printed.partition("\n")[0].split()
    assert verdict == "cannot_tell"
    assert {"servo_lag", "time_offset"} <= set(rivals)
    assert "section_height" in printed
    assert "20 fish" in printed


@pytest.mark.slow
def test_the_page_of_long_diagnoses_runs(tmp_path: Path) -> None:
    """The second time, finished refits are found."""
    (tmp_path / "out").mkdir()
    made, diagnosed = commands(ROOT / "docs" / "many-runs.md")
    run_command(made, tmp_path)
    first = run_command(diagnosed, tmp_path)
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "out" / "kept").iterdir()}
    assert len(kept) > 10
    assert max(file.stat().st_size for file in kept) < 10_000
    assert run_command(diagnosed, tmp_path) == first
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "out" / "kept").iterdir()} == kept


@pytest.mark.slow
def test_the_script_for_processes_runs(tmp_path: Path) -> None:
    (script,) = blocks(ROOT / "docs" / "many-runs.md", "python")
    (tmp_path / "script.py").write_text(script)
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, check=True)
    assert done.stdout == "named\n"


def test_the_page_of_the_next_experiment_runs(tmp_path: Path) -> None:
    """Bench first, the best repeat in the table and below the best run, a folder that lacks one recording."""
    page = ROOT / "docs" / "plan.md"
    (tmp_path / "out").mkdir()
    _, printed = (run_command(line, tmp_path) for line in commands(page))
    assert "First sync-flash" in printed
    assert "v1-again" in printed
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())
    runs = [option for option in plan["options"] if option["kind"] == "run"]
    repeat = next(option for option in runs if option["name"] == "v1-again")
    pair, again = (option["pairs"][0] for option in (runs[0], repeat))
    assert again["probability_now"] < 0.01
    assert pair["probability_after"] > 0.9 > again["probability_after"]
    named = tomllib.loads((tmp_path / "out" / "next" / "dataset.toml").read_text())["trials"][-1]
    assert named["name"] == runs[0]["name"]
    assert not (tmp_path / "out" / "next" / named["file"]).exists()
    assert named["file"] in (tmp_path / "out" / "next" / "RECORD.md").read_text()
    (script,) = blocks(page, "python")
    assert run_python(script, tmp_path).endswith(" True\n")


def test_a_cause_of_ones_own_goes_through_all_of_it(tmp_path: Path) -> None:
    """The how-to's file and commands, as they stand."""
    page = ROOT / "docs" / "own-cause.md"
    source, *forces = blocks(page, "python")
    (tmp_path / "my_effects.py").write_text(source)
    (tmp_path / "out").mkdir()
    run_python("\n".join(forces), tmp_path)
    listed, _, diagnosed = (run_command(line, tmp_path) for line in commands(page))
    assert "gyro_gain" in listed
    assert "The cause is gyro_gain" in diagnosed
    estimate = re.search(r"gyro_gain\.error (\S+)", diagnosed)
    assert estimate is not None
    assert abs(float(estimate[1]) - 0.06) < 0.002


def _printed_by_blocks(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Run a page's Python blocks from the root, with warnings as errors; return what each of them printed.

    A block that begins with a comment ``# name.py`` is a file that others import.
    """
    monkeypatch.syspath_prepend(folder)
    printed = []
    for block in blocks(page, "python"):
        named = re.match(r"# (\w+)\.py\n", block)
        if named:
            (folder / f"{named[1]}.py").write_text(block)
            monkeypatch.delitem(sys.modules, named[1], raising=False)
        else:
            printed.append(run_python(block, ROOT))
    return printed


def _assert_same_text(printed: str, written: str) -> None:
    """The same words; numbers to a unit or so of the last digit, and below 1e-12 if they are rounding errors."""
    number = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
    assert re.sub(number, "#", printed) == re.sub(number, "#", written)
    pairs = [[float(text) for text in re.findall(number, page)] for page in (printed, written)]
    np.testing.assert_allclose(*pairs, rtol=5e-3, atol=1e-12)


@pytest.mark.parametrize("name", ["mujoco-plugin", "gymnasium", "mujoco-rollout"])
def test_page_of_mujoco_prints_what_it_says(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = ROOT / "docs" / f"{name}.md"
    printed = _printed_by_blocks(page, tmp_path, monkeypatch)
    for there, shown in zip(filter(None, printed), blocks(page, "text"), strict=True):
        _assert_same_text(there, shown)


def test_fitter_page_recovers_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fitter prints its iterations first."""
    page = ROOT / "docs" / "mujoco-sysid.md"
    (printed,) = _printed_by_blocks(page, tmp_path, monkeypatch)
    found = "".join(line for line in printed.splitlines(keepends=True) if line.startswith("c_"))
    _assert_same_text(found, blocks(page, "text")[0])
    for (value, half), truth in zip(re.findall(r"= (\S+) \+- (\S+)", found), (1.9, 1.0), strict=True):
        assert abs(float(value) - truth) < 2.0 * float(half) < 0.03


def test_plug_in_page_describes_one_plate_in_three_ways(tmp_path: Path) -> None:
    import mujoco

    from mjfish import StripFluid

    page = ROOT / "docs" / "mujoco-plugin.md"
    scene = ROOT / "models" / "xml" / "towed_plate.xml"
    (toml,) = blocks(page, "toml")
    (tmp_path / "water.toml").write_text(toml)
    spec = mujoco.MjSpec.from_file(str(scene))
    named: dict[str, object] = {"__name__": "page"}
    exec(blocks(page, "python")[0].replace("models/xml/towed_plate.xml", scene.as_posix()), named)  # noqa: S102
    by_python = named["fluid"]
    assert isinstance(by_python, StripFluid)
    by_toml = StripFluid.from_toml(spec.compile(), tmp_path / "water.toml")
    by_mjcf = StripFluid(spec.compile())
    assert by_toml.links == by_mjcf.links == by_python.links
    assert by_toml.density == by_mjcf.density == by_python.density
    custom, outline, room = blocks(page, "xml")
    lines = {line.strip() for line in scene.read_text().splitlines()}
    assert {line.strip() for line in custom.splitlines()} <= lines
    bodies = '<body name="head"><freejoint/><geom size=".1"/><body name="tail"><joint/><geom size=".1"/></body></body>'
    fish = StripFluid(mujoco.MjModel.from_xml_string(f"<mujoco>{outline}<worldbody>{bodies}</worldbody></mujoco>"))
    assert [(link.body, link.start, len(link.sections)) for link in fish.links] == [("head", 0.0, 2), ("tail", 0.3, 2)]
    named_joint = bodies.replace("<joint/>", '<joint name="tail"/>')
    water = f"<mujoco>{outline}<worldbody>{named_joint}</worldbody>{room}</mujoco>"
    assert StripFluid(mujoco.MjModel.from_xml_string(water), loads=[(_remembering, [])]).model.na == 2


@load(memory=1)
def _remembering(link: Any, parameters: Any) -> tuple[float, ...]:
    return 0.0, 0.0, 0.0, link.u


@pytest.mark.slow
@pytest.mark.real
def test_the_measured_fish_is_imported_and_diagnosed(fishsim: Path, tmp_path: Path) -> None:
    """The import page's commands, on the measured files; f1_25 is held out."""
    for file in fishsim.glob("markers_*.csv"):
        (tmp_path / file.name).symlink_to(file)
    *_, imported, diagnosed = commands(ROOT / "docs" / "import-fishsim.md")
    run_command(imported, tmp_path)
    roles = tomllib.loads((tmp_path / "swimming" / "dataset.toml").read_text())["trials"]
    assert {trial["name"]: trial["role"] for trial in roles} == {"f0_50": "fit", "f1_00": "fit", "f1_25": "held_out"}
    printed = run_command(f"{diagnosed} --json found.json", tmp_path)
    assert "held out   nRMSE" in printed
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["verdict"] != "nothing_wrong"
    held, speed = found["gain"]["held_out"], found["gain"]["mean_speed_error"]
    for model in ("nominal", "extended"):
        assert 0.0 < held[model]["yaw_rate"] < 0.2
    # Mean speed: 0.104 m/s. The nominal model errs by 0.004 to 0.04 m/s, under noise models that fit equally well.
    assert 0.0 < speed["extended"] < 0.01
    assert speed["nominal"] < 0.05
    assert held["extended"]["pooled"] < 0.9 * held["nominal"]["pooled"]


@pytest.mark.parametrize("name", ["index", "how-to"])
def test_every_link_of_a_table_of_contents_says_what_is_behind_it(name: str) -> None:
    """A sentence beside each page of the hidden table. Catches a page that only the sidebar has."""
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    (tree,) = re.findall(r"^```\{toctree\}\n:hidden:\n\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    for page in tree.split():
        (said,) = re.findall(rf"^- (?:\[.+\]\({page}\.md\)|\{{doc\}}`{page}`): (.+)$", text, re.MULTILINE)
        assert len(said.split()) > 5
        assert said.endswith(".")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target
