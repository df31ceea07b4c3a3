"""The mode beside a supervisor of a real arm: what it sees, what it chooses, and what it does not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from modes.speed.alteration import SpeedAlteration, SpeedSettings
from modes.speed.bodies import UPPER_BODY, BodyEllipsoids, LinkEllipsoids
from modes.speed.danger_index import danger_index
from modes.speed.genetic import GeneticSettings
from modes.speed.objective import Weights
from occupancy.body import Part, Point, load_profile
from robots.errors import SetupError
from tests.robots.pin_oracle import PinArm, urdf_of
from tests.verifier.scenes import person_at
from tests.verifier.supervised import PANDA_AWAY, PANDA_HOME, panda, panda_supervisor, quintic, report
from verifier.mode_runner import load_mode
from verifier.proposal import NewTrajectory, PathSpeed, SceneView, SeenPerson
from verifier.supervisor import Supervisor

Array = NDArray[np.float64]

ROBOT = panda()[0].robot
EPOCH = 1_700_000_000.0


def walking(t: float) -> Array:
    """Somebody who walks up to the arm with 1 m/s; at t = 0.3 s at x = 1.9 m."""
    return person_at(2.2 - t, 0.3, -0.8)


def moving(seconds: float = 0.3) -> Supervisor:
    """A supervisor on its way, somebody far away in its sight."""
    supervisor = panda_supervisor()
    way = quintic([PANDA_HOME, PANDA_AWAY], ROBOT.limits, 0.5)
    assert supervisor.propose(NewTrajectory(way)) is None
    for k in range(round(seconds / 0.01)):
        t = EPOCH + 0.01 * k
        supervisor.step(t, [report(t, 6.0)] if k % 3 == 0 else [])
    return supervisor


@pytest.fixture(scope="module")
def view() -> SceneView:
    return moving().view()


def with_people(view: SceneView, *people: tuple[str, Array, float]) -> SceneView:
    """The view with other people: id, points (20, 3) [m], and how long ago they were seen [s]."""
    seen = [
        SeenPerson(name, np.full(len(Point), view.t - age), xyz, np.full(len(Point), 0.01))
        for name, xyz, age in people
    ]
    return replace(view, people=tuple(seen))


def hand_at(place: Array) -> Array:
    """Somebody of whom a wrist alone was seen."""
    points = np.full((len(Point), 3), np.nan)
    points[Point.R_WRIST] = place
    return points


def test_a_view_has_the_people_and_the_direction_of_the_path(view: SceneView) -> None:
    (person,) = view.people
    assert person.id == "p1" and np.isfinite(person.xyz).all() and (person.error_m >= 0.01).all()
    np.testing.assert_allclose(person.xyz, person_at(6.0, 0.0, 0.0), atol=1e-12)
    assert np.abs(person.t - (EPOCH + 0.27)).max() < 1e-6
    np.testing.assert_allclose(view.dq_ds * view.sdot, view.dq, atol=1e-9)


def test_views_are_copies_and_people_without_a_point_are_there() -> None:
    supervisor = moving()
    one = supervisor.view()
    one.people[0].xyz[:] = 9.0
    assert not (supervisor.view().people[0].xyz == 9.0).any()
    rest = panda_supervisor().view()
    assert rest.people == () and not rest.dq_ds.any()


def test_links_and_their_motion_are_pinocchios(view: SceneView) -> None:
    """Centres of the ellipsoids are the middles of the capsules; they move as a difference quotient says."""
    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds)
    pin, rows = PinArm(urdf_of("panda")), ROBOT.enclosure[0]

    def middles(q: Array) -> Array:
        pin.place(dict(zip(ROBOT.joints, q.tolist(), strict=True)))
        n = len(ROBOT.links)
        middle = 0.5 * (rows["a"][:n] + rows["b"][:n])
        poses = [pin.pose(ROBOT.joints[j]) for j in rows["joint"][:n]]
        return np.array([pose.act(x) for pose, x in zip(poses, middle, strict=True)])

    np.testing.assert_allclose(arm.links.centre, middles(view.q), atol=1e-9)
    step = 1e-6 * view.dq_ds
    quotient = (middles(view.q + step) - middles(view.q - step)) / 2e-6
    np.testing.assert_allclose(arm.per_path, quotient, atol=1e-7)
    assert isinstance(pin.pose(ROBOT.joints[-1]), pinocchio.SE3) and arm.speed_per_path > 0.05


def test_link_ellipsoids_contain_the_capsules(view: SceneView, rng: np.random.Generator) -> None:
    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds).links
    pin, rows = PinArm(urdf_of("panda")), ROBOT.enclosure[0]
    pin.place(dict(zip(ROBOT.joints, view.q.tolist(), strict=True)))
    for i in range(len(ROBOT.links)):
        ball = rng.normal(size=(500, 3))
        ball *= rows["radius"][i] / np.linalg.norm(ball, axis=1)[:, None]
        ends = np.where(rng.random((500, 1)) < 0.5, rows["a"][i], rows["b"][i]) + ball
        pose = pin.pose(ROBOT.joints[rows["joint"][i]])
        away = np.array([pose.act(x) for x in ends]) - arm.centre[i]
        gauge = ((away @ arm.rotation[i] / arm.semi_axes[i]) ** 2).sum(axis=1)
        assert gauge.max() <= 1.0 + 1e-9, ROBOT.links[i]


def test_with_nobody_around_the_programmed_speed_is_taken_up_to_the_cap(view: SceneView) -> None:
    free = SpeedAlteration(ROBOT, SpeedSettings(cap_m_s=10.0, weights=Weights(smoothness=0.0)))
    assert free.propose(with_people(view)) == PathSpeed(pytest.approx(1.0))
    mode = SpeedAlteration(ROBOT, SpeedSettings(cap_m_s=0.05, weights=Weights(smoothness=0.0)))
    speed = mode.propose(with_people(view))
    assert isinstance(speed, PathSpeed) and mode.decision is not None
    assert mode.decision.programmed > 0.05
    assert speed.sdot * mode.decision.programmed == pytest.approx(0.05)
    assert mode.decision.danger_index == 0.0 == mode.decision.at_programmed


@pytest.mark.parametrize("index", ["exact", "transformed"])
@pytest.mark.parametrize("prediction", ["constant_velocity", "kalman"])
def test_a_hand_in_the_way_is_not_met(view: SceneView, index: str, prediction: str) -> None:
    """Held against the true index after the interval, by the true kinematics and not by its linear part."""
    settings = SpeedSettings(index=index, prediction=prediction, cap_m_s=2.0, weights=Weights(smoothness=0.0))
    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds)
    ahead = arm.per_path[-1] / np.linalg.norm(arm.per_path[-1])
    met = 0
    for away in np.linspace(0.2, 0.3, 51):
        seen = with_people(view, ("p1", hand_at(arm.links.centre[-1] + away * ahead), 0.0))
        mode = SpeedAlteration(ROBOT, settings)
        mode.propose(seen)
        decision = mode.decision
        assert decision is not None
        body = BodyEllipsoids(load_profile("iso")).around(np.array([seen.people[0].xyz]))
        near = danger_index(arm.links, body, index).max()
        step = 0.1 * decision.path_speed * view.dq_ds
        true = danger_index(LinkEllipsoids(ROBOT).at(view.q + step, view.dq_ds).links, body, index).max()
        if decision.at_programmed >= 1.0 > near:
            met += 1
            assert decision.danger_index < 1.0 and decision.path_speed < 1.0
            assert true < 1.0 + 2e-2
        assert decision.danger_index >= true - 2e-2
    assert met > 2


def test_who_comes_nearer_slows_the_arm_more_and_more_people_never_less(view: SceneView) -> None:
    def path_speed(*people: tuple[str, Array, float]) -> float:
        found = SpeedAlteration(ROBOT).propose(with_people(view, *people))
        assert isinstance(found, PathSpeed)
        return found.sdot

    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds)
    ahead = arm.per_path[-1] / np.linalg.norm(arm.per_path[-1])
    places = [arm.links.centre[-1] + d * ahead for d in (1.5, 0.24, 0.2)]
    far, near, nearer = ((f"p{k}", hand_at(place), 0.0) for k, place in enumerate(places))
    assert path_speed(far) > path_speed(near) > path_speed(nearer)
    assert path_speed(far, near) == pytest.approx(path_speed(near), abs=1e-9)
    assert path_speed(nearer, near) <= path_speed(near)
    same = tuple(("p1", xyz, age) for _, xyz, age in (near, nearer))  # two hypotheses about one person
    assert path_speed(*same) == pytest.approx(path_speed(near, nearer), abs=1e-9)


def test_predictions_follow_a_person_over_views(view: SceneView) -> None:
    """Somebody walks towards the arm: with two sightings the forecast leads, and the index is higher."""
    still, walks = SpeedAlteration(ROBOT), SpeedAlteration(ROBOT)
    earlier = replace(view, t=view.t - 0.1)
    walks.propose(with_people(earlier, ("p1", walking(1.2), 0.0)))
    for mode in (still, walks):
        mode.propose(with_people(view, ("p1", walking(1.3), 0.0)))
    assert still.decision is not None and walks.decision is not None
    assert walks.decision.at_programmed > still.decision.at_programmed > 0.0
    gone = SpeedAlteration(ROBOT)
    gone.propose(with_people(view, ("p1", walking(1.3), 1.5)))
    assert gone.decision is not None and gone.decision.at_programmed == 0.0


@pytest.mark.parametrize("prediction", ["constant_velocity", "kalman"])
def test_a_point_that_is_lost_is_not_foretold_for_ever(view: SceneView, prediction: str) -> None:
    """A hand comes nearer with 1 m/s and is lost; the head of the same person stays in sight, far away."""
    mode = SpeedAlteration(ROBOT, SpeedSettings(prediction=prediction))
    for k in range(40):
        points, t = np.full((len(Point), 3), np.nan), np.full(len(Point), np.nan)
        points[Point.HEAD], t[Point.HEAD] = (5.0, 0.0, 1.0), view.t + 0.1 * k
        seen = min(k, 5)
        points[Point.R_WRIST], t[Point.R_WRIST] = (2.0 - 0.1 * seen, 0.0, 0.8), view.t + 0.1 * seen
        person = SeenPerson("p1", t, points, np.full(len(Point), 0.01))
        mode.propose(replace(view, t=view.t + 0.1 * k, people=(person,)))
        assert mode.decision is not None
        if k == 10:
            assert mode.decision.at_programmed > 0.05
        if k > 15:
            assert mode.decision.at_programmed < 0.05


def test_rows_that_go_and_clocks_that_go_back_make_no_velocities(view: SceneView) -> None:
    near, far = person_at(1.2, 0.0, -0.8), person_at(3.0, 0.0, -0.8)
    fresh = SpeedAlteration(ROBOT)
    fresh.propose(with_people(view, ("p1", far, 0.0)))
    mode = SpeedAlteration(ROBOT)
    mode.propose(with_people(replace(view, t=view.t - 0.1), ("p1", near, 0.0), ("p1", far, 0.0)))
    mode.propose(with_people(view, ("p1", far, 0.0)))
    assert mode.decision is not None and fresh.decision is not None
    assert mode.decision.at_programmed == fresh.decision.at_programmed
    mode.propose(with_people(replace(view, t=view.t - 900.0), ("p1", far, 0.0)))
    assert mode.decision.at_programmed == fresh.decision.at_programmed


def test_links_that_swing_while_the_tip_is_at_rest_are_looked_at(view: SceneView) -> None:
    """The null space of a Panda's tip."""
    arm = LinkEllipsoids(ROBOT)
    tips = np.array([arm.at(view.q, e).per_path[-1] for e in np.eye(7)]).T
    swing = np.linalg.svd(tips)[2][-1]
    moved = arm.at(view.q, swing)
    fastest = int(np.linalg.norm(moved.per_path, axis=1).argmax())
    assert np.linalg.norm(moved.per_path[-1]) < 1e-9 < 0.05 < moved.speed_per_path
    ahead = moved.per_path[fastest] / np.linalg.norm(moved.per_path[fastest])
    hand = hand_at(moved.links.centre[fastest] + 0.31 * ahead)
    mode = SpeedAlteration(ROBOT)
    mode.propose(replace(with_people(view, ("p1", hand, 0.0)), dq_ds=swing))
    assert mode.decision is not None and mode.decision.at_programmed > 0.3
    slow = mode.propose(replace(with_people(view, ("p1", hand, 0.0)), dq_ds=1e-3 * swing))
    assert isinstance(slow, PathSpeed) and abs(slow.sdot) <= 5.0


