"""Storage files of ROS 2 bags in SQLite (``.db3``), read without changing anything.

Of a file that SQLite finds damaged, rows are counted as far as it goes, and none is read: the library takes
zeros for what is missing of a page.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from verifier.recordings.containers.container import (
    MAX_MESSAGE_BYTES,
    TIME_END_NS,
    Channel,
    Record,
    readable_text,
    topics_of,
)
from verifier.recordings.containers.stored import Stored
from verifier.recordings.errors import RecordingError

MAGIC = b"SQLite format 3\0"
TABLES = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"topic_id", "timestamp", "data"},
}
MAX_TOPICS = 10_000
BESIDE = ("-wal", "-journal")
"""Files in which SQLite keeps what it has not yet written into the database."""


class Sqlite3Storage(Stored):
    """One storage file; see :class:`verifier.recordings.containers.container.Container`.

    Parameters
    ----------
    path:
        The file, as messages name it.
    data:
        Where its content is, if it had to be unpacked first.
    unpack:
        What turns the bytes of a row into those of a message, where each was compressed.

    Raises
    ------
    RecordingError
        The file is not there, or is no SQLite database of a ROS 2 bag.
    """

    def __init__(
        self, path: Path, data: Path | None = None, unpack: Callable[[bytes], bytes] | None = None
    ) -> None:
        super().__init__(path)
        self._data = data or path
        self._unpack = unpack or bytes
        self._repair = (
            f"`ros2 bag reindex` of its folder, or `sqlite3 {path.name} .recover`, saves what is left"
        )
        with self._opened() as database:
            why = self._damage(database)
            self._channels = self._read_channels(database)
            counts, first, last = self._counted(database) if why is None else self._found(database)
        if why is not None:
            self.damage = f"{why}: {readable_text(counts.values(), first, last)}; {self._repair}"
        self.channels = tuple(dict.fromkeys(self._channels.values()))
        self.topics = topics_of((channel, counts.get(n, 0)) for n, channel in self._channels.items())

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yield the messages of ``topics`` in order of log time; of a damaged file none."""
        if self.damage is not None:
            return
        wanted = [n for n, c in self._channels.items() if topics is None or c.topic in topics]
        with self._opened() as database:
            marks = ",".join("?" for _ in wanted)
            query = f"SELECT rowid, topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})"
            for row, number, time_ns, data in database.execute(f"{query} ORDER BY timestamp, rowid", wanted):
                if not isinstance(time_ns, int) or not isinstance(data, bytes):
                    raise sqlite3.DatabaseError(f"row {row} of its messages holds no message")
                if not 0 <= time_ns < TIME_END_NS:
                    raise sqlite3.DatabaseError(f"row {row} of its messages has the time {time_ns} ns")
                yield Record(self._channels[number], time_ns, self._unpack(data), (int(row),))

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """The database, never to be written; damage becomes a ``RecordingError``."""
        try:
            with self._data.open("rb") as stream:
                magic = stream.read(len(MAGIC))
        except OSError as error:
            raise RecordingError(self.path, "", f"cannot be read: {error.strerror or error}") from error
        if magic != MAGIC:
            right = "name the folder of a ROS 2 bag, or its .db3 or .mcap"
            raise RecordingError(self.path, "", "is not a SQLite database", right)
        database = None
        try:
            name = quote(str(self._data.resolve()))
            database = sqlite3.connect(f"file:{name}?mode=ro&immutable=1", uri=True)
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE_BYTES)
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA cell_size_check = ON")
            yield database
        except (sqlite3.Error, UnicodeDecodeError, OverflowError, MemoryError, ValueError) as error:
            if isinstance(error, RecordingError):
                raise
            reason = str(error) or type(error).__name__
            wrong = f"the database ends early or is damaged ({reason})"
            raise RecordingError(self.path, "", wrong, self._repair) from error
        finally:
            if database is not None:
                database.close()

    def _damage(self, database: sqlite3.Connection) -> str | None:
        """What is wrong with the file as a whole; ``None``: nothing."""
        for ending in BESIDE:
            beside = self.path.with_name(self.path.name + ending)
            if beside.exists() and beside.stat().st_size:
                self._repair = (
                    f"`sqlite3 {self.path.name} 'PRAGMA integrity_check'` writes it into the database"
                )
                return f"was not closed: a part of it is in {beside.name}"
        ((size,),) = database.execute(
            "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"
        )
        found = self._data.stat().st_size
        if found < size:
            return f"the database ends early: {found} of {size} bytes are there"
        try:
            ((verdict,),) = database.execute("PRAGMA quick_check(1)")
        except sqlite3.DatabaseError as error:
            verdict = str(error)
        return (
            None if verdict == "ok" else f"the database is damaged ({' '.join(str(verdict).split())[:200]})"
        )

    def _read_channels(self, database: sqlite3.Connection) -> dict[int, Channel]:
        for table, needed in TABLES.items():
            kind = database.execute(
                "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ? AND sql NOT LIKE '%VIRTUAL%'",
                [table],
            ).fetchone()
            columns = {row[1] for row in database.execute(f"PRAGMA table_info({table})")}
            if kind is None or not needed <= columns:
                wrong = f"has no table {table} with {', '.join(sorted(needed))}"
                raise RecordingError(self.path, "", wrong, "name a database that ROS 2 has recorded")
        definitions = self._definitions(database)
        channels: dict[int, Channel] = {}
        for row in database.execute(
            "SELECT id, name, type, serialization_format FROM topics ORDER BY id LIMIT ?", [MAX_TOPICS]
        ):
            number, topic, schema, encoding = row
            if not isinstance(number, int) or not all(isinstance(text, str) for text in row[1:]):
                raise sqlite3.DatabaseError("its table of topics holds what is no topic")
            channels[number] = Channel(topic, schema, encoding, *definitions.get(schema, ("", "")))
        return channels

    def _definitions(self, database: sqlite3.Connection) -> dict[str, tuple[str, str]]:
        """Definition and its encoding by type: from ROS 2 Iron on they stand in the file."""
        columns = {row[1] for row in database.execute("PRAGMA table_info(message_definitions)")}
        if not {"topic_type", "encoding", "encoded_message_definition"} <= columns:
            return {}
        query = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions LIMIT ?"
        return {
            schema: (text, encoding)
            for schema, text, encoding in database.execute(query, [MAX_TOPICS])
            if isinstance(text, str) and isinstance(encoding, str)
        }

    def _counted(self, database: sqlite3.Connection) -> tuple[dict[int, int], int | None, int | None]:
        counts = dict(database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
        if not counts.keys() <= self._channels.keys():
            raise sqlite3.DatabaseError("messages of a topic that it does not list")
        ((first, last),) = database.execute("SELECT min(timestamp), max(timestamp) FROM messages")
        return counts, first, last

    def _found(self, database: sqlite3.Connection) -> tuple[dict[int, int], int | None, int | None]:
        """Count the rows of a damaged file, up to the first that cannot be read."""
        counts: dict[int, int] = {}
        first = last = None
        with suppress(sqlite3.DatabaseError):
            for number, time_ns, _size in database.execute(
                "SELECT topic_id, timestamp, length(data) FROM messages ORDER BY rowid"
            ):
                if number in self._channels and isinstance(time_ns, int):
                    counts[number] = counts.get(number, 0) + 1
                    first = time_ns if first is None else min(first, time_ns)
                    last = time_ns if last is None else max(last, time_ns)
        return counts, first, last
