"""Topics of types that say anything, in which people are found all the same: how to have them read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from verifier.recordings.containers.container import Container
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.errors import RecordingError
from verifier.recordings.own_people import STRING, own_text
from verifier.recordings.people_sources import GENERAL, speaks_of_people
from verifier.recordings.people_sources.field import FieldSwitch
from verifier.recordings.people_sources.floor import PointPosition, PosePositions
from verifier.recordings.sources import READ
from verifier.recordings.topic import Topic

LOOKED_AT = 300
"""Messages of a topic in which people are looked for."""
_FLOOR = frozenset({*PosePositions.schemas, *PointPosition.schemas})


@dataclass(frozen=True, slots=True)
class LikelyPeople:
    """What was found.

    Attributes
    ----------
    shown:
        Topics whose messages show people.
    floor, fields:
        Topics that may have positions of people, or say whether a field is free: nobody can tell by looking.
    """

    shown: tuple[Topic, ...] = ()
    floor: tuple[Topic, ...] = ()
    fields: tuple[Topic, ...] = ()

    def remarks(self) -> Iterator[str]:
        """Yield what to write in the cell."""
        for topic in self.shown:
            yield f"{topic.name} ({topic.schema}) shows people: {_key(topic)}"
        if self.shown:
            return
        for topic in self.floor:
            yield (
                f"{topic.name} ({topic.schema}): if these are people, {_key(topic)}, and error_m in "
                "[recording.floor]"
            )
        for topic in self.fields:
            yield (
                f"{topic.name} ({topic.schema}): if it says whether a monitored region is free, {_key(topic)}"
                ", and [recording.switch]"
            )


def look_for_people(container: Container) -> LikelyPeople:
    """Look at the first messages of every topic whose type says other things as well.

    Messages that cannot be decoded show nobody.
    """
    general = [
        topic
        for topic in container.topics
        if topic.schema in GENERAL | {STRING} and topic.encoding in READ and topic.messages
    ]
    by_look = [topic for topic in general if topic.schema not in _FLOOR | set(FieldSwitch.schemas)]
    return LikelyPeople(
        tuple(topic for topic in by_look if any(map(_shows_people, _first(container, topic)))),
        tuple(topic for topic in general if topic.schema in _FLOOR),
        tuple(topic for topic in general if topic.schema in FieldSwitch.schemas),
    )


def _first(container: Container, topic: Topic) -> Iterator[Decoded]:
    records = (each for each in container.records({topic.name}) if each.channel.schema == topic.schema)
    for record in islice(records, LOOKED_AT):
        try:
            yield container.decode(record)
        except RecordingError:
            continue


def _shows_people(message: Decoded) -> bool:
    try:
        if message.schema != STRING:
            return speaks_of_people(message)
        said = json.loads(own_text(message))
    except (SourceError, ValueError, RecursionError):
        return False
    return isinstance(said, dict) and {"stamp", "people"} <= said.keys()


def _key(topic: Topic) -> str:
    return f'people_topic = "{topic.name}" in [recording] of the cell, or --people-topic'