def test_views_of_another_arm_are_not_read(view: SceneView) -> None:
    mode = SpeedAlteration(ROBOT)
    assert mode.propose(replace(view, dq_ds=np.empty(0))) is None
    assert mode.propose(replace(view, q=np.zeros(6))) is None


def test_the_genetic_algorithm_may_stand_in_its_place(view: SceneView) -> None:
    people = with_people(view, ("p1", person_at(0.9, 0.3, -0.8), 0.0))
    exact = SpeedAlteration(ROBOT, SpeedSettings()).propose(people)
    settings = SpeedSettings(optimiser="genetic", genetic=GeneticSettings(population=100), seed=3)
    found, again = (SpeedAlteration(ROBOT, settings).propose(people) for _ in range(2))
    assert isinstance(exact, PathSpeed) and isinstance(found, PathSpeed)
    assert found == again and found.sdot == pytest.approx(exact.sdot, abs=0.02)


def test_without_a_cap_it_goes_as_fast_as_it_can_brake(view: SceneView) -> None:
    """Nobody: up to what the joints may; a hand ahead: so that the arm, braking, does not meet it."""
    weights = Weights(smoothness=0.0)
    braking = SpeedSettings(cap_m_s=None, weights=weights)
    assert SpeedAlteration(ROBOT, braking).propose(with_people(view)) == PathSpeed(pytest.approx(1.0))
    view = replace(view, dq_ds=8.0 * view.dq_ds)
    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds)
    ahead = arm.per_path[-1] / np.linalg.norm(arm.per_path[-1])
    slower = 0
    for away in np.linspace(0.2, 0.6, 41):
        seen = with_people(view, ("p1", hand_at(arm.links.centre[-1] + away * ahead), 0.0))
        mode = SpeedAlteration(ROBOT, braking)
        fixed = SpeedAlteration(ROBOT, replace(braking, cap_m_s=100.0))
        for each in (mode, fixed):
            each.propose(seen)
        assert mode.decision is not None and fixed.decision is not None
        assert abs(mode.decision.speed) <= abs(fixed.decision.speed) + 1e-12
        slower += mode.decision.speed < fixed.decision.speed
    assert slower > 2


