"""Arms of the catalogue and of the user, tools, model cards."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robots.assumption import Certainty
from robots.catalog import RobotSetup, describe_card, load_robot, load_tool, robot_names
from robots.errors import SetupError, ToolError
from robots.limits import QUANTITIES, MissingLimits
from robots.model import Mount, RobotModel
from tests.robots.made_up import full_limits, joint, link, robot, shape
from tests.robots.pin_oracle import OWN, PinArm, urdf_of
from tests.robots.test_enclosure import check_geometry_inside, tetrahedron

MODELS = Path(__file__).parents[2] / "robots" / "models"
DEGREE = np.pi / 180


def test_each_model_file_has_a_source_and_a_certainty_for_each_number() -> None:
    for file in MODELS.glob("*.toml"):
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        unknown = {"torque"} if file.stem == "kr5_sixx" else set()
        assert table["name"] == file.stem and set(table["limits"]) == set(QUANTITIES) - unknown
        rated = [table["rated_payload"]] if "rated_payload" in table else []
        for entry in [*table["limits"].values(), *table.get("enclosure", []), *rated]:
            assert len(entry["source"]) > 10 and Certainty(entry["certainty"])
        for entry in table["limits"].values():
            assert len(entry["values"]) == len(table["joints"])


@pytest.mark.parametrize(
    ("name", "velocity", "torque"),
    [
        ("ur3", [180, 180, 180, 360, 360, 360], [56, 56, 28, 12, 12, 12]),
        ("ur5", [180] * 6, [150, 150, 150, 28, 28, 28]),
        ("ur10", [120, 120, 180, 180, 180, 180], [330, 330, 150, 56, 56, 56]),
    ],
)
def test_published_limits_of_universal_robots(
    name: str, velocity: list[float], torque: list[float], arm: Callable[[str], RobotModel]
) -> None:
    """Figures of the maker's ROS 2 description."""
    model = arm(name)
    np.testing.assert_allclose(model.limits.velocity / DEGREE, velocity)
    np.testing.assert_allclose(model.limits.torque, torque)
    np.testing.assert_allclose(model.limits.position_upper[:5] / DEGREE, [360, 360, 180, 360, 360])
    assert (model.limits.position_lower == -model.limits.position_upper).all()
    assert np.isinf(model.limits.position_upper[5]) == (name == "ur3")
    assert model.assumed_limits == ("acceleration", "jerk")


