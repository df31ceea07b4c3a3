"""The index of an MCAP file: what it leaves out, or says wrongly, is never left out silently."""

import io
import os
import struct
import tracemalloc

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from tests.verifier.recordings.samples import joint_states, person, reports, write_all
from verifier.recordings import Recording, RecordingError, inspect_recording
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.mcap_index import FOOTER, _check_sum

CHANNELS = ("/a", "/b", "/c")


def write(path, compression=CompressionType.ZSTD, messages=60, chunk_size=100, **options):
    """Messages on three topics in many small chunks, each of one topic; returns the path."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk_size, compression=compression, **options)
    writer.start()
    channels = [writer.register_channel(topic, "json", 0) for topic in CHANNELS]
    for n in range(messages):
        writer.add_message(channels[n // 4 % 3], n, b"%0100d" % n, n)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


def index_of(path):
    """Bytes of a file, and where its index begins and its checksum stands."""
    data = path.read_bytes()
    footer = len(data) - FOOTER.size
    start = FOOTER.unpack_from(data, footer)[2]
    return data, start, len(data) - 12


def refused(path):
    with pytest.raises(RecordingError) as caught:
        list(McapFile(path).messages(["/a", "/b"]))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_checksum_is_that_of_the_writer(tmp_path):
    path = write(tmp_path / "a.mcap")
    data, _start, place = index_of(path)
    assert struct.unpack_from("<I", data, place)[0] != 0
    with path.open("rb") as stream:
        _check_sum(stream)
    assert len(list(McapFile(path).messages())) == 60


def test_every_flipped_bit_of_the_index_is_noticed(tmp_path, count, rng):
    data, start, place = index_of(write(tmp_path / "a.mcap"))
    flipped = tmp_path / "flipped.mcap"
    places = rng.integers(start, place + 4, count(8_000))
    for byte, bit in zip(places, rng.integers(0, 8, len(places)), strict=True):
        bad = bytearray(data)
        bad[byte] ^= 1 << int(bit)
        flipped.write_bytes(bad)
        assert "`mcap recover flipped.mcap -o FIXED.mcap` repairs it" in refused(flipped)


def test_without_a_checksum_no_flipped_bit_hides_or_moves_a_message(tmp_path, count, rng):
    path = write(tmp_path / "a.mcap")
    data, start, place = index_of(path)
    data = data[:place] + bytes(4) + data[place + 4 :]
    path.write_bytes(data)
    wanted = ["/a", "/b"]
    good = [(m.channel.topic, m.log_time, m.data) for m in McapFile(path).messages(wanted)]
    assert len(good) == 40
    flipped = tmp_path / "flipped.mcap"
    differ = 0
    places = rng.integers(start, place, count(8_000))
    for byte, bit in zip(places, rng.integers(0, 8, len(places)), strict=True):
        bad = bytearray(data)
        bad[byte] ^= 1 << int(bit)
        flipped.write_bytes(bad)
        try:
            found = McapFile(flipped)
            read = [(m.channel.topic, m.log_time, m.data) for m in found.messages(wanted)]
        except RecordingError:
            continue
        renamed = {c.topic for c in found.channels.values()} != set(CHANNELS)
        differ += read != good and not renamed
    assert differ == 0


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"repeat_channels": False}, "has an index that does not say which topics and schemas there are"),
        ({"repeat_schemas": False}, "has an index that does not say which topics and schemas there are"),
    ],
)
def test_an_index_without_channels_or_schemas_is_refused(tmp_path, options, why):
    stream = io.BytesIO()
    writer = Writer(stream, **options)
    writer.start()
    schema = writer.register_schema("S", "jsonschema", b"{}")
    writer.add_message(writer.register_channel("/a", "json", schema), 1, b"{}", 1)
    writer.finish()
    path = tmp_path / "a.mcap"
    path.write_bytes(stream.getvalue())
    for read in (McapFile, Recording, inspect_recording):
        with pytest.raises(RecordingError, match=f"{why}.*; `mcap recover"):
            read(path)


@pytest.mark.parametrize("compression", CompressionType)
def test_the_messages_backwards_are_those_forwards(tmp_path, rng, compression):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=500, compression=compression)
        writer.start()
        channels = [writer.register_channel(topic, "json", 0) for topic in ("/a", "/b")]
        for n, time in enumerate(rng.integers(0, 300, 1000)):
            writer.add_message(channels[n % 2], int(time), b"%d" % n, int(time))
        writer.finish()
    file = McapFile(path)
    forwards = [(m.log_time, m.data, m.place) for m in file.messages(["/a"])]
    backwards = [(m.log_time, m.data, m.place) for m in file.last("/a")]
    assert len(forwards) == 500
    assert sorted(backwards) == sorted(forwards)
    assert [time for time, *_ in backwards] == [time for time, *_ in forwards][::-1]


# ------------------------------------------------------------------------------------------------- memory


def with_camera(path, compression, size):
    """Joints and reports, and between them a chunk of a camera that unpacks to ``size`` zeros."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=1000, compression=compression)
    writer.start()
    topics = [writer.register_channel(topic, "json", 0) for topic in ("/a", "/camera")]
    for n in range(20):
        writer.add_message(topics[0], n, b"%0200d" % n, n)
    writer.add_message(topics[1], 20, bytes(size), 20)
    for n in range(21, 40):
        writer.add_message(topics[0], n, b"%0200d" % n, n)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_unpacks_to_too_much_is_refused_before_it_is(tmp_path, monkeypatch, compression):
    monkeypatch.setattr("verifier.recordings.mcap_chunk.MAX_CHUNK_BYTES", 1 << 20)
    file = McapFile(with_camera(tmp_path / "a.mcap", compression, 30 << 20))
    tracemalloc.start()
    assert len(list(file.messages(["/a"]))) == 39
    with pytest.raises(
        RecordingError, match="unpacks to 30 MiB, more than 1 MiB; rewrite it: `mcap compress"
    ):
        list(file.messages())
    assert tracemalloc.get_traced_memory()[1] < 5 << 20
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("compression", "pack"),
    [(CompressionType.ZSTD, zstandard.compress), (CompressionType.LZ4, lz4.frame.compress)],
)
def test_a_chunk_that_holds_more_than_it_says_is_not_unpacked(tmp_path, compression, pack):
    path = with_camera(tmp_path / "a.mcap", compression, 40 << 20)
    data, huge = path.read_bytes(), 40 << 20
    size = struct.pack("<Q", huge + 31)  # opcode, length and head of the message come before its bytes
    first, last, small = data.index(size), data.rindex(size), struct.pack("<Q", 1 << 10)
    assert first < last, "in the head of the chunk, and in the index"
    data = data[:first] + small + data[first + 8 : last] + small + data[last + 8 :]
    path.write_bytes(data[:-12] + bytes(4) + data[-8:])
    file = McapFile(path)
    tracemalloc.start()
    with pytest.raises(RecordingError, match="damaged"):
        list(file.messages())
    assert tracemalloc.get_traced_memory()[1] < 5 << 20
    tracemalloc.stop()
    assert len(pack(bytes(huge))) < 1 << 18