def test_the_speed_is_smoothed_from_the_one_that_the_arm_has(view: SceneView) -> None:
    """Nobody there, P = D = 1: halfway between the programmed speed and the present one."""
    slow = replace(with_people(view), sdot=0.4)
    assert SpeedAlteration(ROBOT, SpeedSettings(cap_m_s=10.0)).propose(slow) == PathSpeed(pytest.approx(0.7))


def test_it_brakes_over_the_way_that_braking_takes(view: SceneView) -> None:
    """v |v| / (2 a) after v h, with half of the joint accelerations; a sixteenth more meets somebody."""
    view = replace(view, dq_ds=8.0 * view.dq_ds)
    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds)
    ahead = arm.per_path[-1] / np.linalg.norm(arm.per_path[-1])
    a = 0.5 * float(np.min(ROBOT.limits.acceleration / np.abs(view.dq_ds)))  # per path parameter
    settings = SpeedSettings(cap_m_s=None, weights=Weights(smoothness=0.0))
    bodies, tried = BodyEllipsoids(load_profile("iso")), 0
    for away in np.linspace(0.3, 0.5, 9):
        seen = with_people(view, ("p1", hand_at(arm.links.centre[-1] + away * ahead), 0.0))
        mode = SpeedAlteration(ROBOT, settings)
        mode.propose(seen)
        assert mode.decision is not None
        body = bodies.around(np.array([seen.people[0].xyz]))

        def met(sdot: float, body=body) -> bool:
            times = (share * sdot / a for share in (0.0, 0.5, 1.0))
            ways = [sdot * 0.1 + sdot * t - 0.5 * a * t * t for t in times]
            return any(
                danger_index(arm.links.moved(s * arm.per_path), body, "exact").max() >= 1.0 for s in ways
            )

        assert not met(mode.decision.path_speed)
        unbraked = SpeedAlteration(ROBOT, replace(settings, cap_m_s=100.0))
        unbraked.propose(seen)
        assert unbraked.decision is not None
        if mode.decision.path_speed < unbraked.decision.path_speed:
            tried += 1
            assert met(mode.decision.path_speed + unbraked.decision.path_speed / 16)
    assert tried > 4


