"""MCAP in and out: against the readers of mcap and rosbags; damage is refused in one line."""

import io
import itertools

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from tests.verifier.recordings.samples import JOINTS, joint_states, reports, write_all
from verifier.recordings import Reading, Recording, RecordingError
from verifier.recordings.joint_state import SCHEMA, SCHEMA_NAME, JointState, encode
from verifier.recordings.mcap_file import McapFile


@pytest.fixture
def path(tmp_path):
    return write_all(tmp_path / "a.mcap", [*joint_states(), *reports()])


def test_mcap_and_rosbags_read_the_joints_that_we_write(path):
    ros = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("rb") as stream:
        read = [
            (message.log_time, ros.deserialize_cdr(message.data, schema.name))
            for schema, _, message in make_reader(stream).iter_messages(topics=["/joint_states"])
        ]
    wrote = joint_states()
    assert [time for time, _ in read] == [state.stamp_ns for state in wrote]
    for (_, message), state in zip(read, wrote, strict=True):
        assert tuple(message.name) == state.names
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == state.stamp_ns
        np.testing.assert_array_equal(message.position, state.position)


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_reads_what_rosbags_writes(tmp_path, mode):
    ros = get_typestore(Stores.ROS2_HUMBLE)
    header, stamp = ros.types["std_msgs/msg/Header"], ros.types["builtin_interfaces/msg/Time"]
    bag = BagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        connection = bag.add_connection("/joint_states", SCHEMA_NAME, typestore=ros)
        for state in joint_states(start_ns=10**18):
            message = ros.types[SCHEMA_NAME](
                header=header(
                    stamp=stamp(sec=state.stamp_ns // 10**9, nanosec=state.stamp_ns % 10**9), frame_id="base"
                ),
                name=list(state.names),
                position=state.position,
                velocity=state.position,
                effort=np.zeros(0),
            )
            bag.write(connection, state.stamp_ns + 1000, ros.serialize_cdr(message, SCHEMA_NAME))
    reading = Reading(Recording(tmp_path / "bag" / "bag.mcap"), JOINTS, people=False)
    (window,) = reading.windows(100.0, 0.0, 0.0)
    np.testing.assert_array_equal(window.q, [state.position for state in joint_states()])
    np.testing.assert_array_equal(window.t, [state.stamp_ns / 1e9 for state in joint_states()])


def test_mcap_reads_what_we_write_in_the_same_order(path):
    with path.open("rb") as stream:
        theirs = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(stream).iter_messages()]
    ours = [(m.channel.topic, m.log_time, m.data) for m in McapFile(path).messages()]
    assert ours == theirs
    assert len(ours) == 201 + 101


@pytest.mark.parametrize("compression", CompressionType)
def test_reads_every_compression_and_chunks_that_overlap_in_time(tmp_path, rng, compression):
    path = tmp_path / "mixed.mcap"
    times = rng.permutation(1000)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=2000, compression=compression)
        writer.start()
        channels = [writer.register_channel(topic, "json", 0) for topic in ("/a", "/b")]
        for n, time in enumerate(times):
            writer.add_message(channels[n % 2], int(time), b"%d" % time, int(time))
        writer.finish()
    file = McapFile(path)
    assert len(file._chunks) > 10
    assert [m.log_time for m in file.messages()] == list(range(1000))
    assert [m.log_time for m in file.messages(["/a"])] == sorted(times[::2])
    assert [m.log_time for m in file.last("/b")] == sorted(times[1::2], reverse=True)
    assert list(file.messages(["/none"])) == []


def test_unpacks_no_more_than_it_must(tmp_path):
    path = write_all(tmp_path / "long.mcap", joint_states(rate_hz=1000.0, seconds=30.0))
    file = McapFile(path)
    assert len(file._chunks) >= 3
    taken = []
    unpack = file._unpack
    file._unpack = lambda stream, index, wanted: taken.append(index) or unpack(stream, index, wanted)
    list(itertools.islice(file.messages(), 10))
    assert len(taken) == 1