# -------------------------------------------------------------------------------------------- other files


def test_a_pipe_is_refused_for_what_it_is(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(RecordingError, match="is a pipe or device, not a file; save it as a file first"):
        Recording(path)


def test_a_message_time_beyond_what_can_be_counted_is_refused(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_message(writer.register_channel("/a", "json", 0), 2**63 + 5, b"{}", 1)
        writer.finish()
    with pytest.raises(
        RecordingError, match=r"/a: a message time is 9223372036854775813 ns, beyond the year"
    ):
        list(McapFile(path).messages())


def test_records_of_two_robots_in_one_file_are_refused(tmp_path):
    def twice(*values):
        def also(writer):
            for value in values:
                writer.describe({"robot": value})

        return also

    same = write_all(tmp_path / "same.mcap", joint_states(), twice("ur5", "ur5"))
    assert Recording(same).robot == "ur5"
    path = write_all(tmp_path / "a.mcap", joint_states(), twice("ur5", "ur10"))
    with pytest.raises(RecordingError, match="metadata stopproof: several records contradict each other"):
        Recording(path)


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, "1" * 5000, "[1]", '[{"name": "a", "name": "b"}]', '{"a": 1}', "no\njson"],
    ids=["deep", "long", "number", "twice", "object", "text"],
)
def test_assumptions_that_cannot_be_read_are_shown_as_such(tmp_path, text):
    path = write_all(
        tmp_path / "a.mcap", [*joint_states(), *reports()], lambda w: w.describe({"assumptions": text})
    )
    (assumption,) = Recording(path).assumptions
    assert "not a readable list" in assumption.source
    assert len(str(assumption.value)) <= 201 and "\n" not in str(assumption.value)
    assert any("not a readable list" in line for line in inspect_recording(path).lines())


def test_a_person_in_a_chunk_of_their_own_is_never_lost(tmp_path, monkeypatch):
    """One flipped bit in the list of channels of a chunk used to take the only report of somebody away."""
    monkeypatch.setattr("verifier.recordings.mcap_file.CHUNK_SIZE", 100)
    seen = reports()
    seen[50] = seen[50].__class__(seen[50].stamp_ns, seen[50].arrived_ns, "world", False, (person("near"),))
    path = write_all(tmp_path / "a.mcap", [*joint_states(), *seen])
    data, start, _place = index_of(path)
    key = struct.pack("<QQ", seen[50].arrived_ns, seen[50].arrived_ns)
    where = data.index(key, start) + 16 + 8 + 8 + 4
    assert np.frombuffer(data, np.uint16, 1, where)[0] in McapFile(path).channels
    flipped = bytearray(data)
    flipped[where] ^= 8
    path.write_bytes(flipped)
    with pytest.raises(RecordingError, match="damaged"):
        Recording(path)
