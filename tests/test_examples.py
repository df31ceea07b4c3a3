"""Every example runs as its first page says, and shows what it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted(path.name for path in (ROOT / "examples").glob("*.py"))


def run(name: str, *arguments: str) -> str:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    result = subprocess.run(
        [sys.executable, f"examples/{name}", *arguments], cwd=ROOT, capture_output=True, text=True,
        timeout=600, check=False, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_the_robot_rests_on_the_plan_that_it_holds_when_the_supervisor_is_killed():
    out = run("watchdog.py")
    moved, rest, bound, fastest = (
        float(re.search(pattern, out)[1])
        for pattern in (r"moved at ([\d.]+) rad/s", r"after (-?\d+) ms", r"bound (\d+) ms", r"way ([\d.]+)")
    )
    assert moved > 0.1
    assert bound == 1640.0  # room for 800 setpoints of 2 ms, and two cycles of 20 ms
    assert 0.0 < rest <= bound
    assert fastest < 2.5


def test_an_embedded_supervisor_stops_goes_on_and_arrives():
    out = run("embed.py")
    states = re.findall(r"^ *[\d.]+ s (\w+)", out, re.MULTILINE)
    assert {"EXECUTING", "FAILSAFE", "RECOVERING"} <= set(states) and states[-1] == "STOPPED"
    assert "the path was taken" in out and out.strip().endswith("arrived")


def test_a_way_that_joins_in_motion_is_mended_by_its_refusal_and_arrives():
    out = run("join_in_motion.py")
    assert "BEYOND_LIMITS" in out and out.index("BEYOND_LIMITS") < out.index("joins at s = ")
    assert not re.search(r"FAILSAFE|JUMP", out) and out.strip().endswith("arrived")


@pytest.mark.rarely("docs of modes, and tests/verifier/test_mode_runner.py")
def test_a_mode_of_ones_own_moves_the_arm():
    out = run("own_mode.py")
    assert float(re.search(r"to ([\d.]+) rad", out)[1]) > 0.1
    assert "mode ended: True; robot at rest: True; faults: 0" in out


def test_speed_alteration_slows_the_arm_beside_a_hand_and_goes_on():
    out = run("speed_alteration.py")
    rows = re.findall(r"^ *[\d.]+ s  (\w+) +(\w+) +[\d.]+ s +([\d.]+) +(-?[\d.]+)$", out, re.MULTILINE)
    speeds = [float(row[3]) for row in rows]
    assert max(speeds[:4]) == 1.0 == speeds[-1] and min(speeds) < 0.6
    assert all(float(index) > 0.3 for _state, _why, index, speed in rows if float(speed) < 0.8)
    assert float(re.search(r"arrived after ([\d.]+) s", out)[1]) > 6.5 and "0 faults" in out


def test_a_simulated_arm_is_led_stops_when_hit_and_goes_on():
    """A hand of 300 N/m and an arm that yields with 300 N/m: half of 80 mm, less what it takes to begin."""
    out = run("contact.py")
    states = re.findall(r"^ *[\d.]+ s  (\w+)", out, re.MULTILINE)
    assert states == ["task", "collaboration", "return", "task", "collision", "task"]
    assert float(re.search(r"led upwards by (\d+) mm", out)[1]) == pytest.approx(40.0, abs=5.0)


def test_an_arm_stops_for_somebody_who_will_walk_past_and_reaches_its_targets():
    nearest = []
    for arguments in ((), ("--without-forecasts",)):
        out = run("proactive.py", *arguments)
        doing = re.findall(r"^ *[\d.]+ s  (.+)$", out, re.MULTILINE)
        assert any(each.startswith("has stopped, or stops: somebody is, or will be, near") for each in doing)
        assert doing[-1] == "rests at a target" and "3 of 3 targets reached" in out
        nearest.append(float(re.search(r"stayed ([\d.]+) m away", out)[1]))
    assert nearest[0] >= 0.25 > nearest[1] > 0.0


def test_a_planner_in_its_own_process_moves_the_arm():
    out = run("planner_process.py")
    assert "trajectory 1 was taken" in out and "arrived 2 times" in out


@pytest.mark.rarely("tests/verifier/test_safety_state.py")
def test_a_planner_that_asks_first_slows_down_and_takes_the_other_way():
    out = run("planner_with_safety_state.py")
    stops = dict(re.findall(r"planner that (.+): arrived [34] times, (\d+) steps of failsafe stops", out))
    assert int(stops["does not ask"]) > 20 and int(stops["asks"]) == 0
    assert re.search(r"straight ahead: panda_\w+ lacks [\d.]+ m from .* of somebody", out)
    ways = re.findall(r"^ *[\d.]+ s (.+)", out, re.MULTILINE)
    assert ways[0] == ways[-1] == "straight ahead" and "with the arm drawn in" in ways
    assert 0.0 < float(re.search(r"asked for: ([\d.]+)", out)[1]) < 1.0


def test_the_demo_recording_can_be_made_again(tmp_path):
    assert "synthetic" in run("make_demo_recording.py", "--out", str(tmp_path / "demo.mcap"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_says_how_it_is_run(name):
    text = (ROOT / "examples" / name).read_text(encoding="utf-8")
    assert f"python examples/{name}" in text
