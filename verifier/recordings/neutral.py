"""Opening any recording as one of ours: as it is, or translated into a temporary file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from verifier.recordings.choice import Choice
from verifier.recordings.clock_offset import refuse_moved
from verifier.recordings.containers import is_container, open_container
from verifier.recordings.containers.container import Container
from verifier.recordings.containers.mcap_container import McapContainer, open_mcap
from verifier.recordings.errors import RecordingError
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.metadata import noted_assumptions, own_metadata
from verifier.recordings.people_sources import NAMED_BY_CELL
from verifier.recordings.sources import JOINTS, PEOPLE, Sources, choose_sources, unread_people
from verifier.recordings.table_joints import is_table, write_table
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC, Topic
from verifier.recordings.translation import Translation, chosen_prefix, is_joint_state

__all__ = ["JOINTS", "PEOPLE", "Opened", "open_neutral", "open_original", "open_whole"]

NO_SOURCES = Sources(None, None)
NO_METADATA: Mapping[str, str] = {}
NO_NAMES: Mapping[str, str] = {}


class Opened(NamedTuple):
    """A recording of ours.

    Attributes
    ----------
    file:
        Its messages.
    folder:
        Where it lies, if it had to be translated: it is removed with this object.
    sources:
        Topics of the foreign recording that were translated.
    unread:
        Other topics of it that speak of people, and are not read.
    """

    file: McapFile
    folder: TemporaryDirectory[str] | None = None
    sources: Sources = NO_SOURCES
    unread: tuple[Topic, ...] = ()

    def left_to_map(self, point_names: Mapping[str, str]) -> Mapping[str, str]:
        """Return the names of points that are still to be mapped; twice, two that change places would not."""
        people = self.sources.people
        return NO_NAMES if people is not None and people.schema in NAMED_BY_CELL else point_names


def open_neutral(
    path: Path,
    choice: Choice,
    *,
    wanted: Collection[str],
    needed: Collection[str] = (),
    everything: bool = False,
) -> Opened:
    """Open a recording, translated where it is not one of ours.

    Parameters
    ----------
    path:
        MCAP, ROS 1 bag, ROS 2 storage file, the folder of a ROS 2 bag, or a table of joint motion.
    choice:
        Which topics and joints are meant.
    wanted, needed:
        What is looked for, and what must be there (``JOINTS``, ``PEOPLE``).
    everything:
        Whether a translation copies the other topics too.

    Raises
    ------
    RecordingError
        It is not there, is damaged, cannot be decoded or said in our words, or it is not plain what is meant.
    """
    if is_table(path):
        return _from_table(path, choice.arm)
    container, metadata, file = _opened(path)
    refuse_moved(container.path, metadata, choice.clocks)
    sources = choose_sources(container.path, container.topics, choice, wanted)
    if file is not None and sources.topics == (None, None):
        return Opened(file)
    if file is None:
        sources.require(needed, container.path, container.topics)
    plan = Translation(container, sources, everything=everything, people=choice.people)
    prefix = ""
    if choice.joint_prefix is not None or choice.arm:
        prefix = chosen_prefix(container.path, plan.names(), choice)
    if file is not None and not prefix and not choice.clocks.stated and _is_ours(container, sources):
        return Opened(file, unread=unread_people(container.topics, sources.people))
    plan = Translation(container, sources, prefix, everything, choice.people, choice.clocks)
    return _translated(plan, metadata)


def open_whole(path: Path) -> Container:
    """Open a container that must be complete.

    Raises
    ------
    RecordingError
        It is not there, is none, or is damaged; then the line says what can be read, and how to repair it.
    """
    return _opened(path)[0]


def open_original(path: Path) -> McapFile | Container:
    """Open a container that must be complete, to be read as it stands: as MCAP where it is one.

    Raises
    ------
    RecordingError
        As :func:`open_whole` says.
    """
    container, _metadata, file = _opened(path)
    return container if file is None else file


def _opened(path: Path) -> tuple[Container, Mapping[str, str], McapFile | None]:
    """The container, what it says of itself, and the MCAP file if it is a complete one."""
    if is_container(path) and (path.suffix != ".mcap" or path.is_dir()):
        container = open_container(path)
        if container.damage is not None:
            raise RecordingError(path, "", container.damage)
        return container, NO_METADATA, None
    try:
        file = McapFile(path)
    except RecordingError as error:
        container = open_mcap(path)
        if container.damage is None:
            return container, NO_METADATA, None
        raise RecordingError(path, "", container.damage) from error
    return McapContainer(file), own_metadata(file), file


def _is_ours(container: Container, sources: Sources) -> bool:
    joints, people = sources.joints, sources.people
    if joints is not None and joints.name != JOINT_TOPIC:
        return False
    if joints is not None and not all(
        is_joint_state(channel) for channel in container.channels if channel.topic == JOINT_TOPIC
    ):
        return False
    return people is None or (people.name, people.encoding) == (PEOPLE_TOPIC, "json")


def _translated(plan: Translation, metadata: Mapping[str, str]) -> Opened:
    folder, file = _made(
        plan.container.path, lambda out: plan.write(out, metadata, noted_assumptions(metadata))
    )
    unread = unread_people(plan.container.topics, plan.sources.people)
    return Opened(file, folder, plan.sources, unread)


def _from_table(path: Path, arm: tuple[str, ...]) -> Opened:
    """A table of joint motion as a recording without people."""

    def write(out: Path) -> None:
        with out.open("wb") as stream:
            write_table(path, arm, stream)

    folder, file = _made(path, write)
    return Opened(file, folder)


def _made(path: Path, write: Callable[[Path], None]) -> tuple[TemporaryDirectory[str], McapFile]:
    """A recording that ``write`` makes of ``path``, and the folder that it lies in."""
    folder = TemporaryDirectory(prefix="stopproof-", ignore_cleanup_errors=True)
    out = Path(folder.name) / "recording.mcap"
    try:
        write(out)
    except OSError as error:
        wrong = f"cannot be translated into {folder.name}: {error.strerror or error}"
        raise RecordingError(path, "", wrong, "TMPDIR names another folder") from error
    return folder, McapFile(out, shown=path)
