"""Which arm is judged: what a recording states, a URDF and its content, the catalogue."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.occupancy.test_workspace import two_cubes, write_stl
from tests.robots.made_up import joint, link, robot, shape
from tests.verifier.scenes import UR5_JOINTS, Scene
from tests.verifier.test_command_line import Shell, refused
from verifier.cell import Cell
from verifier.enclosure_size import PartSize, too_long
from verifier.inputs import input_files
from verifier.recordings import Recording
from verifier.recordings.joint_state import JointState
from verifier.recordings.recording_writer import new_recording


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(monkeypatch, capsys)


BOX = shape('<box size="0.1 0.1 0.3"/>')


def rail(name: str = "rail", box: str = BOX) -> str:
    return robot(link("base"), link("l1", box), joint("j1", "base", "l1"), name=name)


def imported(shell: Shell, folder: Path, name: str = "rail") -> Path:
    """A recording of the arm of ``arm.urdf``, which is made as well."""
    urdf, table, out = folder / "arm.urdf", folder / "joints.csv", folder / "o.mcap"
    urdf.write_text(rail(name))
    table.write_text("t,j1\n" + "".join(f"{k / 100},{k / 1000}\n" for k in range(101)))
    status, _out, err = shell("import", out, "--robot", urdf, "--joints", table)
    assert (status, err) == (0, "")
    return out


def rail_cell(folder: Path) -> Path:
    path = folder / "rail.toml"
    limits = "[robot.limits.j1]\nacceleration_rad_s2 = 10.0\njerk_rad_s3 = 400.0\n"
    path.write_text("[robot]\nbare_flange = true\n" + limits)
    return path


@pytest.mark.parametrize("name", ["rail", "ur5", "urdf:x:0123456789ab"])
def test_a_recording_of_a_urdf_is_judged_with_that_urdf_alone(
    shell: Shell, tmp_path: Path, name: str
) -> None:
    recording, urdf, cell = imported(shell, tmp_path, name), tmp_path / "arm.urdf", rail_cell(tmp_path)
    judge = ("verify", recording, "--cell", cell, "--assume-nobody")
    digest = hashlib.sha256(urdf.read_bytes()).hexdigest()[:12]
    assert Recording(recording).robot == f"urdf:{name}:{digest}"
    status, out, _err = shell(*judge, "--robot", urdf)
    assert status == 3 and "waived: nobody is there" in out and "the recording says" not in out
    text = refused(shell(*judge))
    assert f"urdf:{name}:{digest}" in text and "name that file with --robot FILE.urdf" in text
    assert "must agree" in refused(shell(*judge, "--robot", "ur5"))
    urdf.write_text(rail(name, BOX.replace("0.3", "0.1")))
    text = refused(shell(*judge, "--robot", urdf))
    assert "they must agree" in text and digest in text


def test_a_cell_for_a_recording_of_a_urdf_asks_for_that_urdf(shell: Shell, tmp_path: Path) -> None:
    recording = imported(shell, tmp_path)
    digest = hashlib.sha256((tmp_path / "arm.urdf").read_bytes()).hexdigest()[:12]
    _status, out, _err = shell("init", recording)
    assert f"with the hash {digest}" in out and 'urdf = "____"' in out and "\nname = " not in out
    assert f"urdf:rail:{digest}, as the file states" in shell("inspect", recording)[1]


@pytest.mark.parametrize("named", ["", "arm", "{urdf}", "./arm.urdf", 'x"\nbare_flange = true #', "urdf::"])
def test_what_a_recording_names_is_never_opened_as_a_file(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    imported(shell, tmp_path)
    monkeypatch.chdir(tmp_path)
    urdf = tmp_path / "arm.urdf"
    (tmp_path / "arm").write_bytes(urdf.read_bytes())
    path = tmp_path / "named.mcap"
    with new_recording(path) as writer:
        writer.describe({"robot": named.format(urdf=urdf)}, ())
        for k in range(101):
            writer.joints(JointState(k * 10_000_000, ("j1",), np.array([k / 1000])))
    judge = ("verify", path, "--cell", rail_cell(tmp_path), "--assume-nobody")
    text = refused(shell(*judge))
    assert "is not in the catalogue (fr3, kr5_sixx" in text and "name its URDF with --robot FILE.urdf" in text
    status, out, _err = shell(*judge, "--robot", urdf)
    assert status == 3 and "judged was the arm of arm.urdf, rail" in out
    _status, out, _err = shell("init", path)
    assert 'name = "____"' in out and "\nbare_flange" not in out


def test_a_urdf_in_place_of_an_arm_of_the_catalogue_is_noted_whatever_its_name(
    shell: Shell, tmp_path: Path
) -> None:
    recording = Scene(duration=1.0).write(tmp_path / "r.mcap")
    parts = [link("l0", BOX)]
    for i, name in enumerate(UR5_JOINTS):
        parts += [joint(name, f"l{i}", f"l{i + 1}", xyz=(0, 0, 0.2), axis=(0, 1, 0)), link(f"l{i + 1}", BOX)]
    limits = "".join(
        f"[robot.limits.{name}]\nacceleration_rad_s2 = 10.0\njerk_rad_s3 = 400.0\n" for name in UR5_JOINTS
    )
    cell = tmp_path / "own.toml"
    cell.write_text('[robot]\nurdf = "own.urdf"\nbare_flange = true\n' + limits)
    for name in ("ur5", "own"):
        (tmp_path / "own.urdf").write_text(robot(*parts, name=name))
        same = f"{tmp_path}/../{tmp_path.name}/own.urdf"
        _status, out, _err = shell("verify", recording, "--cell", cell, "--robot", same)
        assert f"the recording says it is of ur5; judged was the arm of own.urdf, {name}" in out
    (tmp_path / "own.urdf").write_text(robot(*parts, name="ur10"))
    assert "describes ur10: they must agree" in refused(shell("verify", recording, "--cell", cell))


def test_a_name_on_the_command_line_is_never_opened_as_a_file(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Scene(duration=0.5, robot=None).write(tmp_path / "r.mcap")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm").write_text(rail())
    text = refused(shell("verify", path, "--robot", "arm", "--bare-flange"))
    assert "robot arm is not in the catalogue" in text and "ends in .urdf" in text
    (tmp_path / "c.toml").write_text('[robot]\nname = ""\n')
    assert "robot '' is not in the catalogue" in refused(shell("verify", path, "--cell", tmp_path / "c.toml"))


@pytest.mark.parametrize("with_recording", [False, True])
def test_a_cell_for_a_urdf_of_ones_own_has_a_blank_for_each_limit_that_it_lacks(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_recording: bool
) -> None:
    recording, out = imported(shell, tmp_path), tmp_path / "cell.toml"
    monkeypatch.chdir(tmp_path)
    given = (recording,) if with_recording else ()
    assert shell("init", *given, "--robot", "arm.urdf", "--out", out)[0] == 0
    text = out.read_text()
    assert 'urdf = "arm.urdf"' in text and "\nname = " not in text
    for key, value in {"acceleration_rad_s2": 10.0, "jerk_rad_s3": 400.0, "latency_s": 0.03}.items():
        assert text.count(f"\n{key} = ____") == 1
        text = text.replace(f"{key} = ____", f"{key} = {value}")
    assert "velocity_rad_s = ____" not in text, "the URDF states it"
    out.write_text(text.replace('tool = "____"', "bare_flange = true"))
    status, printed, _err = shell("verify", recording, "--cell", out, "--assume-nobody")
    assert status == 3 and "waived: nobody is there" in printed


def test_a_limit_that_is_missing_is_asked_for_so_that_it_fits_into_the_table_that_is_there(
    shell: Shell, tmp_path: Path
) -> None:
    """What is named goes into ``[robot.limits.j1]``: a second one would be no TOML."""
    recording, cell = imported(shell, tmp_path), tmp_path / "cell.toml"
    arm = f'[robot]\nurdf = "{tmp_path / "arm.urdf"}"\nbare_flange = true\n'
    cell.write_text(f"{arm}[robot.limits.j1]\nacceleration_rad_s2 = 10.0\n")
    judge = ("verify", recording, "--cell", cell, "--assume-nobody")
    text = refused(shell(*judge))
    assert "cell.toml: robot.limits: limits of " in text and "`stopproof init --robot FILE`" in text
    asked = text.split("none is assumed: ")[1].split(". Add")[0]
    assert asked == "robot.limits.j1.jerk_rad_s3 = ____"
    key = asked.removeprefix("robot.limits.j1.").replace("____", "400.0")
    cell.write_text(f"{cell.read_text()}{key}\n")
    assert shell(*judge)[0] == 3
    cell.write_text(arm)
    line = refused(shell(*judge)).split("under [robot]: ")[1]
    cell.write_text(arm + line.replace('"?"', "50.0"))
    assert shell(*judge)[0] == 3


@pytest.mark.parametrize(("name", "contains"), [("panda", True), ("fr3", False), ("ur5", False)])
def test_init_says_what_the_model_has_beyond_its_flange(shell: Shell, name: str, contains: bool) -> None:
    said = "# the model contains the Franka hand; bare_flange = true says that nothing hangs beyond it"
    assert (said in shell("init", "--robot", name)[1].splitlines()) == contains


def test_the_capsules_of_an_arm_are_shown_before_its_limits_are_known(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(rail())
    status, out, _err = shell("robots", tmp_path / "arm.urdf")
    assert status == 0 and "  j1: not stated: acceleration_rad_s2, jerk_rad_s3" in out.splitlines()
    (line,) = (line for line in out.splitlines() if line.startswith("  l1 on j1: length "))
    radius = float(line.split("radius ")[1].split(" m")[0])
    assert 0.05 * 2**0.5 <= radius < 0.2, "a box of 0.1 m, 0.1 m, 0.3 m is in it"
    assert "without a value" in refused(shell("robots", tmp_path / "arm.urdf", "--json", "-"))


def test_init_names_what_is_wrong_with_robot(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text("<robot")
    assert "neither a file nor in the catalogue; known: fr3" in refused(shell("init", "--robot", "ur6"))
    assert "a.urdf: not XML" in refused(shell("init", "--robot", tmp_path / "a.urdf"))
    assert "give a RECORDING or --robot NAME|URDF" in refused(shell("init"))
    recording = imported(shell, tmp_path)
    both = ("init", recording, "--robot", tmp_path / "arm.urdf", "--urdf", tmp_path / "new.urdf")
    assert "give one of them" in refused(shell(*both))


def test_meshes_of_a_urdf_and_of_a_tool_are_among_the_inputs(tmp_path: Path) -> None:
    """Whoever exchanges one finds another hash; the name of the arm is that of its XML alone."""
    mesh = '<mesh filename="link.stl"/>'
    (tmp_path / "arm.urdf").write_text(rail("rail", shape(mesh) + shape(mesh)))
    (tmp_path / "tool.toml").write_text('name = "hook"\n[[mesh]]\nfile = "hook.stl"\n')
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nurdf = "arm.urdf"\ntool = "tool.toml"\n')
    found = []
    for size in (0.1, 0.2):
        for name in ("link", "hook"):
            write_stl(tmp_path / f"{name}.stl", size * two_cubes())
        found.append({item.what: item.sha256 for item in input_files(None, Cell.from_toml(cell))})
    assert list(found[0]) == ["cell", "tool file", "URDF", "mesh link.stl of l1", "mesh hook.stl of the tool"]
    assert [found[0][what] == found[1][what] for what in found[0]] == [True, True, True, False, False]


def test_geometry_in_mm_is_pointed_out_by_import_init_and_verify(shell: Shell, tmp_path: Path) -> None:
    """A link of 80 mm, written as 80: enclosures of arms are below 5 m."""
    urdf, table, cell = tmp_path / "arm.urdf", tmp_path / "joints.csv", rail_cell(tmp_path)
    table.write_text("t,j1\n" + "".join(f"{k / 100},{k / 1000}\n" for k in range(101)))
    (tmp_path / "tool.toml").write_text('name = "hook"\nframe = "l1"\n[[mesh]]\nfile = "hook.stl"\n')
    cell.write_text(cell.read_text().replace("bare_flange = true", f'urdf = "{urdf}"\ntool = "tool.toml"'))
    recording, out = tmp_path / "o.mcap", tmp_path / "new.toml"
    for unit, said in ((1.0, False), (1000.0, True)):
        for name in ("link", "hook"):
            write_stl(tmp_path / f"{name}.stl", 0.04 * unit * two_cubes())
        urdf.write_text(rail("rail", shape('<mesh filename="link.stl"/>')))
        asked = 'm long: are its meshes in mm? then write <mesh scale="0.001 0.001 0.001"/>'
        printed = [
            shell("import", recording, "--robot", urdf, "--joints", table, "--force")[1],
            shell("init", "--robot", urdf)[1],
            shell("init", "--robot", urdf, "--out", out, "--force")[1],
            shell("verify", recording, "--cell", cell, "--assume-nobody")[1],
        ]
        assert [asked in text for text in printed] == 4 * [said]
        assert ["look at: l1: its enclosure is" in text for text in printed] == 3 * [said] + [False]
        assert ("note: l1: its enclosure is" in printed[3]) == said
        assert ("note: tool:hook: its enclosure is" in printed[3]) == said
        assert ("a tool file has no scale" in printed[3]) == said
        assert tomllib.loads(shell("init", "--robot", urdf)[1].replace("____", "0"))["robot"]["urdf"] == str(
            urdf
        )


def test_a_urdf_that_verify_would_refuse_is_pointed_out_by_import_and_init(
    shell: Shell, tmp_path: Path
) -> None:
    (tmp_path / "link.stl").write_text("solid link\nnothing\n")
    (tmp_path / "arm.urdf").write_text(rail("rail", shape('<mesh filename="link.stl"/>')))
    (tmp_path / "j.csv").write_text("t,j1\n" + "".join(f"{k / 100},{k / 1000}\n" for k in range(101)))
    urdf = ("--robot", tmp_path / "arm.urdf")
    for arguments in (("import", tmp_path / "o.mcap", "--joints", tmp_path / "j.csv"), ("init",)):
        status, out, _err = shell(*arguments, *urdf)
        assert status == 0 and "look at: verify would refuse this URDF: " in out and "link.stl" in out


def test_meshes_of_packages_are_looked_for_where_import_and_init_are_told(
    shell: Shell, tmp_path: Path
) -> None:
    (tmp_path / "elsewhere" / "maker").mkdir(parents=True)
    write_stl(tmp_path / "elsewhere" / "maker" / "link.stl", 40.0 * two_cubes())
    (tmp_path / "arm").mkdir()
    urdf, cell, recording = tmp_path / "arm" / "arm.urdf", tmp_path / "cell.toml", tmp_path / "o.mcap"
    urdf.write_text(rail("rail", shape('<mesh filename="package://maker/link.stl"/>')))
    (tmp_path / "j.csv").write_text("t,j1\n" + "".join(f"{k / 100},{k / 1000}\n" for k in range(101)))
    make = ("import", recording, "--robot", urdf, "--joints", tmp_path / "j.csv", "--force")
    text = refused(shell(*make))
    assert "put the folder 'maker' beside the URDF" in text and "--package-dir" in text
    assert "put the folder 'maker' beside the URDF" in shell("init", "--robot", urdf)[1]
    folder = ("--package-dir", tmp_path, "--package-dir", tmp_path / "elsewhere")
    assert "look at: l1: its enclosure is" in shell(*make, *folder)[1]
    _status, text, _err = shell("init", "--robot", urdf, *folder)
    assert "look at: l1: its enclosure is" in text
    assert f'\npackage_dirs = ["{tmp_path}", "{tmp_path}/elsewhere"]\n' in text
    text = text.replace('tool = "____"', "bare_flange = true").replace(
        "jerk_rad_s3 = ____", "jerk_rad_s3 = 9"
    )
    cell.write_text(text.replace("____", "1.0"))
    assert "verified in the model" in shell("verify", recording, "--cell", cell, "--assume-nobody")[1]


def test_declared_capsules_that_are_too_long_are_not_taken_for_meshes() -> None:
    (line,) = too_long([PartSize("l1", 6.0, False), PartSize("l2", 5.5, False), PartSize("l3", 4.9, False)])
    assert line == (
        "l1: its enclosure is 6 m long (above 5 m as well: l2): are its numbers in mm? they are read as m"
    )
