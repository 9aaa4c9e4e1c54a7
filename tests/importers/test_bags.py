"""Bags of ROS 2 in the MCAP format: topics by a mapping file, clocks of their own, and what goes wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace as Message

import numpy as np
import pytest
from mcap_ros2.writer import Writer

import mjfish
from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.data.importers import import_files
from mjfish.errors import MjfishError

RULE = "=" * 80
TIME = "int32 sec\nuint32 nanosec"
HEADER = f"builtin_interfaces/Time stamp\nstring frame_id\n{RULE}\nMSG: builtin_interfaces/Time\n{TIME}"
ODOMETRY = f"""std_msgs/Header header
geometry_msgs/Pose pose
geometry_msgs/Vector3 linear
{RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
{RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{RULE}
MSG: std_msgs/Header
{HEADER}"""
JOINTS = f"std_msgs/Header header\nstring[] name\nfloat64[] position\n{RULE}\nMSG: std_msgs/Header\n{HEADER}"
NAMES = ["neck", "back", "stalk", "tail"]
#: The recorder begins at an hour of its own [s].
BEGUN = 1.7e9


@dataclass
class Bag:
    """Messages to write: (time, topic, message)."""

    messages: list[tuple[float, str, Message]] = field(default_factory=list)

    def odometry(self, time: float, pose: Sequence[float], velocity: Sequence[float]) -> None:
        """Add a pose and a velocity."""
        half = 0.5 * pose[2]
        self.messages.append(
            (time, "/odom", Message(
                header=_header(time),
                pose=Message(
                    position=Message(x=pose[0], y=pose[1]),
                    orientation=Message(x=0.0, y=0.0, z=np.sin(half), w=np.cos(half)),
                ),
                linear=Message(x=velocity[0], y=velocity[1], z=velocity[2]),
            ))
        )  # fmt: skip

    def joints(self, time: float, angles: Sequence[float]) -> None:
        """Joints in another order than the fish has them."""
        order = [2, 0, 3, 1]
        message = Message(
            header=_header(time), name=[NAMES[k] for k in order], position=[float(angles[k]) for k in order]
        )
        self.messages.append((time, "/joints", message))

    def write(self, path: Path) -> Path:
        """Write the bag."""
        with path.open("wb") as stream:
            writer = Writer(stream)
            kinds = {
                "/odom": writer.register_msgdef("nav_msgs/msg/Odometry", ODOMETRY),
                "/joints": writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS),
            }
            for time, topic, message in self.messages:
                nanoseconds = round(1e9 * (BEGUN + time + 0.3))  # the recorder is late
                writer.write_message(topic, kinds[topic], message, log_time=nanoseconds, publish_time=nanoseconds)
            writer.finish()
        return path


def _header(time: float) -> Message:
    nanoseconds = round(1e9 * (BEGUN + time))
    return Message(stamp=Message(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), frame_id="")


def swim(joint_rate: float = 130.0) -> tuple[Bag, Trial, FloatArray]:
    """Return a bag of a simulated fish, the truth, and its joint angles at the times of the poses."""
    pool = mjfish.generate("pike", ["v3"], duration=6.0)
    (trial,) = pool.trials
    poses = mjfish.Model(pool.fish).predict(trial, pool.fish.values).pose
    bag = Bag()
    told = 0.3 * np.sin(2.0 * np.pi * 1.5 * trial.time[:, None] - np.arange(4.0))
    for time, pose, velocity in zip(trial.time, poses, trial.velocity, strict=True):
        bag.odometry(float(time), pose, velocity)
    for time in np.arange(-0.05, 6.1, 1.0 / joint_rate):
        bag.joints(float(time), 0.3 * np.sin(2.0 * np.pi * 1.5 * time - np.arange(4.0)))
    return bag, trial, told


COLUMNS = 'surge = "/odom.linear.x"\nsway = "/odom.linear.y"\nyaw_rate = "/odom.linear.z"\n'
ANGLES = "[joints]\ncolumns = [" + ", ".join(f'"/joints.position.{name}"' for name in NAMES) + "]\n"


def mapped(folder: Path, columns: str = COLUMNS, kind: str = "velocities", drive: str = ANGLES) -> Path:
    path = folder / "map.toml"
    path.write_text(f'schema = 1\nkind = "{kind}"\nfish = "pike"\n{columns}{drive}')
    return path


def test_velocities_and_joints_of_a_bag_come_back(tmp_path: Path) -> None:
    bag, truth, told = swim()
    dataset, report = import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path))
    (trial,) = dataset.trials
    np.testing.assert_allclose(trial.time, truth.time, atol=1e-6)
    np.testing.assert_allclose(trial.velocity, truth.velocity, atol=1e-9)
    assert trial.joint_angle is not None
    np.testing.assert_allclose(trial.joint_angle, told, atol=2e-3)
    notes = report.files[0].notes
    assert "/odom: times of its headers" in notes
    assert "/joints interpolated to them" in notes


def test_poses_of_a_bag_are_smoothed_to_velocities(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    place = 'x = "/odom.pose.position.x"\ny = "/odom.pose.position.y"\nyaw = "/odom.pose.orientation.yaw"\n'
    dataset, _ = import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path, place, "poses"))
    (trial,) = dataset.trials
    surge = np.interp(trial.time, truth.time, truth.velocity[:, 0])
    inside = (trial.time > 1.5) & (trial.time < 5.0)
    assert np.sqrt(np.mean((trial.velocity[inside, 0] - surge[inside]) ** 2)) < 0.05 * np.ptp(truth.velocity[:, 0])


def test_repeated_and_unsorted_messages_are_mended_and_said(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    bag.messages.insert(5, bag.messages[4])
    (early, topic, first), (late, _, second) = bag.messages[20:22]
    bag.messages[20:22] = [(late, topic, first), (early, topic, second)]
    dataset, report = import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path))
    assert len(dataset.trials[0].time) == len(truth.time)
    notes = " ".join(report.files[0].notes)
    assert "/odom: messages out of order, sorted" in notes
    assert "/odom: 1 repeated messages left out" in notes


def test_a_gap_of_the_joints_is_no_angle(tmp_path: Path) -> None:
    bag, _, _ = swim()
    bag.messages = [one for one in bag.messages if not (one[1] == "/joints" and 2.0 < one[0] < 2.5)]
    with pytest.raises(MjfishError, match=r"column '/joints\.position\.neck': missing"):
        import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path))


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (COLUMNS.replace("/odom.linear.x", "/pose.x"), r"unknown topic in .*'/pose'; known: /joints \(sensor_msgs"),
        (COLUMNS.replace("linear.x", "linear.u"), "unknown field in .*'u'; known: x, y, z"),
        (COLUMNS.replace("linear.x", "linear"), "'linear' is no number"),
        (COLUMNS.replace("/odom.linear.x", "surge"), "names no field of a topic"),
    ],
)
def test_what_a_bag_has_not_is_said(tmp_path: Path, columns: str, said: str) -> None:
    bag, _, _ = swim()
    with pytest.raises(MjfishError, match=said):
        import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path, columns))


def test_a_broken_bag_is_refused(tmp_path: Path) -> None:
    bag, _, _ = swim()
    path = bag.write(tmp_path / "run.mcap")
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(MjfishError, match="cannot be read as MCAP"):
        import_files("mcap", [path], mapping=mapped(tmp_path))
    with pytest.raises(MjfishError, match=r"needs a mapping file.*looks like a bag in the MCAP format"):
        import_files("mcap", [path])
    with pytest.raises(MjfishError, match="kind is 'markers', expected 'poses' or 'velocities'"):
        import_files("mcap", [path], mapping=mapped(tmp_path, kind="markers"))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"SQLite format 3\x00rest", "looks like a rosbag2 database; convert it by 'ros2 bag convert'"),
        (b"MATLAB 5.0 MAT-file, Platform", "looks like a MATLAB file"),
        (b"\x89HDF\r\n", "an HDF5 file, or a MATLAB file of version 7.3"),
        (b"\x00\x01\x02", "looks like no table of numbers"),
        (b"t,u,v,r,j1\n0,1,2,3,4\n", 'surge = "u"\n'),
        (b"Time [s],X (m),Y (m),heading\n0,1,2,3\n", 'x = "X (m)"\n'),
    ],
)
def test_a_file_that_no_importer_knows_is_told_what_it_looks_like(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "recording.dat"
    path.write_bytes(content)
    with pytest.raises(MjfishError) as without_map:
        import_files("velocities", [path])
    with pytest.raises(MjfishError) as as_importer:
        import_files(path, [path])
    assert said in str(without_map.value)
    assert said in str(as_importer.value)


def test_the_mapping_file_that_is_proposed_can_be_completed(tmp_path: Path) -> None:
    _, truth, told = swim()
    path = tmp_path / "run.csv"
    table = np.column_stack([truth.time, truth.velocity, told])
    np.savetxt(path, table, delimiter=",", header="t,u,v,r,j1,j2,j3,j4", comments="")
    with pytest.raises(MjfishError) as caught:
        import_files("velocities", [path])
    proposed = "\n".join(line[4:] for line in str(caught.value).splitlines() if line.startswith("    "))
    (tmp_path / "map.toml").write_text(proposed.replace("my_fish.toml", "pike"))
    dataset, _ = import_files("velocities", [path], mapping=tmp_path / "map.toml")
    np.testing.assert_allclose(dataset.trials[0].velocity, truth.velocity, atol=1e-12)