def test_every_truncation_is_refused_with_the_tool_that_repairs(path, tmp_path, count, rng):
    data = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    for size in rng.integers(8, len(data), count(10_000)):
        cut.write_bytes(data[:size])
        with pytest.raises(RecordingError) as caught:
            Recording(cut)
        assert "`mcap recover cut.mcap -o FIXED.mcap` repairs it" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_flipped_bit_in_a_message_is_noticed(tmp_path):
    path = tmp_path / "plain.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema(SCHEMA_NAME, "ros2msg", SCHEMA)
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for state in joint_states():
            writer.add_message(channel, state.stamp_ns, encode(state), state.stamp_ns)
        writer.finish()
    assert len(Reading(Recording(path), JOINTS, people=False).joints) == 2
    data = bytearray(path.read_bytes())
    value = joint_states()[100].position[1:].tobytes()
    data[data.index(value) + 3] ^= 1
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"damaged \(crc validation failed in Chunk"):
        Recording(path)


def test_damage_never_raises_anything_else(path, tmp_path, count, rng):
    """Most flips are noticed by the checksums of the chunks; none may end in another exception."""
    data = path.read_bytes()
    damaged = tmp_path / "damaged.mcap"
    refused = 0
    for _ in range(count(8_000)):
        bad = bytearray(data)
        for place in rng.integers(0, len(bad), 3):
            bad[place] ^= 1 << int(rng.integers(0, 8))
        damaged.write_bytes(bad)
        try:
            for _window in Reading(Recording(damaged), JOINTS).windows(1.0, 0.0, 0.0):
                pass
        except RecordingError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 0


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "is not an MCAP file"),
        (b"PK\x03\x04", "is not an MCAP file"),
        (b"#ROSBAG V2.0\n", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "ends early or is damaged"),
    ],
)
def test_other_files_are_refused(tmp_path, content, why):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=why):
        Recording(path)


def test_no_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"none\.mcap: does not exist"):
        Recording(tmp_path / "none.mcap")
    with pytest.raises(RecordingError, match="is a folder"):
        Recording(tmp_path)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"use_chunking": False}, "is not divided into chunks"),
        ({"index_types": IndexType.NONE}, "is not divided into chunks"),
        ({"use_statistics": False}, "has no index"),
        (
            {
                "use_statistics": False,
                "index_types": IndexType.NONE,
                "repeat_channels": False,
                "repeat_schemas": False,
                "use_summary_offsets": False,
            },
            "has no index",
        ),
    ],
)
def test_a_file_without_index_is_refused(tmp_path, options, why):
    path = tmp_path / "plain.mcap"
    stream = io.BytesIO()
    writer = Writer(stream, **options)
    writer.start()
    writer.add_message(writer.register_channel("/a", "json", 0), 1, b"{}", 1)
    writer.finish()
    path.write_bytes(stream.getvalue())
    with pytest.raises(RecordingError, match=f"{why}; `mcap recover"):
        McapFile(path)


@pytest.mark.parametrize("size", [8, 9, 20, 36])
def test_a_file_that_ends_after_its_first_bytes_ends_early(tmp_path, size):
    whole = write_all(tmp_path / "whole.mcap", [*joint_states(), *reports()])
    path = tmp_path / "short.mcap"
    path.write_bytes(whole.read_bytes()[:size])
    with pytest.raises(RecordingError, match="ends early or is damaged") as caught:
        McapFile(path)
    assert "Errno" not in str(caught.value)


def test_same_messages_same_bytes(tmp_path):
    one = write_all(tmp_path / "one.mcap", [*joint_states(), *reports()])
    two = write_all(tmp_path / "two.mcap", [*joint_states(), *reports()])
    assert one.read_bytes() == two.read_bytes()


def test_a_name_that_does_not_print_stays_on_one_line(tmp_path):
    path = tmp_path / "two\nlines.mcap"
    path.write_bytes(b"no")
    with pytest.raises(RecordingError) as caught:
        Recording(path)
    assert "\n" not in str(caught.value)


def test_joint_names_are_found_whoever_publishes_them(tmp_path):
    gripper = [JointState(5_000_000, ("finger",), np.zeros(1))]
    path = write_all(tmp_path / "a.mcap", [*joint_states(), *gripper])
    assert Recording(path).joint_names == (*JOINTS, "finger")
