"""A recording of an arm and of the people around it: what it holds, before anything of it is replayed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from robots.assumption import Assumption, Certainty
from verifier.recordings import joint_state, json_text, people_schema
from verifier.recordings.errors import RecordingError, one_line
from verifier.recordings.mcap_file import McapFile, Message

JOINT_TOPIC = "/joint_states"
COMMAND_TOPIC = "/joint_commands"
PEOPLE_TOPIC = "/people"
VERDICT_TOPIC = "/verdict"
METADATA = "stopproof"
MAX_SHOWN = 200
"""Characters that are shown of metadata that are not what they should be."""
LOOK_AHEAD = 200
"""Joint messages that are looked at to learn the names; several publishers may share the topic."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic: name, schema and encoding of its messages, how many there are."""

    name: str
    schema: str
    encoding: str
    messages: int


class Recording:
    """An MCAP recording with ``/joint_states`` and, as a rule, ``/people``.

    Attributes
    ----------
    path:
        The file.
    topics:
        In order of name.
    metadata:
        Record ``stopproof`` of the file; empty for recordings of other makers.
    joint_names:
        Every joint name among the first messages, in order of appearance; empty when joints have no names.
    assumptions:
        What the import assumed and noted in the file.

    Raises
    ------
    RecordingError
        The file is not there, is no complete MCAP file, is empty, or its ``/joint_states`` or ``/people`` are
        of another type than docs/recordings.md says.
    """

    def __init__(self, path: str | Path) -> None:
        self.file = McapFile(path)
        self.path = self.file.path
        self.topics = tuple(self._topics())
        self.metadata: Mapping[str, str] = own_metadata(self.file)
        self._check_types()
        self.joint_names = tuple(self._joint_names())
        self.assumptions = noted_assumptions(self.metadata)

    @property
    def robot(self) -> str | None:
        """Name of the arm as the import noted it."""
        return self.metadata.get("robot")

    @property
    def has_people(self) -> bool:
        """Whether the recording has reports about people."""
        return self._count(PEOPLE_TOPIC) > 0

    def _topics(self) -> Iterator[Topic]:
        for channel in sorted(self.file.channels.values(), key=lambda c: (c.topic, c.id)):
            schema = self.file.schemas.get(channel.schema_id)
            name = schema.name if schema else ""
            yield Topic(channel.topic, name, channel.message_encoding, self.file.counts.get(channel.id, 0))

    def _count(self, topic: str) -> int:
        return sum(entry.messages for entry in self.topics if entry.name == topic)

    def _check_types(self) -> None:
        if not self.file.counts:
            raise RecordingError(self.path, "", "is empty", "a recording holds messages on /joint_states")
        if not self._count(JOINT_TOPIC):
            present = ", ".join(entry.name for entry in self.topics if entry.messages)
            raise RecordingError(
                self.path,
                "",
                f"has no messages on {JOINT_TOPIC} (it has {present})",
                f"record {joint_state.SCHEMA_NAME} on {JOINT_TOPIC}, or `stopproof import` a table",
            )
        for entry in self.topics:
            found = f"{entry.schema or 'no schema'} in {entry.encoding or 'no encoding'}"
            if entry.name == JOINT_TOPIC and (entry.encoding, entry.schema) != (
                "cdr",
                joint_state.SCHEMA_NAME,
            ):
                raise RecordingError(
                    self.path, JOINT_TOPIC, f"is {found}", f"it must be {joint_state.SCHEMA_NAME} in cdr"
                )
            if entry.name == PEOPLE_TOPIC and entry.encoding != "json":
                raise RecordingError(
                    self.path, PEOPLE_TOPIC, f"is {found}", f"it must be {people_schema.SCHEMA_NAME} in json"
                )

    def _joint_names(self) -> Iterator[str]:
        seen: set[str] = set()
        for message in islice(self.file.messages([JOINT_TOPIC]), LOOK_AHEAD):
            for name in self.layout(message).names:
                if name not in seen:
                    seen.add(name)
                    yield name

    def layout(self, message: Message) -> joint_state.Layout:
        """Return the layout of a joint message.

        Raises
        ------
        RecordingError
            The message cannot be decoded.
        """
        try:
            return joint_state.layout(message.data)
        except joint_state.CdrError as error:
            raise RecordingError(
                self.path,
                f"{JOINT_TOPIC}, message at {message.log_time} ns",
                str(error),
                f"it must be {joint_state.SCHEMA_NAME} in cdr",
            ) from error


def own_metadata(file: McapFile) -> Mapping[str, str]:
    """Return the record ``stopproof`` of a file; empty without one.

    Raises
    ------
    RecordingError
        There are several, and they do not say the same.
    """
    records = [values for name, values in file.metadata if name == METADATA]
    if any(values != records[0] for values in records):
        wrong, right = "several records contradict each other", "one recording of one robot has one"
        raise RecordingError(file.path, f"metadata {METADATA}", wrong, right)
    return records[0] if records else {}


def noted_assumptions(metadata: Mapping[str, str]) -> tuple[Assumption, ...]:
    """Read the assumptions that an import has noted; what is not readable as such is shown as unreadable."""
    text = metadata.get("assumptions")
    if text is None:
        return ()
    try:
        return tuple(
            Assumption(
                str(entry["name"]),
                entry["value"] if isinstance(entry["value"], float) else str(entry["value"]),
                str(entry["unit"]),
                str(entry["source"]),
                Certainty(entry["certainty"]),
            )
            for entry in json_text.loads(text)
        )
    except (ValueError, LookupError, TypeError, RecursionError):
        shown = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"
        source = "metadata of the file: not a readable list of assumptions"
        return (Assumption("recording.assumptions", one_line(shown), "", source, Certainty.UNVERIFIED),)
