"""ROS 2 bags: a folder with ``metadata.yaml`` and storage files (``.db3`` or ``.mcap``), one or several."""

from __future__ import annotations

import heapq
import re
import shutil
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import zstandard
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from verifier.recordings.containers.container import MAX_MESSAGE_BYTES, Record
from verifier.recordings.containers.mcap_container import open_mcap
from verifier.recordings.containers.ros2_sqlite import Sqlite3Storage
from verifier.recordings.containers.stored import Stored
from verifier.recordings.errors import RecordingError
from verifier.recordings.topic import Topic

METADATA = "metadata.yaml"
MAX_METADATA_BYTES = 1 << 20
MAX_UNPACKED_BYTES = 1 << 34
"""A compressed storage file may unpack to 16 GiB; it is unpacked into a temporary folder."""
ENDINGS = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
BLOCK = 1 << 20


@dataclass(frozen=True, slots=True)
class _Metadata:
    """What ``metadata.yaml`` says: files in order, how they are compressed, messages by topic and type."""

    files: tuple[str, ...]
    compression: str
    counts: Mapping[tuple[str, str], int]


class Ros2Folder(Stored):
    """A ROS 2 bag; see :class:`verifier.recordings.containers.container.Container`.

    Raises
    ------
    RecordingError
        The folder holds no storage file, its metadata cannot be read, or its compression is not known.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._repair = f"`ros2 bag reindex {path.name or path}` repairs it"
        present = sorted((each for each in path.iterdir() if _is_storage(each)), key=_by_number)
        about = _read_metadata(path / METADATA, self._repair) if (path / METADATA).exists() else None
        files, damage = self._files(present, about)
        if not files:
            wrong = "is a folder without metadata.yaml, .db3 or .mcap"
            raise RecordingError(path, "", damage[0] if damage else wrong, "name a ROS 2 bag or an MCAP file")
        self._unpacked: TemporaryDirectory[str] | None = None
        compression = "" if about is None else about.compression
        self._parts = [self._open(file, compression) for file in files]
        damage += [f"{part.path.name}: {part.damage}" for part in self._parts if part.damage is not None]
        found: Counter[tuple[str, str, str]] = Counter()
        for part in self._parts:
            for topic in part.topics:
                found[topic.name, topic.schema, topic.encoding] += topic.messages
        if about is not None and not damage:
            damage += self._differences(found, about)
        if damage:
            read = f"{found.total()} messages can be read"
            self.damage = (
                f"{damage[0]}: {read}; {self._repair}" if "can be read" not in damage[0] else damage[0]
            )
        self.topics = tuple(Topic(*key, found[key]) for key in sorted(found))
        self.channels = tuple(dict.fromkeys(channel for part in self._parts for channel in part.channels))

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` in order of log time."""
        streams = (self._numbered(number, topics) for number in range(len(self._parts)))
        return heapq.merge(*streams, key=lambda record: (record.log_time_ns, record.place))

    def _numbered(self, number: int, topics: Collection[str] | None) -> Iterator[Record]:
        for record in self._parts[number].records(topics):
            yield record._replace(place=(number, *record.place))

    def _files(self, present: list[Path], about: _Metadata | None) -> tuple[list[Path], list[str]]:
        """The storage files in order, and what is wrong with them."""
        if about is None:
            return present, [f"has no {METADATA}"] if present else []
        names = [each.name for each in present]
        missing = [name for name in about.files if name not in names]
        more = [name for name in names if name not in about.files]
        damage = [f"{', '.join(missing)} of {METADATA} is not there"] if missing else []
        damage += [f"{', '.join(more)} is not listed in {METADATA}"] if more else []
        return [self.path / name for name in about.files if name in names], damage

    def _open(self, file: Path, compression: str) -> Stored:
        """Open a storage file, unpacked first where it is compressed as a whole."""
        data = self._inflated(file) if file.suffix == ".zstd" else file
        inner = file.name.removesuffix(".zstd")
        if inner.endswith(".mcap"):
            if compression == "message":
                right = "rewrite it with `ros2 bag convert` without compression"
                raise RecordingError(file, "", "is an MCAP file with messages compressed one by one", right)
            return open_mcap(data)
        return Sqlite3Storage(file, data, inflate_message if compression == "message" else None)

    def _inflated(self, file: Path) -> Path:
        if self._unpacked is None:
            self._unpacked = TemporaryDirectory(prefix="stopproof-")
        target = Path(self._unpacked.name) / file.name.removesuffix(".zstd")
        total = 0
        try:
            with file.open("rb") as packed, target.open("wb") as out:
                stream = zstandard.ZstdDecompressor().stream_reader(packed)
                while block := stream.read(BLOCK):
                    total += len(block)
                    if total > MAX_UNPACKED_BYTES:
                        wrong = f"unpacks to more than {MAX_UNPACKED_BYTES >> 30} GiB"
                        raise RecordingError(file, "", wrong, "split it with `ros2 bag convert`")
                    out.write(block)
        except (zstandard.ZstdError, OSError) as error:
            free = shutil.disk_usage(self._unpacked.name).free
            wrong = f"cannot be unpacked ({error}; {free / 2**30:.1f} GiB are free)"
            raise RecordingError(file, "", wrong, self._repair) from error
        return target

    def _differences(self, found: Mapping[tuple[str, str, str], int], about: _Metadata) -> Iterator[str]:
        """Yield where the files hold other numbers of messages than the metadata say."""
        held: Counter[tuple[str, str]] = Counter()
        for (topic, schema, _encoding), number in found.items():
            held[topic, schema] += number
        for topic, schema in sorted(held.keys() | about.counts.keys()):
            there, stated = held[topic, schema], about.counts.get((topic, schema), 0)
            if there != stated:
                yield f"{there} messages on {topic}, {METADATA} says {stated}"
                return


