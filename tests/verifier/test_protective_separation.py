"""S_p over recordings: against distances and speeds computed apart, and against what `verify` answers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.body import Point
from robots.assumption import Assumption
from robots.errors import SetupError
from robots.model import RobotModel
from tests.oracles.hulls import distance, pad
from tests.robots.pin_oracle import PinArm, urdf_of
from tests.verifier.scenes import ALL_POINTS, CELL, UR5_JOINTS, Scene, at, at_rest, person_at, write_reports
from verifier import Cell, Status, verify
from verifier.protective_separation import MonitoringSettings, SeparationHistory, separation_history
from verifier.recordings.people_report import ReportedPerson
from verifier.required_distance import declared
from verifier.setup import build_robot

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
DELAY, CYCLE, OMEGA, SPEED, LATENCY = 0.008, 0.01, 0.6, 2.0, 0.035
"""s, s, rad/s, m/s, s: reports at multiples of 20 ms never arrive at the instant of a cycle."""
TABLE = {**CELL, "robot": {**CELL["robot"], "tracking": {"delay_max_s": DELAY}}}
P = Point
BODY = (
    ((P.HEAD, P.NECK_BASE, P.THORAX, P.PELVIS), 0.35),
    *(((P[f"{s}_SHOULDER"], P[f"{s}_ELBOW"]), 0.1) for s in "LR"),
    *(((P[f"{s}_ELBOW"], P[f"{s}_WRIST"]), 0.1) for s in "LR"),
    *(((P[f"{s}_WRIST"],), 0.205) for s in "LR"),
    *(((P[f"{s}_HIP"], P[f"{s}_KNEE"]), 0.1) for s in "LR"),
    *(((P[f"{s}_KNEE"], P[f"{s}_ANKLE"]), 0.1) for s in "LR"),
    *(((P[f"{s}_ANKLE"],), 0.3) for s in "LR"),
)
"""Enclosures of a measured body (docs/method.md, section 4.1), by hand."""


def turning(t: float) -> Array:
    """Joint 1 alone, at a constant speed."""
    return np.array([OMEGA * t - 0.5, -1.2, 1.3, -0.4, 0.3, 0.0])


def history(
    path: Path, table: dict[str, dict[str, object]] = TABLE, **settings: Assumption
) -> SeparationHistory:
    return separation_history(path, Cell.from_table(table), MonitoringSettings(**settings))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"person_speed": declared("v_h", float("nan"), "m/s")}, "v_h = nan should be a number in m/s"),
        ({"person_speed": declared("v_h", 1.6, "mm/s")}, "v_h = 1.6 should be a number in m/s"),
        ({"intrusion": declared("C", -0.1, "m")}, "C = -0.1 should be"),
        ({"intrusion": declared("C", float("inf"), "m")}, "C = inf should be"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Assumption], told: str) -> None:
    with pytest.raises(SetupError, match=told):
        MonitoringSettings(**settings)


def test_a_recording_shorter_than_a_cycle_is_refused(tmp_path: Path) -> None:
    path = Scene(duration=0.1).write(tmp_path / "r.mcap")
    with pytest.raises(SetupError, match="shorter than a cycle"):
        history(path, {**TABLE, "cycle_s": 0.5})  # type: ignore[dict-item]  # a number beside the tables


def test_nothing_is_compared_at_rest_or_without_anybody(tmp_path: Path) -> None:
    resting = history(Scene(duration=0.5, motion=at_rest).write(tmp_path / "rest.mcap"))
    alone = history(Scene(duration=0.5, people={}, complete=True).write(tmp_path / "alone.mcap"))
    unseen = {"p1": lambda _t: person_at(4.0, 0.0), "p2": lambda _t: np.full((20, 3), np.nan)}
    hidden = history(Scene(duration=0.5, people=unseen).write(tmp_path / "hidden.mcap"))
    for found in (resting, alone, hidden):
        assert found.worst is None, found.worst
        assert found.compared == found.too_close == 0
        assert len(found.t) == 49 and np.isnan(found.required_m).all()


@pytest.mark.parametrize("place", [(1.9, 0.1), (-0.9, 0.6)], ids=["in front", "behind"])
def test_constant_turning_in_closed_form(tmp_path: Path, place: tuple[float, float]) -> None:
    """The arm turns about a vertical axis: every speed is ω times a distance from that axis."""
    error = 0.005
    path = Scene(motion=turning, duration=1.6, people={"p": lambda _t: person_at(*place)}).write(
        tmp_path / "r.mcap"
    )
    table = {**TABLE, "people": {**TABLE["people"], "latency_s": LATENCY}}
    cell = Cell.from_table(table)
    found = history(path, table)
    worst, report = found.worst, verify(path, cell)
    assert worst is not None
    k = round(worst.t / CYCLE)
    stop = float(report.per_cycle.stop_time_s[k])
    stamp = np.floor((worst.t - LATENCY) * 50.0) / 50.0  # reports at 50 Hz
    terms = worst.required.term
    assert terms("T_r") == pytest.approx(worst.t - stamp + 2 * CYCLE + DELAY, abs=1e-6)
    assert terms("T_s") == pytest.approx(stop, abs=1e-6)
    assert terms("S_h") == pytest.approx(SPEED * (terms("T_r") + stop), abs=1e-6)
    a, b, radius = capsule_at(worst.link, turning(worst.t - DELAY))
    rho = max(np.hypot(*a[:2]), np.hypot(*b[:2])) + radius
    assert terms("S_r") == pytest.approx(OMEGA * rho * (2 * CYCLE + DELAY), rel=0.02)
    assert terms("S_r") >= OMEGA * rho * (2 * CYCLE + DELAY) * (1.0 - 1e-4)
    assert 0.3 * OMEGA * rho * stop < terms("S_s") < OMEGA * rho * stop
    assert terms("Z_d") >= error and terms("C") == 0.0
    parts = ("S_h", "S_r", "S_s", "C", "Z_d", "Z_r")
    assert worst.required.distance_m == pytest.approx(sum(terms(part) for part in parts), abs=1e-12)
    assert found.separation_m[k] == worst.separation_m
    for link in ur5()[0].links:  # no other has less room: all speeds grow as ρ does
        a, b, radius = capsule_at(link, turning(worst.t - DELAY))
        away = apart(a, b, radius, person_at(*place))
        share = (max(np.hypot(*a[:2]), np.hypot(*b[:2])) + radius) / rho
        needs = terms("S_h") + share * (terms("S_r") + terms("S_s")) + terms("Z_d") + terms("Z_r")
        assert away - needs >= worst.room_m - 2e-3 or away <= 0.0, link


def apart(a: Array, b: Array, radius: float, xyz: Array) -> float:
    """How far a link's capsule is from a body [m], by hand; 0 or less: they overlap."""
    return min(
        float(distance(pad(np.array([a, b])), pad(xyz[[int(p) for p in points]]))) - radius - flesh
        for points, flesh in BODY
    )


