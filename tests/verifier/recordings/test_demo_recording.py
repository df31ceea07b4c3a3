"""The bundled recording: synthetic, reproducible, and with everything that the demonstration shows."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Point
from verifier.recordings import Reading, Recording, new_recording

ROOT = Path(__file__).parents[3]
SCRIPT = ROOT / "examples/make_demo_recording.py"
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)


@pytest.fixture(scope="module")
def window():
    reading = Reading(Recording(ROOT / "data/demo.mcap"), JOINTS)
    assert reading.extra_joints == ("gripper_finger_joint",)
    (window,) = reading.windows(1000.0, 0.0, 0.0)
    return window


def write(out: Path, seed: int) -> bytes:
    spec = importlib.util.spec_from_file_location("make_demo_recording", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    with new_recording(out) as writer:
        script.write(writer, seed)
    return out.read_bytes()


def test_command_line(tmp_path):
    out = tmp_path / "demo.mcap"
    command = [sys.executable, str(SCRIPT), "--out", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, check=True, env=environment, capture_output=True, text=True)
    assert "synthetic, seed 0" in run.stdout
    assert out.read_bytes() == write(tmp_path / "again.mcap", 0)


def test_is_small_and_says_that_it_is_synthetic():
    path = ROOT / "data/demo.mcap"
    assert path.stat().st_size < 1_000_000
    assert "synthetic" in Recording(path).metadata["note"]
    assert Recording(path).robot == "ur5"


def test_same_seed_same_bytes_and_same_content_as_the_bundled_file(tmp_path, window):
    assert write(tmp_path / "one.mcap", 0) == write(tmp_path / "two.mcap", 0)
    assert write(tmp_path / "three.mcap", 1) != write(tmp_path / "four.mcap", 0)
    (again,) = Reading(Recording(tmp_path / "one.mcap"), JOINTS).windows(1000.0, 0.0, 0.0)
    np.testing.assert_array_equal(again.t, window.t)
    np.testing.assert_allclose(again.q, window.q, atol=1e-6)
    for one, two in zip(again.people, window.people, strict=True):
        np.testing.assert_allclose(one.people[0].xyz, two.people[0].xyz, atol=2e-4)


def test_arm_moves_at_one_radian_per_second(window):
    speed = np.abs(np.diff(window.q, axis=0)).max() * 125
    assert 0.9 < speed < 1.01
    np.testing.assert_allclose(np.diff(window.t), 1 / 125)


def test_worker_comes_near_leaves_and_waves(window):
    stamps = np.array([report.stamp for report in window.people])
    xyz = np.array([report.people[0].xyz for report in window.people])
    assert stamps[0] == pytest.approx(0.4)
    distance = np.linalg.norm(xyz[:, :, :2], axis=2).min(axis=1)
    assert distance[0] > 4.0
    assert distance.min() < 0.9
    assert distance[stamps > 14.0].min() > 3.5
    speed = np.linalg.norm(np.diff(xyz, axis=0), axis=2) * 60
    hand = speed[:, Point.R_HAND]
    assert np.count_nonzero(hand > 3.0) / 60 > 0.15
    waving = (stamps[:-1] > 15.4) & (stamps[:-1] < 16.4)
    noise = 2 * np.sqrt(3) * 0.004 * 60  # both ends of an interval at the limit of the noise
    assert speed[~waving].max() < 1.8 + noise
