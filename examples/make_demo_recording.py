"""Make the bundled recording ``data/demo.mcap``. It is synthetic: nobody was filmed and no robot moved.

A UR5 on a bench (its base is the world frame, the floor lies 0.8 m below) carries parts from one side to the
other. A worker walks up, puts a part down next to the arm, leaves, and then waves so fast that the profile of
2 m/s does not cover the hand. The arm does not react: it is the verifier's business to say when it should
have.

    python examples/make_demo_recording.py --out data/demo.mcap --seed 0 --force
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Point
from verifier.recordings import RecordingWriter, new_recording
from verifier.recordings.joint_state import JointState
from verifier.recordings.people_report import PeopleReport, ReportedPerson

Vector = NDArray[np.float64]

DURATION_S = 20.0
NANO = 1_000_000_000

# The arm.
JOINT_RATE_HZ = 125
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
FINGER = "gripper_finger_joint"
SPEED = 1.0  # largest joint speed [rad/s]
ABOVE_PICK = np.array([0.5912, -1.4058, 1.4979, -1.6629, -1.5708, -0.1942])
PICK = np.array([0.5912, -1.2464, 1.8409, -2.1653, -1.5708, -0.1942])
ABOVE_PLACE = np.array([-0.9796, -1.4058, 1.4979, -1.6629, -1.5708, -0.1942])
PLACE = np.array([-0.9796, -1.2464, 1.8409, -2.1653, -1.5708, -0.1942])
ROUND = (PICK, PICK, ABOVE_PICK, ABOVE_PLACE, PLACE, PLACE, ABOVE_PLACE, ABOVE_PICK)
GRIP_S = 0.3  # how long the gripper takes to close or open
OPEN_M, CLOSED_M = 0.085, 0.040

# The worker.
PEOPLE_RATE_HZ = 60
FIRST_REPORT_S = 0.4  # the tracker starts later than the arm
DELAY_S = 0.03  # between seeing and reporting
NOISE_M, NOISE_LIMIT_M, POSITION_ERROR_M = 0.0015, 0.004, 0.01
FLOOR_M = -0.8
WALK_SPEED = 1.3
FAR_M, NEAR_M, SIDE_M = 4.5, 1.25, 0.3
STRIDE_HZ = 0.9
# When [s]: walk in, reach, hold until, turn away, walk out, turn back, wave.
WALK_IN, REACH, RETRACT, TURN, WALK_OUT, TURN_BACK, WAVE = 2.5, 5.8, 7.4, 8.3, 9.4, 13.0, 15.5
WAVE_S, WAVE_ANGLE = 0.8, 2.6  # arm from hanging to raised [rad]; the hand reaches 4 m/s


def ease(u: float) -> float:
    """Quintic from 0 to 1 with zero speed and acceleration at both ends; ``u`` outside [0, 1] rests there."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


EASE_PEAK = 1.875  # largest slope of ``ease``


def arm_motion() -> tuple[Vector, Vector, Vector]:
    """Times, joint positions and finger positions: point-to-point moves, joints in step."""
    keys = [(0.0, ABOVE_PICK, OPEN_M)]
    while keys[-1][0] < DURATION_S:
        for goal in ROUND:
            begin, start, finger = keys[-1]
            distance = float(np.abs(goal - start).max())
            if distance == 0.0:
                keys.append((begin + GRIP_S, goal, CLOSED_M if finger == OPEN_M else OPEN_M))
            else:
                keys.append((begin + EASE_PEAK * distance / SPEED, goal, finger))
    t = np.arange(round(DURATION_S * JOINT_RATE_HZ) + 1) / JOINT_RATE_HZ
    begins = np.array([key[0] for key in keys])
    q, fingers = np.empty((len(t), len(JOINTS))), np.empty(len(t))
    for row, now in enumerate(t):
        i = min(int(np.searchsorted(begins, now, side="right")) - 1, len(keys) - 2)
        (begin, start, finger), (end, goal, next_finger) = keys[i], keys[i + 1]
        share = ease((now - begin) / (end - begin))
        q[row] = start + share * (goal - start)
        fingers[row] = finger + share * (next_finger - finger)
    return t, q, fingers


def walked(now: float, begin: float) -> tuple[float, float]:
    """Distance walked since ``begin`` and share of full speed: half a second to get going and to stop."""
    distance, ramp = FAR_M - NEAR_M, 0.5
    total = distance / WALK_SPEED + ramp
    u = min(max(now - begin, 0.0), total)
    going = min(u, ramp)
    cruising = min(max(u - ramp, 0.0), total - 2 * ramp)
    stopping = max(u - (total - ramp), 0.0)
    walked_m = WALK_SPEED * (going**2 / (2 * ramp) + cruising + stopping - stopping**2 / (2 * ramp))
    share = min(going / ramp, 1.0 - stopping / ramp)
    return walked_m, share if 0.0 < now - begin < total else 0.0


