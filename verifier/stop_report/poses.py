"""Configurations of worst cases: as pictures need them, and as a list of stops to be measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from failsafe.bracket import Bracket, Witness
from failsafe.stopping import STOP_ANGLE, STOP_TIME, ArmSearch
from robots.kernels import forward
from verifier.stop_report.report import Array, Grid, Pose, PoseToMeasure, StopCase

_STEP_S = 1e-6
_NOTHING = 1e-6
"""Angles and ways below this [rad; m] are nothing to be measured."""


def pose_of(arm: ArmSearch, title: str, stop: str, witness: Witness) -> Pose:
    """Return where the capsules are in a state, which point is the fastest, and how it moves."""
    model = arm.model
    rotation, position = _placed(arm, witness.q)
    n_links = len(model.links)
    rows = model.enclosure[0]
    joint = rows["joint"][:n_links]
    ends = np.stack([rows["a"][:n_links], rows["b"][:n_links]], axis=1)
    placed = position[joint][:, None, :] + np.einsum("lij,lkj->lki", rotation[joint], ends)
    place, velocity, link = fastest_at(arm, witness)
    return Pose(
        title, stop, witness.q, witness.dq, model.links, placed, rows["radius"][:n_links].copy(),
        position, place, velocity, link,
    )  # fmt: skip


def fastest_at(arm: ArmSearch, witness: Witness) -> tuple[Array, Array, str]:
    """Return the fastest point of the capsules, its velocity, and its link; differences in time.

    In a ball around a point that moves with v and turns with ω the fastest is at r v⊥ × ω / (‖v⊥‖‖ω‖), v⊥ the
    part of v across ω.
    """
    q = [witness.q + step * witness.dq for step in (-_STEP_S, 0.0, _STEP_S)]
    before, now, after = arm.places(np.array(q))
    turned = (_placed(arm, q[2])[0] - _placed(arm, q[0])[0]) / (2.0 * _STEP_S)
    skew = np.einsum("jab,jcb->jac", turned, _placed(arm, witness.q)[0])
    spins = 0.5 * np.stack(
        [skew[:, 2, 1] - skew[:, 1, 2], skew[:, 0, 2] - skew[:, 2, 0], skew[:, 1, 0] - skew[:, 0, 1]], axis=1
    )
    best = (now[0], np.zeros(3), arm.links[0])
    for k, moving in enumerate((after - before) / (2.0 * _STEP_S)):
        spin, ball = spins[arm.points["joint"][k]], float(arm.points["ball"][k])
        rate = float(np.linalg.norm(spin))
        axis = spin / rate if rate > 0.0 else spin
        across = moving - axis * float(axis @ moving)
        size = float(np.linalg.norm(across))
        away = ball * np.cross(across / size, axis) if size > 0.0 else np.zeros(3)
        velocity = moving + np.cross(spin, away)
        if np.linalg.norm(velocity) > np.linalg.norm(best[1]):
            best = (now[k] + away, velocity, arm.links[k])
    return best


def _placed(arm: ArmSearch, q: Array) -> tuple[Array, Array]:
    n = len(arm.model.joints)
    rotation, position = np.zeros((n, 3, 3)), np.zeros((n, 3))
    forward(arm.model.kinematics, np.ascontiguousarray(q), rotation, position)
    return rotation, position


def poses_to_measure(grids: Sequence[Grid], recorded: StopCase | None) -> tuple[PoseToMeasure, ...]:
    """List the states from which the lower numbers of full speed, load and extension are reached."""
    return (*_of_grids(grids), *_of_recording(recorded))


def _of_grids(grids: Sequence[Grid]) -> Iterator[PoseToMeasure]:
    for each in grids:
        full = [cell for cell in each.grid.cells if cell.extension == cell.speed == cell.load == 1.0]
        for cell in full:
            for bracket in _measurable(cell.brackets):
                yield PoseToMeasure(each.stop, bracket, each.load_kg, each.guessed)


def _of_recording(case: StopCase | None) -> Iterator[PoseToMeasure]:
    if case is None:
        return
    kept = {id(each) for each in _measurable(case.brackets)}
    for bracket, instant in zip(case.brackets, case.instants, strict=True):
        if id(bracket) in kept:
            yield PoseToMeasure(case.stop, bracket, None, False, None if instant is None else instant.t)


def _measurable(brackets: Sequence[Bracket]) -> Iterator[Bracket]:
    """Yield what is reached somewhere, of times the longest: those of other joints come with their angles."""
    times = [each for each in brackets if each.quantity == STOP_TIME]
    longest = max(times, key=lambda each: each.lower, default=None)
    alone = {each.part for each in brackets if each.quantity == STOP_ANGLE}
    for each in brackets:
        together = each.quantity == STOP_TIME and each.part in alone and each is not longest
        if each.witness is not None and each.lower > _NOTHING and each.unit != "J" and not together:
            yield each
