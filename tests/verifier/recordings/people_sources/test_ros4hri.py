"""ROS4HRI frames, by rosbags: chains, stamps, several people, and where the default error comes from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occupancy.body import load_profile
from robots.assumption import Certainty
from robots.errors import SetupError
from tests.verifier.recordings.people_sources.ros import OneByOne, as_written, decoded, header, make
from verifier.recordings.decoded import SourceError
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_sources import SourceOptions, speaks_of_people
from verifier.recordings.people_sources.ros4hri import Ros4HriFrames
from verifier.recordings.people_sources.source import ROS4HRI_ERROR_M

SCHEMA = "tf2_msgs/msg/TFMessage"
NOW = 1_700_000_000_123_456_789
UNIT = 1.65 / 7.5
"""A seventh and a half of the template's height (human-tpl.xacro)."""
TEMPLATE = {
    "waist": ("body", (0, 0, 0)), "torso": ("waist", (0, 0, 2.75)), "p_head": ("torso", (0, 0, 0.25)),
    "head": ("p_head", (0.25, 0, 0.5)),
    **{f"{s}_y_shoulder": ("torso", (0, 0.8 * y, 0)) for s, y in (("l", 1), ("r", -1))},
    **{f"{s}_shoulder": (f"{s}_y_shoulder", (0, 0, 0)) for s in "lr"},
    **{f"{s}_elbow": (f"{s}_shoulder", (0, 0, -1.6)) for s in "lr"},
    **{f"{s}_wrist": (f"{s}_elbow", (0, 0, -1.0)) for s in "lr"},
    **{f"{s}_hip": ("body", (0, 0.6 * y, 0)) for s, y in (("l", 1), ("r", -1))},
    **{f"{s}_knee": (f"{s}_hip", (0, 0, -1.5)) for s in "lr"},
    **{f"{s}_ankle": (f"{s}_knee", (0, 0, -2.0)) for s in "lr"},
}  # fmt: skip
"""Frame -> parent, and place in it [units], as the template has them."""
STATIC = {"torso", "head", "l_wrist", "r_wrist", "l_ankle", "r_ankle"}
ENDS = ("shortest", "longest")
POINTS = {"torso": "neck_base", "body": "pelvis", "head": "head"} | {
    f"{s}_{n}": f"{s}_{n}" for s in "lr" for n in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
}