@cache
def ur5() -> tuple[RobotModel, PinArm]:
    """The arm of these tests, with a bare flange, and the same one through pinocchio alone."""
    return build_robot(Cell.from_table(TABLE), "ur5"), PinArm(urdf_of("ur5"))


def capsule_at(link: str, q: Array) -> tuple[Array, Array, float]:
    """Axis end points in the world [m], and radius, by pinocchio alone."""
    robot, arm = ur5()
    row = robot.links.index(link)
    rows = robot.enclosure[0]
    arm.place(dict(zip(UR5_JOINTS, q.tolist(), strict=True)))
    pose = arm.pose(robot.joints[int(rows["joint"][row])])
    a, b = (pose.rotation @ rows[end][row] + pose.translation for end in ("a", "b"))
    return a, b, float(rows["radius"][row])


def test_separation_is_the_distance_of_the_enclosures(
    tmp_path: Path, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Every link, and every part of a body by hand: none is nearer than what is reported for the pair."""
    for number in range(max(2, count(100))):
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.9, 2.0)
        there = person_at(away * np.cos(angle), away * np.sin(angle))
        path = Scene(duration=0.3, people={"p": lambda _t, xyz=there: xyz}).write(tmp_path / f"{number}.mcap")
        worst = history(path).worst
        assert worst is not None
        a, b, radius = capsule_at(worst.link, Scene().motion(worst.t - DELAY))
        exact = apart(a, b, radius, there)
        if exact > 0.0:
            assert worst.separation_m == pytest.approx(exact, abs=2e-4)  # the path is fitted
        else:
            assert worst.separation_m <= 2e-4


def test_whoever_has_room_for_s_p_is_verified() -> None:
    """S_p forgets directions and shapes, so it is never kept where `verify` does not verify, unless people or
    robot contradict what both rest on."""
    cell = Cell.from_toml(ROOT / "data/demo.toml")
    found = separation_history(ROOT / "data/demo.mcap", cell, window_s=(7.5, 9.5))
    rows = verify(ROOT / "data/demo.mcap", cell).per_cycle
    room = found.separation_m - found.required_m
    enough = room > cell.check.margin_m
    assert enough.sum() > 50 and found.too_close > 50 and found.compared == 200
    assert set(rows.status[enough]) <= {int(Status.VERIFIED), int(Status.CONTRADICTED)}
    compared = enough & np.isfinite(rows.gap_m)
    assert compared.sum() > 50 and (rows.gap_m[compared] >= room[compared] - 1e-6).all()
    below = rows.status[room < 0.0]
    assert (below == int(Status.NOT_VERIFIED)).any() and (below == int(Status.VERIFIED)).any()
    assert found.worst is not None and found.worst.room_m == np.nanmin(room)
    assert found.worst.required.distance_m == found.required_m[round(found.worst.t / cell.cycle_s)]


def test_the_same_for_random_motions_and_people(
    tmp_path: Path, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    cell, enough = Cell.from_table(TABLE), 0
    for number in range(max(2, count(200))):
        turn, beat, phase = rng.uniform(-0.4, 0.4, 6), rng.uniform(0.5, 2.0, 6), rng.uniform(0.0, 6.0, 6)

        def motion(t: float, turn: Array = turn, beat: Array = beat, phase: Array = phase) -> Array:
            return np.array([0.0, -1.2, 1.3, -0.4, 0.3, 0.0]) + turn * np.sin(beat * t + phase)

        walks = [
            (rng.uniform(0.9, 2.0), rng.uniform(-np.pi, np.pi), rng.uniform(-1.2, 1.2, 2)) for _ in range(2)
        ]
        people = {
            f"p{i}": lambda t, r=r, a=a, v=v: person_at(r * np.cos(a) + v[0] * t, r * np.sin(a) + v[1] * t)
            for i, (r, a, v) in enumerate(walks)
        }
        path = Scene(motion=motion, duration=0.8, people=people).write(tmp_path / f"{number}.mcap")
        found, rows = history(path), verify(path, cell).per_cycle
        kept = found.separation_m - found.required_m > cell.check.margin_m
        enough += int(kept.sum())
        assert set(rows.status[kept]) <= {int(Status.VERIFIED), int(Status.CONTRADICTED)}, number
    assert enough > 20


@pytest.mark.parametrize("monitored", [0, 1])
def test_more_speed_intrusion_or_latency_needs_more(tmp_path: Path, monitored: int) -> None:
    people = {"p": lambda t: person_at(1.5 - 0.3 * monitored * t, 0.0)}
    path = Scene(duration=0.6, people=people).write(tmp_path / "r.mcap")
    plain = history(path)
    more = [
        history(path, person_speed=declared("v_h", 2.5, "m/s")),
        history(path, intrusion=declared("C", 0.2, "m")),
        history(path, {**TABLE, "people": {**TABLE["people"], "latency_s": 0.08}}),
    ]
    for each in more:
        both = np.isfinite(plain.required_m) & np.isfinite(each.required_m)
        room, less = (h.separation_m - h.required_m for h in (plain, each))
        assert both.sum() > 20 and (less[both] < room[both] - 1e-3).all()


def test_every_error_that_is_stated_is_in_it(tmp_path: Path) -> None:
    """The worst point's, the clocks', and what the joints' displace of that link, whatever the posture."""
    clock, joint, worst_point = 0.02, 0.01, 0.03
    errors = np.full(len(P), 0.005)
    errors[P.L_HAND] = worst_point
    who = ReportedPerson("p", person_at(1.9, 0.1), errors, ALL_POINTS)
    reports = [(t, t + LATENCY, {"p": who}) for t in at(50.0, 0.8)]
    path = write_reports(tmp_path / "r.mcap", reports, motion=turning, joint_times=tuple(at(125.0, 0.8)))
    tracking = {"delay_max_s": DELAY, "position_error_rad": joint}
    people = {"latency_s": LATENCY, "clock_error_s": clock, "left_right": "trusted"}
    table = {
        "robot": {**CELL["robot"], "tracking": tracking},
        "people": {**CELL["people"], **people},
    }
    worst = history(path, table).worst
    assert worst is not None
    terms = worst.required.term
    stamp = np.floor((worst.t - LATENCY) * 50.0) / 50.0
    assert terms("T_r") == pytest.approx(worst.t - stamp + 2 * CYCLE + DELAY + clock, abs=1e-6)
    assert terms("Z_d") == pytest.approx(worst_point, abs=1e-9)
    robot = ur5()[0]
    reach = robot.enclosure[0]["reach"][robot.links.index(worst.link), :6]
    assert terms("Z_r") == pytest.approx(joint * float(reach.sum()), rel=1e-9) and terms("Z_r") > 0.01


def test_older_points_have_grown_until_the_newest(tmp_path: Path) -> None:
    """A hand that was last seen some time ago may be anywhere that it could have come to since."""

    def hides(t: float) -> Array:
        xyz = person_at(1.6, 0.0)
        if t > 0.3:
            xyz[[P.L_WRIST, P.L_HAND, P.L_FINGERTIP, P.R_WRIST, P.R_HAND, P.R_FINGERTIP]] = np.nan
        return xyz

    seen = history(
        Scene(duration=0.8, people={"p": lambda _t: person_at(1.6, 0.0)}).write(tmp_path / "a.mcap")
    )
    hidden = history(Scene(duration=0.8, people={"p": hides}).write(tmp_path / "b.mcap"))
    k = slice(15, 30)
    np.testing.assert_allclose(seen.separation_m[k], hidden.separation_m[k], atol=1e-6)
    shrunk = seen.separation_m - hidden.separation_m
    assert np.nanmax(shrunk[60:]) > 0.1 and (shrunk[40:][np.isfinite(shrunk[40:])] >= -1e-9).all()
