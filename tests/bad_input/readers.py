"""Every reader of files: a valid file, what reads it, and how it goes wrong."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from random import Random
from types import SimpleNamespace as Message
from typing import Any

import mutations
import numpy as np
from diagnosed import diagnosis
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

import mjfish
from mjfish import data, fish
from mjfish.comparison.comparison import read_rollout
from mjfish.data.importers import import_files
from mjfish.data.importers.mapping import LAYOUTS, MarkersMap, read_mapping
from mjfish.data.importers.markers import metres, placed, read_points, read_tracks
from mjfish.design import load_fitted_models
from mjfish.errors import MjfishError
from mjfish.files import checksummed_json, tomlfile
from mjfish.files.writing import json_text
from mjfish.model import extended
from mjfish.study import read_cases
from mjfish.study.cases import Generated, acting

#: As a user gives it.
_TAIL_FISH = Path(__file__).parents[2] / "tools" / "importers" / "tail_fish.py"

#: Most that a file may take, of a processor [s].
SECONDS = 5.0
Mutation = Callable[[bytes, Random], bytes]


@dataclass(frozen=True)
class Reader:
    """Reads a file.

    Attributes:
        name: of the file.
        valid: one that is read.
        read: takes the folder of the file, and returns what was read.
        mutations: that change it.
        beside: other files in the folder, by name.
    """

    name: str
    valid: bytes
    read: Callable[[Path], Any]
    mutations: tuple[Mutation, ...]
    beside: Mapping[str, bytes] = field(default_factory=dict)

    def prepare(self, folder: Path) -> None:
        """Write the files beside."""
        for name, content in self.beside.items():
            (folder / name).write_bytes(content)

    def mutated(self, random: Random) -> bytes:
        """Return the file after one mutation."""
        return random.choice(self.mutations)(self.valid, random)

    def outcome(self, raw: bytes, folder: Path) -> str:
        """Return ``read`` or ``refused``; whatever else comes of reading is an error, and so is a number not finite."""
        (folder / self.name).write_bytes(raw)
        fish.fish._read.cache_clear()  # a file may change twice within the resolution of its time
        begun, found, message = time.process_time(), None, ""
        try:
            found = self.read(folder)
        except MjfishError as error:
            message = str(error)
        taken = time.process_time() - begun
        assert taken < SECONDS, f"{self.name} took {taken:.1f} s"
        assert not message or str(folder) in message, f"names no file: {message}"
        for value in _arrays(found):
            assert np.isfinite(value).all(), f"{self.name}: {value} is not finite"
        return "refused" if message else "read"


def _arrays(found: Any) -> Any:
    """Yield the numbers of what was read that must be finite."""
    if isinstance(found, data.Dataset):
        for trial in found.trials:
            yield trial.velocity[:, list(trial.measured)]
            others = (trial.time, trial.joint_angle, trial.errors, trial.roll)
            yield from (array for array in others if array is not None)
            if trial.pose is not None:
                yield trial.pose[:, ~np.isnan(trial.pose).all(axis=0)]
            for sensor in trial.sensors:
                yield sensor.time
                yield np.nan_to_num(sensor.values, posinf=math.inf, neginf=-math.inf)  # cells may be missing
        yield from _arrays(found.fish)
        if found.noise is not None:
            yield np.nan_to_num(found.noise, posinf=math.inf, neginf=-math.inf)
    elif isinstance(found, fish.Fish):
        yield np.array([found.length, *found.values.values()])
        yield np.array([[p.low, p.high, p.start, p.scale] for p in (*found.parameters, *found.numbers)])
    elif isinstance(found, extended.Extended):
        yield np.array(list(found.values.values()))
        yield from _arrays(found.fish)
    elif isinstance(found, dict):
        yield from map(np.asarray, found.values())
    elif isinstance(found, (tuple, list)):
        for item in found:
            yield from _arrays(item)


#: Every reader.
NAMES = (
    "dataset.toml", "cpg.csv", "measured.csv", "tag.csv", "wave.parquet", "fish.toml", "run_1.csv", "map.toml",
    "pose.csv", "track.csv", "Amp20Bias-30.txt", "bag.mcap", "rollout.csv", "diagnosis.json", "saved.json",
    "planned.json", "film.csv", "markers.toml", "study.toml",
)  # fmt: skip
STEP = 0.02
ROWS = 51
TIME = np.round(np.arange(ROWS) * STEP, 6)


def _csv(table: Mapping[str, np.ndarray]) -> bytes:
    rows = zip(*(np.asarray(values).tolist() for values in table.values()), strict=True)
    return ("\n".join([",".join(table), *(",".join(map(repr, row)) for row in rows)]) + "\n").encode()


def _velocities() -> dict[str, np.ndarray]:
    wave = np.sin(18.0 * TIME)
    return {"time [s]": TIME, "surge [m/s]": 0.2 * TIME, "sway [m/s]": 0.1 * wave, "yaw_rate [rad/s]": 0.5 * wave}


def _angles() -> dict[str, np.ndarray]:
    return {f"joint_{joint + 1} [rad]": 0.4 * np.cos(18.0 * TIME - joint) for joint in range(4)}


_PATH = {"x [m]": 0.1 * TIME**2, "y [m]": 0.01 * np.sin(18.0 * TIME), "yaw [rad]": 0.02 * np.cos(18.0 * TIME)}
_DATASET = """\
schema = 1
name = "pool"
fish = "own.toml"
clock = "synchronised"
[noise]
surge = 0.01
sway = 0.01
yaw_rate = 0.05
[tank]
x = [-5.0, 5.0]
y = [-3.0, 3.0]
[start]
"c_d.tail" = {start = 1.8, low = 0.5, high = 3.0}
[known]
"*:start.surge" = {sd = 0.02}
[filter]
kind = "differentiated"
window = 7
degree = 2
[[trials]]
name = "cpg"
file = "cpg.csv"
role = "fit"
gaps = true
[[trials.drive]]
start = 0.0
omega = 18.0
bias = [0, 0, 0, 0]
[[trials.drive]]
start = 0.5
omega = 22.0
bias = [0, 1, 1.5, 2]
[[trials.sensors]]
kind = "position"
file = "tag.csv"
columns = {time = "t", x = "px", y = "py"}
place = {link = "head", station = 0.1}
sigma = [0.01, 0.01]
clock = "free"
[[trials.sensors]]
kind = "gyro"
file = "gyro.csv"
[[trials]]
name = "measured"
file = "measured.csv"
role = "held_out"
[[trials]]
name = "wave"
file = "wave.parquet"
[trials.drive]
kind = "wave"
frequency = 3.0
amplitude = [0.1, 0.2, 0.3, 0.4]
phase = [0.0, -0.5, -1.0, -1.5]
"""
_IDENTIFIED = f'''
[effects.servo_lag]
time_constant = 0.02

[identified]
geometry = "{fish.load_fish("pike").geometry}"
dataset = "pool"
by = "mjfish 0.1.0"
outcome = "converged"
range = {{ speed = [0.9, 1.5], beat = [2.8, 4.1] }}
intervals = {{ "c_d.tail" = [2.4, 2.6] }}
'''
_FISH = fish.shipped()["pike"].read_bytes() + _IDENTIFIED.encode()


def _parquet(table: Mapping[str, np.ndarray], path: Path) -> bytes:
    data.write_table(path, table)
    raw = path.read_bytes()
    path.unlink()
    return raw


_STUDY = """\
schema = 1
seeds = [1, 2]
[[generate]]
name = "lag"
fish = "own.toml"
modes = ["v1", "v3"]
duration = 2
noise = [0.006, 0.006, 0.04]
held_out = ["v3"]
effects = { servo_lag = { time_constant = 0.03 } }
values = { "c_d.tail" = 1.8 }
[[folder]]
name = "pool"
path = "."
[[identify]]
name = "drag"
free = ["c_d.*"]
loss = "huber"
starts = 2
[[diagnose]]
name = "cause"
"""
_WAVE = "[wave]\nfrequency = 2.9\namplitude = [0.1, 0.1, 0.1, 0.1]\nphase = [0, 0, 0, 0]\n"
_VELOCITIES_MAP = (
    'schema = 1\nkind = "velocities"\nfish = "pike"\nprefix = "run_"\ntime = "t"\nsurge = "u"\nsway = "v"\n'
    'yaw_rate = "r"\ntime_unit = "ms"\nlength_unit = "mm"\nangle_unit = "deg"\nsurge_to = "front"\n'
    "behind_nose = 0.1\nnoise = [1.0, 1.0, 1.0]\n"
    '[joints]\ncolumns = ["a", "b", "c", "d"]\nunit = "deg"\nsign = -1\n'
)
_BAG_MAP = (
    'schema = 1\nkind = "velocities"\nfish = "pike"\nsurge = "/fish.twist.x"\nsway = "/fish.twist.y"\n'
    'yaw_rate = "/fish.twist.z"\n[joints]\n'
    'columns = ["/joints.position.a", "/joints.position.b", "/joints.position.2", "/joints.position.3"]\n'
)
_POSES_MAP = (
    'schema = 1\nkind = "poses"\nfish = "pike"\ntime = "time [s]"\nx = "x [m]"\ny = "y [m]"\nyaw = "yaw [rad]"\n'
    '[joints]\ncolumns = ["joint_1 [rad]", "joint_2 [rad]", "joint_3 [rad]", "joint_4 [rad]"]\n'
)
STAMPED = "int32 sec\nuint32 nanosec"
_HEADER = f"builtin_interfaces/Time stamp\nstring frame_id\n{'=' * 80}\nMSG: builtin_interfaces/Time\n{STAMPED}"
TWIST = f"std_msgs/Header header\npool/Vector twist\n{'=' * 80}\nMSG: pool/Vector\nfloat64 x\nfloat64 y\nfloat64 z\n"
JOINTS = "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
OF_HEADER = f"{'=' * 80}\nMSG: std_msgs/Header\n{_HEADER}"


def bag(random: Random | None = None, *, checked: bool = True) -> bytes:
    """Return a bag of two topics; with a generator, some of its numbers and definitions are not what they should be."""

    def odd(value: Any, among: tuple[Any, ...]) -> Any:
        return value if random is None or random.random() < 0.995 else random.choice(among)

    numbers = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e20, 0.0)
    stamps = (0, -1, 2**31 - 1, -(2**31), 1)
    lines = (TWIST.replace("float64 z\n", ""), TWIST.replace("float64 x", "string x"), "", "float64[] twist\n")
    twist = TWIST if random is None or random.random() < 0.8 else random.choice(lines)
    kinds = (CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE)
    sink = BytesIO()
    compression = kinds[0] if random is None else random.choice(kinds)
    writer = Writer(sink, chunk_size=2000, compression=compression, enable_crcs=checked)
    kinds_of = writer.register_msgdef("pool/msg/Twist", twist + OF_HEADER)
    joints = writer.register_msgdef("pool/msg/Joints", JOINTS + OF_HEADER)
    for row in range(ROWS):
        sec = int(TIME[row]) + 100
        stamp = Message(sec=odd(sec, stamps), nanosec=odd(round(1e9 * (TIME[row] + 100 - sec)), (0, 2**32 - 1)))
        header = Message(stamp=stamp, frame_id="pool")
        logged = odd(round(1e9 * (TIME[row] + 100)), (0, 2**63, 2**64 - 1, 1))
        x, y, z = (odd(float(value), numbers) for value in (0.2 * TIME[row], 0.01, 0.3))
        messages = [
            ("/fish", kinds_of, Message(header=header, twist=Message(x=x, y=y, z=z))),
            (
                "/joints",
                joints,
                Message(
                    header=header,
                    name=odd(["a", "b"], ([], ["a"], ["a", "a"], ["\0", ""])),
                    position=odd([float(0.3 * np.sin(18.0 * TIME[row] - k)) for k in range(4)], ([], [math.nan] * 4)),
                ),
            ),
        ]
        for topic, kind, message in messages:
            try:
                writer.write_message(topic, kind, message, log_time=logged, publish_time=logged)
            except Exception:  # noqa: S112 - a definition that the message does not fit
                continue
    writer.finish()
    return sink.getvalue()


def _odd_bag(_: bytes, random: Random) -> bytes:
    return bag(random)


def _unchecked_bag(_: bytes, random: Random) -> bytes:
    """Bytes behind the checksums: what a damaged definition or length makes of the messages."""
    return mutations.corrupted(bag(checked=False), random)


def _tracks() -> bytes:
    parts = [f"part{k}" for k in range(2)]
    head = [["scorer", *["net"] * 6], ["bodyparts", *[p for p in parts for _ in range(3)]]]
    head += [["coords", *["x", "y", "likelihood"] * 2]]
    rows = [[str(frame), *(repr(float(v)) for v in (frame, 2.0, 0.9, 3.0, 4.0, 0.5))] for frame in range(30)]
    return ("\n".join(",".join(row) for row in [*head, *rows]) + "\n").encode()


def _markers(folder: Path) -> Any:
    text = (LAYOUTS / "fishsim.toml").read_text()
    table = tomlfile.parse(tomlfile.tomllib.loads(text), MarkersMap, "layout")
    named = table.model_copy(update={"markers": tuple(
        entry.model_copy(update={"name": f"part{k % 2}"}) for k, entry in enumerate(table.markers[:2]))})  # fmt: skip
    return [np.nan_to_num(read_tracks(folder / "track.csv", named), posinf=math.inf, neginf=-math.inf)]


def _film() -> bytes:
    points = 100.0 * np.arange(18) + np.sin(0.3 * np.arange(90))[:, None]
    return "\n".join(",".join(f"{value:.2f}" for value in row) for row in points).encode()


def _points(folder: Path) -> Any:
    """Read a film up to its points in metres: fitting a motion to them is slow."""
    path = folder / "markers.toml"
    table, fish, _ = read_mapping(path, MarkersMap, "markers")
    marked = placed(table, fish, path)
    points, scale = metres(folder / "film.csv", read_points(folder / "film.csv", table), table, marked)
    return [{"scale": scale, "points": np.nan_to_num(points, posinf=math.inf, neginf=-math.inf)}]


def _tail_run() -> bytes:
    time_ = 0.05 * np.arange(60)
    wave = np.sin(12.0 * time_)
    table = [time_, 0.1 + 0.01 * wave, 0.02 * wave, wave, 0.1 * wave, 0.1 * time_, 0.01 * wave]
    return "\n".join(" ".join(f"{v:.6f}" for v in row) for row in zip(*table, strict=True)).encode()


def _spaced(raw: bytes, random: Random) -> bytes:
    return mutations.rearranged_table(raw.replace(b" ", b","), random).replace(b",", b" ")


def _imported(importer: str, name: str, mapping: str | None = "map.toml") -> Callable[[Path], Any]:
    return lambda folder: import_files(
        importer, [folder / name], mapping=None if mapping is None else folder / mapping
    )[0]


def readers(folder: Path) -> dict[str, Reader]:
    """Return every reader by name; a folder to make files in."""
    table = (mutations.corrupted, mutations.rearranged_table)
    toml = (mutations.corrupted, mutations.rearranged_toml, mutations.rearranged_toml)
    laboratory = {"t": 1e3 * TIME, "u": 200.0 * TIME, "v": np.sin(18 * TIME), "r": 10.0 * np.sin(18 * TIME)}
    laboratory |= {name: 20.0 * np.cos(18.0 * TIME) for name in "abcd"}
    own = {
        "dataset.toml": _DATASET.encode(),
        "own.toml": fish.shipped()["pike"].read_bytes(),
        "cpg.csv": _csv(_velocities() | _PATH),
        "measured.csv": _csv(_velocities() | _angles()),
        "tag.csv": _csv({"t": TIME, "px": 0.1 * TIME, "py": 0.0 * TIME}),
        "gyro.csv": _csv({"time [s]": TIME, "yaw_rate [rad/s]": np.sin(18.0 * TIME)}),
        "wave.parquet": _parquet(_velocities(), folder / "wave.parquet"),
    }
    result = diagnosis()
    film_map = (LAYOUTS / "fishsim.toml").read_bytes().replace(b"missing = false", b"missing = true")
    told = json_text(result.to_dict()).encode()
    tail, pose = "Amp20Bias-30.txt", _csv({"time [s]": TIME, **_PATH, **_angles()})
    parquet = (mutations.corrupted, mutations.rearranged_parquet)
    bags = (mutations.corrupted, _odd_bag, _unchecked_bag)
    posterior = (mutations.corrupted, _of_posterior)
    tree = (mutations.corrupted, mutations.rearranged_json, _signed)
    run = {"run_1.csv": _csv(laboratory), "map.toml": _VELOCITIES_MAP.encode()}
    found = [
        Reader("dataset.toml", own["dataset.toml"], mjfish.load_dataset, toml, own),
        *(Reader(name, own[name], mjfish.load_dataset, table, own) for name in ("cpg.csv", "measured.csv", "tag.csv")),
        Reader("wave.parquet", own["wave.parquet"], mjfish.load_dataset, parquet, own),
        Reader("fish.toml", _FISH, lambda place: extended.load(place / "fish.toml"), toml),
        Reader("run_1.csv", run["run_1.csv"], _imported("velocities", "run_1.csv"), table, run),
        Reader("map.toml", run["map.toml"], _imported("velocities", "run_1.csv"), toml, run),
        Reader("pose.csv", pose, _imported("poses", "pose.csv"), table, {"map.toml": _POSES_MAP.encode()}),
        Reader("track.csv", _tracks(), _markers, table),
        Reader(tail, _tail_run(), _imported(str(_TAIL_FISH), tail, None), (mutations.corrupted, _spaced)),
        Reader("bag.mcap", bag(), _imported("mcap", "bag.mcap"), bags, {"map.toml": _BAG_MAP.encode()}),
        Reader("rollout.csv", _csv(_velocities()), lambda place: _rollout(place / "rollout.csv"), table),
        Reader("diagnosis.json", told, lambda place: mjfish.sample(place / "diagnosis.json", 1), posterior),
        Reader("saved.json", told, lambda place: mjfish.load_diagnosis(place / "saved.json"), tree),
        Reader("planned.json", told, lambda place: [load_fitted_models(place / "planned.json", result.dataset)], tree),
    ]
    found += [
        Reader("film.csv", _film(), _points, table, {"markers.toml": film_map}),
        Reader("markers.toml", film_map, _points, toml, {"film.csv": _film()}),
        Reader("study.toml", _STUDY.encode(), _inputs, toml, own),
    ]
    assert tuple(reader.name for reader in found) == NAMES
    return {reader.name: reader for reader in found}


def _inputs(folder: Path) -> list[Any]:
    """Return the numbers of the effects that act in each piece of a study, whose hash is made on the way."""
    found = read_cases(folder / "study.toml")
    assert all(case.key for case in found)
    return [acting(case.dataset, folder)[2] for case in found if isinstance(case.dataset, Generated)]


def _rollout(path: Path) -> dict[str, Any]:
    run = read_rollout(path)
    return {"time": run.time, "velocity": run.velocity}


def _signed(raw: bytes, random: Random) -> bytes:
    """Change what is read, and let the hash fit it."""
    try:
        content = mutations.json.loads(mutations.rearranged_json(raw, random))
        content.pop("sha256", None)
        return json_text(content | {"sha256": checksummed_json.digest(content)}).encode()
    except (ValueError, RecursionError, AttributeError, TypeError):
        return raw


def _of_posterior(raw: bytes, random: Random) -> bytes:
    """Change what is read of a diagnosis alone."""
    saved = mutations.json.loads(raw)
    saved["posterior"] = mutations.rearranged_tree(saved["posterior"], random)
    return mutations.json.dumps(saved).encode()