def test_published_limits_of_the_panda(arm: Callable[[str], RobotModel]) -> None:
    """Figures of the Franka Control Interface documentation."""
    limits = arm("panda").limits
    np.testing.assert_allclose(limits.acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_allclose(limits.jerk, [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    np.testing.assert_allclose(limits.velocity, [2.175] * 4 + [2.61] * 3)
    assert arm("panda").assumed_limits == () and not arm("panda").assumed_enclosure


@pytest.mark.parametrize("name", robot_names())
def test_every_arm_loads_and_lists_what_it_rests_on(name: str, arm: Callable[[str], RobotModel]) -> None:
    model = arm(name)
    names = [assumption.name for assumption in model.assumptions]
    assert len(set(names)) == len(names) and all(n.startswith(f"robot.{name}.") for n in names)
    for each in model.joints:
        assert {f"robot.{name}.{quantity}.{each}" for quantity in QUANTITIES} <= set(names)
    assert {f"robot.{name}.enclosure.{each}.radius" for each in model.links} <= set(names)
    assert all(assumption.source or assumption.name.endswith(".tool") for assumption in model.assumptions)
    assert model.tool == "bare flange" and len(model.content_hash) == 64


def test_differences_from_the_urdf_are_those_that_are_known(cache_dir: Path) -> None:
    """ur3_robot.urdf carries a UR10's limits; all UR files round 180°/s; the Panda's are the maker's."""
    setup = RobotSetup(cache_dir=cache_dir)
    cards = {name: describe_card(name, setup) for name in robot_names()}
    for name, card in cards.items():
        for limit in card.differences:
            print(f"{name}: {limit.quantity} of {limit.joint} {limit.value:.4g}, URDF {limit.urdf_value:.4g}")
    differing = {name: {(d.quantity, d.joint) for d in card.differences} for name, card in cards.items()}
    assert not any(differing[name] for name in ("panda", *OWN))
    assert {quantity for quantity, _ in differing["ur5"]} == {"velocity"}
    wrists = {("torque", f"wrist_{i}_joint") for i in (1, 2, 3)}
    assert {d for d in differing["ur10"] if d[0] != "velocity"} == wrists
    assert len({d for d in differing["ur3"] if d[0] == "torque"}) == 6
    assert ("position_upper", "wrist_3_joint") in differing["ur3"]
    urdf = PinArm(urdf_of("ur3")).model
    stated = {d.joint: d.urdf_value for d in cards["ur3"].differences if d.quantity == "torque"}
    assert stated == dict(zip(list(urdf.names)[1:], urdf.effortLimit, strict=True))


def test_panda_fingers_are_locked_and_enclosed(arm: Callable[[str], RobotModel]) -> None:
    model = arm("panda")
    assert len(model.joints) == 7 and not any("finger" in name for name in model.joints)
    assert {a.name for a in model.assumptions if ".locked." in a.name} == {
        "robot.panda.locked.panda_finger_joint1",
        "robot.panda.locked.panda_finger_joint2",
    }


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(
        SetupError,
        match=r"neither a file.*fr3, kr5_sixx, lwa4p, panda, ra605, ur10, ur10e, ur16e, ur3, ur3e, ur5, ur5e",
    ):
        load_robot("ur7", setup=RobotSetup())


BOX = shape('<box size="0.1 0.1 0.4"/>')
USER_ARM = robot(
    link("base", BOX),
    link("upper", BOX),
    link("rail", BOX),
    link("flange"),
    joint("turn", "base", "upper", kind="continuous", xyz=(0, 0, 0.2)),
    joint("slide", "upper", "rail", kind="prismatic", xyz=(0, 0, 0.4)),
    joint("end", "rail", "flange", kind="fixed", xyz=(0, 0, 0.2)),
    name="user_arm",
)
LIMITS = {
    "turn": {"velocity_rad_s": 1.5, "acceleration_rad_s2": 5, "jerk_rad_s3": 100.0},
    "slide": {"acceleration_m_s2": 2.0, "jerk_m_s3": 30.0},
}


def test_a_user_arm_without_limits_gets_them_asked_for_in_one_message(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    path = write_urdf(USER_ARM.replace('velocity="2"', ""))
    with pytest.raises(MissingLimits) as caught:
        load_robot(path, setup=RobotSetup(cache_dir=tmp_path))
    assert str(caught.value).startswith(f"setup.limits: limits of {path} without a value")
    assert caught.value.gaps == {
        "turn": ("velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3"),
        "slide": ("acceleration_m_s2", "jerk_m_s3"),
    }
    setup = RobotSetup(limits=LIMITS, cache_dir=tmp_path, bare_flange=True)
    model = load_robot(path, setup=setup)
    assert model.name == "user_arm" and model.joints == ("turn", "slide")
    assert model.limits.velocity.tolist() == [1.5, 1.0] and model.limits.jerk.tolist() == [100.0, 30.0]
    assert model.fixed_links == ("base",) and model.links == ("upper", "rail")
    assert model.assumed_limits == () and not model.assumed_enclosure
    certainty = {a.name: a.certainty for a in model.assumptions}
    assert certainty["robot.user_arm.jerk.slide"] is Certainty.DECLARED
    assert certainty["robot.user_arm.velocity.slide"] is Certainty.SOURCED


def test_declared_limits_override_the_catalogue(cache_dir: Path) -> None:
    setup = RobotSetup(limits={"elbow_joint": {"jerk_rad_s3": 250.0}}, cache_dir=cache_dir)
    model = load_robot("ur5", setup=setup)
    assert model.limits.jerk.tolist() == [400, 400, 250, 400, 400, 400]
    entry = next(a for a in model.assumptions if a.name == "robot.ur5.jerk.elbow_joint")
    assert (entry.value, entry.certainty) == (250.0, Certainty.DECLARED)


def test_moving_links_without_geometry_need_declared_capsules(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    path = write_urdf(USER_ARM.replace(f'<link name="upper">{BOX}</link>', link("upper")))
    with pytest.raises(SetupError, match="moving link without geometry: upper"):
        load_robot(path, setup=RobotSetup(limits=LIMITS, cache_dir=tmp_path))
    row = {"link": "upper", "a_m": [0, 0, 0], "b_m": [0, 0, 0.4], "radius_m": 0.1}
    model = load_robot(path, setup=RobotSetup(limits=LIMITS, cache_dir=tmp_path, enclosure=[row, row]))
    assert model.links == ("upper:1", "upper:2", "rail")
    assert model.enclosure[0]["radius"][0] == 0.1
    for bad in ({"link": "upper"}, row | {"radius": 1}, row | {"link": "base"}, row | {"link": "nose"}):
        with pytest.raises(SetupError):
            load_robot(path, setup=RobotSetup(limits=LIMITS, cache_dir=tmp_path, enclosure=[bad]))


def test_uncommanded_joints_of_an_arm_widen_its_links(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    path = write_urdf(USER_ARM)
    both = load_robot(path, setup=RobotSetup(limits=LIMITS, cache_dir=tmp_path))
    limits = {"turn": LIMITS["turn"]}
    one = load_robot(path, setup=RobotSetup(limits=limits, commanded=("turn",), cache_dir=tmp_path))
    rows = one.enclosure[0]
    length = [np.linalg.norm(rows["b"][i] - rows["a"][i]) + 2 * rows["radius"][i] for i in range(rows["n"])]
    assert max(length) >= 0.4 + 0.5, "0.4 m long, slides 0.5 m"
    assert both.links == ("upper", "rail") and set(one.joints) == {"turn"}


TOOL = """
name = "gripper"
[[capsule]]
a_m = [0.0, 0.0, 0.0]
b_m = [0.0, 0.0, 0.1]
radius_m = 0.05
[[mesh]]
file = "jaw.stl"
xyz_m = [0.0, 0.0, 0.1]
rpy_deg = [0.0, 0.0, 90.0]
[[payload]]
a_m = [0.0, 0.0, 0.2]
b_m = [0.0, 0.0, 0.3]
radius_m = 0.03
"""


@pytest.fixture
def tool_file(tmp_path: Path) -> Path:
    (tmp_path / "jaw.stl").write_bytes(tetrahedron(0.1))
    path = tmp_path / "tool.toml"
    path.write_text(TOOL)
    return path


def test_tool_and_payload_move_with_the_flange(tool_file: Path, cache_dir: Path) -> None:
    setup = RobotSetup(tool=load_tool(tool_file), cache_dir=cache_dir)
    model, bare = load_robot("ur5", setup=setup), load_robot("ur5", setup=RobotSetup(cache_dir=cache_dir))
    assert model.tool == "gripper" and bare.tool is None and model.content_hash != bare.content_hash
    assert model.links[6:] == ("tool:gripper:1", "payload:gripper", "tool:gripper:2")
    rows = model.enclosure[0]
    assert set(rows["joint"][6:9]) == {5}
    oracle = PinArm(urdf_of("ur5"))
    frame = oracle.model.frames[oracle.model.getFrameId("tool0")]
    np.testing.assert_allclose(rows["a"][6], frame.placement.translation, atol=1e-12)
    tip = frame.placement * np.array([0, 0, 0.3])
    np.testing.assert_allclose(rows["b"][7], tip, atol=1e-12)
    turned = np.array([[0, 0, 0.1], [0, 0.1, 0.1], [-0.1, 0, 0.1], [0, 0, 0.2]])
    corners = np.array([frame.placement * corner for corner in turned])
    a, b = rows["a"][8], rows["b"][8]
    along = np.clip((corners - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
    distance = np.linalg.norm(corners - a - along[:, None] * (b - a), axis=1)
    assert rows["radius"][8] - 0.01 < distance.max() <= rows["radius"][8]
    assert rows["reach"][6:9, 0].max() > bare.enclosure[0]["reach"][:, 0].max()


def test_a_tool_may_hang_on_any_moving_link(tool_file: Path, cache_dir: Path) -> None:
    tool_file.write_text('frame = "forearm_link"\n' + TOOL)
    model = load_robot("ur5", setup=RobotSetup(tool=load_tool(tool_file), cache_dir=cache_dir))
    rows = [model.enclosure[0]["joint"][i] for i, name in enumerate(model.links) if "gripper" in name]
    assert rows == [2, 2, 2] and list(model.enclosure[0]["joint"][:9]) == sorted(
        model.enclosure[0]["joint"][:9]
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "gripper"', "", "name is missing"),
        ('name = "gripper"', "name = 3", "must be text"),
        ('name = "gripper"', 'name = ""', r"tool\.toml: name = '' must be one line of text that prints"),
        ('name = "gripper"', 'name = "a\\nb"', r"name = 'a\\nb' must be one line"),
        (
            "radius_m = 0.05",
            f"radius_m = 1{'0' * 400}",
            r"capsule\[0\].radius_m = 10+… must be a finite number",
        ),
        ("radius_m = 0.05", f"radius_m = {'1' * 5000}", "not a TOML file"),
        ("radius_m = 0.05", f"radius_m = 0x{'f' * 5000}", "radius_m = a huge int must be a finite number"),
        ("radius_m = 0.05", "radius_m = 2000.0", "from -1000 to 1000"),
        ("radius_m = 0.05", f"radius_m = {'[' * 5000}{']' * 5000}", "nested too deeply"),
        ('file = "jaw.stl"', 'file = "a\\u0000b"', r"mesh file 'a\\x00b' was not found"),
        ('file = "jaw.stl"', f'file = "{"a" * 5000}"', "mesh file 'a+… was not found"),
        ('file = "jaw.stl"', "file = 3", r"mesh\[0\].file = 3 must be text"),
        ('name = "gripper"', 'name = "g"\ncolour = "red"', "unknown key 'colour'"),
        ('name = "gripper"', 'name = "g"\nframe = 7', "must be the name of a link"),
        ("radius_m = 0.05", "radius_m = -0.05", r"capsule\[0\].radius_m = -0.05 must be above zero"),
        ("radius_m = 0.05", "radius_m = nan", "must be a finite number"),
        ("radius_m = 0.05", "radius_mm = 50", "radius_m is missing"),
        ("b_m = [0.0, 0.0, 0.1]", "b_m = [0.0, 0.1]", "must be three numbers"),
        ("b_m = [0.0, 0.0, 0.1]", 'b_m = [0.0, 0.0, "x"]', "must be a finite number"),
        ('file = "jaw.stl"', 'file = "claw.stl"', r"mesh\[0\]: mesh file 'claw.stl' was not found"),
        (TOOL, 'name = "g"\ncapsule = ""', r"capsule must be written as \[\[capsule\]\] tables"),
        ("[[capsule]]", "[capsule]", r"must be written as \[\[capsule\]\]"),
        (TOOL, 'name = "g"', r"tool g has no \[\[capsule\]\] and no \[\[mesh\]\]"),
        (TOOL, "name = ", "not a TOML file"),
    ],
)
def test_a_wrong_tool_file_gets_one_line(old: str, new: str, message: str, tool_file: Path) -> None:
    tool_file.write_text(TOOL.replace(old, new, 1))
    with pytest.raises(ToolError, match=message) as caught:
        load_tool(tool_file)
    assert str(caught.value).startswith(f"{tool_file}: ")
    assert "\n" not in str(caught.value) and "gripper" not in str(caught.value).split(":")[0]


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        ("nose", r"tool\.toml: frame: no link is called 'nose'"),
        ("", r"tool\.toml: frame: no link is called ''"),
        ("base_link", r"tool\.toml: frame: link base_link moves with no joint"),
        (None, r"tool\.toml: frame: no flange is known; state frame = the link it hangs on, one of: flange$"),
    ],
)
def test_a_tool_needs_a_frame_that_moves(
    frame: str | None, message: str, tool_file: Path, write_urdf: Callable[[str], Path], cache_dir: Path
) -> None:
    named = frame is not None
    tool_file.write_text(f'frame = "{frame}"\n{TOOL}' if named else TOOL)
    setup = RobotSetup(tool=load_tool(tool_file), cache_dir=cache_dir, limits=None if named else LIMITS)
    with pytest.raises(SetupError, match=message):
        load_robot("ur5" if named else write_urdf(USER_ARM), setup=setup)


def test_a_tool_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ToolError, match=r"none\.toml: does not exist"):
        load_tool(tmp_path / "none.toml")
    for name in ("a\0b", "a" * 5000):
        with pytest.raises(ToolError, match="cannot be read") as caught:
            load_tool(tmp_path / name)
        assert str(caught.value).isprintable()
        with pytest.raises(SetupError, match="neither a file nor a robot"):
            load_robot(tmp_path / name, setup=RobotSetup())


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"commanded": ("knee",)}, r"^cell\.toml: robot\.joints: no moving joint is called 'knee'"),
        ({"commanded": ("slide",)}, r"^cell\.toml: robot\.joints: joint slide is commanded, but hangs on"),
        ({"limits": {"knee": {}}}, r"^cell\.toml: robot\.limits\.knee: no such commanded joint"),
        (
            {"enclosure": [{"link": "nose", "a_m": [0, 0, 0], "b_m": [0, 0, 1], "radius_m": 1}]},
            r"^cell\.toml: robot\.enclosure\.nose: no link is called 'nose'",
        ),
        (
            {"enclosure": [{"link": "rail", "a_m": [0, 0, 0], "b_m": [0, 0, 1e5], "radius_m": 1}]},
            r"^cell\.toml: robot\.enclosure\.rail\.b_m = 100000\.0 must be a finite number from -1000",
        ),
        (
            {"enclosure": [{"link": "base", "a_m": [0, 0, 0], "b_m": [0, 0, 1], "radius_m": 1}]},
            r"^cell\.toml: robot\.enclosure\.base: link base moves with no joint",
        ),
    ],
)
def test_messages_name_the_file_and_the_key_of_the_setup(
    stated: dict[str, Any], message: str, write_urdf: Callable[[str], Path], cache_dir: Path
) -> None:
    setup = RobotSetup(**({"limits": LIMITS} | stated), cache_dir=cache_dir, source="cell.toml: robot")
    with pytest.raises(SetupError, match=message):
        load_robot(write_urdf(USER_ARM), setup=setup)


