"""What URDF parsers skip, guess or print about is refused in one line that names file, element and rule."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest

from robots.catalog import RobotSetup, load_robot
from robots.errors import SetupError
from robots.geometry import moving_geometry
from robots.model import RobotModel, read_tree
from robots.urdf import Urdf, parse_urdf
from tests.robots.made_up import full_limits, joint, link, robot, shape

SMALL = shape('<box size="0.02 0.02 0.02"/>')
BIG = '<box size="6 6 6"/>'
LIMITS = full_limits(["j"], [False])


def parse(text: str) -> Urdf:
    return parse_urdf(text.encode(), Path("x.urdf"))


def refusal(text: str) -> str:
    with pytest.raises(SetupError) as caught:
        parse(text)
    message = str(caught.value)
    assert message.startswith("x.urdf: ") and "\n" not in message
    return message


def arm(shapes: str, **how: Any) -> str:
    return robot(link("base"), link("arm", shapes), joint("j", "base", "arm", **how))


def load(path: Path, cache: Path) -> RobotModel:
    return load_robot(path, setup=RobotSetup(limits=LIMITS, cache_dir=cache, bare_flange=True))


@pytest.mark.parametrize("kind", ["visual", "collision"])
@pytest.mark.parametrize(
    ("geometry", "told"),
    [
        ('<capsule radius="3" length="1"/>', "shape <capsule> is not supported; possible are: box"),
        ('<cone radius="3" length="6"/>', "shape <cone> is not supported"),
        ("<plane/>", "shape <plane> is not supported"),
        ("<Box/>", "shape <Box> is not supported"),
        ("", "has 0 shapes"),
        ('<box size="0.1 0.1 0.1"/><box size="6 6 6"/>', "has 2 shapes"),
        ('<box size="6 6 6,0"/>', "box size = '6 6 6,0' must be three numbers above 0"),
        ('<box size="6 6"/>', "box size = '6 6'"),
        ('<box size="6 6 nan"/>', "box size"),
        ('<box size="6 6 1_0"/>', "box size"),
        ('<box size="-6 6 6"/>', "box size"),
        ('<box size="0 0 0"/>', "box size"),
        ('<box size="1e200 1 1"/>', "at most 1000 [m]"),
        ("<box/>", "box size = None"),
        ('<sphere radius="-1"/>', "sphere radius = '-1' must be a number above 0"),
        ('<sphere radius="1e400"/>', "sphere radius"),
        ('<sphere radius="abc"/>', "sphere radius"),
        ('<cylinder radius="3"/>', "cylinder length = None"),
        ('<cylinder radius="-3" length="1"/>', "cylinder radius = '-3'"),
        ('<cylinder radius="3" length="inf"/>', "cylinder length = 'inf'"),
        ('<box size="1 1 1" Size="6 6 6"/>', "box has the attribute Size; possible are: size"),
        ('<box size="1 1 1"><size>6 6 6</size></box>', "box holds a <size>, which is not read"),
        ('<mesh filename="a.stl" Scale="9 9 9"/>', "mesh has the attribute Scale; possible are: filename"),
        ('<mesh filename="a.stl" unit="km"/>', "mesh has the attribute unit"),
        ('<mesh filename="a.stl"><scale>9 9 9</scale></mesh>', "mesh holds a <scale>, which is not read"),
        ('<mesh filename="a.stl" scale="9"/>', "mesh scale = '9' must be three numbers"),
        ('<mesh filename="a.stl" scale="1 1"/>', "mesh scale = '1 1' must be three numbers"),
        ('<mesh filename="a.stl" scale="0 0 0"/>', "mesh scale = '0 0 0'"),
        ('<mesh filename="a.stl" scale="1e200 1 1"/>', "mesh scale"),
    ],
)
def test_a_shape_that_would_be_skipped_is_refused_beside_one_that_is_read(
    kind: str, geometry: str, told: str
) -> None:
    message = refusal(arm(SMALL + shape(geometry, kind=kind)))
    index = 1 if kind == "visual" else 0
    assert f"link arm: {kind}[{index}]" in message and told in message


@pytest.mark.parametrize(
    ("shapes", "told"),
    [
        ("<visual/>", "visual[0] has 0 shapes"),
        (
            f"<visual><geometry>{BIG}</geometry><geometry>{BIG}</geometry></visual>",
            "<geometry> stands there 2",
        ),
        (f"<Visual><geometry>{BIG}</geometry></Visual>", "<Visual> is not read; write <visual>"),
        (f'<c:collision xmlns:c="c"><geometry>{BIG}</geometry></c:collision>', "write <collision>"),
        (f'<visual scale="9"><geometry>{BIG}</geometry></visual>', "visual has the attribute scale"),
        (f'<visual><geometry scale="9">{BIG}</geometry></visual>', "geometry has the attribute scale"),
        (f'<visual><Origin xyz="1 2 3"/><geometry>{BIG}</geometry></visual>', "write <origin>"),
    ],
)
def test_elements_that_would_not_be_read_are_refused(shapes: str, told: str) -> None:
    assert told in refusal(arm(SMALL.replace("visual", "collision") + shapes))


XACRO = 'xmlns:xacro="http://ros.org/wiki/xacro"'
TOOL = link("tool", shape(BIG))


@pytest.mark.parametrize(
    ("shapes", "beside", "told"),
    [
        ("", f'<xacro:include {XACRO} filename="gripper.xacro"/>', "x.urdf: <xacro:include> is not expanded"),
        (
            "",
            f'<gazebo><xacro:gripper {XACRO} parent="arm"/></gazebo>',
            "<xacro:gripper> is not expanded: run",
        ),
        (f"<xacro:finger {XACRO}/>", "", "<xacro:finger> is not expanded"),
        ("", f"<group>{TOOL}</group>", "x.urdf: <link> inside <group> is not read, and would be lost"),
        ("", f"<group><part>{TOOL}</part></group>", "<link> inside <group>"),
        ("", f"<group>{joint('k', 'arm', 'tool')}</group>", "<joint> inside <group>"),
        ("", "<g:group xmlns:g='g'><g:Link name='tool'/></g:group>", "Link> inside <{g}group>"),
        ("", shape(BIG), "x.urdf: <visual> here is not read"),
        (f"<extra>{shape(BIG)}</extra>", "", "x.urdf: link arm: <visual> inside <extra> is not read"),
        (f"<inertial>{shape(BIG, kind='collision')}</inertial>", "", "<collision> inside <inertial>"),
        (TOOL, "", "link arm: <link> here is not read"),
        (
            SMALL.replace("</visual>", f"<lod>{shape(BIG)}</lod></visual>"),
            "",
            "visual[1]: <visual> inside <lod>",
        ),
        (SMALL.replace("<origin", f"<material>{shape(BIG)}</material><origin"), "", "inside <material>"),
        (SMALL.replace('rpy="0 0 0"/>', f'rpy="0 0 0">{shape(BIG)}</origin>'), "", "inside <origin>"),
        (SMALL.replace("<box", "<geometry/><box"), "", "visual[1]: <geometry> inside <geometry>"),
        (
            "<collision_checking><capsule name='c'/></collision_checking>",
            "",
            "<collision_checking> here is not",
        ),
        ("", '<include filename="gripper.urdf"/>', "x.urdf: <include> here is not read, and would be lost"),
        (
            "",
            '<i:include xmlns:i="http://www.w3.org/2001/XInclude" href="gripper.urdf"/>',
            "include> here is not read, and would be lost",
        ),
        ("", '<xacro:gripper xmlns:xacro="x"/>', "x.urdf: <{x}gripper> is of another namespace"),
        ('<g:finger xmlns:g="x"/>', "", "link arm: <{x}finger> is of another namespace"),
        ("", link("${side}tool"), "x.urdf: the name '${side}tool' is not expanded: run xacro first"),
    ],
)
def test_links_and_shapes_are_not_lost_with_what_surrounds_them(shapes: str, beside: str, told: str) -> None:
    text = arm(SMALL + shapes).replace("</robot>", f"{beside}</robot>")
    assert told in refusal(text)


@pytest.mark.parametrize("beside", ["gazebo", "transmission", "ros2_control"])
def test_simulators_and_controllers_may_name_joints_and_shapes_again(beside: str) -> None:
    again = f'<{beside}><joint name="j"/>{shape(BIG)}</{beside}>'
    declared = arm(SMALL + "<gazebo><visual/></gazebo>").replace("</robot>", f"{again}</robot>")
    parsed = parse(declared.replace("<robot", f"<robot {XACRO}"))
    assert parsed.links == ("base", "arm") and parsed.shapes["arm"] == {"visual": 1, "collision": 0}


@pytest.mark.parametrize(
    ("origin", "told"),
    [
        ('xyz="1 2"', "xyz = '1 2' must be three numbers from -1000 to 1000"),
        ('xyz=""', "xyz = ''"),
        ('xyz="0,1 0 0"', "xyz = '0,1 0 0'"),
        ('xyz="nan 0 0"', "xyz = 'nan 0 0'"),
        ('xyz="1e200 0 0"', "xyz = '1e200 0 0'"),
        ('rpy="a b c"', "rpy = 'a b c'"),
        ('rpy="1e300 0 0"', "rpy = '1e300 0 0'"),
        ('xzy="1 2 3"', "has the attribute xzy; possible are: xyz, rpy"),
    ],
)
def test_placements_are_three_numbers(origin: str, told: str) -> None:
    placed = f"<visual><origin {origin}/><geometry>{BIG}</geometry></visual>"
    assert f"link arm: visual[0]: origin {told}" in refusal(arm(placed))
    turned = arm(SMALL).replace('<origin xyz="0 0 0" rpy="0 0 0"/><axis', f"<origin {origin}/><axis")
    assert f"joint j: origin {told}" in refusal(turned)


@pytest.mark.parametrize("axis", [(1e200, 0, 0), (1e-200, 0, 0), (0, 0, 0), (1, np.nan, 0)])
def test_an_axis_has_a_length_that_can_be_divided_by(axis: tuple[float, float, float]) -> None:
    assert "joint j: axis" in refusal(arm(SMALL, axis=axis))


@pytest.mark.parametrize(
    "beside",
    [
        "<visual><geometry><box size='0.1 0.1 0.1'/></geometry><material/></visual>",
        '<inertial><mass value="x"/></inertial>',
        "<gazebo><visual/></gazebo>",
    ],
)
def test_what_is_not_needed_hides_no_shape(
    beside: str, write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    path = write_urdf(arm(beside + SMALL + shape(BIG, kind="collision")))
    assert load(path, tmp_path / "cache").enclosure[0]["radius"][0] > 3.0


def test_a_broken_element_that_is_not_needed_does_not_matter() -> None:
    inside = '<limit lower="-1" upper="1" velocity="1"/><dynamics damping="x"/><safety_controller/>'
    assert read_tree(parse(arm(SMALL, inside=inside)), ("j",)).joints == ("j",)
    assert "joint j, mimic: mimic has the attribute Offset" in refusal(
        arm(SMALL, inside='<mimic joint="k" Offset="1"/>')
    )
    with pytest.raises(SetupError, match="joint j mimics another joint"):
        read_tree(parse(arm(SMALL, inside="<mimic/>")), ("j",))


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_shapes_are_counted_after_loading(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = read_tree(parse(arm(SMALL + shape(BIG) + 2 * shape(BIG, kind="collision"))), None)
    assert len(moving_geometry(tree)["arm", 0]) == 32
    load_geometry = pinocchio.buildGeomFromUrdfString

    def loses_one(model: Any, xml: str, kind_: Any) -> Any:
        geometry = load_geometry(model, xml, kind_)
        if (kind_ == pinocchio.GeometryType.VISUAL) == (kind == "visual"):
            geometry.removeGeometryObject(geometry.geometryObjects[1].name)
        return geometry

    monkeypatch.setattr("robots.geometry.pinocchio.buildGeomFromUrdfString", loses_one)
    with pytest.raises(SetupError, match=f"link arm: 1 of its 2 {kind} shapes could be loaded"):
        moving_geometry(tree)


LINKS = tuple(link(f"l{i}", SMALL) for i in range(4))


@pytest.mark.parametrize(
    ("joints", "told"),
    [
        (((0, 1), (1, 2)), "links l0, l3 all hang on nothing; a URDF has one root link"),
        (((0, 1), (1, 2), (2, 3), (0, 3)), "link l3 is the child of two joints, j2 and j3"),
        (((0, 1), (1, 2), (2, 0)), "a ring of the links l0 - l2 - l1 - l0; a URDF is a tree"),
        (((0, 1), (2, 3), (3, 2)), "a ring of the links l2 - l3 - l2"),
        (((0, 1), (1, 2), (3, 3)), "a ring of the links l3 - l3"),
    ],
)
def test_joints_make_one_tree(joints: tuple[tuple[int, int], ...], told: str) -> None:
    made = [joint(f"j{i}", f"l{a}", f"l{b}", kind="fixed") for i, (a, b) in enumerate(joints)]
    assert told in refusal(robot(*LINKS, *made))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (robot(), "there is no link"),
        (f'<!DOCTYPE robot SYSTEM "robot.dtd">{robot(link("a"))}', "has a DOCTYPE"),
        (f"<!DOCTYPE robot [<!ENTITY a 'b'>]>{robot(link('a'))}", "has a DOCTYPE"),
        (robot(link("a"), link("a")), "two links are called a"),
        (robot("<link/>"), "a link has the name ''"),
        (robot(link("a&#10;verified")), "a link has the name 'a\\nverified'; it must be text that prints"),
        (robot(link("a"), name="arm&#10;verified"), "robot name 'arm\\nverified' must be one line"),
        (arm(SMALL).replace('name="j"', ""), "a joint has the name ''"),
        ('<?xml version="1.0" encoding="klingon"?><robot/>', "not XML"),
    ],
)
def test_names_are_there_print_and_are_not_shared(text: str, told: str) -> None:
    assert told in refusal(text)


@pytest.mark.parametrize("depth", [60, 20_000, 200_000])
def test_a_file_nested_too_deeply_is_refused(depth: int) -> None:
    assert "nested more than 50 deep" in refusal(robot("<a>" * depth + "</a>" * depth))


def test_long_chains_are_read_quickly() -> None:
    links = [link(f"l{i}") for i in range(5000)]
    joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}", kind="fixed") for i in range(4999)]
    assert len(parse(robot(*links, *joints)).joints) == 4999


def test_numbers_reach_the_kinematics_as_they_were_read(tmp_path: Path) -> None:
    xyz, rpy = (0.1, 1 / 3, -2e-7), (3.141592653589793, -0.7, 1e-3)
    tree = read_tree(parse(arm(SMALL, xyz=xyz, rpy=rpy)), None)
    np.testing.assert_array_equal(tree.model.jointPlacements[1].translation, xyz)


@pytest.mark.parametrize(
    "geometry",
    [
        '<box size="1000 1e-9 1"/>',
        '<sphere radius="1000"/>',
        '<sphere radius="1e-9"/>',
        '<cylinder radius="1000" length="1000"/>',
    ],
)
def test_sizes_up_to_a_thousand_metres_are_read(geometry: str) -> None:
    placed = shape(geometry, xyz=(1000, -1000, 0), rpy=(1000, 0, -1000))
    assert parse(arm(placed)).shapes["arm"] == {"visual": 1, "collision": 0}


@pytest.mark.parametrize("scale", ["1e6 1 1", "-1e6 1e-6 -1", "0.5 0.5 0.5"])
def test_scales_up_to_a_million_are_read_and_may_mirror(scale: str) -> None:
    assert "mesh file 'a.stl' was not found" in refusal(
        arm(shape(f'<mesh filename="a.stl" scale="{scale}"/>'))
    )


@pytest.mark.parametrize(
    ("geometry", "told"),
    [
        ('<sphere radius="1 2"/>', "sphere radius = '1 2' must be a number"),
        ('<sphere radius=""/>', "sphere radius = ''"),
        ('<sphere radius="1000.5"/>', "at most 1000 [m]"),
        ('<cylinder radius="1 2" length="1"/>', "cylinder radius = '1 2' must be a number"),
        ('<cylinder radius="1" length="1 2"/>', "cylinder length = '1 2'"),
        ('<mesh filename="a.stl" scale="1 1 1 1"/>', "mesh scale = '1 1 1 1'"),
        ('<mesh filename="a.stl" scale="1 1000000.5 1"/>', "mesh scale"),
        ('<mesh filename="a.stl" scale="1 0 1"/>', "mesh scale"),
        ('<mesh filename="a.stl" scale="1 nan 1"/>', "mesh scale"),
    ],
)
def test_what_is_just_beyond_is_refused(geometry: str, told: str) -> None:
    assert told in refusal(arm(shape(geometry)))
    beyond = shape('<sphere radius="1"/>').replace('xyz="0 0 0"', 'xyz="0 -1000.5 0"')
    assert "from -1000 to 1000" in refusal(arm(beyond))


@pytest.mark.parametrize(("inside", "told"), [(49, "there is no link"), (50, "nested more than 50 deep")])
def test_fifty_elements_inside_one_another_are_read(inside: int, told: str) -> None:
    """The robot is the first of them."""
    assert told in refusal(robot("<a>" * inside + "</a>" * inside))


@pytest.mark.parametrize("tag", ["a:visual", "a:VISUAL"])
def test_a_shape_of_another_namespace_is_refused(tag: str) -> None:
    told = refusal(arm(f'<{tag} xmlns:a="x:y"><geometry>{BIG}</geometry></{tag}>'))
    assert "is not read; write <visual>" in told
