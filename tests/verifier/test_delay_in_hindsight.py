"""The robot may rest later than planned by its largest delay: what is seen until then counts as well."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.verifier.scenes import CELL, Scene, far, person_at
from verifier import Cell, Reason, Status, verify
from verifier.batch import BatchVerifier
from verifier.setup import build_gate, build_profile

SEEN_S, DELAY_S, CYCLE_S = 2.0, 0.3, 0.01
LATE = {**CELL, "robot": {**CELL["robot"], "tracking": {"delay_max_s": DELAY_S}}}


def comes_in(t: float) -> np.ndarray | None:
    return person_at(1.1, 0.0) + 1e-4 * t if t >= SEEN_S - 1e-9 else None


def test_who_is_first_seen_within_the_delay_was_unreported(tmp_path: Path) -> None:
    path = Scene(people={"p1": far, "p2": comes_in}, duration=3.0).write(tmp_path / "r.mcap")
    cell = Cell.from_table(LATE)
    rows = verify(path, cell).per_cycle
    rests = rows.t + 2.0 * CYCLE_S + rows.stop_time_s
    within = (rests < SEEN_S - 0.001) & (rests + DELAY_S > SEEN_S + 0.001)
    assert np.count_nonzero(within) > 20
    assert (rows.reason[within] == Reason.UNREPORTED_PERSON).all()
    before = rests + DELAY_S < SEEN_S - 0.001
    assert np.count_nonzero(before) > 20
    assert not (rows.status[before] == Status.CONTRADICTED).any()
    many = BatchVerifier(cell, recorded="ur5").verify_recording(path)
    assert many.bounded.any(), "vacuous: nothing was proven together"
    np.testing.assert_array_equal(many.reason, rows.reason)


def test_a_gate_has_the_errors_of_its_cell() -> None:
    table = {**CELL, "people": {"stamp_error_s": 0.004, "clock_error_s": 0.003, "position_error_m": 0.02}}
    cell = Cell.from_table(table)
    gate = build_gate(cell, build_profile(cell))
    assert gate.people["stamp_error"][0] == 0.004 and gate.people["clock_error"][0] == 0.003
    assert gate._frames["world"]["default_error"][0] == 0.02
