"""Small recordings for the tests."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from occupancy.body import POINT_NAMES
from verifier.recordings import RecordingWriter, new_recording
from verifier.recordings.joint_state import JointState
from verifier.recordings.people_report import PeopleReport, ReportedPerson

NANO = 1_000_000_000
JOINTS = ("shoulder", "elbow")
WRIST = POINT_NAMES.index("r_wrist")


def joint_states(
    rate_hz: float = 100.0, seconds: float = 2.0, start_ns: int = 0, names: tuple[str, ...] = JOINTS
) -> list[JointState]:
    """Joints on sine curves."""
    times = [start_ns + round(n / rate_hz * NANO) for n in range(round(rate_hz * seconds) + 1)]
    return [
        JointState(t, names, np.array([np.sin(j + (t - start_ns) / NANO) for j in range(len(names))]))
        for t in times
    ]


def person(name: str = "p1", x: float = 1.0, error_m: float = 0.01) -> ReportedPerson:
    xyz = np.full((20, 3), np.nan)
    xyz[WRIST] = x, 2.0, 3.0
    return ReportedPerson(name, xyz, np.full(20, error_m), 1 << WRIST)


def reports(
    rate_hz: float = 50.0, seconds: float = 2.0, start_ns: int = 0, delay_s: float = 0.02
) -> list[PeopleReport]:
    times = [start_ns + round(n / rate_hz * NANO) for n in range(round(rate_hz * seconds) + 1)]
    return [
        PeopleReport(t, t + round(delay_s * NANO), "world", True, (person(x=(t - start_ns) / NANO + 1.0),))
        for t in times
    ]


def write_all(
    path: Path,
    items: Iterable[JointState | PeopleReport],
    also: Callable[[RecordingWriter], None] = lambda writer: None,
) -> Path:
    """Write messages in order of their time."""
    with new_recording(path) as writer:
        also(writer)
        for item in sorted(items, key=lambda i: i.arrived_ns if isinstance(i, PeopleReport) else i.stamp_ns):
            if isinstance(item, PeopleReport):
                writer.people(item)
            else:
                writer.joints(item)
    return path