def test_where_there_is_no_speed_to_alter(view: SceneView) -> None:
    mode = SpeedAlteration(ROBOT)
    assert mode.propose(replace(view, dq_ds=np.zeros(7))) == PathSpeed(1.0)
    assert mode.propose(replace(view, s=math.nan)) is None
    assert mode.propose(replace(view, dq_ds=np.full(7, np.nan))) is None
    assert mode.propose(replace(view, t=math.nan)) is None
    assert mode.decision is None


def test_it_is_installed_and_needs_to_know_the_robot() -> None:
    mode = load_mode("speed-alteration", ROBOT)
    assert mode.name == "speed-alteration" and mode.propose(moving(0.1).view()) is not None
    with pytest.raises(SetupError, match=r"it needs to know the robot: load_mode\(name, robot\)"):
        load_mode("speed-alteration")


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"cap_m_s": 0.0}, r"cap_m_s \(or None\) = 0.0 should be a number at least 0.001 and at most 100"),
        ({"cap_m_s": math.nan}, "cap_m_s .* = nan"),
        ({"cap_m_s": "0.25"}, "cap_m_s .* = '0.25'"),
        ({"cap_m_s": 1e-320}, "cap_m_s .* = 1e-320"),
        ({"interval_s": 0.0}, "interval_s = 0.0 should be a number at least 0.001 and at most 10"),
        ({"seed": -1}, "seed = -1 should be a whole number from 0"),
        ({"seed": 1.5}, "seed = 1.5"),
        ({"weights": (1, 1, 10)}, r"weights = \(1, 1, 10\) should be Weights"),
        ({"genetic": None}, "genetic = None should be GeneticSettings"),
        ({"parts": ("hand",)}, r"parts = \('hand',\) should be a tuple of parts"),
        ({"parts": Part.HEAD}, "parts = .*HEAD.* should be a tuple"),
        ({"cap_m_s": True}, "cap_m_s .* = True"),
        ({"interval_s": None}, "interval_s = None"),
        ({"index": "other"}, "index = 'other' should be one of transformed, exact"),
        ({"prediction": "lstm"}, "prediction = 'lstm' should be one of constant_velocity, kalman"),
        ({"optimiser": "best"}, "optimiser = 'best' should be one of exact, genetic"),
        ({"parts": ()}, "a body without parts is nobody"),
        ({"profile": "nobody"}, "nobody"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_by_name(settings: dict[str, object], text: str) -> None:
    with pytest.raises(SetupError, match=text):
        SpeedAlteration(ROBOT, SpeedSettings(**settings))


def test_something_else_than_a_robot_or_settings_is_refused_by_name() -> None:
    with pytest.raises(SetupError, match="robot = None should be the supervisor's robot"):
        SpeedAlteration(None)  # type: ignore[arg-type]  # wrong types are what is tried
    with pytest.raises(SetupError, match=r"settings = \{\} should be SpeedSettings"):
        SpeedAlteration(ROBOT, {})  # type: ignore[arg-type]  # wrong types are what is tried


@pytest.mark.parametrize("changed", [{"sdot": math.nan}, {"s": math.inf}, {"t": math.nan}])
def test_a_view_with_what_is_not_finite_is_passed_over(view: SceneView, changed: dict[str, float]) -> None:
    mode = SpeedAlteration(ROBOT)
    assert mode.propose(view) is not None and mode.decision is not None
    assert mode.propose(replace(view, **changed)) is None and mode.decision is None
    for name in ("q", "dq_ds"):
        assert mode.propose(replace(view, **{name: np.full(7, np.nan)})) is None


def test_without_a_fixed_cap_it_backs_off_where_every_speed_touches(view: SceneView) -> None:
    """The least dangerous of the speeds that it looked at, and never a wait beside a hand in the way."""
    arm = LinkEllipsoids(ROBOT).at(view.q, view.dq_ds)
    ahead = arm.per_path[-1] / np.linalg.norm(arm.per_path[-1])
    for away in np.linspace(0.1, 0.22, 7):
        seen = with_people(view, ("p1", hand_at(arm.links.centre[-1] + away * ahead), 0.0))
        mode = SpeedAlteration(ROBOT, SpeedSettings(cap_m_s=None))
        speed = mode.propose(replace(seen, sdot=0.0))
        assert isinstance(speed, PathSpeed) and speed.sdot < -0.1, away
        assert mode.decision is not None and 1.0 <= mode.decision.danger_index < mode.decision.at_programmed


def test_a_body_of_another_shape_is_refused() -> None:
    with pytest.raises(SetupError, match=r"points of shape \(1, 14, 3\) should be \(people, 20, 3\)"):
        BodyEllipsoids(load_profile("iso"), UPPER_BODY).around(np.zeros((1, 14, 3)))
