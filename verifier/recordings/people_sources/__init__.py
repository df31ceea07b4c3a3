"""Sources of people: an adapter per message type says in our words what its messages say about people."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from verifier.recordings.decoded import Decoded
from verifier.recordings.people_sources import azure_kinect, ros4hri
from verifier.recordings.people_sources.azure_kinect import AzureKinectMarkers
from verifier.recordings.people_sources.field import FieldSwitch
from verifier.recordings.people_sources.flat import HriSkeleton2D
from verifier.recordings.people_sources.floor import PeoplePositions, PointPosition, PosePositions
from verifier.recordings.people_sources.mocap4r2 import Mocap4r2Markers, Mocap4r2RigidBodies
from verifier.recordings.people_sources.ros4hri import Ros4HriFrames
from verifier.recordings.people_sources.skeletons import JsonSkeletons
from verifier.recordings.people_sources.source import (
    FieldState,
    FloorPositions,
    PeopleAdapter,
    SourceOptions,
)
from verifier.recordings.people_sources.zed import ZedObjects

_KINDS = (
    ZedObjects,
    AzureKinectMarkers,
    Mocap4r2Markers,
    Mocap4r2RigidBodies,
    Ros4HriFrames,
    HriSkeleton2D,
    JsonSkeletons,
    PeoplePositions,
    PosePositions,
    PointPosition,
    FieldSwitch,
)

ADAPTERS: Mapping[str, Callable[[SourceOptions], PeopleAdapter]] = MappingProxyType(
    {schema: kind for kind in _KINDS for schema in kind.schemas}
)
"""Message type -> what makes an adapter for one source of it."""

GENERAL: frozenset[str] = frozenset(
    schema
    for kind in (Ros4HriFrames, AzureKinectMarkers, PosePositions, PointPosition, FieldSwitch)
    for schema in kind.schemas
)
"""Types that say other things as well: a topic of theirs is about people only where the user says so, or
:func:`speaks_of_people` finds a body in it."""

NAMED_BY_CELL: frozenset[str] = frozenset((*Mocap4r2Markers.schemas, *Mocap4r2RigidBodies.schemas))
"""Types whose adapters map names of points as the cell says."""


def new_adapters(options: SourceOptions | None = None) -> Mapping[str, PeopleAdapter]:
    """Return new adapters for the sources of one recording, by message type."""
    stated = options or SourceOptions()
    return {schema: adapter for kind in _KINDS for adapter in (kind(stated),) for schema in kind.schemas}


def speaks_of_people(message: Decoded) -> bool:
    """Whether a message is about people by its type and content, without anybody saying so."""
    if message.schema in Ros4HriFrames.schemas:
        return ros4hri.has_a_body(message.value)
    if message.schema in AzureKinectMarkers.schemas:
        return azure_kinect.has_a_body(message.value)
    return message.schema in ADAPTERS and message.schema not in GENERAL


__all__ = [
    "ADAPTERS",
    "GENERAL",
    "NAMED_BY_CELL",
    "FieldState",
    "FloorPositions",
    "PeopleAdapter",
    "SourceOptions",
    "new_adapters",
    "speaks_of_people",
]
