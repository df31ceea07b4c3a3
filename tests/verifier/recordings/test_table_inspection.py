"""`inspect` and `init` on tables of joint motion."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner

from tests.verifier.recordings.robot_sources.test_robot_logs import libfranka, rtde, write
from verifier.cell_template import BLANK
from verifier.commands import cli
from verifier.recordings import RecordingError, inspect_recording
from verifier.recordings.inspection import catalogue

SCHEMA = json.loads(
    Path(__file__).resolve().parents[3].joinpath("docs/inspect.schema.json").read_text("utf-8")
)


def run(*arguments):
    result = CliRunner().invoke(cli, [str(each) for each in arguments], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return result.output


def test_a_ur_log(tmp_path, rng):
    names, lines, _t, (q, _dq, target, _speed) = rtde(rng)
    path = write(tmp_path / "a.csv.gz", names, lines)
    found = json.loads(run("inspect", path, "--json", "-"))
    jsonschema.validate(found, SCHEMA)
    (table,) = found["topics"]
    assert (table["schema"], table["messages"]) == ("log of a UR controller", 40)
    assert table["rate_hz"] == pytest.approx(125.0)
    assert found["joints"] == [] and set(found["robot_candidates"]) == {"lwa4p", "kr5_sixx", "ra605"} | {
        name for name in catalogue() if name.startswith("ur")
    }
    known = np.abs(q - target).max(axis=0)
    assert [each["error_without_delay"] for each in found["tracking"]["joints"]] == pytest.approx(list(known))
    text = run("inspect", path)
    assert "payload that the controller was told: 1.25 kg" in text
    assert "tracking error, measured from commands" in text


def test_a_libfranka_log_and_the_cell_for_it(tmp_path, rng):
    text, _t, groups = libfranka(rng, rows=60)
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert inspect_recording(path).robot_candidates == ("fr3", "panda")
    cell = run("init", path)
    assert f'name = "{BLANK}"' in cell, "seven joints without names: of either arm of this maker"
    largest = float(np.abs(groups["state.q"] - groups["state.q_d"]).max())
    (line,) = [line for line in cell.splitlines() if line.startswith("position_error_rad")]
    assert largest <= float(line.split("=")[1].split("#")[0]) <= 1.01 * largest
    assert '|measured - commanded| of "a.csv"' in line


def test_columns_of_our_own_and_npz(tmp_path):
    t = np.arange(0.0, 1.0, 0.01)
    rows = ["t,a,b", *(f"{each!r},{each!r},1" for each in t.tolist())]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    np.savez(tmp_path / "a.npz", t=t, q=np.column_stack([t, t]), joints=np.array(["a", "b"]))
    for name in ("a.csv", "a.npz"):
        found = inspect_recording(tmp_path / name)
        assert (found.joints, found.tracking) == (("a", "b"), None)
        assert found.duration_s == pytest.approx(0.99)


def test_people_are_no_joints(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,person,head_x,head_y,head_z\n0,a,1,2,3\n0.1,a,1,2,3\n")
    with pytest.raises(RecordingError, match="holds points of people, and no joints"):
        inspect_recording(path)


def test_init_says_what_it_lacks(tmp_path, rng):
    names, lines, _t, _tables = rtde(rng)
    path = write(tmp_path / "a.csv", names, lines)
    limits = tmp_path / "joint_limits.yaml"
    limits.write_text("joint_limits:\n  elbow_joint: {has_velocity_limits: true, max_velocity: 3.0}\n")
    with pytest.raises(Exception, match="nobody says of which arm"):
        run("init", path, "--joint-limits", limits)
    with pytest.raises(Exception, match="has no message on /robot_description"):
        run("init", path, "--urdf", tmp_path / "a.urdf")
    out = tmp_path / "cell.toml"
    run("init", "--robot", "ur5", "--joint-limits", limits, "--out", out)
    assert 'velocity_rad_s = 3.0  # declared in "joint_limits.yaml"' in out.read_text()
