"""Inverse answers: what is answered verifies, one step beyond does not; and closed forms."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.errors import SetupError
from tests.verifier.scenes import CELL, Scene, at_rest, person_at
from tests.verifier.shell import Shell, refused
from tests.verifier.test_protective_separation import capsule_at, ur5
from verifier import Cell, Status, VerifyReport, verify
from verifier.barriers import CORNERS, Barrier, Boundary
from verifier.bracket import Bracket
from verifier.limits import LimitsSettings, find_limits
from verifier.limits_command import limits as command
from verifier.reports.limits import LimitsReport
from verifier.verdict import Reason

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
CYCLE, DELAY, LATENCY, OMEGA, SPEED = 0.01, 0.008, 0.035, 0.6, 2.0
TABLE: dict[str, dict[str, Any]] = {
    "robot": {**CELL["robot"], "tracking": {"delay_max_s": DELAY}},
    "people": {**CELL["people"], "latency_s": LATENCY},
}


def turning(omega: float = OMEGA):
    """Joint 1 alone, at a constant speed."""
    return lambda t: np.array([omega * t - 0.5, -1.2, 1.3, -0.4, 0.3, 0.0])


def with_people(**more: Any) -> Cell:
    return Cell.from_table({**TABLE, "people": {**TABLE["people"], **more}})


def ask(path: Path, cell: Cell, *answers: str, **settings: Any) -> LimitsReport:
    return find_limits(path, cell, LimitsSettings(answers=answers, **settings))


def ends(bracket: Bracket) -> tuple[float, float]:
    assert bracket.verified_at is not None and bracket.not_verified_at is not None, bracket
    assert bracket.cycles > 0 and bracket.failure is not None
    return bracket.verified_at, bracket.not_verified_at


def all_verified(report: VerifyReport, window: slice = slice(None)) -> bool:
    """Whether every cycle that was checked is verified."""
    status = report.per_cycle.status[window]
    assert (status == int(Status.VERIFIED)).any() or (status == int(Status.NOT_VERIFIED)).any()
    return not set(status.tolist()) & {int(Status.NOT_VERIFIED), int(Status.CONTRADICTED)}


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"answers": ()}, r"--only \(none\)"),
        ({"answers": ("speed", "wealth")}, "--only wealth: known are speed, latency, line, separation"),
        ({"window_s": (-1.0, 2.0)}, "--from -1 --to 2"),
        ({"window_s": (2.0, 2.0)}, "--from 2 --to 2"),
        ({"window_s": (float("nan"), 2.0)}, "--from nan"),
        ({"fastest": 0.0}, "--fastest 0: should be 0.015625 to 10"),
        ({"fastest": float("inf")}, "--fastest inf"),
        ({"latency_bound_s": float("nan")}, "--latency-bound nan"),
        ({"farthest_m": 0.1}, "--farthest 0.1: should be 0.11 to 25"),
        ({"detection_time_s": -0.1}, "--detection-time -0.1"),
        ({"angles_deg": (0.0, float("nan"))}, "--line nan: should be an angle in degrees"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(SetupError, match=told):
        LimitsSettings(**settings)


def test_the_answer_about_the_bundled_recording_verifies_and_a_step_beyond_does_not() -> None:
    """With `verify` itself, in cells that state the two latencies."""
    recording, cell = ROOT / "data/demo.mcap", Cell.from_toml(ROOT / "data/demo.toml")
    found = ask(recording, cell, "latency", window_s=(7.9, 8.0), latency_bound_s=0.06)
    assert found.latency is not None
    holds, fails = ends(found.latency)
    assert fails - holds == pytest.approx(0.001) and holds > 0.03
    window = slice(790, 800)
    for latency, verified in ((holds, True), (fails, False)):
        people = cell.people.model_copy(update={"latency_s": latency})
        report = verify(recording, cell.model_copy(update={"people": people}))
        assert all_verified(report, window) is verified
        if not verified:
            failed = window.start + int(
                np.argmax(report.per_cycle.status[window] == int(Status.NOT_VERIFIED))
            )
            failure = found.latency.failure
            assert failure is not None and failure.t == pytest.approx(failed * CYCLE)
            assert failure.reason is Reason(int(report.per_cycle.reason[failed]))


def test_the_path_speed_is_that_at_which_a_recording_verifies(tmp_path: Path) -> None:
    """Beside somebody who stands still, a path speed is a recording of a motion that is so much slower."""
    people = {"p": lambda _t: person_at(1.37, 0.0)}
    path = Scene(motion=turning(), duration=1.0, people=people).write(tmp_path / "r.mcap")
    cell = Cell.from_table(TABLE)
    (segment,) = ask(path, cell, "speed", fastest=3.0).segments or ()
    holds, fails = ends(segment.path_speed)
    assert holds > 0.0 and fails - holds == pytest.approx(1.0 / 64.0)
    for speed, verified in ((holds - 1.0 / 64.0, True), (fails + 1.0 / 64.0, False)):
        other = Scene(motion=turning(OMEGA * speed), duration=1.0 / speed, people=people)
        assert all_verified(verify(other.write(tmp_path / f"{verified}.mcap"), cell)) is verified


@pytest.mark.parametrize("answer", ["latency", "separation"])
@pytest.mark.parametrize(("stated", "listed"), [(0.005, False), (math.nan, True)])
def test_the_default_position_error_is_listed_where_it_was_used(
    tmp_path: Path, stated: float, listed: bool, answer: str
) -> None:
    path = Scene(duration=0.3, error_m=stated).write(tmp_path / "r.mcap")
    report = ask(path, Cell.from_table(TABLE), answer)
    assert ("people.position_error" in {item.name for item in report.assumptions}) is listed


@pytest.mark.parametrize("angle", [None, 20.0])
def test_the_nearest_line_is_that_of_the_cell_that_verifies(tmp_path: Path, angle: float | None) -> None:
    """A recording in which nobody is, in cells whose monitored region ends at the two distances."""
    scene = Scene(motion=turning(), duration=0.4, people={}, people_rate=100.0, complete=True)
    path = scene.write(tmp_path / "r.mcap")
    cell = Cell.from_table(TABLE)
    angles = () if angle is None else (angle,)
    (line,) = ask(path, cell, "line", angles_deg=angles, farthest_m=1.7, detection_time_s=0.08).lines or ()
    holds, fails = ends(line.distance)
    assert holds - fails == pytest.approx(0.01)
    for distance, verified in ((holds, True), (fails, False)):
        region = {
            "kind": "prism", "detection_time_s": 0.08, "z_m": (-50.0, 50.0),
            "polygon_m": Boundary((0.0, 0.0, 0.0), distance, angle).polygon,
        }  # fmt: skip
        assert all_verified(verify(path, with_people(monitored={"line": region}))) is verified


def farthest_out() -> float:
    """How far any link reaches from the axis about which the arm turns [m]."""
    ends = (capsule_at(link, turning()(0.3)) for link in ur5()[0].links)
    return max(max(float(np.hypot(*a[:2])), float(np.hypot(*b[:2]))) + radius for a, b, radius in ends)


@pytest.mark.parametrize("angle", [None, 0.0, -30.0])
def test_a_fence_stands_on_the_region_that_people_are_kept_out_of(angle: float | None) -> None:
    """Each plane on two corners that follow each other, all others on its free side."""
    boundary = Boundary((0.3, -0.2, 0.1), 1.5, angle)
    corners = np.array(boundary.polygon) - np.array(boundary.base_m[:2])
    planes = list(boundary.planes())
    assert len(planes) == (CORNERS if angle is None else 1)
    for number, plane in enumerate(planes):
        assert plane.normal is not None and plane.point_m is not None
        away = (corners - np.array(plane.point_m[:2]) + np.array(boundary.base_m[:2])) @ plane.normal[:2]
        on = {k for k in range(len(corners)) if abs(away[k]) < 1e-9}
        assert on == {number, (number + 1) % len(corners)} and away.min() > -1e-9
    if angle is None:
        np.testing.assert_allclose(np.linalg.norm(corners, axis=1), 1.5)


@pytest.mark.parametrize("angle", [None, -30.0])
def test_the_nearest_fence_in_closed_form(tmp_path: Path, angle: float | None) -> None:
    """No link may touch a fence: that of a circle stands as far away as the arm reaches out.

    A line in the direction where the arm points in the middle of the recording, too.
    """
    path = Scene(motion=turning(1.2), duration=0.4, people={}, complete=True).write(tmp_path / "r.mcap")
    cell, angles = Cell.from_table(TABLE), () if angle is None else (pointing(turning(1.2)(0.2)),)
    settings = {"angles_deg": angles, "farthest_m": 1.2, "barrier": Barrier.FENCE}
    found = ask(path, cell, "line", **settings)
    (line,) = found.lines or ()
    holds, fails = ends(line.distance)
    shrunk = np.cos(np.pi / CORNERS) if angle is None else 1.0
    assert fails * shrunk < farthest_out() + 2e-3 and holds >= farthest_out()
    assert line.distance.failure is not None
    assert line.distance.failure.reason is Reason.FIXTURE_IN_REACH
    assert "closed by a fence" in "\n".join(found.lines_of_text())
    assert {"line.fence"} == {item.name for item in found.assumptions if "fence" in item.name}


def test_the_fence_stands_around_the_base_wherever_that_is(tmp_path: Path) -> None:
    """As far from the base as when the base is at the origin: as far as the arm reaches out."""
    path = Scene(motion=turning(1.2), duration=0.4, people={}, complete=True).write(tmp_path / "r.mcap")
    robot = {**TABLE["robot"], "mount": {"xyz_m": (0.7, -0.4, 0.2)}}
    found = ask(
        path, Cell.from_table({**TABLE, "robot": robot}), "line", farthest_m=1.2, barrier=Barrier.FENCE
    )
    (line,) = found.lines or ()
    holds, fails = ends(line.distance)
    assert fails * np.cos(np.pi / CORNERS) < farthest_out() + 2e-3 and holds >= farthest_out()
    assert line.base_m == (0.7, -0.4)


def test_each_line_is_that_of_its_own_direction(tmp_path: Path) -> None:
    """In the middle of the recording the arm points at the first; it is nearest to the second at its begin.

    It turns away from there, in its stops too. What is judged first is planned, and begins a cycle later.
    """
    path = Scene(motion=turning(1.2), duration=0.4, people={}, complete=True).write(tmp_path / "r.mcap")
    ahead = pointing(turning(1.2)(0.2))
    angles = (ahead, ahead - 60.0)
    found = ask(
        path, Cell.from_table(TABLE), "line", angles_deg=angles, farthest_m=1.2, barrier=Barrier.FENCE
    )
    reaches = (farthest_out(), farthest_towards(angles[1], turning(1.2)(CYCLE)))
    assert reaches[1] < 0.8 * reaches[0], "vacuous"
    for line, angle, reach in zip(found.lines or (), angles, reaches, strict=True):
        holds, fails = ends(line.distance)
        assert line.angle_deg == angle and fails < reach + 2e-3 and holds >= reach


def farthest_towards(angle_deg: float, q: Array) -> float:
    """How far any link reaches in a direction about z [m]."""
    towards = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    ends = [capsule_at(link, q) for link in ur5()[0].links]
    return max(float(max(a[:2] @ towards, b[:2] @ towards)) + radius for a, b, radius in ends)


def test_a_fixture_that_is_called_as_the_fence_is_not_replaced(tmp_path: Path) -> None:
    wall = {"kind": "plane", "point_m": (5.0, 0.0, 0.0), "normal": (-1.0, 0.0, 0.0)}
    cell = Cell.from_table({**TABLE, "workspace": {"fixtures": {"fence 3": wall}}})
    path = Scene(duration=0.2).write(tmp_path / "r.mcap")
    with pytest.raises(SetupError, match=r"workspace.fixtures: 'fence 3' is kept for --barrier fence"):
        ask(path, cell, "line", barrier=Barrier.FENCE)


def pointing(q: Array) -> float:
    """Direction [deg] in which the point of the arm lies that is farthest out."""
    ends = [capsule_at(link, q) for link in ur5()[0].links]
    points = [(float(np.hypot(*p[:2])) + r, p) for a, b, r in ends for p in (a, b)]
    _, far = max(points, key=lambda each: each[0])
    return float(np.degrees(np.arctan2(far[1], far[0])))


def test_the_nearest_circle_in_closed_form(tmp_path: Path) -> None:
    """The arm turns about the centre: it always reaches as far out, and always stops as quickly.

    Whoever comes in from the circle comes as far as v times detection (0.1 s by default), latency, the age of
    the newest report, two periods of the cycle, the stop and the delay. The circle is a polygon, whose edges
    are nearer than its corners by the cosine of half an edge.
    """
    path = Scene(motion=turning(), duration=0.5, people={}, complete=True).write(tmp_path / "r.mcap")
    cell = Cell.from_table(TABLE)
    found = ask(path, cell, "line", farthest_m=1.7)
    (circle,) = found.lines or ()
    holds, fails = ends(circle.distance)
    listed = {each.name: each for each in found.assumptions}
    assert (listed["line.detection_time"].value, listed["line.detection_time"].certainty) == (0.1, "default")
    stop = float(np.nanmax(verify(path, cell).per_cycle.stop_time_s))
    reach = farthest_out()
    age = 0.04  # the first period of 10 ms after a latency of 35 ms
    comes = SPEED * (0.1 + age + 2.0 * CYCLE + stop + DELAY)
    assert fails < (reach + comes + 2e-3) / np.cos(np.pi / CORNERS)
    assert holds >= reach + comes


def test_a_line_is_looked_at_in_the_same_cycles(tmp_path: Path) -> None:
    """All answers count from the first report on, although the line asks for no report."""
    path = Scene(duration=0.5, people_from=0.3).write(tmp_path / "late.mcap")
    found = ask(path, Cell.from_table(TABLE), "line", "separation", farthest_m=1.7)
    assert found.separation is not None and found.lines is not None
    assert 0 < found.lines[0].distance.cycles <= len(found.separation.t) == 19
    nobody = Scene(duration=0.5, people={}, people_from=9.0).write(tmp_path / "none.mcap")
    (circle,) = ask(nobody, Cell.from_table(TABLE), "line", farthest_m=1.7).lines or ()
    assert circle.distance.cycles > 19


def test_the_separation_is_looked_at_in_the_window(tmp_path: Path) -> None:
    path = Scene(duration=0.5).write(tmp_path / "r.mcap")
    found = ask(path, Cell.from_table(TABLE), "separation", window_s=(0.2, 0.3)).separation
    assert found is not None and found.compared == 10
    compared = found.t[np.isfinite(found.required_m)]
    assert compared[0] == pytest.approx(0.2) and compared[-1] == pytest.approx(0.29)


def test_segments_have_speeds_of_their_own(tmp_path: Path) -> None:
    """Somebody is near while the arm moves for the second time, and breaks the profile in the third."""

    def motion(t: float) -> Array:
        within = np.clip((t % 1.0) / 0.7, 0.0, 1.0)
        return np.array([0.1 * (4.0 * within * (1.0 - within)) ** 3 - 0.5, -1.2, 1.3, -0.4, 0.3, 0.0])

    def comes(t: float) -> Array:
        jumps = 2.3 <= t < 2.4
        return person_at(2.0 - 1.0 * float(np.clip(t - 0.7, 0.0, 0.7)) + 0.8 * jumps, 0.0)

    path = Scene(motion=motion, duration=3.0, people={"p": comes}).write(tmp_path / "r.mcap")
    whole = ask(path, Cell.from_table(TABLE), "speed")
    first, second, third = whole.segments or ()
    assert (first.begin_s, third.end_s) == (0.0, pytest.approx(3.0, abs=0.02))
    assert 0.7 < first.end_s < 1.0 and 1.7 < second.end_s == third.begin_s < 2.0
    assert ends(first.path_speed)[0] > ends(second.path_speed)[0] > 0.0
    assert second.path_speed.failure is not None
    assert second.path_speed.failure.reason is Reason.REACHABLE
    assert third.path_speed.verified_at is None and third.path_speed.failure is not None
    assert third.path_speed.failure.reason is Reason.PERSON_OUTSIDE_PREDICTION
    assert third.path_speed.trials[0].value == 0.0, "also an arm at rest is contradicted"
    assert "s: no path speed, not even 0: people are contradicted" in "\n".join(whole.lines_of_text())
    halves = ask(path, Cell.from_table(TABLE), "speed", window_s=(0.1, 0.6), borders_s=(0.3,), fastest=0.5)
    assert [(each.begin_s, each.end_s) for each in halves.segments or ()] == [(0.1, 0.3), (0.3, 0.6)]
    assert {each.path_speed.cycles for each in halves.segments or ()} == {20, 30}
    assert halves.exit_status == 0 and halves.latency is None and halves.lines is None


def test_without_an_answer_the_status_is_1(tmp_path: Path) -> None:
    """Somebody stands within the arm: no number helps, and an arm at rest is no answer."""
    inside = {"p": lambda _t: person_at(0.4, 0.0)}
    path = Scene(motion=turning(), duration=0.5, people=inside).write(tmp_path / "r.mcap")
    found = ask(path, Cell.from_table(TABLE), "speed", "latency")
    assert found.exit_status == 1 and found.latency is not None and found.segments is not None
    assert found.latency.verified_at is None and found.latency.trials[0].value == 0.0
    assert found.segments[0].path_speed.verified_at == 0.0
    text = "\n".join(found.lines_of_text())
    assert "no latency that was tried: at " in text and "verified at 0 (" in text


def test_where_nothing_is_checked_nothing_is_answered(tmp_path: Path) -> None:
    path = Scene(duration=0.3, motion=at_rest).write(tmp_path / "r.mcap")
    found = ask(path, with_people(latency_s=1.0), "speed")
    assert found.exit_status == 1
    assert "no cycle was checked" in "\n".join(found.lines_of_text())
    with pytest.raises(SetupError, match="--from 5 --to inf: no cycle lies there"):
        ask(path, Cell.from_table(TABLE), "latency", window_s=(5.0, float("inf")))


def test_progress_ends_at_1_and_never_goes_back(tmp_path: Path) -> None:
    path = Scene(duration=0.3).write(tmp_path / "r.mcap")
    told: list[float] = []
    near = LimitsSettings(fastest=0.25, latency_bound_s=0.005, farthest_m=1.5, window_s=(0.1, 0.15))
    find_limits(path, Cell.from_table(TABLE), near, progress=told.append)
    assert told[-1] == 1.0 and told == sorted(told) and len(told) > 10


ZERO = "[robot.limits.elbow_joint]\nvelocity_rad_s = 0.0"
MASS = """[workspace]
floor_z_m = -0.8
[[criteria.contact]]
links = ["wrist_3_link"]
parts = ["l_hand"]
payload_kg = 2.0
"""


@pytest.mark.parametrize(
    ("text", "options", "told"),
    [
        (ZERO, (), "robot.limits.elbow_joint.velocity_rad_s = 0.0: must be above 0"),
        (ZERO.replace("velocity_rad_s", "acceleration_rad_s2"), (), "must be above 0"),
        (MASS, (), "moving_mass_kg and payload_kg belong together"),
        ("", ("--only", "wealth"), "--only wealth: known are"),
        ("", ("--fastest", "0"), "--fastest 0"),
        ("", ("--fastest", "x"), "--fastest"),
        ("", ("--border", "9"), "--border 9: should lie between"),
        ("", ("--from", "9"), "no cycle lies there"),
        ("", ("--robot", "panda"), "must agree"),
        ("", ("--json", "{recording}", "--force"), "is the recording itself"),
    ],
)
def test_bad_input_is_2_with_one_line(
    shell: Shell, recording: Path, tmp_path: Path, text: str, options: tuple[str, ...], told: str
) -> None:
    cell = tmp_path / "c.toml"
    cell.write_text(f"[robot]\nbare_flange = true\n{text}\n")
    filled = [each.format(recording=recording) for each in options]
    assert told in refused(shell("limits", recording, "--cell", cell, *filled))


def test_no_recording_is_2_with_one_line(shell: Shell, cell: Path) -> None:
    assert "does not exist" in refused(shell("limits", "nothing.mcap", "--cell", cell))
    assert command.name == "limits"


def test_the_command_prints_and_writes(shell: Shell, recording: Path, cell: Path, tmp_path: Path) -> None:
    target = tmp_path / "limits.json"
    short = ("--from", 0.2, "--to", 0.3, "--fastest", 0.25, "--latency-bound", 0.05, "--farthest", 1.5)
    status, out, err = shell("limits", recording, "--cell", cell, *short, "--json", target)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "stop: path-consistent (this software's) · profile: iso (2 m/s) · waived: nothing"
    assert (
        lines[1].startswith("path speed (1: as recorded)") and "0.20 … 0.30 s: verified at 0.25" in lines[2]
    )
    for begin in ("largest people.latency_s", "nearest circle around (0, 0) m", "S_p (ISO/TS 15066:2016)"):
        assert any(line.startswith(begin) for line in lines), begin
    assert lines[-1] == f"wrote {target}"
    written = json.loads(target.read_text())
    assert written["latency_s"]["verified_at"] == 0.05 and written["window_s"] == [0.2, 0.3]
    assert "--force" in refused(shell("limits", recording, "--cell", cell, *short, "--json", target))


def test_waivers_are_3_and_listed(shell: Shell, recording: Path) -> None:
    short = ("--only", "latency", "--from", 0.2, "--to", 0.3, "--latency-bound", 0.002)
    status, out, _ = shell("limits", recording, *short)
    assert status == 3 and "no tool declared" in out.splitlines()[0]
