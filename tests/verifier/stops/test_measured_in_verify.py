"""A stop model in a cell: what verify makes of it, what it lists, and who refuses it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from failsafe.braking import Braking
from robots.errors import SetupError
from tests.docs.test_schemas import faults
from tests.verifier.scenes import Scene, far
from tests.verifier.stops.made_up import random_stops, sampled, write_csv
from tests.verifier.stops.test_stops_command import HOME, UR5, columns, run
from verifier.cell import Cell, CellError
from verifier.replay import verify
from verifier.setup import build_robot, build_supervised
from verifier.stop_model import braking_of
from verifier.verdict import Reason, Status

JOINTS = ", ".join(f'"{name}"' for name in UR5)


def model_file(folder: Path, fastest: float = 3.0, robot: str = "ur5", delay: float = 0.1) -> Path:
    path = folder / "stops.toml"
    path.write_text(
        f'robot = "{robot}"\njoints = [{JOINTS}]\ndelay_s = {delay}\nbraking_time_s = 0.2\n'
        f"deceleration_rad_s2 = {[5.0] * 6}\nfastest_rad_s = {[fastest] * 6}\nmargin = 0.1\n"
        'source = "worst of 9 stops in r.csv (stop)"\n',
        encoding="utf-8",
    )
    return path


def cell_of(folder: Path, more: str = "") -> Cell:
    path = folder / "cell.toml"
    path.write_text(
        '[robot]\nname = "ur5"\nbare_flange = true\naccept_assumed = ["limits"]\n[stop]\nmodel = "measured"\n'
        f'measured = "stops.toml"\n{more}',
        encoding="utf-8",
    )
    return Cell.from_toml(path)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return Scene(duration=2.0, people={"p1": far}).write(tmp_path / "r.mcap")


def test_every_plan_ends_with_the_measured_stop(tmp_path: Path, recording: Path):
    model_file(tmp_path)
    cell = cell_of(tmp_path)
    report = verify(recording, cell)
    assert not faults("verify", report.to_dict())
    assert report.stop_model == "measured" and report.count(Status.VERIFIED) > 100
    braking = braking_of(tmp_path / "stops.toml", build_robot(cell))[1]
    times = report.per_cycle.stop_time_s
    times = times[np.isfinite(times)]
    assert times.min() >= braking.delay_s + braking.braking_time_s - 1e-6
    assert times.max() <= braking.time(braking.fastest).max()
    assert report.lines()[0].startswith("stop: measured (the robot's own, fitted on recordings)")
    listed = {item.name: item for item in report.assumptions if item.name.startswith("stop.")}
    assert listed["stop.delay"].value == 0.1 and listed["stop.delay"].certainty == "measured"
    assert listed["stop.deceleration.elbow_joint"].unit == "rad/s²"
    assert "worst of 9 stops" in listed["stop.braking_time"].source


def test_a_longer_stop_never_verifies_more(tmp_path: Path):
    recording = Scene(duration=2.0).write(tmp_path / "r.mcap")
    verified = []
    for delay in (0.02, 0.3):
        model_file(tmp_path, delay=delay)
        report = verify(recording, cell_of(tmp_path))
        verified.append((report.count(Status.VERIFIED), report.cell_hash))
    assert verified[0][0] >= verified[1][0]
    assert verified[0][1] != verified[1][1], "the content of the model is part of the cell"


def test_faster_than_what_was_measured_is_not_verified(tmp_path: Path, recording: Path):
    model_file(tmp_path, fastest=0.01)
    report = verify(recording, cell_of(tmp_path))
    assert report.count(Status.VERIFIED) == 0
    assert dict(report.reasons(Status.NOT_VERIFIED)).get(Reason.NO_STOP_WITHIN_LIMITS, 0) > 50
    (line,) = (line for line in report.lines() if line.startswith("first limit in the way"))
    assert line.endswith("limit 0.01 rad/s (of the joint, or the fastest from which a stop was measured)")


def test_who_refuses_it(tmp_path: Path, recording: Path):
    model_file(tmp_path)
    with pytest.raises(SetupError, match="a supervisor drives its own"):
        build_supervised(cell_of(tmp_path, "[robot.tracking]\nposition_error_rad = 0.01\n"))
    with pytest.raises(CellError, match=r"leave robot\.silence away"):
        cell_of(tmp_path, "[robot.silence]\nhold_s = 0.01\ndeceleration_rad_s2 = 5.0\n")
    with pytest.raises(CellError, match="delay_max_s must be 0"):
        cell_of(tmp_path, "[robot.tracking]\ndelay_max_s = 0.01\n")
    with pytest.raises(CellError, match="needs measured"):
        Cell.from_table({"stop": {"model": "measured"}})
    unused = Cell.from_table({"stop": {"measured": "none.toml"}})
    assert unused.stop.measured_file is None
    assert unused.with_options(stop_model="measured").stop.measured_file == "none.toml"
    model_file(tmp_path, robot="ur10")
    with pytest.raises(SetupError, match="is of ur10, and the robot is ur5"):
        verify(recording, cell_of(tmp_path))
    model_file(tmp_path)
    text = (tmp_path / "stops.toml").read_text(encoding="utf-8")
    (tmp_path / "stops.toml").write_text(text.replace("elbow_joint", "knee_joint"), encoding="utf-8")
    with pytest.raises(SetupError, match=r"is of joints .*knee_joint"):
        verify(recording, cell_of(tmp_path))
    (tmp_path / "stops.toml").unlink()
    with pytest.raises(SetupError, match=r"stops\.toml"):
        verify(recording, cell_of(tmp_path))


def test_numbers_come_in_the_order_of_the_arm(tmp_path: Path):
    path = model_file(tmp_path)
    text = path.read_text(encoding="utf-8").replace(JOINTS, ", ".join(reversed(JOINTS.split(", "))))
    path.write_text(text.replace(str([5.0] * 6), "[6.0, 5.0, 4.0, 3.0, 2.0, 1.0]"), encoding="utf-8")
    braking = braking_of(path, build_robot(cell_of(tmp_path)))[1]
    assert isinstance(braking, Braking) and braking.deceleration.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


def test_what_stops_writes_verify_reads(tmp_path: Path, recording: Path, rng):
    motion = sampled(rng, random_stops(rng, 6, 3), 0.008, HOME)
    table = write_csv(tmp_path / "r.csv", columns(motion, stop=motion.flag(motion.t).astype(int)))
    run(table, "--robot", "ur5", "--model", tmp_path / "stops.toml", "--margin", 0.5)
    report = verify(recording, cell_of(tmp_path))
    assert report.cycles > 0 and any("r.csv" in item.source for item in report.assumptions)
