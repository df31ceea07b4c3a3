"""A recording of an arm and of the people around it: what it holds, before anything of it is replayed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import islice
from pathlib import Path

from robots.assumption import Assumption
from verifier.recordings import joint_state, people_schema
from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_file import Message
from verifier.recordings.metadata import noted_assumptions, own_metadata
from verifier.recordings.neutral import JOINTS, PEOPLE, Opened, open_neutral
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC, Topic

LOOK_AHEAD = 200
"""Joint messages that are looked at to learn the names; several publishers may share the topic."""


class Recording:
    """A recording with ``/joint_states`` and, as a rule, ``/people``: one of ours, or translated into one.

    Parameters
    ----------
    path:
        MCAP, ROS 1 bag, ROS 2 storage file, the folder of a ROS 2 bag, or a table of joint motion.
    choice:
        Which topics and joints of it are meant.
    everything:
        Whether other topics are wanted too, where it has to be translated.
    wanted:
        What is looked for, where it has to be translated.
    noted:
        What opening it assumed.

    Attributes
    ----------
    path:
        The file or folder.
    file:
        Its messages, in our words.
    topics:
        In order of name.
    metadata:
        Record ``stopproof`` of the file; empty for recordings of other makers.
    joint_names:
        Every joint name among the first messages, in order of appearance; empty when joints have no names.
    assumptions:
        What an import assumed and noted in the file, and what a translation rests on.
    regions:
        Names of the monitored regions that complete reports must speak for.
    unread_people:
        Topics beside the one that is read whose messages cannot but speak of people.
    moving_frames:
        Frames for which a cell states one pose, and which the recording moves; set by who knows the cell.

    Raises
    ------
    RecordingError
        It is not there, is not complete, is empty, its joints or people are of another type than
        docs/recordings.md says, or it is not plain which topics are meant.
    """

    def __init__(
        self,
        path: str | Path,
        choice: Choice = NOTHING_SAID,
        *,
        everything: bool = False,
        wanted: Collection[str] = (JOINTS, PEOPLE),
        noted: Collection[Assumption] = (),
    ) -> None:
        opened = open_neutral(Path(path), choice, wanted=wanted, needed=(JOINTS,), everything=everything)
        self.regions = choice.regions
        self._take(opened, wanted, noted)

    @classmethod
    def of(cls, opened: Opened) -> Recording:
        """Return a recording that is open already, and has joints.

        Raises
        ------
        RecordingError
            It is refused.
        """
        recording = cls.__new__(cls)
        recording.regions = ()
        recording._take(opened, (JOINTS,), ())
        return recording

    def _take(self, opened: Opened, wanted: Collection[str], noted: Collection[Assumption]) -> None:
        self._opened = opened
        self.file = self._opened.file
        self.unread_people = self._opened.unread
        self.moving_frames: tuple[str, ...] = ()
        self.path = self.file.path
        self.topics = tuple(self._topics())
        self.metadata: Mapping[str, str] = own_metadata(self.file)
        self._check_types(wanted)
        self.joint_names = tuple(self._joint_names())
        self.assumptions = (*noted_assumptions(self.metadata), *noted)

    @property
    def translated(self) -> bool:
        """Whether ``file`` is a translation of what lies at ``path``."""
        return self._opened.folder is not None

    def left_to_map(self, point_names: Mapping[str, str]) -> Mapping[str, str]:
        """Return the names of points that no translation has mapped yet."""
        return self._opened.left_to_map(point_names)

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

    def _check_types(self, wanted: Collection[str]) -> None:
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
            if PEOPLE in wanted and entry.name == PEOPLE_TOPIC and entry.encoding != "json":
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