def inflate_message(data: bytes) -> bytes:
    """Unpack one message.

    Raises
    ------
    ValueError
        It is damaged or too large.
    """
    try:
        message = zstandard.ZstdDecompressor().stream_reader(data).read(MAX_MESSAGE_BYTES + 1)
    except zstandard.ZstdError as error:
        raise ValueError(f"a message cannot be unpacked ({error})") from error
    if len(message) > MAX_MESSAGE_BYTES:
        raise ValueError(f"a message unpacks to more than {MAX_MESSAGE_BYTES >> 20} MiB")
    return bytes(message)


def _is_storage(path: Path) -> bool:
    return path.name.endswith(ENDINGS) and path.is_file()


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Sort ``bag_10`` behind ``bag_9``."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", path.name)]


def _read_metadata(path: Path, repair: str) -> _Metadata:
    try:
        with path.open("rb") as stream:
            text = stream.read(MAX_METADATA_BYTES + 1)
        if len(text) > MAX_METADATA_BYTES:
            raise RecordingError(path, "", f"has more than {MAX_METADATA_BYTES >> 20} MiB", repair)
        table = YAML(pure=True).load(text.decode())  # makes maps, lists and scalars, whatever the tags say
        return _metadata(table["rosbag2_bagfile_information"], path)
    except OSError as error:
        raise RecordingError(path, "", f"cannot be read: {error.strerror or error}") from error
    except RecordingError:
        raise
    except (YAMLError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise RecordingError(
            path, "", f"cannot be read as metadata of a ROS 2 bag ({reason})", repair
        ) from error


def _metadata(table: Mapping[str, Any], path: Path) -> _Metadata:
    packing, mode = (_text(table.get(f"compression_{key}") or "") for key in ("format", "mode"))
    mode = mode.lower()
    mode = "" if mode == "none" else mode
    if mode not in ("", "file", "message") or (mode and packing != "zstd"):
        wrong = f"compression {packing[:40]!r} of {mode[:40]!r} is not read"
        raise RecordingError(path, "", wrong, "rewrite it with `ros2 bag convert` without compression")
    counts: Counter[tuple[str, str]] = Counter()
    for entry in table["topics_with_message_count"]:
        about = entry["topic_metadata"]
        counts[_text(about["name"]), _text(about["type"])] += int(entry["message_count"])
    files = tuple(PurePosixPath(_text(each)).name for each in table["relative_file_paths"])
    return _Metadata(files, mode, counts)


def _text(value: object) -> str:
    """A text; lists that refer to each other would make one without end.

    Raises
    ------
    TypeError
        It is none.
    """
    if not isinstance(value, str):
        raise TypeError(f"a {type(value).__name__} where a text should be")
    return str(value)
