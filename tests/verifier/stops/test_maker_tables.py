"""The models of ``bench.maker_stops`` against integration, and what the documentation says of them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from scipy.integrate import solve_ivp

from bench.maker_stops import ARMS, GRAVITY, MANUALS, SPEED_RAD_S, Torques, fitted, lines, predictions

ROOT = Path(__file__).resolve().parents[3]
TABLE = "robot/stopping_and_reaction_tables.csv"


def integrated(torques: Torques, inertia: float, gravity: float, speed: float) -> tuple[float, float]:
    """Angle and time of a stop, by steps."""

    def rates(_t: float, y: list[float]) -> list[float]:
        return [y[1], -(torques.friction - gravity + torques.damping * y[1]) / inertia]

    def rest(_t: float, y: list[float]) -> float:
        return y[1]

    rest.terminal = True
    done = solve_ivp(rates, (0.0, 100.0), [0.0, speed], events=rest, rtol=1e-10, atol=1e-12)
    return float(done.y_events[0][0][0]), float(done.t_events[0][0])


def test_closed_forms_against_integration(rng, count):
    for _ in range(count(500)):
        torques = Torques(rng.uniform(5.0, 200.0), rng.uniform(0.5, 100.0))
        inertia, speed = rng.uniform(0.5, 10.0), rng.uniform(0.5, 4.0)
        gravity = torques.friction * rng.uniform(0.0, 0.9)
        found = torques.stop(inertia, gravity, speed)
        assert found == pytest.approx(integrated(torques, inertia, gravity, speed), rel=1e-6)
        assert torques.stop(inertia, 1.01 * torques.friction, speed) == (math.inf, math.inf)
        angle, time = torques.stop(inertia, 0.0, speed)
        again = fitted(angle, time, inertia, speed)
        assert (again.friction, again.damping) == pytest.approx((torques.friction, torques.damping), rel=1e-5)


def test_what_is_no_friction_is_refused():
    for angle in (0.0, 0.6, 1.0):
        with pytest.raises(ValueError, match="above 0 and below 1/2"):
            fitted(angle, 0.5, 1.0, 2.0)


def test_loads_by_hand():
    arm, payload = ARMS["UR5 CB3"], 5.0
    elbow = 2.33 * (0.24225**2 + 0.39225**2 / 12) + 2 * 1.219 * 0.39225**2 + 5.1879 * (0.39225 + 0.09465) ** 2
    assert arm.inertia("J2 elbow", payload) == pytest.approx(elbow)
    torque = GRAVITY * (2.33 * 0.24225 + 2 * 1.219 * 0.39225 + 5.1879 * (0.39225 + 0.09465))
    assert arm.gravity("J2 elbow", payload) == pytest.approx(torque)
    assert arm.gravity("J0 base", payload) == 0.0 < arm.gravity("J1 shoulder", payload)
    assert arm.inertia("J0 base", payload) == arm.inertia("J1 shoulder", payload) > elbow


@pytest.mark.real_data
def test_the_base_joint_is_met_and_the_others_are_predicted_from_it(real_data: Path):
    rows = predictions(real_data / TABLE)
    assert [row.joint for row in rows] == 2 * ["J0 base", "J1 shoulder", "J2 elbow"]
    for robot, payload in MANUALS.items():
        base, *others = (row for row in rows if row.robot == robot)
        torques = fitted(base.angle, base.time, ARMS[robot].inertia("J0 base", payload), SPEED_RAD_S)
        for found in (base.same_law, base.same_torques, base.gravity_held):
            assert found == pytest.approx((base.angle, base.time), rel=1e-9)
        for row in others:
            assert row.same_law == (base.angle, base.time)
            inertia = ARMS[robot].inertia(row.joint, payload)
            by_steps = integrated(torques, inertia, 0.0, SPEED_RAD_S)
            assert row.gravity_held == pytest.approx(by_steps, rel=1e-6)


@pytest.mark.real_data
def test_the_documentation_shows_what_the_command_prints(real_data: Path):
    text = (ROOT / "docs/stops.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```text\n(stop category 0.*?)```", text, re.DOTALL)
    assert shown.splitlines() == list(lines(real_data / TABLE))