def transform(child: str, parent: str, place: Any, turn: Rotation, stamp: int) -> Any:
    x, y, z, w = turn.as_quat()
    moved = make(
        "geometry_msgs/msg/Transform",
        translation=make("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, place), strict=True))),
        rotation=make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )
    return make(
        "geometry_msgs/msg/TransformStamped",
        header=header(stamp, parent),
        child_frame_id=child,
        transform=moved,
    )


def message(transforms: list[Any], arrived: int = NOW, topic: str = "/tf"):
    return decoded(SCHEMA, make(SCHEMA, transforms=transforms), arrived, topic)


class Model:
    """A person by the template, with any turns of its frames; places by matrices, for comparison."""

    def __init__(self, name: str, rng: np.random.Generator, camera: str = "camera") -> None:
        self.name, self.camera = name, camera
        self.turn = {
            frame: Rotation.random(rng=rng) if frame not in STATIC else Rotation.identity()
            for frame in TEMPLATE
        }
        self.root = Rotation.random(rng=rng), rng.normal(0.0, 2.0, 3)

    def place(self, frame: str) -> np.ndarray:
        return self._matrix(frame)[:3, 3]

    def _matrix(self, frame: str) -> np.ndarray:
        own = np.eye(4)
        if frame == "body":
            own[:3, :3], own[:3, 3] = self.root[0].as_matrix(), self.root[1]
            return own
        parent, place = TEMPLATE[frame]
        own[:3, :3], own[:3, 3] = self.turn[frame].as_matrix(), UNIT * np.array(place)
        return self._matrix(parent) @ own

    def below(self, frames: set[str] | list[str], stamp: int) -> list[Any]:
        return [
            transform(
                f"{f}_{self.name}",
                f"{TEMPLATE[f][0]}_{self.name}",
                UNIT * np.array(TEMPLATE[f][1]),
                self.turn[f],
                stamp,
            )
            for f in frames
        ]

    def body(self, stamp: int) -> Any:
        return transform(f"body_{self.name}", self.camera, self.root[1], self.root[0], stamp)


def adapter(**options: Any) -> OneByOne:
    return OneByOne(Ros4HriFrames(SourceOptions(**options)))


def check(found: Any, model: Model) -> None:
    assert found.id == model.name
    for frame, name in POINTS.items():
        np.testing.assert_allclose(found.xyz[COLUMN[name]], model.place(frame), atol=1e-12)
        assert found.measured >> COLUMN[name] & 1
    assert set(found.error_m[np.isfinite(found.xyz[:, 0])]) == {0.5}


def test_frames_spread_over_messages_make_one_report_per_person_and_stamp(rng) -> None:
    """Static ones come once, the root alone, the others in two messages, robots between them."""
    people = [Model("a3f2e", rng), Model("b1", rng)]
    moving = sorted(set(TEMPLATE) - STATIC)
    reader, reports = adapter(), []
    for model in people:
        static = message(model.below(STATIC, 0), NOW - 10**9, "/tf_static")
        assert reader.read(static) is None
    robot = transform("tool0", "base", (1, 2, 3), Rotation.identity(), NOW + 5_000_000)
    for step in range(3):
        stamp = NOW + step * 33_000_000
        for k, model in enumerate(people):
            model.root = Rotation.random(rng=rng), rng.normal(0.0, 2.0, 3)
            for part in (
                [model.body(stamp)],
                model.below(moving[:4], stamp),
                [robot],
                model.below(moving[4:], stamp),
            ):
                reports.append(reader.read(message(part, stamp + 10_000_000 + k)))
        done = [each for each in reports if each is not None]
        assert len(done) == 2 * step
        if step == 1:
            for k, report in enumerate(map(as_written, done[-2:])):
                assert (report.stamp_ns, report.arrived_ns) == (NOW, NOW + 10_000_000 + k)
                assert report.frame == "camera" and not report.flaws
                assert [each.id for each in report.people] == [people[k].name]
    last = [as_written(each) for each in reader.all.finish()]
    for report, model in zip(last, people, strict=True):
        assert report.stamp_ns == NOW + 66_000_000
        check(report.people[0], model)
    assert reader.finish() is None


def test_points_whose_way_is_of_another_stamp_are_missing(rng) -> None:
    model, reader = Model("x", rng), adapter()
    reader.read(message(model.below(STATIC, 0), NOW, "/tf_static"))
    moving = set(TEMPLATE) - STATIC
    reader.read(message([model.body(NOW), *model.below(moving, NOW)]))
    later = message([model.body(NOW + 1), *model.below(moving - {"l_elbow"}, NOW + 1)])
    check(reader.read(later).people[0], model)
    found = reader.finish().people[0]
    for name in ("l_elbow", "l_wrist"):
        assert np.isnan(found.xyz[COLUMN[name]]).all() and not found.measured >> COLUMN[name] & 1
    np.testing.assert_allclose(found.xyz[COLUMN["r_wrist"]], model.place("r_wrist"), atol=1e-12)


def test_frames_that_come_too_late_are_left_out_and_said(rng) -> None:
    model, reader = Model("x", rng), adapter()
    reader.read(message([model.body(NOW)]))
    late = reader.read(message([model.body(NOW - 1)]))
    assert [each.id for each in late.people] == ["x"] and not late.people[0].measured
    assert "after those of a later stamp" in late.flaws[0].reason
    report = reader.read(message([model.body(NOW + 1)]))
    assert report.stamp_ns == NOW
    np.testing.assert_allclose(report.people[0].xyz[COLUMN["pelvis"]], model.root[1])


def test_whoever_is_gone_is_reported_once_more_and_not_waited_for(rng) -> None:
    """The last report of somebody comes a second later, with its own stamp and arrival."""
    reader, gone, there = adapter().all, Model("gone", rng), Model("there", rng)
    assert reader.read(message([gone.body(NOW), there.body(NOW)], NOW + 1)) == ()
    (first,) = reader.read(message([there.body(NOW + 10**9)], NOW + 10**9))
    assert [each.id for each in first.people] == ["there"]
    (last,) = reader.read(message([there.body(NOW + 10**9)], NOW + 10**9 + 2))
    assert [each.id for each in last.people] == ["gone"]
    assert (last.stamp_ns, last.arrived_ns) == (NOW, NOW + 1)
    (late,) = reader.read(message([gone.body(NOW)], NOW + 10**9 + 3))
    assert [each.id for each in late.people] == ["gone"] and late.flaws
    (end,) = reader.finish()
    assert [each.id for each in end.people] == ["there"]


def test_people_in_several_frames_have_reports_of_their_own(rng) -> None:
    reader = adapter().all
    reader.read(message([Model("x", rng).body(NOW), Model("y", rng, "other").body(NOW)]))
    found = {each.frame: each for each in reader.finish()}
    assert {frame: each.people[0].id for frame, each in found.items()} == {"camera": "x", "other": "y"}
    assert all(each.people[0].measured for each in found.values())


@pytest.mark.parametrize("name", ["person_2", "a.b-c", "ü 1", "2/x", "body_3", "a\nb"])
def test_identifiers_are_any_text(name: str, rng) -> None:
    """REP-155: "arbitrary, as long as they are unique"; beside somebody whose own ends alike."""
    names = dict.fromkeys(["z", name, name.rsplit("_", 1)[-1]])
    people = [Model(each, rng) for each in names]
    reader = adapter().all
    frames = [f for model in people for f in (*model.below(list(TEMPLATE), NOW), model.body(NOW))]
    reader.read(message(frames))
    found = {each.people[0].id: each.people[0] for each in map(as_written, reader.finish())}
    assert set(found) == {model.name for model in people}
    for model in people:
        check(found[model.name], model)


def test_a_prefix_before_the_frames_is_of_the_name_and_nobody_is_nameless(rng) -> None:
    reader = adapter().all
    frames = [
        transform(child, "camera", (1, 0, 0.5), Rotation.identity(), NOW)
        for child in ("/left/body_x", "right/body_x", "body_", "left/head_x")
    ]
    reader.read(message(frames))
    found = {each.people[0].id: each.people[0] for each in map(as_written, reader.finish())}
    assert set(found) == {"left/x", "right/x", "nameless"}
    heads = {name: each.measured >> COLUMN["head"] & 1 for name, each in found.items()}
    assert heads == {"left/x": 1, "right/x": 0, "nameless": 0}


def test_static_bodies_are_people_without_points(rng) -> None:
    """A static frame does not say when it was there; frames that have stamps do, from then on."""
    reader, model = adapter().all, Model("x", rng)
    (report,) = reader.read(message([model.body(NOW), *model.below(list(TEMPLATE), NOW)], topic="/tf_static"))
    assert [each.id for each in report.people] == ["x"] and np.isnan(report.people[0].xyz).all()
    assert "static" in report.flaws[0].reason and report.stamp_ns == report.arrived_ns
    reader.read(message(model.below(["l_hip"], NOW), NOW))
    (report,) = reader.finish()
    assert np.isnan(report.people[0].xyz).all() and "does not have" in report.flaws[0].reason
    reader.read(message([model.body(NOW + 1)], NOW + 2))
    (report,) = reader.finish()
    assert report.people[0].measured and not report.flaws


def test_broken_rotations_and_loops_leave_points_missing(rng) -> None:
    model, reader = Model("x", rng), adapter()
    broken = model.below(["l_hip", "l_knee"], NOW)
    broken[0].transform.rotation.w += 1.0
    loop = transform("r_hip_x", "r_hip_x", (0, 0, 0), Rotation.identity(), NOW)
    reader.read(message([model.body(NOW), *broken, loop]))
    assert reader.finish().people[0].measured == 1 << COLUMN["pelvis"]


def test_frames_of_robots_alone_say_nothing(rng) -> None:
    robot = [
        transform(n, "base", (1, 0, 0), Rotation.identity(), NOW)
        for n in ("head_link", "l_elbow_flex_link", "tool0")
    ]
    reader = adapter()
    assert reader.read(message(robot)) is None and reader.finish() is None
    assert not speaks_of_people(message(robot))
    assert speaks_of_people(message([Model("x", rng).body(NOW)]))


def test_streams_without_stamps_are_refused(rng) -> None:
    reader = adapter()
    for _ in range(3):
        reader.read(message([Model("x", rng).body(0)]))
    with pytest.raises(SourceError, match="stamp is 0"):
        reader.finish()


def test_the_error_is_large_and_may_be_stated() -> None:
    shown = {each.name: each for each in adapter().assumptions}["recording.ros4hri_error"]
    assert (shown.value, shown.certainty) == (0.5, Certainty.DEFAULT)
    shown = {each.name: each for each in adapter(ros4hri_error_m=0.2).assumptions}["recording.ros4hri_error"]
    assert (shown.value, shown.certainty) == (0.2, Certainty.DECLARED)
    for wrong in (-0.1, float("nan"), float("inf")):
        with pytest.raises(SetupError, match="must be at least 0 m"):
            SourceOptions(ros4hri_error_m=wrong)


def test_the_template_alone_takes_more_than_half_of_the_default_error() -> None:
    """Every length of the template off by what people of 1.5 to 1.9 m have, all joints straight: a wrist."""
    numbers = {each.name: each.value for each in load_profile("iso").assumptions}
    chain = {"trunk": 2.75, "clavicle": 0.8, "upper_arm": 1.6, "forearm": 1.0}
    worst = max(
        sum(
            max(abs(UNIT * units - h * numbers[f"people.iso.limb.{limb}.{end}"]) for end in ENDS)
            for limb, units in chain.items()
        )
        for h in (1.5, 1.9)
    )
    assert 0.25 < worst <= 0.28 < ROS4HRI_ERROR_M
