"""Where in a container the arm's joints and the people are: the only topic that says so, or the one named."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from verifier.recordings import people_sources, robot_sources
from verifier.recordings.choice import Choice
from verifier.recordings.errors import RecordingError
from verifier.recordings.own_people import OWN, STRING
from verifier.recordings.topic import COMMAND_TOPIC, JOINT_TOPIC, PEOPLE_TOPIC, Topic

JOINTS, PEOPLE = "joints", "people"
JOINTS_OPTION = "--joints-topic, or joints_topic in [recording] of the cell"
PEOPLE_OPTION = "--people-topic, or people_topic in [recording] of the cell"
READ = ("cdr", "ros1", "json")
"""Encodings of messages."""


PEOPLE_TYPES = frozenset({*people_sources.ADAPTERS, *OWN})
GENERAL = people_sources.GENERAL | {STRING}
"""Types that say other things as well: a topic of these is taken only if it is named, or is ours."""


@dataclass(frozen=True, slots=True)
class Sources:
    """Topics with the arm's joints and with people; ``None``: there is none.

    ``stated``: which of them the user named (``"joints"``, ``"people"``).
    """

    joints: Topic | None
    people: Topic | None
    stated: frozenset[str] = frozenset()

    @property
    def topics(self) -> tuple[Topic | None, Topic | None]:
        """Both topics."""
        return self.joints, self.people

    def require(self, needed: Collection[str], path: Path, topics: Sequence[Topic]) -> None:
        """Refuse a recording that lacks something of ``needed``.

        Raises
        ------
        RecordingError
            It has no such topic.
        """
        for kind, topic in zip(_KINDS, self.topics, strict=True):
            if kind.what in needed and topic is None:
                names = ", ".join(topic.name for topic in topics) or "no topic"
                right = f"{kind.what} are read from {', '.join(sorted(kind.schemas))}"
                raise RecordingError(path, "", f"has no topic with {kind.what} (it has {names})", right)


def choose_sources(
    path: Path, topics: Sequence[Topic], choice: Choice, wanted: Collection[str] = (JOINTS, PEOPLE)
) -> Sources:
    """Choose the topics that are read; only for what is ``wanted``.

    Raises
    ------
    RecordingError
        A topic that was named is not there, or of a type that is not read; or several could be meant.
    """
    said = choice.joints_topic, choice.people_topic
    found = [
        _one(path, topics, kind, stated) if kind.what in wanted else None
        for kind, stated in zip(_KINDS, said, strict=True)
    ]
    stated = (kind.what for kind, topic in zip(_KINDS, said, strict=True) if topic is not None)
    return Sources(found[0], found[1], frozenset(stated))


def candidates(topics: Sequence[Topic]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the topics that could be the arm's joints, and those that could be the people."""
    joints, people = (tuple(topic.name for topic in _candidates(topics, kind)) for kind in _KINDS)
    return joints, people


def unread_people(topics: Sequence[Topic], read: Topic | None) -> tuple[Topic, ...]:
    """Return the topics beside the one that is ``read`` whose messages cannot but speak of people."""
    kind = _KINDS[1]
    return tuple(t for t in topics if t != read and kind.reads(t) and _speaks_for_itself(t))


@dataclass(frozen=True, slots=True)
class _Kind:
    """What is looked for, under which name it is ours, how it is chosen, and the types that are read."""

    what: str
    ours: str
    option: str
    schemas: Collection[str]

    def reads(self, topic: Topic) -> bool:
        if topic.encoding not in READ or not topic.messages:
            return False
        return topic.schema in self.schemas or (
            topic.name == self.ours == PEOPLE_TOPIC and topic.encoding == "json"
        )


_KINDS = (
    _Kind(JOINTS, JOINT_TOPIC, JOINTS_OPTION, robot_sources.ADAPTERS.keys()),
    _Kind(PEOPLE, PEOPLE_TOPIC, PEOPLE_OPTION, PEOPLE_TYPES),
)


def _one(path: Path, topics: Sequence[Topic], kind: _Kind, stated: str | None) -> Topic | None:
    if stated is not None:
        return _stated(path, topics, [topic for topic in topics if kind.reads(topic)], kind, stated)
    found = _candidates(topics, kind)
    if len(found) > 1:
        raise RecordingError(
            path,
            "",
            f"has several topics with {kind.what}: {_listed(found)}",
            f"choose one with {kind.option}",
        )
    return found[0] if found else None


def _candidates(topics: Sequence[Topic], kind: _Kind) -> list[Topic]:
    """Topics that could be meant: joints that have our name are; a name alone leaves no people out."""
    readable = [topic for topic in topics if kind.reads(topic)]
    ours = [topic for topic in readable if topic.name == kind.ours]
    if ours and kind.what == JOINTS:
        return ours
    return [topic for topic in readable if topic in ours or _speaks_for_itself(topic)]


def _speaks_for_itself(topic: Topic) -> bool:
    """Whether a topic may be taken without having been named: not commands, not types that say anything."""
    return topic.name != COMMAND_TOPIC and topic.schema not in GENERAL


def _stated(
    path: Path, topics: Sequence[Topic], readable: Sequence[Topic], kind: _Kind, stated: str
) -> Topic | None:
    found = [topic for topic in readable if topic.name == stated]
    if len(found) == 1:
        return found[0]
    there = [topic for topic in topics if topic.name == stated]
    if not there:
        wrong = f"has no topic {stated} (it has {', '.join(dict.fromkeys(topic.name for topic in topics))})"
        raise RecordingError(path, "", wrong, f"name one of them with {kind.option}")
    if len(found) > 1:
        raise RecordingError(
            path, stated, f"has messages of several types: {_listed(found)}", "record it anew"
        )
    if not any(topic.messages for topic in there):
        raise RecordingError(path, stated, "has no messages", f"name another topic with {kind.option}")
    types = ", ".join(sorted(kind.schemas))
    raise RecordingError(path, stated, f"is {_listed(there)}", f"{kind.what} are read from {types}")


def _listed(topics: Sequence[Topic]) -> str:
    return ", ".join(_entries(topics))


def _entries(topics: Sequence[Topic]) -> Iterator[str]:
    for topic in topics:
        yield f"{topic.name} ({topic.schema or 'no schema'} in {topic.encoding or 'no encoding'})"
