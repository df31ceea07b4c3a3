"""Stopping tables of makers against three models with one set of numbers per robot.

    python -m bench.maker_stops TABLES.csv

Fitted on the base joint J0, which gravity does not move, to its stopping time and angle; J1 and J2 are
predicted, and the misfit is printed as it is. For stop category 0 at full extension, speed and payload.

*Same law*: every joint slows down as J0 does. *Same torques*: friction c and damping b, those of J0, slow
down what each joint carries, and gravity pulls down with all its torque:

    I dω/dt = -(c - G) - b ω,   ω(0) = v

of which time and angle are closed forms. *Gravity held*: the same with G = 0, as if drives held the arm.
The arm is stretched out horizontally: rods and point masses along a line, wrist 3 and payload at its end (an
assumption). Masses, centres of mass, lengths:
UniversalRobots/Universal_Robots_ROS2_Description, config/*/{physical_parameters,default_kinematics}.yaml.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from scipy.optimize import brentq

GRAVITY = 9.81
SPEED_RAD_S = math.radians(183.0)
"""As the tables of the UR3 and the UR5 state it."""
MANUALS = {"UR3 CB3": 3.0, "UR5 CB3": 5.0}
"""Robot -> payload [kg] in its table."""
AS_TABLE_ONLY = "KUKA KR 20"


@dataclass(frozen=True)
class Arm:
    """Masses [kg] of upper arm, forearm, wrists 1, 2, 3; lengths [m] of both links and to the flange."""

    masses: tuple[float, float, float, float, float]
    upper_arm: float
    forearm: float
    wrist: float
    centres: tuple[float, float]
    """Centres of mass of upper arm and forearm, each from its own joint [m]."""

    def loads(self, joint: str, payload: float) -> Iterator[tuple[float, float, float]]:
        """Mass, distance from the joint's axis, and length of the rod that it is spread over."""
        start = 0.0 if joint in ("J0 base", "J1 shoulder") else self.upper_arm
        wrist = self.upper_arm + self.forearm - start
        if start == 0.0:
            yield self.masses[0], self.centres[0], self.upper_arm
        yield self.masses[1], self.upper_arm - start + self.centres[1], self.forearm
        yield self.masses[2] + self.masses[3], wrist, 0.0
        yield self.masses[4] + payload, wrist + self.wrist, 0.0

    def inertia(self, joint: str, payload: float) -> float:
        """About the axis of a joint [kg m²]."""
        return sum(m * (r * r + length * length / 12.0) for m, r, length in self.loads(joint, payload))

    def gravity(self, joint: str, payload: float) -> float:
        """Largest torque of gravity about the axis of a joint [N m]; none about a vertical one."""
        if joint == "J0 base":
            return 0.0
        return GRAVITY * sum(m * r for m, r, _ in self.loads(joint, payload))


ARMS = {
    "UR3 CB3": Arm((3.42, 1.26, 0.8, 0.8, 0.35), 0.24365, 0.21325, 0.08535, (0.11365, 0.16325)),
    "UR5 CB3": Arm((8.393, 2.33, 1.219, 1.219, 0.1879), 0.425, 0.39225, 0.09465, (0.2125, 0.24225)),
}


@dataclass(frozen=True)
class Torques:
    """Friction [N m] and damping [N m s/rad]."""

    friction: float
    damping: float

    def stop(self, inertia: float, gravity: float, speed: float) -> tuple[float, float]:
        """Angle [rad] and time [s] from ``speed`` [rad/s] to standstill; infinite if gravity wins."""
        c, b = self.friction - gravity, self.damping
        if c <= 0.0:
            return math.inf, math.inf
        time = inertia / b * math.log1p(b * speed / c)
        return inertia / b * speed - c / b * time, time


def fitted(angle: float, time: float, inertia: float, speed: float) -> Torques:
    """Return the torques that stop an inertia in this angle [rad] and time [s], without gravity."""
    share = angle / (speed * time)
    if not 0.0 < share < 0.5:
        raise ValueError(f"{share:.3f} of speed times time should be above 0 and below 1/2 to be friction")
    u = brentq(lambda x: 1.0 / math.log1p(x) - 1.0 / x - share, 1e-6, 1e12)
    friction = inertia * speed / (time * u) * math.log1p(u)
    return Torques(friction, u * friction / speed)


@dataclass(frozen=True)
class Row:
    """One joint of one robot: what the maker states and what follows from J0 by both models."""

    robot: str
    joint: str
    angle: float
    time: float
    same_law: tuple[float, float]
    same_torques: tuple[float, float]
    gravity_held: tuple[float, float]


def predictions(table: Path) -> list[Row]:
    """Return the rows of the UR3 and the UR5, J0 (fitted) first."""
    stated = {
        (row["robot"], row["axis_or_function"]): (float(row["value"]), float(row["value2"]))
        for row in _stops(table)
        if row["robot"] in MANUALS
    }
    rows = []
    for robot, payload in MANUALS.items():
        base, arm = stated[robot, "J0 base"], ARMS[robot]
        torques = fitted(*base, arm.inertia("J0 base", payload), SPEED_RAD_S)
        for (name, joint), (angle, time) in stated.items():
            if name == robot:
                inertia, gravity = arm.inertia(joint, payload), arm.gravity(joint, payload)
                found = (torques.stop(inertia, pull, SPEED_RAD_S) for pull in (gravity, 0.0))
                rows.append(Row(robot, joint, angle, time, base, *found))
    return rows


def _stops(table: Path) -> list[dict[str, str]]:
    with table.open(encoding="utf-8", newline="") as stream:
        return [row for row in csv.DictReader(stream) if row["quantity"] == "stopping distance / time"]


def lines(table: Path) -> Iterator[str]:
    """Yield what is printed."""
    yield "stop category 0, full extension, speed and payload; fitted on J0, predicted: angle rad / time s"
    models = f"{'same law as J0':>18}{'same torques':>18}{'gravity held':>18}"
    yield f"{'robot':<10}{'joint':<14}{'maker':>16}{models}  misfits"
    for row in predictions(table):
        misfit = ", ".join(
            "never stops"
            if math.isinf(angle)
            else f"{angle / row.angle - 1:+.0%} / {time / row.time - 1:+.0%}"
            for angle, time in (row.same_law, row.same_torques, row.gravity_held)
        )
        yield (
            f"{row.robot:<10}{row.joint:<14}{_pair(row.angle, row.time):>16}{_pair(*row.same_law):>18}"
            f"{_pair(*row.same_torques):>18}{_pair(*row.gravity_held):>18}  "
            f"{'fitted' if row.joint == 'J0 base' else misfit}"
        )
    for row in _stops(table):
        if row["robot"].startswith(AS_TABLE_ONLY):
            yield (
                f"{row['robot']} {row['axis_or_function']}: {row['value']} {row['unit']}, {row['value2']} s "
                f"({row['conditions']}; {row['source_document']}): as a table only"
            )


def _pair(angle: float, time: float) -> str:
    return "never" if math.isinf(angle) else f"{angle:.2f} / {time:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description="Stopping tables of makers against three models.")
    parser.add_argument("table", type=Path, help="CSV with the tables")
    for line in lines(parser.parse_args().table):
        print(line)


if __name__ == "__main__":
    main()
