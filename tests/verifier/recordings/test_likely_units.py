"""What an import points out about units: nothing is refused for it, and nothing ordinary is pointed out."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import POINT_NAMES
from occupancy.report import GateSettings
from tests.conftest import Some
from tests.occupancy.people import standing
from tests.verifier.recordings.samples import write_all
from tests.verifier.shell import Shell
from verifier.recordings import ImportSettings, ImportSummary, PeopleFile, import_recording, inspect_recording
from verifier.recordings.import_summary import NOT_COMPLETE
from verifier.recordings.joint_state import JointState
from verifier.recordings.likely_units import FAR_M

ROBOT = ("j1", "j2")


def motion(path: Path, unit: float, rate: float = 800.0, samples: int = 900) -> Path:
    """An arm that swings at 1 rad/s; ``unit``: times of the file in a second."""
    t = np.arange(samples) / rate
    q = np.sin(t[:, None] + [0.0, 1.0])
    np.savez(path, t=unit * t + 0.5, q=q, joints=np.array(ROBOT))
    return path


def people(path: Path, unit: float, *, times: float = 1.0, rate: float = 120.0, samples: int = 300) -> Path:
    """Somebody who walks at 1.2 m/s; ``unit``: coordinates of the file in a metre."""
    t = np.arange(samples) / rate
    xyz = np.repeat(standing()[None], samples, axis=0)
    xyz[:, :, 0] += 1.2 * t[:, None] + 3.0
    xyz[5] = np.nan
    np.savez(path, t=times * t, joints=np.array(POINT_NAMES), xyz=unit * xyz)
    return path


def imported(folder: Path, joints: Path, *files: Path) -> ImportSummary:
    return import_recording(
        folder / "out.mcap",
        joints,
        [PeopleFile(file) for file in files],
        ImportSettings("arm", ROBOT),
        force=True,
    )


@pytest.mark.parametrize("rate", [800.0, 1500.0])
def test_joint_times_in_milliseconds_are_pointed_out(tmp_path: Path, rate: float) -> None:
    (remark,) = imported(tmp_path, motion(tmp_path / "ms.npz", 1000.0, rate)).remarks
    assert remark.startswith("ms.npz: samples are mostly ") and "are its times in ms?" in remark
    assert f"{1000.0 / rate:.4g} s apart" in remark


@pytest.mark.parametrize("rate", [1.0, 1.9, 8.0, 125.0, 1000.0])
def test_an_arm_that_moves_between_samples_is_not(tmp_path: Path, rate: float) -> None:
    assert imported(tmp_path, motion(tmp_path / "s.npz", 1.0, rate, samples=60)).remarks == ()


def test_times_of_people_in_milliseconds_are_pointed_out(tmp_path: Path) -> None:
    joints = motion(tmp_path / "s.npz", 1.0, 125.0)
    (remark,) = imported(tmp_path, joints, people(tmp_path / "p.npz", 1.0, times=1000.0)).remarks
    assert remark.startswith("p.npz: samples are mostly 8.333 s apart")


@pytest.mark.parametrize(("unit", "name"), [(1000.0, "mm"), (100.0, "cm"), (39.37, "inches")])
def test_lengths_in_another_unit_are_pointed_out(tmp_path: Path, unit: float, name: str) -> None:
    joints = motion(tmp_path / "s.npz", 1.0, 125.0)
    (remark,) = imported(tmp_path, joints, people(tmp_path / "p.npz", unit)).remarks
    assert f"are its coordinates in {name}?" in remark and remark.startswith("p.npz: limbs are ")
    said = float(remark.split("limbs are about ")[1].split(" times")[0])
    assert 0.5 * unit < said < 2.0 * unit and "e+" not in remark


def test_lengths_that_are_far_too_small_are_pointed_out(tmp_path: Path) -> None:
    joints = motion(tmp_path / "s.npz", 1.0, 125.0)
    (remark,) = imported(tmp_path, joints, people(tmp_path / "p.npz", 0.01)).remarks
    assert "what unit are its coordinates in?" in remark


@pytest.mark.parametrize("size", [0.6, 1.0, 1.2])
def test_people_of_any_size_are_not(tmp_path: Path, size: float) -> None:
    joints = motion(tmp_path / "s.npz", 1.0, 125.0)
    assert imported(tmp_path, joints, people(tmp_path / "p.npz", size)).remarks == ()


@pytest.mark.parametrize("kind", ["npz", "mcap"])
@pytest.mark.parametrize(("largest", "said"), [(85.94, True), (20.1, True), (19.9, False), (12.6, False)])
def test_joints_in_degrees_are_pointed_out(tmp_path: Path, kind: str, largest: float, said: bool) -> None:
    """Once, far into the file, by the joint that goes furthest; joints of others may be anything."""
    source = motion(tmp_path / "q.npz", 1.0, 125.0, samples=2400)
    with np.load(source) as data:
        t, q = data["t"], np.column_stack([data["q"], np.full(2400, 300.0)])
    q[2300, 1] = -largest
    np.savez(source, t=t, q=q, joints=np.array([*ROBOT, "gripper"]))
    if kind == "mcap":
        imported(tmp_path, source)
        source = (tmp_path / "out.mcap").rename(tmp_path / "q.mcap")
    remarks = imported(tmp_path, source).remarks
    expected = f"q.{kind}: j2 goes up to {largest:.4g}: are its positions in degrees? they are read as rad"
    assert [remark.startswith(expected) for remark in remarks] == [True] * said


def test_times_of_an_mcap_in_milliseconds_are_pointed_out(tmp_path: Path) -> None:
    imported(tmp_path, motion(tmp_path / "ms.npz", 1000.0))
    source = (tmp_path / "out.mcap").rename(tmp_path / "q.mcap")
    (remark,) = imported(tmp_path, source).remarks
    assert remark.startswith("q.mcap: samples are mostly 1.25 s apart")


def test_points_are_far_where_the_gate_takes_them_to_be() -> None:
    (default,) = (field.default for field in fields(GateSettings) if field.name == "range_m")
    assert default == FAR_M


@pytest.mark.parametrize(
    ("height", "said"), [(1.6, None), (99.0, None), (101.0, "101"), (160.0, "160"), (1600.0, "1600")]
)
def test_points_without_any_limb_are_pointed_out_where_they_are_far(
    tmp_path: Path, height: float, said: str | None
) -> None:
    """A head alone; now and then it is missing, or stands at zero."""
    xyz = np.repeat([[[0.3, 0.2, height]]], 300, axis=0)
    xyz[::3], xyz[1::3] = np.nan, 0.0
    np.savez(tmp_path / "p.npz", t=np.arange(300) / 120, joints=np.array(["head"]), xyz=xyz)
    remarks = imported(tmp_path, motion(tmp_path / "s.npz", 1.0, 125.0), tmp_path / "p.npz").remarks
    if said is None:
        assert remarks == ()
        return
    (remark,) = remarks
    assert remark.startswith(f"p.npz: points are mostly {said} m from the origin, farther than 100 m: what ")


def test_inspect_points_out_the_same(tmp_path: Path) -> None:
    source = motion(tmp_path / "q.npz", 1000.0)
    with np.load(source) as data:
        np.savez(source, t=data["t"], q=30.0 * data["q"], joints=data["joints"])
    remarks = imported(tmp_path, source, people(tmp_path / "p.npz", 1000.0, times=300.0)).remarks
    assert [remark.split(": ")[0] for remark in remarks] == ["q.npz", "q.npz", "p.npz", "p.npz"]
    found = inspect_recording(tmp_path / "out.mcap").remarks
    for remark in remarks:
        file, _, text = remark.partition(": ")
        assert f"{'/joint_states' if file == 'q.npz' else '/people'}: {text}" in found


def test_inspect_looks_at_joints_without_names_too(tmp_path: Path) -> None:
    states = [JointState(n * 10_000_000, (), np.array([0.1, 90.0 + n])) for n in range(1, 9)]
    found = inspect_recording(write_all(tmp_path / "a.mcap", states)).remarks
    assert any(
        remark.startswith("/joint_states: joint 2 goes up to 98: are its positions in deg")
        for remark in found
    )


@pytest.mark.real_data
def test_no_recorded_person_is(tmp_path: Path, real_data: Path, some: Some) -> None:
    joints = motion(tmp_path / "s.npz", 1.0, 125.0, samples=3000)
    clips = sorted(real_data.glob("human/*.npz"))
    assert len(clips) > 5
    for clip in some(clips, 4):
        assert imported(tmp_path, joints, clip).remarks == (), clip


def test_the_command_says_so_and_what_follows_from_reports_that_are_not_complete(
    shell: Shell, tmp_path: Path
) -> None:
    joints = motion(tmp_path / "q.npz", 1000.0)
    with np.load(joints) as data:
        np.savez(joints, t=data["t"], q=np.repeat(data["q"], 3, axis=1))
    source = people(tmp_path / "p.npz", 1000.0, times=300.0)
    arguments = ("import", tmp_path / "o.mcap", "--robot", "ur5", "--joints", joints)
    status, out, _err = shell(*arguments, "--people", source)
    assert status == 0
    assert out.splitlines()[-1] == f"note: {NOT_COMPLETE}"
    assert [line[:16] for line in out.splitlines() if line.startswith("look at: ")] == [
        "look at: q.npz: ",
        "look at: p.npz: ",
        "look at: p.npz: ",
    ]
    status, out, _err = shell(*arguments, "--force")
    assert status == 0 and "complete" not in out
