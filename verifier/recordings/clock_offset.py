"""What is added to stamps so that they are on the clock of the message times, and how well that is known.

How such offsets are found, and what of them is proven: docs/clocks.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from robots.errors import SetupError
from verifier.recordings import joint_state, json_text
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_state import NANO
from verifier.recordings.people_report import STAMP_NAME, ReportError, decimal, stamp_of

LARGEST_OFFSET_S = 4e9
LARGEST_ERROR_S = 10.0
SIGNS = ("±", "+/-", "+-")
"""Between an offset and its error."""
MOVED_BY = {
    "people": "`stopproof inspect` bounds their offset; state it as --time-offset S±ERR, or in the cell as "
    "time_offset_s in [recording] with people.clock_error_s",
    "joints": "`stopproof inspect` bounds their offset; state it in the cell as joints_time_offset_s in "
    "[recording] with people.clock_error_s",
}
"""How stamps come to another clock."""
PEOPLE_MOVED, JOINTS_MOVED, ERROR = "people_time_offset_s", "joints_time_offset_s", "time_offset_error_s"
"""Keys of the record ``stopproof``: what was added to the stamps of a recording already, and its error."""
_SINCE_1970_S = (946_684_800.0, 4_102_444_800.0)
"""Clocks that count from 1970 are between 2000 and 2100."""


class TimeOffset(NamedTuple):
    """An offset and the largest distance from it of the true one [s]; ``None``: nobody stated that."""

    offset_s: float
    error_s: float | None


def read_time_offset(text: str) -> TimeOffset:
    """Read ``S±ERR`` [s]; ``+-`` and ``+/-`` stand for ``±``.

    Raises
    ------
    SetupError
        It is none, or a number is NaN, infinite or too large.
    """
    sign = next((sign for sign in SIGNS if sign in text), None)
    parts = [text] if sign is None else text.split(sign)
    try:
        offset_s, *rest = (float(part) for part in parts)
    except ValueError as error:
        raise SetupError(
            f"--time-offset {text}: it must be S±ERR in s, as 0.25±0.01 or 0.25+-0.01"
        ) from error
    if len(rest) > 1:
        raise SetupError(f"--time-offset {text}: it must be S±ERR in s, with one error")
    if not abs(offset_s) <= LARGEST_OFFSET_S:
        raise SetupError(f"time offset {offset_s} s: it must be within {LARGEST_OFFSET_S:g} s")
    if rest and not 0.0 <= rest[0] <= LARGEST_ERROR_S:
        raise SetupError(f"time offset error {rest[0]} s: it must be from 0 to {LARGEST_ERROR_S:g} s")
    return TimeOffset(offset_s, rest[0] if rest else None)


@dataclass(frozen=True, slots=True)
class ClockOffsets:
    """What is added to the stamps of people and of joints, commands included.

    Attributes
    ----------
    people_s, joints_s:
        Offsets [s]; ``None``: nobody stated one, and stamps count as they are.
    error_s:
        How far the two clocks may still be apart after that [s].
    """

    people_s: float | None = None
    joints_s: float | None = None
    error_s: float = 0.0

    @property
    def stated(self) -> bool:
        """Whether anything is stated."""
        return self.people_s is not None or self.joints_s is not None

    @property
    def people_ns(self) -> int:
        """What is added to stamps of people [ns]."""
        return round((self.people_s or 0.0) * NANO)

    @property
    def joints_ns(self) -> int:
        """What is added to stamps of joints [ns]."""
        return round((self.joints_s or 0.0) * NANO)

    @property
    def later_ns(self) -> int:
        """How much later reports count as arrived [ns].

        The instants of a cycle are on the clock of the joints, whose offset may be wrong by the error.
        """
        return 0 if self.joints_s is None else math.ceil(self.error_s * NANO)

    def metadata(self) -> dict[str, str]:
        """Return what a recording with moved stamps says of itself."""
        if not self.stated:
            return {}
        moved = {PEOPLE_MOVED: self.people_s, JOINTS_MOVED: self.joints_s}
        return {key: repr(value) for key, value in moved.items() if value is not None} | {
            ERROR: repr(self.error_s)
        }


ONE_CLOCK = ClockOffsets()


def refuse_moved(path: Path, metadata: Mapping[str, str], clocks: ClockOffsets) -> None:
    """Refuse to move stamps that were moved already.

    Raises
    ------
    RecordingError
        The recording says that its stamps were moved, and an offset is stated.
    """
    moved = [f"{key} = {metadata[key]}" for key in (PEOPLE_MOVED, JOINTS_MOVED, ERROR) if key in metadata]
    if clocks.stated and moved:
        wrong = f"its stamps were moved already ({', '.join(moved)})"
        raise RecordingError(path, "", wrong, "state no time offset for it, only people.clock_error_s")


def stated_error(metadata: Mapping[str, str]) -> float:
    """Return the error [s] of the offset that moved stamps; 0: none is stated; NaN: it is no number."""
    try:
        return float(metadata.get(ERROR, "0"))
    except ValueError:
        return math.nan


def refuse_unstated_error(path: Path, metadata: Mapping[str, str], clock_error_s: float) -> None:
    """Refuse a recording whose stamps are known less well than the cell says.

    Raises
    ------
    RecordingError
        Its stamps were moved with a larger error than ``clock_error_s``, or what it says of it is no number.
    """
    if not stated_error(metadata) <= clock_error_s:
        wrong = f"its stamps were moved by an offset with an error of {metadata[ERROR][:40]} s"
        right = f"people.clock_error_s of the cell must be at least that, it is {clock_error_s:g} s"
        raise RecordingError(path, "", wrong, right)


def moved_cdr(data: bytes, offset_ns: int) -> bytes:
    """Return a JointState in CDR with another stamp; one without a stamp, or that is none, stays as it is.

    Raises
    ------
    OverflowError
        As :func:`moved_stamp`.
    """
    stamp_ns = joint_state.stamp_of(data)
    return joint_state.with_stamp(data, moved_stamp(stamp_ns, offset_ns)) if stamp_ns else data


def moved_stamp(stamp_ns: int, offset_ns: int) -> int:
    """Return the stamp of joints with an offset [ns].

    Raises
    ------
    OverflowError
        It would be 0, which says that there is no stamp, before 1970, or after 2038.
    """
    moved = stamp_ns + offset_ns
    if not 0 < moved < joint_state.LATEST_STAMP_NS:
        raise OverflowError(f"a stamp of {stamp_ns / NANO:.9g} s would become {moved / NANO:.9g} s")
    return moved


def moved_json(data: bytes, offset_ns: int) -> bytes:
    """Return a report of ours with another stamp; what is no report stays as it is, and is refused later."""
    try:
        message = json_text.loads(data)
        if not isinstance(message, dict):
            return data
        stamp_ns = stamp_of(message.get(STAMP_NAME), data) + offset_ns
    except (json_text.JsonError, ReportError):
        return data
    rest = json.dumps({key: value for key, value in message.items() if key != STAMP_NAME})
    return f'{{"{STAMP_NAME}":{decimal(stamp_ns)}{"," if rest != "{}" else ""}{rest[1:]}'.encode()


def in_words(time_ns: int) -> str:
    """Return an instant [ns] with what its clock seems to count from."""
    seconds = time_ns / NANO
    if _SINCE_1970_S[0] <= seconds < _SINCE_1970_S[1]:
        return f"{seconds:.3f} s since 1970 ({datetime.fromtimestamp(seconds, UTC):%Y-%m-%d})"
    return f"{seconds:.3f} s since a start"