def worker(now: float) -> Vector:
    """The 20 points of the worker [m, world], shape (20, 3)."""
    came, speed_in = walked(now, WALK_IN)
    left, speed_out = walked(now, WALK_OUT)
    away = ease((now - TURN) / 1.0) - ease((now - TURN_BACK) / 1.0)
    yaw = math.pi * (1.0 + away)  # facing the arm, or away from it
    swing = 0.1 * max(speed_in, speed_out) * math.sin(2 * math.pi * STRIDE_HZ * now)
    reach = ease((now - REACH) / 1.2) - ease((now - RETRACT) / 0.9)
    wave = ease((now - WAVE) / WAVE_S) - ease((now - WAVE - 1.2) / 2.2)
    xyz = np.empty((len(Point), 3))
    for point, height in (
        (Point.PELVIS, 0.95),
        (Point.THORAX, 1.25),
        (Point.NECK_BASE, 1.47),
        (Point.HEAD, 1.63),
    ):
        xyz[point] = 0.0, 0.0, height
    for side, name in ((1.0, "L"), (-1.0, "R")):
        right = name == "R"
        shoulder = np.array([0.0, 0.19 * side, 1.42])
        hip = np.array([0.0, 0.10 * side, 0.92])
        lift = 0.1 + side * 1.2 * swing + (0.6 * reach + WAVE_ANGLE * wave if right else 0.0)
        bend = 0.25 + (0.25 * reach if right else 0.0)
        elbow = shoulder + 0.29 * _forward(lift)
        wrist = elbow + 0.26 * _forward(lift + bend)
        knee = hip + 0.42 * _forward(-side * swing)
        ankle = knee + 0.42 * _forward(-side * swing - 0.05)
        along = _forward(lift + bend)
        parts = {"SHOULDER": shoulder, "ELBOW": elbow, "WRIST": wrist, "HAND": wrist + 0.09 * along}
        parts |= {"FINGERTIP": wrist + 0.18 * along, "HIP": hip, "KNEE": knee, "ANKLE": ankle}
        for part, position in parts.items():
            xyz[Point[f"{name}_{part}"]] = position
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    return xyz @ turn.T + [FAR_M - came + left, SIDE_M, FLOOR_M]


def _forward(angle: float) -> Vector:
    """Unit vector: 0 hangs down, 90 degrees points forward."""
    return np.array([math.sin(angle), 0.0, -math.cos(angle)])


def write(writer: RecordingWriter, seed: int) -> None:
    """Write the recording, messages in order of their time."""
    rng = np.random.default_rng(seed)
    writer.describe({"robot": "ur5", "note": f"synthetic, examples/make_demo_recording.py --seed {seed}"})
    messages: list[JointState | PeopleReport] = []
    for now, q, finger in zip(*arm_motion(), strict=True):
        position = np.append(q, finger).round(6)
        messages.append(JointState(round(now * NANO), (*JOINTS, FINGER), position))
    for number in range(round((DURATION_S - FIRST_REPORT_S) * PEOPLE_RATE_HZ)):
        now = FIRST_REPORT_S + number / PEOPLE_RATE_HZ
        noise = np.clip(rng.normal(0.0, NOISE_M, (len(Point), 3)), -NOISE_LIMIT_M, NOISE_LIMIT_M)
        xyz = (worker(now) + noise).round(4)
        person = ReportedPerson("worker", xyz, np.full(len(Point), POSITION_ERROR_M), (1 << len(Point)) - 1)
        messages.append(
            PeopleReport(round(now * NANO), round((now + DELAY_S) * NANO), "world", True, (person,))
        )
    for message in sorted(
        messages, key=lambda m: m.arrived_ns if isinstance(m, PeopleReport) else m.stamp_ns
    ):
        if isinstance(message, PeopleReport):
            writer.people(message)
        else:
            writer.joints(message)


def main() -> None:
    """Write the file that the command line names."""
    parser = argparse.ArgumentParser(description="Make the synthetic demonstration recording.")
    parser.add_argument("--out", type=Path, default=Path("data/demo.mcap"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--force", action="store_true", help="overwrite")
    options = parser.parse_args()
    with new_recording(options.out, force=options.force) as writer:
        write(writer, options.seed)
    print(f"{options.out}: {options.out.stat().st_size / 1e3:.0f} kB, synthetic, seed {options.seed}")


if __name__ == "__main__":
    main()
