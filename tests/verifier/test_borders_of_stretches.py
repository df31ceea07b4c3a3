"""What a stretch of 30 s must know of the reports before it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.verifier.scenes import Array, person_at, swing, write_reports
from tests.verifier.test_sizes import large
from verifier import Cell, Reason, Status, verify
from verifier.batch import BatchVerifier

PEOPLE = {"latency_s": 0.005, "repeated_points": "measured"}
CELL = {"cycle_s": 0.02, "robot": {"bare_flange": True, "accept_assumed": ["limits"]}}


def recorded(path: Path, seconds: float, late: tuple[float, float, Array] | None, until: float) -> Path:
    """Reports at 20 Hz; p1 is listed until then [s], afterwards nobody, or p2 where something comes late."""
    away, other = {"p1": person_at(22.0, 0.0)}, {} if late is None else {"p2": person_at(0.0, 25.0)}
    reports = [
        (i / 20.0, i / 20.0 + 0.005, away if i / 20.0 < until else other)
        for i in range(int(seconds * 20) - 1)
    ]
    if late is not None:
        reports.append((late[0], late[1], {"p1": late[2]}))
    times = [i / 125.0 for i in range(int(seconds * 125) + 1)]
    ordered = sorted(reports, key=lambda each: each[1])
    return write_reports(path, ordered, motion=swing, joint_times=times, complete=False)


def test_a_report_that_comes_late_counts_on_both_sides_of_a_border(tmp_path: Path) -> None:
    """Seen at 24 s, it arrives at 33 s and says that p1 was elsewhere: until then nothing is verified."""
    path = recorded(tmp_path / "r.mcap", 36.0, (24.0, 33.0, large(9.0)), 25.95)
    cell = Cell.from_table(CELL | {"people": PEOPLE})
    rows = verify(path, cell).per_cycle
    between = (rows.t > 24.1) & (rows.t < 35.0)
    assert (rows.status[between] == Status.CONTRADICTED).all()
    many = BatchVerifier(cell, recorded="ur5").verify_recording(path)
    np.testing.assert_array_equal(many.reason, rows.reason)


def test_reports_before_a_border_are_no_silence(tmp_path: Path) -> None:
    path = recorded(tmp_path / "r.mcap", 36.0, None, 24.5)
    cell = Cell.from_table(CELL | {"people": PEOPLE | {"max_report_gap_s": 0.5}})
    report = verify(path, cell)
    assert Reason.PEOPLE_STREAM_GAP not in {Reason(int(each)) for each in report.per_cycle.reason}
    assert report.count(Status.VERIFIED) > 0.9 * report.cycles