def test_a_tool_contradicts_a_bare_flange(tool_file: Path) -> None:
    with pytest.raises(SetupError, match="contradict each other"):
        RobotSetup(tool=load_tool(tool_file), bare_flange=True)


def test_too_many_capsules_are_refused_with_the_maximum(tool_file: Path, cache_dir: Path) -> None:
    capsule = TOOL.split("[[mesh]]", maxsplit=1)[0].split("\n", 2)[2]
    tool_file.write_text('name = "brush"\n' + capsule * 20)
    with pytest.raises(SetupError, match="26 capsules on moving links; the maximum is 24"):
        load_robot("ur5", setup=RobotSetup(tool=load_tool(tool_file), cache_dir=cache_dir))


def test_a_mounted_arm_with_its_meshes_lies_in_its_capsules(
    cache_dir: Path, rng: np.random.Generator
) -> None:
    import pinocchio

    mount = Mount.from_xyz_rpy((0.4, -2.0, 1.0), (180, 20, -70))
    model = load_robot("ur5", setup=RobotSetup(mount=mount, cache_dir=cache_dir))
    oracle = PinArm(urdf_of("ur5"), pinocchio.SE3(mount.rotation, mount.translation))
    assert min(check_geometry_inside(model, oracle, rng, 2).values()) >= -1e-9
    entry = next(a for a in model.assumptions if a.name == "robot.ur5.mount")
    assert entry.certainty is Certainty.DECLARED and "0.4, -2, 1" in str(entry.value)


