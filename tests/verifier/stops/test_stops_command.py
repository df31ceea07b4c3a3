"""``stopproof stops``: what it finds in files of each kind, what it prints, what it refuses in one line."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner

from robots.catalog import RobotSetup, load_robot
from robots.errors import SetupError
from tests.verifier.stops.made_up import (
    KnownStop,
    Motion,
    byte,
    double,
    random_stops,
    sampled,
    write_csv,
    write_mcap,
)
from verifier.commands import cli
from verifier.recordings.motion_source import open_motion
from verifier.reports.stops import MEASURED_DISCLAIMER
from verifier.stops.measuring import ToolPoints

ROOT = Path(__file__).resolve().parents[3]
UR5 = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
HOME = np.array([0.0, -1.2, 1.5, -0.3, 1.5, 0.0])
BOOL, FLOAT, MODE = "std_msgs/msg/Bool", "std_msgs/msg/Float64", "ur_dashboard_msgs/msg/SafetyMode"


def run(*arguments: object) -> str:
    result = CliRunner().invoke(cli, ["stops", *map(str, arguments)], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    assert result.return_value == 0
    return result.stdout


def found(*arguments: object) -> dict:
    printed = json.loads(run(*arguments, "--json", "-"))
    text = (ROOT / "docs/stops.schema.json").read_text(encoding="utf-8")
    faults = list(jsonschema.Draft202012Validator(json.loads(text)).iter_errors(printed))
    assert not faults, faults[0].message
    return printed


def refused(*arguments: object) -> str:
    with pytest.raises(SetupError) as refusal:
        run(*arguments)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


@pytest.fixture
def motion(rng) -> Motion:
    stops = [
        KnownStop(1.0, 0.05, np.array([1.0, 0.5, 0.0, 0.0, -1.5, 0.0]), np.full(6, 5.0)),
        KnownStop(3.0, 0.10, np.array([-0.8, 0.0, 0.4, 0.0, 0.0, 2.0]), np.full(6, 8.0), begin=2.0),
    ]
    return Motion(stops, np.arange(0.0, 4.0, 0.008), HOME)


def columns(motion: Motion, **beside) -> dict:
    return {"t": motion.t, **{name: motion.q[:, j] for j, name in enumerate(UR5)}, **beside}


@pytest.fixture
def table(tmp_path: Path, motion: Motion) -> Path:
    return write_csv(tmp_path / "r.csv", columns(motion, stop=motion.flag(motion.t).astype(int)))


def check(printed: dict, motion: Motion, cause: str = "stop", step: float = 0.008) -> None:
    (recording,) = printed["recordings"]
    assert len(recording["stops"]) == len(motion.stops)
    for known, stop in zip(motion.stops, recording["stops"], strict=True):
        assert stop["causes"][0] == cause
        assert stop["asked_s"][0] - 1e-9 <= known.asked <= stop["asked_s"][1] + 1e-9
        true = known.rest - known.asked
        assert stop["time_s"][0] - 1e-9 <= true <= stop["time_s"][1] + 0.012
        assert stop["time_s"][1] - stop["time_s"][0] <= 2.0 * step + 1e-9
        for angle, exact in zip(stop["angle_rad"], known.angle, strict=True):
            assert angle[0] - 1e-9 <= exact <= angle[1] + 6e-4


def test_a_table_of_our_own(table: Path, motion: Motion):
    printed = found(table)
    assert printed["robot"] is None
    check(printed, motion)
    assert all(stop["way_m"] is None for stop in printed["recordings"][0]["stops"])
    lines = run(table).splitlines()
    assert lines[0].startswith("stop: the robot's own, as recorded · 2 stops in 1 recording · robot: unknown")
    assert lines[-1] == MEASURED_DISCLAIMER


def test_the_way_of_the_tool_is_that_of_its_farthest_point(table: Path, motion: Motion):
    """Against the chain of the model, finely sampled."""
    printed = found(table, "--robot", "ur5")
    assert printed["robot"] == "ur5"
    points = ToolPoints(load_robot("ur5", setup=RobotSetup(bare_flange=True)))
    for known, stop in zip(motion.stops, printed["recordings"][0]["stops"], strict=True):
        t = np.linspace(known.asked, known.rest, 2000)
        q = HOME + sum(each.moved(t) for each in motion.stops)
        way = np.linalg.norm(np.diff(points.along(q), axis=0), axis=2).sum(axis=0).max()
        assert stop["way_m"][0] - 1e-6 <= way <= stop["way_m"][1] + 1e-3
    assert "tool 0." in run(table, "--robot", "ur5")


def test_a_log_of_a_ur_controller(tmp_path: Path, motion: Motion):
    mode = np.where(motion.flag(motion.t), 3, 1)
    log = {"timestamp": 1000.0 + motion.t}
    for j in range(6):
        log |= {f"actual_q_{j}": motion.q[:, j], f"actual_qd_{j}": motion.dq[:, j]}
        log |= {f"target_q_{j}": motion.q[:, j] + 1e-3 * (j == 1)}
    path = write_csv(tmp_path / "rtde.csv", log | {"safety_mode": mode, "speed_scaling": np.ones(len(mode))})
    printed = found(path, "--robot", "ur5")
    check(printed, motion, "protective stop")
    (recording,) = printed["recordings"]
    assert recording["has"] == ["positions", "velocities", "commanded positions"]
    assert recording["told_by"] == ["safety_mode", "speed_scaling", "the command"]
    for stop in recording["stops"]:  # off by 1 mrad across, less along the way of that joint
        assert 0.0 < stop["off_path_rad"] <= 1e-3 + 1e-9
        assert 0.0 < stop["off_path_m"] <= 1e-3 + 1e-6
    spaced = path.read_text(encoding="utf-8").replace(",", " ")
    (tmp_path / "spaced.csv").write_text(spaced, encoding="utf-8")
    assert found(tmp_path / "spaced.csv")["recordings"][0]["stops"][0]["causes"] == ["protective stop"]


def test_speeds_without_positions(tmp_path: Path):
    """A second apart: hardly anything can be said, and no more is."""
    when = [f"2022-10-26T08:17:{second:02d}.500Z" for second in range(10, 22)]
    speed = [0.0, 0.5, 1.0, 1.0, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    flag = ["False"] * 4 + ["True", "True", "", "False", "False", "True", "True", "False"]
    log = {"Timestamp": when, "Speed_J0": speed, "Speed_J1": [0.0] * 12, "Robot_ProtectiveStop": flag}
    printed = found(write_csv(tmp_path / "slow.csv", log))
    (recording,) = printed["recordings"]
    first, second = recording["stops"]
    assert first["time_s"] == [0.0, 2.0] and second["time_s"] == [0.0, 1.0]
    assert first["angle_rad"] is None and first["speed_rad_s"] == [1.0, 0.0]
    assert any("1 rows left out" in note for note in recording["notes"])
    assert "no positions, so no angles" in run(tmp_path / "slow.csv")


def test_an_archive(tmp_path: Path, motion: Motion):
    path = tmp_path / "r.npz"
    given = {"t": motion.t, "q": motion.q, "joints": np.array(UR5), "stop": motion.flag(motion.t)}
    np.savez(path, **given)
    check(found(path), motion)
    mode = np.where(given.pop("stop"), 5, 2)
    np.savez(path, **given, dq=motion.dq, safety_mode=mode, q_command=motion.q)
    printed = found(path, "--robot", "ur5")
    check(printed, motion, "safeguard stop")
    assert printed["recordings"][0]["stops"][0]["off_path_rad"] == pytest.approx(0.0, abs=1e-9)
    np.savez(path, **given, safety_mode=mode, run=np.repeat([3, 4], len(mode) // 2))
    assert "choose one with --run N" in refused(path)
    assert len(found(path, "--run", 4)["recordings"][0]["stops"]) == 1
    np.savez(path, **{**given, "dq": np.full_like(motion.q, np.nan)}, safety_mode=mode)
    assert "dq of joint" in refused(path) and "NaN" in refused(path)


@pytest.mark.parametrize("kind", ["stop", "mode", "scaling", "command"])
def test_a_recording_with_topics(tmp_path: Path, motion: Motion, kind: str):
    told = [
        (0.0, 0),
        *((t, v) for known in motion.stops for t, v in ((known.asked, 3), (known.rest + 0.2, 0))),
    ]
    topics = {
        "stop": [("/cell/stop", BOOL, [(t, byte(v > 0)) for t, v in told])],
        "mode": [("/io/safety_mode", MODE, [(t, byte(v or 1)) for t, v in told])],
        "scaling": [
            (
                "/x/speed_scaling",
                FLOAT,
                [
                    (t, double(0.0 if v else 100.0))
                    for t, v in zip(motion.t, motion.flag(motion.t), strict=True)
                ],
            )
        ],
        "command": [],
    }[kind]
    held = motion.q.copy()
    for known in motion.stops:
        first, last = np.searchsorted(motion.t, [known.asked, known.rest + 0.2])
        held[first:last] = held[first]
    path = write_mcap(
        tmp_path / "r.mcap",
        motion,
        UR5,
        robot="ur5",
        topics=topics,
        commands=held if kind == "command" else None,
    )
    cause = {"stop": "stop", "mode": "protective stop", "scaling": "speed scaling", "command": "command"}[
        kind
    ]
    printed = found(path)
    assert printed["robot"] == "ur5"
    check(printed, motion, cause)
    if kind in ("stop", "mode"):
        for known, stop in zip(motion.stops, printed["recordings"][0]["stops"], strict=True):
            assert stop["asked_s"] == pytest.approx([known.asked] * 2, abs=1e-6)


def test_topics_that_cannot_be_read_are_refused(tmp_path: Path, motion: Motion):
    path = write_mcap(tmp_path / "r.mcap", motion, UR5, topics=[("/stop", BOOL, [(0.5, b"")])])
    assert "/stop, message at 1500000000 ns: cannot be read" in refused(path)


def test_refusals(tmp_path: Path, table: Path, motion: Motion):
    assert "does not exist" in refused(tmp_path / "none.csv")
    assert "stands there twice" in refused(table, table)
    (tmp_path / "again.csv").hardlink_to(table)
    assert "stands there twice" in refused(table, tmp_path / "again.csv")
    (tmp_path / "copy.csv").write_bytes(table.read_bytes())
    assert "copy.csv: is a copy of " in refused(table, tmp_path / "copy.csv")
    assert "on which robot is it? name that with --robot" in refused(table, "--tool", "none.toml")
    far = write_csv(
        tmp_path / "far.csv", {**columns(motion, stop=motion.flag(motion.t)), UR5[2]: motion.q[:, 2] * 1e6}
    )
    assert "q of joint elbow_joint, t = 0 s: is 1.5e+06, beyond 1000; give rad" in refused(far)
    assert "no kind of file" in refused(write_csv(tmp_path / "r.txt", columns(motion)))
    assert "--standstill 0.0: must be above 0" in refused(table, "--standstill", 0)
    assert "--standstill nan" in refused(table, "--standstill", "nan")
    assert "has no runs" in refused(table, "--run", 1)
    assert "not in the catalogue" in refused(table, "--robot", "ur6")
    plain = write_csv(tmp_path / "plain.csv", columns(motion))
    said = refused(plain)
    assert "has no stop that can be measured: the arm comes to rest 2 times, and nothing recorded" in said
    assert found(plain, "--ends-of-motion")["recordings"][0]["stops"][0]["causes"] == ["end of motion"]
    still = {**columns(motion), **dict.fromkeys(UR5, np.zeros(len(motion.t)))}
    assert "has no stop" in refused(write_csv(tmp_path / "still.csv", still), plain)
    flags = np.full(len(motion.t), "perhaps")
    odd = write_csv(tmp_path / "odd.csv", columns(motion, stop=flags))
    assert "line 2, column stop: 'perhaps' is neither true nor false" in refused(odd)
    header = write_csv(tmp_path / "header.csv", {"time": motion.t, **{"x": motion.t}})
    assert "has no column t, and is no log that is known" in refused(header)


def test_what_could_have_told_of_a_stop_is_named_where_it_did_not(tmp_path: Path, motion: Motion):
    """Nobody is told to record what was recorded, nor to give an option that was given."""
    calm = write_csv(tmp_path / "calm.csv", columns(motion, safety_mode=np.ones(len(motion.t), int)))
    said = refused(calm)
    assert "comes to rest 2 times, and safety_mode tell of no stop; --ends-of-motion" in said
    assert "record the safety mode" not in said
    going = {name: column[100:120] for name, column in columns(motion).items()}
    said = refused(write_csv(tmp_path / "going.csv", going), "--ends-of-motion")
    assert "the arm never comes to rest from motion; record the safety mode" in said
    assert "--ends-of-motion" not in said and said.endswith("until it has stood still for 0.1 s")


def test_degrees_are_pointed_out(tmp_path: Path, motion: Motion):
    table = columns(motion, stop=motion.flag(motion.t).astype(int))
    for name in UR5:
        table[name] = np.degrees(table[name])
    (recording,) = found(write_csv(tmp_path / "deg.csv", table))["recordings"]
    assert any("in degrees?" in note for note in recording["notes"])


def test_joints_in_another_order_are_put_into_that_of_the_first(tmp_path: Path, table: Path, motion: Motion):
    other = Motion(motion.stops, motion.t[:-1], motion.q0)
    mixed = columns(other, stop=other.flag(other.t).astype(int))
    mixed = {name: mixed[name] for name in ("t", *reversed(UR5), "stop")}
    first, second = found(table, write_csv(tmp_path / "mixed.csv", mixed))["recordings"]
    assert first["joints"] == second["joints"] == list(UR5)
    assert first["stops"] == second["stops"]


def test_what_the_samples_can_show_is_said(tmp_path: Path, motion: Motion, table: Path):
    assert "  what the samples can show: times to within 16 ms\n" in run(table)
    rare = Motion(motion.stops[:1], np.arange(0.0, 3.0, 0.5), HOME)
    said = run(write_csv(tmp_path / "rare.csv", columns(rare, stop=rare.flag(rare.t).astype(int))))
    assert "; in the stop no sample shows motion after the arm was told, so that the least is 0" in said
    assert "500 ms apart" in said


def test_recordings_of_another_robot_are_refused(tmp_path: Path, table: Path, motion: Motion):
    assert "lacks joint panda_joint1" in refused(table, "--robot", "panda")
    panda = write_mcap(tmp_path / "p.mcap", motion, [f"j{j}" for j in range(6)], robot="panda")
    assert "the recording is of panda, but the cell or --robot says ur5" in refused(panda, "--robot", "ur5")
    two = [write_mcap(tmp_path / f"{name}.mcap", motion, UR5, robot=name) for name in ("ur5", "ur3")]
    assert "different robots: ur5 and ur3" in refused(*two)
    other = write_csv(
        tmp_path / "o.csv", {"t": motion.t, "elbow": motion.q[:, 0], "stop": motion.flag(motion.t)}
    )
    assert "is of another arm than r.csv" in refused(table, other)
    log = {"timestamp": motion.t, **{f"actual_q_{j}": motion.q[:, j] for j in range(5)}}
    assert "has 5 joints, and the robot has 6" in refused(
        write_csv(tmp_path / "five.csv", log), "--robot", "ur5"
    )


def test_truncated_files_are_refused(tmp_path: Path, table: Path, motion: Motion):
    lines = table.read_text(encoding="utf-8")
    (tmp_path / "cut.csv").write_text(lines[: len(lines) // 2], encoding="utf-8")
    assert "cells" in refused(tmp_path / "cut.csv") or "is not a number" in refused(tmp_path / "cut.csv")
    whole = write_mcap(tmp_path / "r.mcap", motion, UR5, robot="ur5").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert "has no index" in refused(tmp_path / "cut.mcap") or "ends early" in refused(tmp_path / "cut.mcap")
    np.savez(tmp_path / "r.npz", t=motion.t, q=motion.q)
    (tmp_path / "cut.npz").write_bytes((tmp_path / "r.npz").read_bytes()[:-400])
    assert "is no readable NPZ file" in refused(tmp_path / "cut.npz")


def test_files_are_written_and_named(tmp_path: Path, table: Path):
    assert f"wrote {tmp_path / 'r.json'}" in run(table, "--json", tmp_path / "r.json")
    assert "exists already" in refused(table, "--json", tmp_path / "r.json")
    assert "is the recording itself" in refused(table, "--json", table, "--force")


@pytest.mark.real_data
def test_protective_stops_of_a_ur3_once_a_second(real_data: Path):
    """UCI 963: the flag rises 38 times; at 1 Hz a stop is known to be shorter than two steps or so."""
    printed = found(real_data / "robot/ur3_cobotops_1hz.csv.gz")
    (recording,) = printed["recordings"]
    stops = recording["stops"]
    unmeasured = sum(each["times"] for each in recording["not_measured"])
    assert len(stops) + unmeasured == rises(real_data / "robot/ur3_cobotops_1hz.csv.gz")
    assert len(stops) > 25
    for stop in stops:
        assert stop["causes"] == ["Robot ProtectiveStop"] and stop["angle_rad"] is None
        assert stop["time_s"][1] - stop["time_s"][0] >= 0.9, "no finer than the samples"
        assert stop["time_s"][0] <= 1.1, "no protective stop takes a second for certain"


def rises(path: Path) -> int:
    """How often the flag rises, over the rows that have one, by a reader of its own."""
    import csv
    import gzip

    with gzip.open(path, "rt", encoding="utf-8-sig") as stream:
        flags = [row["Robot_ProtectiveStop"] for row in csv.DictReader(stream)]
    known = [flag == "True" for flag in flags if flag]
    return sum(now and not before for before, now in pairwise(known))


@pytest.mark.real_data
def test_motions_of_a_ur3e_end_without_a_stop(real_data: Path):
    paths = [real_data / f"robot/ur3e_rad_rtde_{name}.csv.gz" for name in ("L0L1", "L1L2", "L2L3")]
    said = refused(*paths)
    assert "nor has any of the 2 others" in said and "comes to rest" in said
    printed = found(*paths, "--ends-of-motion")
    (stop,) = [stop for each in printed["recordings"] for stop in each["stops"]]
    # by eye in the file: the last row that moves is at 1550308.49 s, the first at rest 0.04 s later
    assert stop["asked_s"][0] + stop["time_s"][1] == pytest.approx(1550308.53 - 1550308.29, abs=1e-6)
    assert open_motion(paths[0]).t[-1] == pytest.approx(1550305.65 - 1550304.53, abs=1e-6)


def test_the_same_stops_whatever_the_zero_of_time(tmp_path: Path, rng):
    stops = random_stops(rng, 6, 2)
    motion = sampled(rng, stops, 0.008, HOME)
    flag = motion.flag(motion.t).astype(int)
    printed = []
    for shift in (0.0, 1e6):
        path = write_csv(tmp_path / f"{shift:g}.csv", {**columns(motion, stop=flag), "t": motion.t + shift})
        (recording,) = found(path)["recordings"]
        printed.append([stop["time_s"] for stop in recording["stops"]])
    assert np.allclose(*printed, atol=1e-6)
