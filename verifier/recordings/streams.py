"""The streams of any recording: running numbers of every topic, of joints and of people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from verifier.recordings.beside import NOTHING_BESIDE, Beside, look_beside
from verifier.recordings.choice import Choice
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.likely_people import LikelyPeople, look_for_people
from verifier.recordings.mcap_file import McapFile, Message
from verifier.recordings.metadata import own_metadata
from verifier.recordings.neutral import JOINTS, PEOPLE, Opened, open_neutral, open_whole
from verifier.recordings.sources import candidates
from verifier.recordings.survey import JointSurvey, PeopleSurvey, StreamFacts, StreamSurvey
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC, Topic


@dataclass(slots=True)
class Streams:
    """What was counted.

    Attributes
    ----------
    topics:
        By name.
    joints, people:
        What the messages of these hold.
    metadata:
        What the recording says of itself.
    choices:
        Keys of ``[recording]`` of the cell that must be filled in, and what could be meant.
    unclear:
        Why joints and people were not looked at.
    beside:
        What the recording holds beside them.
    likely:
        Topics in which people were found, or may be, that nobody named.
    """

    topics: dict[str, StreamSurvey]
    joints: JointSurvey = field(default_factory=JointSurvey)
    people: PeopleSurvey = field(default_factory=PeopleSurvey)
    metadata: Mapping[str, str] = field(default_factory=dict)
    choices: dict[str, tuple[str, ...]] = field(default_factory=dict)
    unclear: tuple[str, ...] = ()
    beside: Beside = NOTHING_BESIDE
    likely: LikelyPeople = field(default_factory=LikelyPeople)
    counted: dict[str, int] = field(default_factory=lambda: {JOINT_TOPIC: 0, PEOPLE_TOPIC: 0})

    @property
    def start(self) -> int:
        """Time of the first message [ns]."""
        return min((each.first for each in self.topics.values() if each.messages), default=0)

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message [s]."""
        last = max((each.last for each in self.topics.values() if each.messages), default=0)
        return (last - self.start) / NANO

    def facts(self) -> tuple[StreamFacts, ...]:
        """Return the numbers of every topic, in order of name."""
        return tuple(self.topics[name].facts(self.start) for name in sorted(self.topics))

    def numbers(self) -> Iterator[tuple[str, str, int]]:
        """Yield key of the choice, our topic, and how many messages there are on it, people first."""
        for key, ours in (("people_topic", PEOPLE_TOPIC), ("joints_topic", JOINT_TOPIC)):
            yield key, ours, self.counted[ours]

    def look_at(self, message: Message) -> int | None:
        """Look at a message in our words; return its stamp [ns] if it has one."""
        topic = message.channel.topic
        if topic not in self.counted:
            return None
        self.counted[topic] += 1
        return (self.joints if topic == JOINT_TOPIC else self.people).take(message)


def survey(path: Path, choice: Choice) -> Streams:
    """Read a recording from end to end.

    Raises
    ------
    RecordingError
        It is not there, or is not complete.
    """
    container = open_whole(path)
    streams = Streams({topic.name: _stream(topic) for topic in container.topics})
    said = choice.joints_topic, choice.people_topic
    keys = "joints_topic", "people_topic"
    for key, stated, found in zip(keys, said, candidates(container.topics), strict=True):
        if stated is None and len(found) > 1:
            streams.choices[key] = found
    try:
        opened = open_neutral(path, choice, wanted=(JOINTS, PEOPLE))
    except RecordingError as error:
        opened = None
        streams.unclear = ("; ".join(part for part in (error.place, error.wrong, error.right) if part),)
    if choice.people_topic is None and not candidates(container.topics)[1]:
        streams.likely = look_for_people(container)
        if streams.likely.shown:
            streams.choices["people_topic"] = tuple(topic.name for topic in streams.likely.shown)
    if opened is not None:
        streams.beside = look_beside(container, opened)
    if opened is not None and opened.folder is None:
        _look_at_ours(streams, opened.file)
        return streams
    for record in container.records():
        streams.topics[record.channel.topic].take(record.log_time_ns, None)
    if opened is not None:
        _look_at_translated(streams, opened)
    return streams


def _look_at_ours(streams: Streams, file: McapFile) -> None:
    streams.metadata = own_metadata(file)
    for message in file.messages():
        streams.topics[message.channel.topic].take(message.log_time, streams.look_at(message))


def _look_at_translated(streams: Streams, opened: Opened) -> None:
    streams.metadata = {key: text for key, text in own_metadata(opened.file).items() if key != "format"}
    joints, people = opened.sources.topics
    sources = {JOINT_TOPIC: joints, PEOPLE_TOPIC: people}
    for message in opened.file.messages([JOINT_TOPIC, PEOPLE_TOPIC]):
        stamp = streams.look_at(message)
        source = sources[message.channel.topic]
        if stamp is not None and source is not None:
            streams.topics[source.name].take_stamp(message.log_time, stamp)


def _stream(topic: Topic) -> StreamSurvey:
    return StreamSurvey(topic.name, topic.schema, topic.encoding)
