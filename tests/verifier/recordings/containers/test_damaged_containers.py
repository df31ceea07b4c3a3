"""Truncated and damaged containers: said, with what can be read and how to repair it; no crash, no hang."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.verifier.recordings.bags import (
    WRITERS,
    files_of,
    joint_item,
    text_item,
    write_ros1,
    write_ros2,
)
from tests.verifier.recordings.samples import joint_states
from verifier.recordings import RecordingError
from verifier.recordings.containers import open_container

REPAIRS = (
    "rosbag reindex", "ros2 bag reindex", "mcap recover", "sqlite3", "name ", "rosbag fix", "import",
)  # fmt: skip
KINDS = [kind for kind in WRITERS if "zstd" not in kind]


def items():
    states = [joint_item(state) for state in joint_states(100.0, 1.0)]
    return sorted(
        [*states, *(text_item("/note", n * 10**8, "x") for n in range(10))], key=lambda item: item[2]
    )


def contents(path: Path) -> tuple[list[tuple[str, int, bytes]], str | None]:
    """Everything that is read, and what is said to be wrong with it."""
    try:
        container = open_container(path)
    except RecordingError as error:
        return [], str(error)
    read = []
    try:
        for record in container.records():
            read.append((record.channel.topic, record.log_time_ns, record.data))
    except RecordingError as error:
        return read, str(error)
    return read, container.damage


@pytest.mark.parametrize("kind", KINDS)
def test_truncated_anywhere_it_says_so_and_reads_the_beginning(tmp_path: Path, kind: str) -> None:
    name, write = WRITERS[kind]
    path = write(tmp_path / name, items())
    whole, said = contents(path)
    assert said is None
    assert len(whole) == len(items())
    file = files_of(path)[0]
    data = file.read_bytes()
    most = 0
    for part in range(50):
        file.write_bytes(data[: len(data) * part // 50])
        read, said = contents(path)
        assert said is not None, part
        assert any(repair in said for repair in REPAIRS), said
        assert "\n" not in said
        assert set(read) <= set(whole)
        most = max(most, len(read))
    assert most > len(whole) // 2 or kind == "ros2 sqlite"


@pytest.mark.parametrize("kind", KINDS)
def test_flipped_bytes_never_crash_nor_lose_a_message_quietly(tmp_path: Path, kind: str, rng, count) -> None:
    """Where nothing is said, every message is there: what has no checksum may differ, never be less."""
    name, write = WRITERS[kind]
    path = write(tmp_path / name, items())
    whole, _said = contents(path)
    file = files_of(path)[0]
    data = file.read_bytes()
    for _ in range(count(2000)):
        broken = bytearray(data)
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            broken[place] = rng.integers(256)
        file.write_bytes(broken)
        read, said = contents(path)
        assert said is not None or len(read) == len(whole)


def test_a_bag_that_was_not_ended_is_read_without_its_index(tmp_path: Path) -> None:
    """The position of the index is zero, as while recording."""
    path = write_ros1(tmp_path / "a.bag", items())
    data = path.read_bytes()
    field = data.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(data[:field] + bytes(8) + data[field + 8 :])
    container = open_container(path)
    assert container.damage == (
        "it has no index: the recording was not ended: 111 messages of its first 1.000 s can be read; "
        "`rosbag reindex a.bag` repairs it"
    )
    assert len(list(container.records())) == 111


def test_headers_that_claim_gigabytes_are_not_believed(tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", items())
    data = path.read_bytes()
    for place in (13, 13 + 4, data.index(b"size=") + 5):
        path.write_bytes(data[:place] + b"\xff\xff\xff\x7f" + data[place + 4 :])
        _read, said = contents(path)
        assert said is not None


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_chunks_are_not_unpacked_beyond_what_they_declare(tmp_path: Path, compression: str) -> None:
    path = write_ros1(tmp_path / "a.bag", [text_item("/note", 1, "x" * 1_000_000)], compression)
    data = path.read_bytes()
    place = data.index(b"size=") + 5
    path.write_bytes(data[:place] + (1000).to_bytes(4, "little") + data[place + 4 :])
    _read, said = contents(path)
    assert "another size than it says" in str(said)


def test_a_folder_without_metadata_is_read_and_said(tmp_path: Path) -> None:
    folder = write_ros2(tmp_path / "a", items())
    (folder / "metadata.yaml").unlink()
    read, said = contents(folder)
    assert len(read) == 111
    assert said == "has no metadata.yaml: 111 messages can be read; `ros2 bag reindex a` repairs it"


def test_storage_that_is_missing_or_not_listed_is_said(tmp_path: Path) -> None:
    folder = write_ros2(tmp_path / "a", items())
    shutil.copy(folder / "a.db3", folder / "a_1.db3")
    assert "a_1.db3 is not listed in metadata.yaml" in str(contents(folder)[1])
    (folder / "a.db3").rename(tmp_path / "gone.db3")
    assert "a.db3 of metadata.yaml is not there" in str(contents(folder)[1])


def test_metadata_that_promise_other_numbers_are_said(tmp_path: Path) -> None:
    import sqlite3

    folder = write_ros2(tmp_path / "a", items())
    with sqlite3.connect(folder / "a.db3") as database:
        database.execute("DELETE FROM messages WHERE id = 50")
    database.close()
    assert "metadata.yaml says" in str(contents(folder)[1])


@pytest.mark.parametrize(
    "text", ["", "a: [", "- 1", "rosbag2_bagfile_information: 3", "x: &a [*a]", "!!python/object:os.x {}"]
)
def test_metadata_that_are_none_are_refused(tmp_path: Path, text: str) -> None:
    folder = write_ros2(tmp_path / "a", items())
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(RecordingError, match=r"metadata\.yaml"):
        open_container(folder)


def test_a_database_that_was_not_closed_is_said(tmp_path: Path) -> None:
    folder = write_ros2(tmp_path / "a", items())
    (folder / "a.db3-wal").write_bytes(b"x" * 100)
    assert "was not closed: a part of it is in a.db3-wal" in str(contents(folder)[1])


def test_random_bytes_are_refused(tmp_path: Path, rng, count) -> None:
    heads = {"a.bag": b"#ROSBAG V2.0\n", "a.db3": b"SQLite format 3\0", "a.mcap": b"\x89MCAP0\r\n"}
    for name, head in heads.items():
        for _ in range(count(500)):
            tail = rng.integers(0, 256, int(rng.integers(0, 3000)), np.uint8).tobytes()
            (tmp_path / name).write_bytes(head + tail)
            read, said = contents(tmp_path / name)
            assert said is not None
            assert not read


@pytest.mark.parametrize("place", ["format", "file", "name"])
def test_metadata_that_grow_without_end_are_refused(tmp_path: Path, place: str) -> None:
    """Lists of ten references to the list before: as a text, each is ten times as long as that."""
    folder = write_ros2(tmp_path / "a", items())
    grown = ["  a0: &a0 [x]"] + [f"  a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 30)]
    values = {"format": "''", "file": "a.db3", "name": "/a"} | {place: "*a29"}
    text = [
        "rosbag2_bagfile_information:",
        *grown,
        f"  compression_format: {values['format']}",
        f"  relative_file_paths: [{values['file']}]",
        "  topics_with_message_count:",
        f"  - {{topic_metadata: {{name: {values['name']}, type: t}}, message_count: 1}}",
    ]
    (folder / "metadata.yaml").write_text("\n".join(text))
    with pytest.raises(RecordingError, match="where a text should be"):
        open_container(folder)
