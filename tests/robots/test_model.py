"""Which joints are commanded, where the robot stands, and what the content hash sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robots.catalog import RobotSetup, load_robot
from robots.errors import SetupError
from robots.limits import JointLimits
from robots.model import Mount, RobotModel, Tree, read_tree
from robots.urdf import parse_urdf
from tests.robots.made_up import full_limits, joint, link, robot, shape

BOX = shape('<box size="0.1 0.1 0.1"/>')


def chain(*kinds: str, mimic: str = "") -> str:
    """Links l0, l1, … with joints j1, j2, … of the given kinds; the last one may mimic."""
    parts = [link("l0")]
    for i, kind in enumerate(kinds, start=1):
        last = mimic if i == len(kinds) else None
        limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
        parts.append(link(f"l{i}", BOX))
        parts.append(
            joint(
                f"j{i}",
                f"l{i - 1}",
                f"l{i}",
                kind=kind,
                xyz=(0, 0, 0.3),
                inside=f"{limit}{last}" if last else None,
            )
        )
    return robot(*parts)


def tree_of(text: str, commanded: tuple[str, ...] | None = None) -> Tree:
    path = Path("x.urdf")
    return read_tree(parse_urdf(text.encode(), path), commanded)


def test_all_moving_joints_that_mimic_none_are_commanded_unless_told() -> None:
    text = chain("revolute", "fixed", "prismatic", "continuous", mimic='<mimic joint="j3"/>')
    assert tree_of(text, ("j1",)).joints == ("j1",) and tree_of(text, ("j1",)).locked == ("j3", "j4")
    bare = text.replace(text[text.index('<link name="l4">') :].split("</link>")[0], '<link name="l4">')
    assert tree_of(bare).joints == ("j1", "j3") and tree_of(bare).locked == ("j4",)


def test_what_follows_a_commanded_joint_would_be_taken_to_rest_and_is_refused() -> None:
    text = chain("revolute", "fixed", "prismatic", "continuous", mimic='<mimic joint="j3"/>')
    for commanded in (None, ("j1", "j3")):
        with pytest.raises(
            SetupError, match=r"j4 mimics j3, which is commanded, and moves link l4: .*without j3"
        ):
            tree_of(text, commanded)


def test_joints_come_parents_first_whatever_order_is_asked() -> None:
    assert tree_of(chain("revolute", "revolute"), ("j2", "j1")).joints == ("j1", "j2")


@pytest.mark.parametrize(
    ("text", "commanded", "message"),
    [
        (chain("floating", "revolute"), None, "joint j1 is floating; a moving base is not supported"),
        (chain("planar", "revolute"), None, "joint j1 is planar; a moving base is not supported"),
        (chain("fixed"), None, "no moving joint"),
        (chain("revolute"), ("elbow",), "no moving joint is called 'elbow'; there are: j1"),
        (chain("revolute", "fixed"), ("j2",), "no moving joint is called 'j2'"),
        (chain("revolute"), (), "at least one"),
        (chain("revolute"), ("j1", "j1"), "named once each"),
        (chain("revolute", "revolute", mimic='<mimic joint="j1"/>'), ("j1", "j2"), "j2 mimics"),
        (
            chain("revolute", "revolute"),
            ("j2",),
            "joint j2 is commanded, but hangs on joint j1, which is not",
        ),
        (chain(*["revolute"] * 17), None, "17 commanded joints; the maximum is 16"),
        (robot(link("a"), link("b")), None, "x.urdf"),
    ],
)
def test_what_cannot_be_commanded_is_refused_in_one_line(
    text: str, commanded: tuple[str, ...] | None, message: str
) -> None:
    with pytest.raises(SetupError) as caught:
        tree_of(text, commanded)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_sixteen_joints_are_possible(write_urdf: Callable[[str], Path], tmp_path: Path) -> None:
    names = [f"j{i}" for i in range(1, 17)]
    setup = RobotSetup(limits=full_limits(names, [False] * 16), cache_dir=tmp_path / "cache")
    model = load_robot(write_urdf(chain(*["revolute"] * 16)), setup=setup)
    assert model.kinematics[0]["n"] == 16 and model.enclosure[0]["n"] == 16


def test_links_before_the_first_commanded_joint_are_fixed() -> None:
    tree = tree_of(chain("fixed", "revolute", "fixed", "revolute"), ("j2",))
    assert tree.fixed_links == ("l1",)
    assert [tree.carrier(f"l{i}") for i in range(5)] == [None, None, 1, 1, 1]


def test_a_mount_moves_the_base_and_nothing_else() -> None:
    text = chain("revolute", "prismatic")
    mount = Mount.from_xyz_rpy((1, 2, 3), (90, 0, 0))
    plain, moved = tree_of(text).kinematics(Mount())[0], tree_of(text).kinematics(mount)[0]
    np.testing.assert_allclose(moved["translation"][0], [1, 1.7, 3], atol=1e-15)
    np.testing.assert_allclose(moved["rotation"][0], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    for field in ("rotation", "translation"):
        assert (moved[field][1:] == plain[field][1:]).all()
    assert (moved["axis"] == plain["axis"]).all() and Mount().is_identity and not mount.is_identity


@pytest.mark.parametrize(
    ("xyz", "rpy", "message"),
    [
        ((0, 0), (0, 0, 0), "three finite numbers"),
        ((0, np.nan, 0), (0, 0, 0), "three finite numbers"),
        ((0, 0, 0), (0, 0), "rpy_deg"),
        ((0, 0, 0), (0, 0, np.inf), "rpy_deg"),
    ],
)
def test_a_mount_that_is_none_is_refused(
    xyz: tuple[float, ...], rpy: tuple[float, ...], message: str
) -> None:
    with pytest.raises(SetupError, match=message):
        Mount.from_xyz_rpy(xyz, rpy)


@pytest.mark.parametrize("rotation", [np.eye(2), 2 * np.eye(3), -np.eye(3), np.full((3, 3), np.nan)])
def test_a_mount_takes_rotations_only(rotation: np.ndarray) -> None:
    with pytest.raises(SetupError, match=r"rotation|reflection"):
        Mount(rotation)


def test_mounts_compose() -> None:
    outer, inner = Mount.from_xyz_rpy((1, 0, 0), (0, 0, 90)), Mount.from_xyz_rpy((1, 0, 0), (0, 0, 90))
    both = outer @ inner
    np.testing.assert_allclose(both.translation, [1, 1, 0], atol=1e-15)
    np.testing.assert_allclose(both.rotation, np.diag([-1, -1, 1]), atol=1e-15)


def test_content_hash_sees_every_part_of_the_model(arm: Callable[[str], RobotModel]) -> None:
    model = arm("ur5")
    assert arm("ur5").content_hash == model.content_hash
    kinematics, enclosure = model.kinematics.copy(), model.enclosure.copy()
    kinematics[0]["translation"][3, 1] += 1e-9
    enclosure[0]["radius"][2] += 1e-9
    faster = {name: getattr(model.limits, name) for name in JointLimits.__dataclass_fields__}
    faster["jerk"] = faster["jerk"] * 2
    changed = [
        replace(model, kinematics=kinematics),
        replace(model, enclosure=enclosure),
        replace(model, limits=JointLimits(**faster)),
        replace(model, name="ur6"),
        replace(model, tool=None),
        replace(model, fixed_links=()),
        replace(model, assumptions=model.assumptions[1:]),
        replace(model, links=tuple(reversed(model.links))),
        replace(model, joints=tuple(reversed(model.joints))),
        replace(model, assumed_limits=()),
        replace(model, assumed_enclosure=True),
    ]
    assert len({other.content_hash for other in changed} | {model.content_hash}) == len(changed) + 1
