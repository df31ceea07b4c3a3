"""Sections: what a cell says reaches planner and path, window after window."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from tests.verifier.scenes import CELL, UR5_JOINTS, Scene, at, far, person_at, swing, write_reports
from verifier import Cell, verify
from verifier.recordings import Reading, Recording
from verifier.section import LEAD_S, TAIL_S, Section, Sections
from verifier.setup import build_gate, build_profile, build_robot
from verifier.supervised import supervise

TRACKING = {
    "position_error_rad": 0.02,
    "velocity_error_rad_s": 0.03,
    "delay_min_s": 0.004,
    "delay_max_s": 0.012,
}


def made(
    path: Path, robot: dict[str, object], window_s: float = 30.0, **table: object
) -> tuple[Sections, list[Section]]:
    cell = Cell.from_table({**CELL, "robot": {**CELL["robot"], "name": "ur5", **robot}, **table})
    arm = build_robot(cell)
    sections = Sections(path, cell, arm, build_gate(cell, build_profile(cell)))
    reading = Reading(Recording(path), UR5_JOINTS)
    return sections, [sections.next(window) for window in reading.windows(window_s, LEAD_S, TAIL_S)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Scene(duration=3.0).write(tmp_path_factory.mktemp("section") / "r.mcap")


def test_the_planner_is_that_of_the_cell(recording: Path) -> None:
    stop = {"slice_s": 0.004, "allow_joint_space": False}
    sections, (section,) = made(recording, {"tracking": TRACKING}, stop=stop, cycle_s=0.02)
    settings = section.planner.settings
    assert settings.cycle_s == 0.02 and settings.slice_s == 0.004
    assert settings.allow_joint_space is False
    assert settings.delay == (0.004, 0.012)
    assert settings.q_error.tolist() == [0.02] * 6 and settings.dq_error.tolist() == [0.03] * 6
    assert sections.residual is None


def test_an_undeclared_error_is_the_largest_residual_of_the_samples(recording: Path) -> None:
    sections, (section,) = made(recording, {})
    (trajectory,) = section.trajectories
    path = trajectory.sample(section.window.t)[0]
    off = np.abs(section.window.q - path).max(axis=0)
    assert sections.residual is not None
    np.testing.assert_allclose(sections.residual, off, atol=1e-12)
    np.testing.assert_allclose(section.planner.settings.q_error, off, atol=1e-12)


def test_the_largest_residual_of_all_windows_is_kept(tmp_path: Path) -> None:
    def bump(t: float) -> np.ndarray:
        return swing(t) + (0.01 if abs(t - 7.0) < 0.004 else 0.0)

    path = Scene(duration=9.0, motion=bump).write(tmp_path / "r.mcap")
    sections, found = made(path, {}, window_s=1.5)
    assert len(found) >= 4
    assert sections.residual is not None and sections.residual.min() > 1e-3
    first = found[0].planner.settings.q_error  # knows nothing of what comes after 5.5 s
    assert (sections.residual >= first).all() and (sections.residual > first).any()


def test_a_path_that_misses_its_samples_must_be_declared(tmp_path: Path) -> None:
    def jumps(t: float) -> np.ndarray:
        return swing(t) + (0.2 if abs(t - 1.504) < 0.004 else 0.0)

    path = Scene(duration=3.0, motion=jumps).write(tmp_path / "r.mcap")
    with pytest.raises(
        SetupError,
        match=r"by 0\.1\d+ rad at 1\.50\d s \(between 0\.00 s and 3\.00 s\): look at the samples there",
    ):
        made(path, {})


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("value", "told"), [(1e300, "1e+300"), (-2e4, "-2e+04"), (math.nextafter(1e3, math.inf), "1000")]
)
@pytest.mark.parametrize("everywhere", [False, True])
def test_where_no_joint_is_the_sample_is_named(
    tmp_path: Path, value: float, told: str, everywhere: bool
) -> None:
    def motion(t: float) -> np.ndarray:
        q = swing(t)
        if everywhere or abs(t - 1.0) < 1e-6:
            q[2] = value
        return q

    path = Scene(motion=motion).write(tmp_path / "r.mcap")
    when = "0.000" if everywhere else "1.000"
    text = re.escape(
        f"elbow_joint at {told} rad at {when} s: no joint is there (its position limits are -3.1"
    )
    with pytest.raises(SetupError, match=text) as refusal:
        made(path, {"tracking": TRACKING})
    assert str(refusal.value).endswith("and 3.142 rad); positions must be in rad")
    assert len(str(refusal.value)) < 300
    cell = Cell.from_table({**CELL, "robot": {**CELL["robot"], "name": "ur5"}})
    for judge in (verify, supervise):
        with pytest.raises(SetupError, match=r"no joint is there|beyond 1000 a path loses digits"):
            judge(path, cell)


def test_a_joint_that_has_turned_many_times_is_believed(tmp_path: Path) -> None:
    """Whether it may be there is a matter of the limits."""
    path = Scene(motion=lambda t: swing(t) + 400.0).write(tmp_path / "r.mcap")
    _sections, (section,) = made(path, {"tracking": TRACKING})
    assert len(section.trajectories) == 1


def test_a_path_that_loses_its_digits_names_the_joint(tmp_path: Path) -> None:
    """How it is rounded decides whether it does, and that depends on the processor: some of twelve do."""
    refused = []
    for turned in np.linspace(940.0, 995.0, 12).tolist():
        away = np.array([0.0, 0.0, 0.0, 0.0, turned, 0.0])
        path = Scene(motion=lambda t, away=away: swing(t) + away).write(tmp_path / f"{turned}.mcap")
        try:
            made(path, {"tracking": TRACKING})
        except SetupError as error:
            refused.append(str(error))
    assert refused
    for text in refused:
        assert re.search(r"jumps by .* \(wrist_2_joint: up to 9[0-9][0-9]\.?[0-9]* rad\)$", text), text


def test_knots_of_the_cell_are_used(recording: Path) -> None:
    close, wide = (made(recording, {"knot_spacing_s": s})[0].residual for s in (0.05, 1.0))
    assert close is not None and wide is not None
    assert wide.max() > 10.0 * close.max()


def test_reports_around_a_window_belong_to_its_future_and_its_past(tmp_path: Path) -> None:
    path = Scene(duration=9.0, people={"p1": far}, people_rate=10.0).write(tmp_path / "r.mcap")
    _, found = made(path, {}, window_s=1.0)
    for section in found:
        (samples,) = section.people["p1"].samples
        assert samples.t[-1] >= min(section.window.end + TAIL_S, 9.0) - 0.11
        assert samples.t[0] <= max(section.window.start - 0.5, 0.0)
        assert section.stamps.tolist() == samples.t.tolist()
        end = section.window.end + TAIL_S
        assert section.follows(end)
        if end < 8.8:  # the next report is one that this window does not have
            assert not section.follows(float(samples.t[-1]) + 0.11)
    assert sum(section.window.end + TAIL_S < 8.8 for section in found) > 2 and found[-1].follows(100.0)


def test_a_window_without_samples_is_one_gap(tmp_path: Path) -> None:
    times = [t for t in np.arange(0.0, 20.0, 0.01) if not 4.0 < t < 15.0]
    path = write_reports(
        tmp_path / "r.mcap",
        [(t, t, {"p1": person_at(4.0, 0.0)}) for t in at(10.0, 20.0)],
        joint_times=times,
    )
    _, found = made(path, {}, window_s=1.0)
    for section in found:
        for t in np.arange(section.window.start + 0.025, section.window.end, 0.05):
            gap = section.robot.check(float(t), float(t) + 0.1)
            assert (gap is not None) == (3.9 <= t <= 15.0), t
