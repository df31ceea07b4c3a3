"""Speed alteration beside a supervisor: an arm goes on its way while somebody reaches for it and leaves.

The mode is asked ten times a second, and what it proposes is verified like any plan. Time is simulated:

    python examples/speed_alteration.py
"""

from __future__ import annotations

import numpy as np

from failsafe.trajectory import IntendedTrajectory
from modes.speed.alteration import SpeedAlteration, SpeedSettings
from modes.speed.objective import Weights
from occupancy.body import Point
from occupancy.report import RawMeasurement, RawPerson
from verifier import Cell
from verifier.mode_runner import ModeReport, Proposals
from verifier.proposal import NewTrajectory
from verifier.supervisor import Supervisor

HOME = np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.5, 0.0])
AWAY = np.array([1.2, -0.2, 0.0, -1.7, 0.0, 1.5, 0.0])
LINKS = [f"panda_link{i}" for i in range(1, 8)]
CELL = {
    "cycle_s": 0.02,
    "robot": {
        "name": "panda",
        "bare_flange": True,
        "tracking": {"position_error_rad": 0.001, "velocity_error_rad_s": 0.001},
    },
    "people": {"latency_s": 0.03, "repeated_points": "measured"},
    # Hands and arms may be touched, slowly; head, neck and torso are kept away from.
    "workspace": {"floor_z_m": -0.8},
    "criteria": {
        "accept_unverified": True,
        "contact": [
            {
                "links": LINKS,
                "parts": ["l_hand", "l_forearm", "l_upper_arm", "r_hand", "r_forearm", "r_upper_arm"],
                "person_speed": "neglected",
            }
        ],
    },
}
PERSON = {
    Point.HEAD: (0.62, 0.0, 0.5), Point.NECK_BASE: (0.62, 0.0, 0.3), Point.THORAX: (0.62, 0.0, 0.08),
    Point.PELVIS: (0.62, 0.0, -0.22),
    Point.R_SHOULDER: (0.56, -0.18, 0.24), Point.R_ELBOW: (0.34, -0.1, 0.06), Point.R_WRIST: (0.08, 0.0, 0.0),
    Point.R_HAND: (0.0, 0.0, 0.0), Point.R_FINGERTIP: (-0.07, 0.0, 0.0),
    Point.L_SHOULDER: (0.62, 0.18, 0.24), Point.L_ELBOW: (0.62, 0.22, -0.04),
    Point.L_WRIST: (0.62, 0.22, -0.3), Point.L_HAND: (0.62, 0.22, -0.38),
    Point.L_FINGERTIP: (0.62, 0.22, -0.46),
    Point.R_HIP: (0.62, -0.1, -0.24), Point.R_KNEE: (0.62, -0.1, -0.66), Point.R_ANKLE: (0.62, -0.1, -1.06),
    Point.L_HIP: (0.62, 0.1, -0.24), Point.L_KNEE: (0.62, 0.1, -0.66), Point.L_ANKLE: (0.62, 0.1, -1.06),
}  # fmt: skip
"""Where the points of somebody who reaches out are, seen from the hand [m]."""


def reaching(t: float) -> RawMeasurement:
    """Return the report of somebody whose hand comes from 2 m away, is in the way, and leaves."""
    hand = np.array([np.interp(t, [0.0, 3.0, 5.0, 8.0], [2.6, 0.75, 0.75, 2.6]), 0.35, 0.75])
    points = np.full((len(Point), 3), np.nan)
    for point, away in PERSON.items():
        points[point] = hand + away
    who = RawPerson("p1", points, np.full(len(Point), 0.01), sum(1 << point for point in PERSON))
    return RawMeasurement(t - 0.02, t, "world", True, (who,))


def way(a: np.ndarray, b: np.ndarray, T: float = 6.0) -> IntendedTrajectory:
    """Return a quintic from rest to rest."""
    d, z = b - a, np.zeros(7)
    return IntendedTrajectory([0.0, T], [[a, z, z, 10 * d / T**3, -15 * d / T**4, 6 * d / T**5]], "rest")


def main() -> None:
    """Go from one place to the other, with the mode beside it."""
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), HOME)
    supervisor.propose(NewTrajectory(way(HOME, AWAY)))
    settings = SpeedSettings(cap_m_s=0.25, weights=Weights(closeness=1.0, smoothness=1.0, penalty=10.0))
    mode, report = SpeedAlteration(supervisor.check.robot, settings), ModeReport()
    proposals = Proposals(supervisor)
    print("   t    state       verdict                  path   index at programmed   chosen path speed")
    for k in range(800):
        t = 0.02 * k
        command = supervisor.step(t, [reaching(t)] if k % 2 == 0 else [])
        if k % 5 == 0:
            proposals.ask(mode, report)
        if k % 25 == 0 and mode.decision is not None:
            view, chosen = supervisor.view(), mode.decision
            print(
                f"{t:5.1f} s  {command.outcome.name:10}  {command.verdict.reason.name:22}  {view.s:4.1f} s"
                f"  {chosen.at_programmed:19.2f}   {chosen.path_speed:17.2f}"
            )
        if supervisor.view().s > 6.0 - 1e-6:
            print(f"arrived after {t:.1f} s, {report.handed_on} proposals, {report.faults} faults")
            break


if __name__ == "__main__":
    main()
