"""Bags of ROS 2 in the MCAP format: topics by a mapping file, clocks of their own, and what goes wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace as Message

import numpy as np
import pytest
from doc_blocks import ROOT, blocks, commands, run_command
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_ros2.writer import Writer

import mjfish
from mjfish.data import Dataset, Trial, load_dataset, save
from mjfish.data.importers import FileReport, bags, import_files
from mjfish.data.importers.bags import read_bag
from mjfish.data.importers.mapping import VelocitiesMap
from mjfish.errors import MjfishError
from mjfish.files import tomlfile
from mjfish.numerics.arrays import FloatArray

RULE = "=" * 80
TIME = "int32 sec\nuint32 nanosec"
HEADER = f"builtin_interfaces/Time stamp\nstring frame_id\n{RULE}\nMSG: builtin_interfaces/Time\n{TIME}"
ODOMETRY = f"""std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
{RULE}
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
{RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{RULE}
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
{RULE}
MSG: geometry_msgs/TwistWithCovariance
geometry_msgs/Twist twist
float64[36] covariance
{RULE}
MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
{RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{RULE}
MSG: std_msgs/Header
{HEADER}"""
JOINTS = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{RULE}
MSG: std_msgs/Header
{HEADER}"""
NAMES = ["neck", "back", "stalk", "tail"]
#: The recorder begins at an hour of its own [s].
BEGUN = 1_700_000_000


@dataclass
class Bag:
    """Messages to write: (time, topic, message)."""

    messages: list[tuple[float, str, Message]] = field(default_factory=list)

    def odometry(self, time: float, pose: Sequence[float], velocity: Sequence[float]) -> None:
        """Add a pose and a velocity."""
        half = 0.5 * pose[2]
        self.messages.append(
            (time, "/fish/odom", Message(
                header=_header(time),
                child_frame_id="nose",
                pose=Message(
                    pose=Message(
                        position=Message(x=pose[0], y=pose[1], z=0.0),
                        orientation=Message(x=0.0, y=0.0, z=np.sin(half), w=np.cos(half)),
                    ),
                    covariance=[0.0] * 36,
                ),
                twist=Message(
                    twist=Message(
                        linear=Message(x=velocity[0], y=velocity[1], z=0.0),
                        angular=Message(x=0.0, y=0.0, z=velocity[2]),
                    ),
                    covariance=[0.0] * 36,
                ),
            ))
        )  # fmt: skip

    def joints(self, time: float, angles: Sequence[float]) -> None:
        """Joints in another order than the fish has them."""
        order = [2, 0, 3, 1]
        message = Message(
            header=_header(time),
            name=[NAMES[k] for k in order],
            position=[float(angles[k]) for k in order],
            velocity=[],
            effort=[],
        )
        self.messages.append((time, "/joint_states", message))

    def write(self, path: Path) -> Path:
        """Write the bag."""
        with path.open("wb") as stream:
            writer = Writer(stream)
            kinds = {
                "/fish/odom": writer.register_msgdef("nav_msgs/msg/Odometry", ODOMETRY),
                "/joint_states": writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS),
            }
            for time, topic, message in self.messages:
                nanoseconds = BEGUN * 10**9 + round(1e9 * (time + 0.3))  # the recorder is late
                writer.write_message(topic, kinds[topic], message, log_time=nanoseconds, publish_time=nanoseconds)
            writer.finish()
        return path


def _header(time: float) -> Message:
    nanoseconds = BEGUN * 10**9 + round(1e9 * time)
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


COLUMNS = (
    'surge = "/fish/odom.twist.twist.linear.x"\nsway = "/fish/odom.twist.twist.linear.y"\n'
    'yaw_rate = "/fish/odom.twist.twist.angular.z"\n'
)
PLACE = (
    'x = "/fish/odom.pose.pose.position.x"\ny = "/fish/odom.pose.pose.position.y"\n'
    'yaw = "/fish/odom.pose.pose.orientation.yaw"\n'
)
ANGLES = "[joints]\ncolumns = [" + ", ".join(f'"/joint_states.position.{name}"' for name in NAMES) + "]\n"
PAGE = ROOT / "docs" / "import-fishsim.md"


def mapped(folder: Path, columns: str = COLUMNS, kind: str = "velocities", drive: str = ANGLES) -> Path:
    path = folder / "map.toml"
    path.write_text(f'schema = 1\nkind = "{kind}"\nfish = "pike"\n{columns}{drive}')
    return path


def imported(folder: Path, bag: Bag, columns: str = COLUMNS, kind: str = "velocities") -> tuple[Dataset, FileReport]:
    dataset, report = import_files("mcap", [bag.write(folder / "run.mcap")], mapping=mapped(folder, columns, kind))
    return dataset, report.files[0]


def odometry(bag: Bag, start: float, end: float) -> list[Message]:
    return [one for time, topic, one in bag.messages if topic == "/fish/odom" and start < time < end]


def test_velocities_and_joints_of_a_bag_come_back(tmp_path: Path) -> None:
    bag, truth, told = swim()
    dataset, report = imported(tmp_path, bag)
    (trial,) = dataset.trials
    # Stamps are whole nanoseconds.
    np.testing.assert_allclose(trial.time, truth.time, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(trial.velocity, truth.velocity, atol=1e-12)
    assert trial.joint_angle is not None
    # A curve through 130 angles a second: 87 a beat.
    np.testing.assert_allclose(trial.joint_angle, told, atol=1e-4)
    assert "rows are the messages of /fish/odom" in report.notes
    assert "times of the headers" in report.notes
    assert "/joint_states interpolated to the rows" in report.notes


def test_the_commands_of_the_page_import_a_bag(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    bag.write(tmp_path / "run.mcap")
    (table,) = (block for block in blocks(PAGE, "toml") if "/fish/odom" in block)
    (tmp_path / "bag.toml").write_text(table)
    (line,) = (line for line in commands(PAGE) if line.startswith("mjfish import mcap"))
    run_command(line, tmp_path)
    (trial,) = load_dataset(tmp_path / "swimming").trials
    np.testing.assert_allclose(trial.velocity, truth.velocity, atol=1e-9)


def test_poses_of_a_bag_are_samples_of_sensors(tmp_path: Path) -> None:
    bag, truth, told = swim()
    poses = mjfish.Model(mjfish.load_fish("pike")).predict(truth, mjfish.load_fish("pike").values).pose
    dataset, _ = imported(tmp_path, bag, PLACE, "poses")
    (trial,) = dataset.trials
    place, heading = trial.sensors
    np.testing.assert_allclose(place.values, poses[:, :2], atol=1e-12)
    np.testing.assert_allclose(heading.values[:, 0], poses[:, 2], atol=1e-9)
    np.testing.assert_allclose(place.time, truth.time, rtol=0.0, atol=1e-9)
    assert not trial.measured.any()
    assert trial.joint_angle is not None
    np.testing.assert_allclose(trial.joint_angle, told, atol=1e-4)


def test_repeated_and_unsorted_messages_are_mended_and_said(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    bag.messages.insert(5, bag.messages[4])
    (early, topic, first), (late, _, second) = bag.messages[20:22]
    bag.messages[20:22] = [(late, topic, first), (early, topic, second)]
    dataset, report = imported(tmp_path, bag)
    np.testing.assert_allclose(dataset.trials[0].velocity, truth.velocity, atol=1e-12)
    assert "/fish/odom: messages out of order, sorted" in report.notes
    assert "/fish/odom: 1 repeated messages left out" in report.notes


def test_velocities_are_interpolated_over_short_dropouts_and_that_is_said(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    lost = {100, 150, 151}
    bag.messages = [one for k, one in enumerate(bag.messages) if k not in lost]
    dataset, report = imported(tmp_path, bag)
    (trial,) = dataset.trials
    np.testing.assert_allclose(trial.time, truth.time, rtol=0.0, atol=1e-9)
    error = np.abs(trial.velocity - truth.velocity)
    assert np.all(error[[k for k in range(len(error)) if k not in lost]] < 1e-12)
    assert np.all(error < 0.02 * np.ptp(truth.velocity, axis=0))
    assert "/fish/odom: 3 messages lost, longest gap 0.060 s" in report.notes
    assert "/fish/odom: 3 rows interpolated" in report.notes


@pytest.mark.parametrize("topic", ["/fish/odom", "/joint_states"])
def test_velocities_are_cut_at_a_gap_of_any_topic_and_can_be_saved(tmp_path: Path, topic: str) -> None:
    bag, truth, _ = swim()
    bag.messages = [one for one in bag.messages if not (one[1] == topic and 2.01 < one[0] < 2.41)]
    dataset, report = imported(tmp_path, bag)
    assert report.trials == ("run-a", "run-b")
    (cut,) = report.cuts
    assert (cut.start, cut.end) == (pytest.approx(2.02, abs=0.011), pytest.approx(2.42, abs=0.011))
    assert topic in cut.reason
    save(dataset, tmp_path / "saved")
    first, second = load_dataset(tmp_path / "saved").trials
    np.testing.assert_allclose(first.velocity, truth.velocity[: len(first.time)], atol=1e-9)
    np.testing.assert_allclose(second.velocity, truth.velocity[-len(second.time) :], atol=1e-9)


def test_poses_lost_in_a_gap_are_absent_and_the_joints_go_on(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    bag.messages = [one for one in bag.messages if not (one[1] == "/fish/odom" and 3.0 < one[0] < 3.4)]
    dataset, report = imported(tmp_path, bag, PLACE, "poses")
    assert (report.frames, report.usable) == (len(truth.time), len(truth.time) - 19)
    (trial,) = dataset.trials
    assert len(trial.time) == len(truth.time)
    for sensor in trial.sensors:
        assert len(sensor.time) == len(truth.time) - 19
        assert np.diff(sensor.time).max() == pytest.approx(0.4)


def test_rows_before_the_first_and_after_the_last_joint_angles_are_left_out(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    bag.messages = [one for one in bag.messages if one[1] == "/fish/odom" or 0.1 < one[0] < 5.9]
    dataset, report = imported(tmp_path, bag)
    inside = slice(6, len(truth.time) - 6)
    np.testing.assert_allclose(dataset.trials[0].velocity, truth.velocity[inside], atol=1e-12)
    assert "/fish/odom: 12 messages at the ends left out, where another topic has none" in report.notes


def test_one_clock_counts_for_all_topics(tmp_path: Path) -> None:
    """The recorder is 0.3 s late: joint angles by its clock beside poses by their headers would be half a beat off."""
    bag, _, told = swim()
    for _, topic, message in bag.messages:
        if topic == "/joint_states":
            message.header.stamp = Message(sec=0, nanosec=0)
    dataset, report = imported(tmp_path, bag)
    np.testing.assert_allclose(dataset.trials[0].joint_angle, told, atol=1e-4)
    assert "times of the recorder: /joint_states without times in the headers" in report.notes


def test_headers_of_two_clocks_give_way_to_the_recorder(tmp_path: Path) -> None:
    bag, _, told = swim()
    for _, topic, message in bag.messages:
        if topic == "/joint_states":
            message.header.stamp.sec -= 3600
    dataset, report = imported(tmp_path, bag)
    np.testing.assert_allclose(dataset.trials[0].joint_angle, told, atol=1e-4)
    assert any("the headers of /fish/odom and /joint_states are 3.6e+03 s apart" in note for note in report.notes)


def test_a_message_without_a_time_is_left_out(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    odometry(bag, 1.99, 2.01)[0].header.stamp = Message(sec=0, nanosec=0)
    dataset, report = imported(tmp_path, bag)
    np.testing.assert_allclose(dataset.trials[0].time, truth.time, rtol=0.0, atol=1e-9)
    assert "/fish/odom: 1 messages without a time left out" in report.notes


def test_a_quaternion_of_another_length_has_the_same_yaw_and_a_zero_one_none(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    whole, _ = imported(tmp_path, bag, PLACE, "poses")
    for message in odometry(bag, -1.0, 9.0):
        turn = message.pose.pose.orientation
        turn.z, turn.w = 2.0 * turn.z, 2.0 * turn.w
    again, _ = imported(tmp_path, bag, PLACE, "poses")
    heading, same = (one.trials[0].sensors[1] for one in (whole, again))
    np.testing.assert_allclose(same.values, heading.values, atol=1e-12)
    for message in odometry(bag, 3.0, 3.1):
        message.pose.pose.orientation = Message(x=0.0, y=0.0, z=0.0, w=0.0)
    _, report = imported(tmp_path, bag, PLACE, "poses")
    assert report.usable == len(truth.time) - len(odometry(bag, 3.0, 3.1))


def test_a_heading_of_another_topic_is_interpolated_over_half_a_turn(tmp_path: Path) -> None:
    """Between +pi and -pi lies no zero."""
    bag = Bag()
    for time in np.arange(0.0, 4.0, 0.02):
        bag.odometry(float(time), (0.0, 0.0, 2.0 * time), (0.0, 0.0, 0.0))
        bag.joints(float(time) + 0.01, np.full(4, time))
    heading = "/fish/odom.pose.pose.orientation.yaw"
    raw = {"schema": 1, "kind": "velocities", "fish": "pike", "joints": {"columns": ["/joint_states.position.neck"]}}
    table = tomlfile.parse(raw, VelocitiesMap, "map")
    read = read_bag(bag.write(tmp_path / "run.mcap"), table, ["/joint_states.position.neck", heading])
    np.testing.assert_allclose(read.numbers[heading], 2.0 * (read.numbers["time"] + 0.01), atol=1e-8)


def test_joints_of_two_publishers_and_commands_by_number(tmp_path: Path) -> None:
    """Of a topic with messages of some joints each; a list without names is read by number."""
    bag, _, told = swim()
    both = []
    for time, topic, message in bag.messages:
        if topic == "/joint_states":
            halves = [Message(**vars(message)), Message(**vars(message))]
            halves[0].name, halves[0].position = message.name[:2], message.position[:2]
            halves[1].name, halves[1].position = message.name[2:], message.position[2:]
            halves[1].header = _header(time + 0.003)
            both += [(time, topic, halves[0]), (time, topic, halves[1])]
        else:
            both.append((time, topic, message))
    dataset, _ = imported(tmp_path, Bag(both))
    # The second half was stamped 3 ms after its angles.
    np.testing.assert_allclose(dataset.trials[0].joint_angle, told, atol=0.3 * 2.0 * np.pi * 1.5 * 0.0031)
    numbered = mapped(tmp_path, drive=ANGLES.replace("position.neck", "position.1"))
    whole, _ = import_files("mcap", [swim()[0].write(tmp_path / "run.mcap")], mapping=numbered)
    np.testing.assert_allclose(whole.trials[0].joint_angle, told, atol=1e-4)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (
            COLUMNS.replace("/fish/odom.twist.twist.linear.x", "/pose.x"),
            r"unknown topic in .*'/pose'; known: /fish/odom \(nav_msgs/msg/Odometry\), /joint_states \(sensor_msgs",
        ),
        (COLUMNS.replace("linear.x", "linear.u"), "unknown field in .*'u'; known: x, y, z"),
        (COLUMNS.replace("linear.x", "linear"), "'twist.twist.linear' is no number"),
        (COLUMNS.replace("/fish/odom.twist.twist.linear.x", "surge"), "names no field of a topic"),
    ],
)
def test_what_a_bag_has_not_is_said(tmp_path: Path, columns: str, said: str) -> None:
    bag, _, _ = swim()
    with pytest.raises(MjfishError, match=said):
        import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path, columns))


@pytest.mark.parametrize(
    ("drive", "said"),
    [
        (ANGLES.replace("neck", "head"), "unknown field in .*/joint_states.*'head'; known: back, neck, stalk, tail"),
        (ANGLES.replace("position.neck", "velocity.neck"), "unknown field in .*/joint_states.*'neck'"),
        (ANGLES.replace("position.neck", "effect.neck"), "'effect'; known: effort, header, name, position, velocity"),
    ],
)
def test_a_joint_that_no_message_has_is_said(tmp_path: Path, drive: str, said: str) -> None:
    bag, _, _ = swim()
    with pytest.raises(MjfishError, match=said):
        import_files("mcap", [bag.write(tmp_path / "run.mcap")], mapping=mapped(tmp_path, drive=drive))


def test_a_topic_of_another_type_is_said(tmp_path: Path) -> None:
    bag, _, _ = swim()
    swapped = COLUMNS.replace("/fish/odom", "/joint_states")
    with pytest.raises(
        MjfishError, match=r"topic /joint_states \(sensor_msgs/msg/JointState\).*'twist'; known: effort"
    ):
        imported(tmp_path, bag, swapped)


def raw_bag(path: Path, encoding: str, schema: str, definition: str, data: bytes | None) -> Path:
    """Write a bag of one topic with a message that no ROS 2 writes, or none."""
    with path.open("wb") as stream:
        writer = RawWriter(stream)
        writer.start()
        number = writer.register_schema("nav_msgs/msg/Odometry", schema, definition.encode())
        channel = writer.register_channel("/fish/odom", encoding, number)
        if data is not None:
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("encoding", "schema", "data", "said"),
    [
        ("cdr", "ros2msg", None, "topic /fish/odom has no message"),
        ("json", "jsonschema", b"{}", "is not as ROS 2 writes them"),
        ("cdr", "ros2idl", b"\0\1\0\0", "is not as ROS 2 writes them"),
        ("cdr", "ros2msg", b"\0\1\0\0\0", "it breaks off or is damaged"),
    ],
)
def test_a_topic_without_messages_that_can_be_read(
    tmp_path: Path, encoding: str, schema: str, data: bytes | None, said: str
) -> None:
    path = raw_bag(tmp_path / "run.mcap", encoding, schema, ODOMETRY, data)
    drive = "[wave]\nfrequency = 1.0\namplitude = [0.1, 0.1, 0.1, 0.1]\nphase = [0.0, 0.0, 0.0, 0.0]\n"
    with pytest.raises(MjfishError, match=said):
        import_files("mcap", [path], mapping=mapped(tmp_path, drive=drive))


def test_topics_that_were_not_recorded_together_are_refused(tmp_path: Path) -> None:
    bag, _, _ = swim()
    bag.messages = [one for one in bag.messages if (one[1] == "/fish/odom") == (one[0] > 3.0)]
    with pytest.raises(MjfishError, match=r"no messages of all topics at one time \(/fish/odom 0\.000 to"):
        imported(tmp_path, bag)


def test_a_recording_of_short_stretches_is_refused(tmp_path: Path) -> None:
    bag, _, _ = swim()
    bag.messages = [one for one in bag.messages if one[1] == "/joint_states" or one[0] % 0.5 < 0.3]
    with pytest.raises(MjfishError, match="the longest stretch without a gap has"):
        imported(tmp_path, bag)


def test_a_bag_that_breaks_off_or_has_a_wrong_byte_among_its_messages_is_refused(tmp_path: Path) -> None:
    bag, _, _ = swim()
    path = bag.write(tmp_path / "run.mcap")
    table = mapped(tmp_path)
    content = path.read_bytes()
    for length in np.linspace(8, len(content) - 1, 40).astype(int):
        path.write_bytes(content[:length])
        with pytest.raises(MjfishError, match=r"cannot be read as MCAP, it breaks off or is damaged .*'mcap recover'"):
            import_files("mcap", [path], mapping=table)
    with BytesIO(content) as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    end = summary.chunk_indexes[0].chunk_start_offset + summary.chunk_indexes[0].chunk_length
    for place in np.linspace(end - summary.chunk_indexes[0].compressed_size, end - 1, 40).astype(int):
        path.write_bytes(content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :])
        with pytest.raises(MjfishError, match="it breaks off or is damaged"):
            import_files("mcap", [path], mapping=table)


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_bag_that_is_small_on_disk_alone_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: CompressionType
) -> None:
    """Its chunk says that it is empty: only unpacking it tells."""
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = RawWriter(stream, compression=compression, chunk_size=10**6)
        writer.start()
        number = writer.register_schema("nav_msgs/msg/Odometry", "ros2msg", ODOMETRY.encode())
        channel = writer.register_channel("/fish/odom", "cdr", number)
        writer.add_message(channel, 1, bytes(100_000), 1)
        writer.finish()
    content = path.read_bytes()
    with BytesIO(content) as stream:
        chunk = next(record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk))
    size = chunk.uncompressed_size.to_bytes(8, "little")
    path.write_bytes(content.replace(size, bytes(8), 1))
    for most, said in ((chunk.uncompressed_size, "/fish/odom"), (chunk.uncompressed_size - 1, "a chunk unpacks to")):
        monkeypatch.setattr(bags, "LARGEST_CHUNK", most)
        with pytest.raises(MjfishError, match=said):
            import_files("mcap", [path], mapping=mapped(tmp_path))


def test_a_mapping_file_that_is_none_of_a_bag_is_refused(tmp_path: Path) -> None:
    bag, _, _ = swim()
    path = bag.write(tmp_path / "run.mcap")
    with pytest.raises(MjfishError, match="kind is 'markers', expected 'poses' or 'velocities'"):
        import_files("mcap", [path], mapping=mapped(tmp_path, kind="markers"))
    with pytest.raises(MjfishError, match="time_unit: the times of a bag are in seconds; remove it"):
        import_files("mcap", [path], mapping=mapped(tmp_path, 'time_unit = "ms"\n' + COLUMNS))


def test_without_a_mapping_file_the_topics_are_named_and_one_is_proposed(tmp_path: Path) -> None:
    bag, truth, _ = swim()
    path = bag.write(tmp_path / "run.mcap")
    with pytest.raises(
        MjfishError, match=r"has the topics /fish/odom \(nav_msgs/msg/Odometry\), /joint_states"
    ) as caught:
        import_files("mcap", [path])
    names = ", ".join(f'"/joint_states.position.{name}"' for name in NAMES)
    proposed = _proposed(caught.value).replace("my_fish.toml", "pike")
    (tmp_path / "map.toml").write_text(proposed.replace('"/joint_states.position.NAME"', names))
    _, report = import_files("mcap", [path], mapping=tmp_path / "map.toml")
    assert report.files[0].frames == len(truth.time)


def _proposed(error: Exception) -> str:
    return "\n".join(line[4:] for line in str(error).splitlines() if line.startswith("    "))


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("run_0.db3", "looks like a rosbag2 folder of SQLite; convert it by 'ros2 bag convert' to MCAP"),
        ("run_0.mcap", "is a folder with a bag; import what is in it: run_0.mcap"),
        ("notes.txt", "is a folder, expected a file; name the files in it"),
    ],
)
def test_a_folder_is_told_what_it_is(tmp_path: Path, file: str, said: str) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / file).write_bytes(b"")
    for importer in ("mcap", "velocities", folder):
        for table in (None, mapped(tmp_path)):
            with pytest.raises(MjfishError, match=said):
                import_files(importer, [folder], mapping=table)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"SQLite format 3\x00rest", "looks like a rosbag2 database; convert it by 'ros2 bag convert'"),
        (b"MATLAB 5.0 MAT-file, Platform", "looks like a MATLAB file"),
        (b"\x89HDF\r\n", "an HDF5 file, or a MATLAB file of version 7.3"),
        (b"\x28\xb5\x2f\xfd", "looks like a Zstandard archive, such as .mcap.zstd"),
        (b"", "is empty"),
        (b"\xef\xbb\xbft,x,y,psi\r\n0,1,2,3\r\n", "the columns t, x, y, psi; import it as 'poses'"),
        (b"0.1,0.2,0.3\n1,2,3\n", "a CSV file of 3 columns without a header line"),
        (b't,u,v,r,"j ""1"""\n', r'columns = ["j \"1\""]'),
        (b"t,u,v,r," + b",".join(b"j%d" % k for k in range(999)) + b"\n", '"j998"]'),
        (b"\x00\x01\x02", "byte 1 is zero, as in a damaged or binary file"),
        (b"once upon a time\n", "looks like no table of numbers, found 'once upon a time' in line 1; give --separator"),
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
    proposed = _proposed(caught.value)
    (tmp_path / "map.toml").write_text(proposed.replace("my_fish.toml", "pike"))
    dataset, _ = import_files("velocities", [path], mapping=tmp_path / "map.toml")
    np.testing.assert_allclose(dataset.trials[0].velocity, truth.velocity, atol=1e-12)