def test_cards_are_json_and_text_with_every_number(cache_dir: Path) -> None:
    for name in robot_names():
        card = describe_card(name, RobotSetup(cache_dir=cache_dir))
        parsed = json.loads(json.dumps(card.to_dict(), allow_nan=False))
        model = load_robot(name, setup=RobotSetup(cache_dir=cache_dir))
        assert parsed["content_hash"] == model.content_hash
        assert len(parsed["limits"]) == 6 * len(model.joints) and len(parsed["enclosure"]) == len(model.links)
        text = "\n".join(card.lines())
        assert all(word in text for word in (*model.joints, *model.links, *QUANTITIES))
        assert ("engineering assumptions: nothing" in text) == (name == "panda")
        for entry in parsed["enclosure"]:
            assert entry["hull_litres"] is None or entry["hull_litres"] <= entry["litres"]
        assert not re.search(r"\bsafe\b|certified|compliant", text)


def test_a_missing_mesh_is_named_before_anything_is_loaded(write_urdf: Callable[[str], Path]) -> None:
    arm_link = link("upper", shape('<mesh filename="package://maker/upper.stl"/>'))
    path = write_urdf(robot(link("base"), arm_link, joint("turn", "base", "upper")))
    limits = full_limits(["turn"], [False])
    with pytest.raises(SetupError, match=r"link upper: mesh file 'package://maker/upper\.stl' was not found"):
        load_robot(path, setup=RobotSetup(limits=limits))
