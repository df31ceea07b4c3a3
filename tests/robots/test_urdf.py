"""URDF files: what is read, and the one line that a wrong one gets."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from robots.errors import SetupError
from robots.urdf import Urdf, parse_urdf
from tests.robots.made_up import joint, link, robot, shape

ARM = (link("base"), link("arm", shape('<box size="1 1 1"/>')))


def parse(text: str, path: Path = Path("x.urdf"), package_dirs: tuple[Path, ...] = ()) -> Urdf:
    return parse_urdf(text.encode(), path, package_dirs)


def test_joints_limits_and_links_are_read() -> None:
    inside = '<limit lower="-1" upper="2.5" velocity="3" effort="4"/>'
    urdf = parse(robot(*ARM, joint("j", "base", "arm", inside=inside), name="two"))
    assert urdf.name == "two" and urdf.links == ("base", "arm") and urdf.shaped == {"arm"}
    read = urdf.joints["j"]
    assert (read.lower, read.upper, read.velocity, read.effort) == (-1.0, 2.5, 3.0, 4.0)
    assert (read.kind, read.parent, read.child, read.mimics) == ("revolute", "base", "arm", None)


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ("", (None, None, None, None)),
        ("<limit/>", (None, None, None, None)),
        ('<limit velocity="2"/>', (None, None, 2.0, None)),
    ],
)
def test_what_is_not_written_is_not_invented(inside: str, expected: tuple[float | None, ...]) -> None:
    read = parse(robot(*ARM, joint("j", "base", "arm", inside=inside))).joints["j"]
    assert (read.lower, read.upper, read.velocity, read.effort) == expected


def test_mimic_joints_have_a_factor_and_an_offset() -> None:
    inside = (
        '<limit lower="0" upper="1" velocity="1" effort="1"/><mimic joint="k" multiplier="-2" offset="0.5"/>'
    )
    assert parse(robot(*ARM, joint("j", "base", "arm", inside=inside))).joints["j"].mimics == ("k", -2.0, 0.5)
    plain = joint("j", "base", "arm", inside='<mimic joint="k"/>')
    assert parse(robot(*ARM, plain)).joints["j"].mimics == ("k", 1.0, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not XML"),
        ("<robot", "not XML"),
        ("<sdf></sdf>", "root element is <sdf>"),
        (robot(*ARM, joint("j", "base", "arm", kind="ball")), "joint j has type 'ball'"),
        (
            robot(*ARM, '<joint name="j" type="fixed"><parent link="base"/></joint>'),
            "joint j has no child link",
        ),
        (robot(*ARM, joint("j", "base", "hand")), "joint j names link 'hand', which does not exist"),
        (robot(*ARM, joint("j", "base", "arm"), joint("j", "arm", "base")), "two joints are called j"),
        (robot(*ARM, joint("j", "base", "arm", inside='<limit velocity="fast"/>')), "velocity = 'fast'"),
        (robot(*ARM, joint("j", "base", "arm", inside='<limit lower="nan"/>')), "lower = 'nan'"),
        (robot(*ARM, joint("j", "base", "arm", axis=(0, 0, 0))), "joint j: axis '0 0 0'"),
        (robot(*ARM, joint("j", "base", "arm", axis=(0, math.nan, 1))), "joint j: axis"),
        (robot(*ARM, joint("j", "base", "arm", axis=(0, 1))), "joint j: axis"),
    ],
)
def test_a_wrong_file_gets_one_line(text: str, message: str) -> None:
    with pytest.raises(SetupError) as caught:
        parse(text)
    assert message in str(caught.value) and "x.urdf" in str(caught.value) and "\n" not in str(caught.value)


def mesh(uri: str) -> str:
    return robot(link("base"), link("arm", shape(f'<mesh filename="{uri}"/>')), joint("j", "base", "arm"))


@pytest.mark.parametrize("uri", ["package://maker/m/arm.stl", "m/arm.stl", "../maker/m/arm.stl"])
def test_meshes_are_found_beside_and_above_the_file(uri: str, tmp_path: Path) -> None:
    file = tmp_path / "maker" / "m" / "arm.stl"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"x")
    urdf = parse(mesh(uri), tmp_path / "maker" / "arm.urdf")
    assert urdf.meshes == (("arm", file.resolve()),) and str(file.resolve()) in urdf.xml


def test_meshes_are_found_in_named_folders_and_by_absolute_names(tmp_path: Path) -> None:
    file = tmp_path / "a" / "maker" / "arm.stl"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"x")
    elsewhere = tmp_path / "b" / "arm.urdf"
    assert parse(mesh(f"file://{file}"), elsewhere).meshes[0][1] == file.resolve()
    assert parse(mesh(str(file)), elsewhere).meshes[0][1] == file.resolve()
    with pytest.raises(SetupError):
        parse(mesh("package://maker/arm.stl"), elsewhere)
    urdf = parse(mesh("package://maker/arm.stl"), elsewhere, package_dirs=(tmp_path / "a",))
    assert urdf.meshes[0][1] == file.resolve()


def test_a_name_is_read_to_its_end(tmp_path: Path) -> None:
    """Another file must not be taken for one that is not there."""
    for name in ("arm.stl", "arm.stl#2.stl", "arm.stl?2.stl"):
        (tmp_path / name).write_bytes(b"solid")
    for scheme in (f"package://{tmp_path.name}", f"file://{tmp_path}", f"FILE://localhost{tmp_path}"):
        for name in ("arm.stl#2.stl", "arm.stl?2.stl", "arm.stl"):
            assert parse(mesh(f"{scheme}/{name}"), tmp_path).meshes[0][1].name == name
    with pytest.raises(SetupError, match="was not found"):
        parse(mesh(f"package://{tmp_path}/arm.stl"), tmp_path)


@pytest.mark.parametrize("uri", ["package://maker/arm.stl", "arm.stl", "", "http://maker/arm.stl"])
def test_a_missing_mesh_is_named_with_its_link(uri: str) -> None:
    with pytest.raises(SetupError, match="link arm: mesh file") as caught:
        parse(mesh(uri))
    assert repr(uri) in str(caught.value) and "\n" not in str(caught.value)
    advice = "; put the folder 'maker' beside the URDF or above it, or name the folder that has it in robot.p"
    assert (advice in str(caught.value)) == uri.startswith("package")


@pytest.mark.parametrize("length", [1e-3, 0.0015, 999.5, 1e3])
def test_an_axis_may_have_any_length_that_can_be_divided_by(length: float) -> None:
    assert parse(robot(*ARM, joint("j", "base", "arm", axis=(0, 0, -length)))).joints["j"].kind == "revolute"
    for beyond in (0.00099, 1000.5):
        with pytest.raises(SetupError, match=r"of a length from 0\.001 to 1000"):
            parse(robot(*ARM, joint("j", "base", "arm", axis=(beyond, 0, 0))))


def test_a_joint_that_does_not_move_needs_no_axis_and_any_other_joint_may_have_none() -> None:
    fixed = joint("j", "base", "arm", kind="fixed", axis=(0, 0, 0))
    read = parse(robot(*ARM, fixed))
    assert read.joints["j"].kind == "fixed" and "axis" not in read.xml and "limit" not in read.xml
    plain = joint("j", "base", "arm").replace('<axis xyz="0 0 1"/>', "")
    assert "axis" not in plain and "axis" not in parse(robot(*ARM, plain)).xml
    turned = parse(robot(*ARM, joint("j", "base", "arm", axis=(1, 0, 0))))
    assert '<axis xyz="1 0 0"' in turned.xml and 'lower="-1"' in turned.xml


@pytest.mark.parametrize(
    ("kind", "slides"), [("revolute", False), ("continuous", False), ("prismatic", True), ("fixed", False)]
)
def test_only_prismatic_joints_slide(kind: str, slides: bool) -> None:
    assert parse(robot(*ARM, joint("j", "base", "arm", kind=kind))).joints["j"].prismatic is slides


def test_a_mimic_factor_may_be_a_million_and_no_more() -> None:
    def read(multiplier: str, offset: str) -> Urdf:
        inside = f'<mimic joint="k" multiplier="{multiplier}" offset="{offset}"/>'
        return parse(robot(*ARM, joint("j", "base", "arm", inside=inside)))

    assert read("1e6", "-1e6").joints["j"].mimics == ("k", 1e6, -1e6)
    for numbers in (("1000000.5", "0"), ("0", "-1000000.5"), ("inf", "0")):
        with pytest.raises(SetupError, match=r"must be a number from -1e\+06 to 1e\+06"):
            read(*numbers)
    with pytest.raises(SetupError, match="multiplier = 'nan' is not a number"):
        read("nan", "0")
