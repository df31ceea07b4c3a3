"""A stop that stays on the path, with its duration, and nobody around: python examples/path_true_stop.py"""

import numpy as np

from failsafe.plan import PlanSettings
from failsafe.running_plan import RunningPlan
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.waypoints import rest_to_rest
from robots.catalog import RobotSetup, load_robot

CYCLE_S = 0.002


def main() -> None:
    """Stop a UR5 in the middle of a motion."""
    limits = load_robot("ur5", setup=RobotSetup(bare_flange=True)).limits
    path = rest_to_rest([[0.0, -1.6, 1.6, 0.0, 0.0, 0.0], [1.2, -1.1, 1.0, 0.4, 0.0, 0.0]], limits)
    s = 0.4 * path.s_end
    planner = ShortTermPlanner(limits, PlanSettings(CYCLE_S, (0.0, 0.0), np.zeros(6), np.zeros(6)))
    stop = planner.plan(path, t=0.0, s=s)
    running = RunningPlan(path, s)
    running.take(path, planner, stop)
    further = stop.s_rest - s
    print(f"{stop.outcome.name}: at rest after {stop.stop_time_s:.3f} s, {further:.3f} s further on the path")
    for tau in np.linspace(0.0, running.duration_s, 6):
        q, dq, _ = running.motion(tau)
        print(f"{tau:.3f} s  q {np.round(q, 3)}  dq {np.round(dq, 3)}")


if __name__ == "__main__":
    main()
