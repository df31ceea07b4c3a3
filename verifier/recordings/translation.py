"""From a foreign recording to one of ours, message by message; what is behind it never sees the difference.

Joints become ``/joint_states``, people ``/people`` (docs/recordings.md). Messages that are ours already are
copied byte by byte; times are integer nanoseconds throughout.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

from mcap.records import Schema

from robots.assumption import Assumption, Certainty
from verifier.recordings import joint_state, robot_sources
from verifier.recordings.choice import Choice
from verifier.recordings.clock_offset import ONE_CLOCK, ClockOffsets, moved_cdr, moved_stamp
from verifier.recordings.containers.container import Channel, Container, Record
from verifier.recordings.containers.message_types import is_laid_out_as, without_definition
from verifier.recordings.decoded import SourceError
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_prefix import prefixes, without_prefix
from verifier.recordings.mcap_file import MessageTimeError
from verifier.recordings.people_sources import SourceOptions
from verifier.recordings.people_sources.ros4hri import STATIC_TOPIC, Ros4HriFrames
from verifier.recordings.recording_writer import RecordingWriter
from verifier.recordings.robot_sources import JointSample
from verifier.recordings.robot_sources.joint_sample import is_stamped
from verifier.recordings.sources import JOINTS, PEOPLE, Sources
from verifier.recordings.topic import COMMAND_TOPIC, JOINT_TOPIC, PEOPLE_TOPIC, VERDICT_TOPIC, Topic
from verifier.recordings.translated_people import TranslatedPeople

LOOK_AHEAD = 200
"""Joint messages that are looked at to learn the names; several publishers may share the topic."""
PREFIX_OPTION = "--joint-prefix, or joint_prefix in [recording] of the cell"
OURS = (JOINT_TOPIC, PEOPLE_TOPIC, VERDICT_TOPIC)
RIGHT_OFFSET = "stamps of joints begin in 1970 and end in 2038: state another joints_time_offset_s"
RIGHT_TIME = "message times count from 0 and end in the year 2262, stamps of joints in 2038"


@dataclass(frozen=True, slots=True)
class Translation:
    """How a container is translated.

    Attributes
    ----------
    container, sources:
        What is read, and which of its topics.
    prefix:
        What is taken off the joint names.
    everything:
        Whether other topics are copied.
    people:
        What is said about the source of people.
    clocks:
        What is added to stamps.
    """

    container: Container
    sources: Sources
    prefix: str = ""
    everything: bool = False
    people: SourceOptions = field(default_factory=SourceOptions)
    clocks: ClockOffsets = ONE_CLOCK

    def assumptions(self) -> Iterator[Assumption]:
        """Yield what the translation rests on, to be shown with every result."""
        name, sources = self.container.path.name, self.sources
        for what, topic in (("joints", sources.joints), ("people", sources.people)):
            if topic is None:
                continue
            stated = what in sources.stated
            why = "named by the user" if stated else f"the topic of {name} that has {what}"
            certainty = Certainty.DECLARED if stated else Certainty.ASSUMED
            yield Assumption(f"recording.{what}_topic", f"{topic.name} ({topic.schema})", "", why, certainty)
            if any(without_definition(each) for each in self._channels(topic)):
                why = f"{name} does not say how {topic.schema} is laid out: as in ROS 2 Humble"
                yield Assumption(f"recording.{what}_definition", topic.schema, "", why, Certainty.ASSUMED)
        if self.prefix:
            why = f"stands before the joints of the arm in {name}, and is taken off"
            yield Assumption("recording.joint_prefix", self.prefix, "", why, Certainty.DECLARED)
        moved = {PEOPLE: self.clocks.people_s, JOINTS: self.clocks.joints_s}
        for what, offset_s in moved.items():
            if offset_s is not None:
                why = f"declared: added to the stamps of {what} in {name}"
                yield Assumption(f"recording.{what}_time_offset", offset_s, "s", why, Certainty.DECLARED)

    def write(self, out: Path, metadata: Mapping[str, str], noted: tuple[Assumption, ...] = ()) -> None:
        """Write our recording; ``metadata``, ``noted``: what the foreign one says of itself.

        Raises
        ------
        RecordingError
            A message cannot be decoded or said in our words, or has a time that none can have; joints stand
            in the file in another order than their times.
        """
        with out.open("wb") as stream:
            writer = RecordingWriter(stream)
            people = TranslatedPeople(self.container, self.people, writer, self.clocks)
            left_out = list[str]()
            try:
                self._write(writer, people, left_out)
                people.finish()
            except MessageTimeError as error:
                raise RecordingError(self.container.path, "", str(error), RIGHT_TIME) from error
            values = {key: value for key, value in metadata.items() if key not in ("assumptions", "format")}
            found = (*self.assumptions(), *people.assumptions(), *_commands_left_out(left_out))
            writer.describe(values | self.clocks.metadata(), (*noted, *found))
            writer.finish()

    def _write(self, writer: RecordingWriter, people: TranslatedPeople, left_out: list[str]) -> None:
        joints, before = self.sources.joints, tuple[int, ...]()
        plain = frozenset(filter(is_joint_state, self.container.channels))
        for record in self.container.records(self._topics()):
            if joints is not None and _is_of(record.channel, joints):
                if record.place < before:
                    raise self._refuse(
                        record,
                        "time runs backwards: a message before it in the file is of a later time",
                        "message times must increase",
                    )
                before = record.place
                self._write_joints(writer, record, plain)
            elif self._is_about_people(record.channel):
                people.take(record)
            elif record.channel.topic == COMMAND_TOPIC and record.channel.schema in robot_sources.ADAPTERS:
                self._write_command(writer, record, left_out)
            elif record.channel.topic not in OURS:
                channel = record.channel
                writer.raw(
                    channel.topic, schema_of(channel), channel.encoding, record.data, record.log_time_ns
                )

    def _write_command(self, writer: RecordingWriter, record: Record, left_out: list[str]) -> None:
        """Write a command, or leave out one that cannot be read: no verdict rests on it."""
        try:
            state = self.moved_sample(record).state
        except RecordingError as error:
            left_out.append(str(error))
            return
        writer.commands(without_prefix(state, self.prefix), record.log_time_ns)

    def _is_about_people(self, channel: Channel) -> bool:
        """Whether a message is of the source of people, or of the static part of its frames."""
        topic = self.sources.people
        if topic is None:
            return False
        static = topic.schema in Ros4HriFrames.schemas and channel.topic.rsplit("/", 1)[-1] == STATIC_TOPIC
        return _is_of(channel, topic) or (static and channel.schema == topic.schema)

    def _topics(self) -> set[str]:
        if self.everything:
            return {topic.name for topic in self.container.topics}
        people = {channel.topic for channel in self.container.channels if self._is_about_people(channel)}
        if self.sources.joints is None:
            return people
        commands = {COMMAND_TOPIC} & {topic.name for topic in self.container.topics if _says_joints(topic)}
        return people | {self.sources.joints.name} | commands

    def _write_joints(self, writer: RecordingWriter, record: Record, plain: Collection[Channel]) -> None:
        """Write a sample; those of ``plain`` are copied byte by byte."""
        if not self.prefix and record.channel in plain:
            writer.joints_as_they_are(self._moved(record), record.log_time_ns)
            return
        sample = self.moved_sample(record)
        writer.joints(without_prefix(sample.state, self.prefix), record.log_time_ns)
        if sample.reference is not None and not any(t.name == COMMAND_TOPIC for t in self.container.topics):
            writer.commands(without_prefix(sample.reference, self.prefix), record.log_time_ns)

    def _moved(self, record: Record) -> bytes:
        try:
            return moved_cdr(record.data, self.clocks.joints_ns) if self.clocks.joints_ns else record.data
        except OverflowError as error:
            raise self._refuse(record, str(error), RIGHT_OFFSET) from error

    def moved_sample(self, record: Record) -> JointSample:
        """Read a message with joints, its stamp on the clock of the message times.

        Raises
        ------
        RecordingError
            As :meth:`sample`, or it would get a stamp that none can have.
        """
        sample, offset_ns = self.sample(record), self.clocks.joints_ns
        if not offset_ns or not is_stamped(self.container.decode(record)):
            return sample
        try:
            stamp_ns = moved_stamp(sample.state.stamp_ns, offset_ns)
        except OverflowError as error:
            raise self._refuse(record, str(error), RIGHT_OFFSET) from error
        reference = None if sample.reference is None else replace(sample.reference, stamp_ns=stamp_ns)
        return JointSample(replace(sample.state, stamp_ns=stamp_ns), reference)

    def sample(self, record: Record) -> JointSample:
        """Read a message with joints.

        Raises
        ------
        RecordingError
            It cannot be decoded, or not be said in our words.
        """
        decoded = self.container.decode(record)
        try:
            return robot_sources.ADAPTERS[record.channel.schema].read(decoded)
        except SourceError as error:
            raise self._refuse(record, str(error)) from error

    def names(self) -> tuple[str, ...]:
        """Return every joint name among the first messages, in order of appearance.

        Messages that cannot be read say none: who reads them all refuses them.

        Raises
        ------
        RecordingError
            None of them can be read.
        """
        topic = self.sources.joints
        if topic is None:
            return ()
        records = (each for each in self.container.records({topic.name}) if _is_of(each.channel, topic))
        names: dict[str, None] = {}
        refused: RecordingError | None = None
        for record in islice(records, LOOK_AHEAD):
            try:
                names |= dict.fromkeys(self.sample(record).state.names)
            except RecordingError as error:
                refused = refused or error
        if refused is not None and not names:
            raise refused
        return tuple(names)

    def _channels(self, topic: Topic) -> Iterator[Channel]:
        return (channel for channel in self.container.channels if _is_of(channel, topic))

    def _refuse(self, record: Record, wrong: str, right: str = "") -> RecordingError:
        place = f"{record.channel.topic}, message at {record.log_time_ns} ns"
        return RecordingError(self.container.path, place, wrong, right)


def chosen_prefix(path: Path, names: tuple[str, ...], choice: Choice) -> str:
    """Return what stands before the names of the arm's joints.

    Raises
    ------
    RecordingError
        The prefix that was named is not there, or the arm is there several times.
    """
    if choice.joint_prefix is not None:
        if not any(name.startswith(choice.joint_prefix) for name in names):
            wrong = f"has no joint that begins with {choice.joint_prefix} (it has {', '.join(names)})"
            raise RecordingError(path, "", wrong, f"name another one with {PREFIX_OPTION}")
        return choice.joint_prefix
    found = prefixes(names, choice.arm)
    if len(found) > 1:
        wrong = f"has the joints of the arm {len(found)} times, after {', '.join(found)}"
        raise RecordingError(path, "", wrong, f"choose one with {PREFIX_OPTION}")
    return found[0] if found else ""


def is_joint_state(channel: Channel) -> bool:
    """Whether messages are those that we read without their definition: a file may define them otherwise."""
    named = (channel.encoding, channel.schema) == ("cdr", joint_state.SCHEMA_NAME)
    return named and is_laid_out_as(channel, joint_state.SCHEMA.decode())


def _is_of(channel: Channel, topic: Topic) -> bool:
    return (channel.topic, channel.schema, channel.encoding) == (topic.name, topic.schema, topic.encoding)


def _commands_left_out(reasons: list[str]) -> Iterator[Assumption]:
    if reasons:
        why = f"commands that cannot be read; the first: {reasons[0]}"
        yield Assumption("recording.commands_left_out", float(len(reasons)), "", why, Certainty.MEASURED)


def _says_joints(topic: Topic) -> bool:
    return topic.schema in robot_sources.ADAPTERS


def schema_of(channel: Channel) -> Schema | None:
    """Return the schema of a channel as MCAP has it; ``None``: there is none."""
    if not channel.schema:
        return None
    return Schema(
        id=0, name=channel.schema, encoding=channel.definition_encoding, data=channel.definition.encode()
    )
