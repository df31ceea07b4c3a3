"""OMPL on the planner's own question: the same goals, the same proof of edges; for ``bench.planning``."""

from __future__ import annotations

import time
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.planning.arrt import Planner
from modes.planning.lines import EDGE_SLACK_M
from modes.planning.potential_field import Bodies, Field

Array = NDArray[np.float64]


def is_installed() -> bool:
    return find_spec("ompl") is not None


def ompl_plan(
    field: Field, start: Array, goal: Array, bodies: Bodies, name: str, step_rad: float, longest_s: float
) -> tuple[Array | None, float]:
    """Return the first path that a planner of OMPL finds, simplified, and the processor time [s].

    Its states are clear as ours are and its motions are proven by the same kernel with the same slack; the
    goals are the goal plus whole turns; longest edges are as ours. Not the same: samples are even in the
    box of position limits, calls go through Python, and paths are shortened by OMPL's simplifier.
    """
    from ompl import base as ob
    from ompl import geometric as og
    from ompl import util

    util.setLogLevel(util.LOG_NONE)

    n, limits = len(start), field.robot.limits
    space = ob.RealVectorStateSpace(n)
    bounds = ob.RealVectorBounds(n)
    for j in range(n):
        bounds.setLow(j, float(limits.position_lower[j]))
        bounds.setHigh(j, float(limits.position_upper[j]))
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)

    def numbers(state: Any) -> Array:
        return np.array([state[j] for j in range(n)])

    class Proven(ob.MotionValidator):
        def checkMotion(self, first: Any, second: Any) -> bool:
            return field.is_clear_between(numbers(first), numbers(second), bodies, EDGE_SLACK_M)

    def state_of(q: Array) -> Any:
        state = space.allocState()
        for j in range(n):
            state[j] = float(q[j])
        return state

    proven = Proven(information)
    information.setStateValidityChecker(lambda state: field.is_clear(numbers(state), bodies))
    information.setMotionValidator(proven)
    information.setup()
    problem = ob.ProblemDefinition(information)
    problem.addStartState(state_of(start))
    goals = ob.GoalStates(information)
    for each in Planner(field).goals(start, goal):
        goals.addState(state_of(each))
    problem.setGoal(goals)
    planner = getattr(og, name)(information)
    planner.setRange(step_rad)
    planner.setProblemDefinition(problem)
    planner.setup()
    began = time.process_time()
    planner.solve(longest_s)  # with a condition in Python, OMPL now and then waits for itself
    if not problem.hasExactSolution():
        return None, time.process_time() - began
    path = problem.getSolutionPath()
    og.PathSimplifier(information).reduceVertices(path)
    seconds = time.process_time() - began
    return np.array([numbers(path.getState(k)) for k in range(path.getStateCount())]), seconds
