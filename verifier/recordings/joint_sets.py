"""Joint sets of body trackers: which of their joints is which of our points (``joint_sets.toml``)."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS
from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import SourceError
from verifier.recordings.people_report import COLUMN, ReportedPerson

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

Joint = int | str
_FILE = Path(__file__).with_name("joint_sets.toml")


@dataclass(frozen=True, slots=True)
class JointSet:
    """The joints of one kind of skeleton.

    Attributes
    ----------
    name, title:
        Key, and what it is called.
    joints:
        Indices or names of the source's joints, in the order of the arrays that :meth:`person` takes; of an
        index set all of them, whether they are ours or not.
    at:
        Column of our point -> the source's joint, or the two between which it lies.
    source, certainty:
        Where that is written, and how sure it is.
    """

    name: str
    title: str
    joints: tuple[Joint, ...]
    at: Mapping[int, tuple[int, ...]]
    source: str
    certainty: Certainty

    def person(self, name: str, xyz: FloatArray, inferred: BoolArray) -> ReportedPerson:
        """Return a person's points.

        Parameters
        ----------
        name:
            The tracker's name for the person.
        xyz:
            Positions of the joints, shape (J, 3) [m]; one with a NaN or an infinity, or at exactly (0, 0, 0),
            is missing.
        inferred:
            Which of them the tracker inferred, shape (J,).

        Raises
        ------
        SourceError
            There are not as many joints as the set has.
        """
        if xyz.shape != (len(self.joints), 3) or inferred.shape != xyz.shape[:1]:
            shape = " x ".join(map(str, xyz.shape))
            raise SourceError(f"positions are {shape} numbers; {self.title} has {len(self.joints)} x 3")
        known: BoolArray = np.isfinite(xyz).all(axis=1) & (xyz != 0.0).any(axis=1)
        points = np.full((MAX_POINTS, 3), np.nan)
        measured = 0
        for column, rows in self.at.items():
            if known[list(rows)].all():
                points[column] = 0.5 * xyz[rows[0]] + 0.5 * xyz[rows[-1]]
                measured |= int(not inferred[list(rows)].any()) << column
        return ReportedPerson(name, points, np.full(MAX_POINTS, np.nan), measured)

    def assumption(self) -> Assumption:
        """Say which set was taken to be recorded, as results list it."""
        return Assumption("recording.joint_set", self.title, "", self.source, self.certainty)


@cache
def joint_sets() -> Mapping[str, JointSet]:
    """Return every known joint set by its name."""
    table = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    return MappingProxyType({name: _joint_set(name, entry) for name, entry in table.items()})


def joint_set(name: object) -> JointSet:
    """Return a joint set by its name.

    Raises
    ------
    SourceError
        It is not known: nothing is guessed.
    """
    known = joint_sets()
    if not isinstance(name, str) or name not in known:
        raise SourceError(f"joint set {str(name)[:40]!r} is not known; known are {', '.join(known)}")
    return known[name]


def _joint_set(name: str, entry: Mapping[str, Any]) -> JointSet:
    ends = {
        COLUMN[point]: where if isinstance(where, list) else [where] for point, where in entry["at"].items()
    }
    named = [joint for joints in ends.values() for joint in joints if isinstance(joint, str)]
    joints: tuple[Joint, ...] = tuple(dict.fromkeys(named)) or tuple(range(entry["joints"]))
    at = {column: tuple(joints.index(joint) for joint in where) for column, where in ends.items()}
    certainty = Certainty(entry["certainty"])
    return JointSet(name, entry["title"], joints, MappingProxyType(at), entry["source"], certainty)
