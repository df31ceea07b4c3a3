"""One seeded trial of any model of people: random admissible motions, and how far they get out of its rows.

A trial is told apart by its seed alone. It may leave out one term of what the model is told
(:mod:`tests.occupancy.left_out`); the truth is the same with and without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, MAX_PARTS, PART_NAMES, Part, Point, Profile, load_profile
from occupancy.humans.arm_reach import ArmReach
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedPosition, ArticulatedVelocity
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.options import OptionModel
from occupancy.humans.pedestrian import Pedestrian
from occupancy.humans.unobserved import UnobservedSpace
from occupancy.measurement import Gate, GateSettings, SensorFrame
from occupancy.sets import MAX_PEOPLE, distance_to_hull, new_people_sets, new_reach_sets
from robots.motion import Block
from tests.occupancy.arm_crowds import BITS, ArmCrowd, arms
from tests.occupancy.arm_motion_kernels import worst_of_arms
from tests.occupancy.arm_twin import Twin
from tests.occupancy.crowds import SLICES, Crowd, accelerating, bodies, flat
from tests.occupancy.entering import entering, worst_of_entering
from tests.occupancy.inclusion_kernels import EXCESS, MOST_OPEN, OPEN_WIDTH, Array, worst_of_bodies
from tests.occupancy.left_out import LeftOut
from tests.occupancy.moving_people import HANDS, SEGMENTS, unit
from tests.occupancy.people import report, standing

WHOLE = LeftOut("nothing")
THINNER = 1.0 - 1e-9
"""What is true of flesh: so much thinner than the profile says that no rounding puts it outside."""
HELD_M = 0.3
ENDS = np.array([SEGMENTS.get(part, (-1, -1)) for part in Part])
HAND_POINTS = np.array([HANDS.get(part, (-1, -1, -1)) for part in Part])


class Outcome(NamedTuple):
    """How far [m] something got out at worst, negative: stayed inside; of how many motions; which, in words.

    ``-inf``: nothing came within 0.01 m of the boundary.
    """

    excess_m: float
    motions: int
    witness: str


Trial = Callable[[int, bool, LeftOut], Outcome]
"""Seed, whether all is aligned, what is left out."""


@cache
def _profiles() -> dict[str, Profile]:
    iso, tum, extreme = (load_profile(name) for name in ("iso", "tum", "extreme"))
    return {
        "iso": iso,
        "iso at 1.6 m/s": iso.with_speed(1.6),
        "tum": tum,
        "extreme": extreme,
        "gentle": flat(tum, 3.0, 5.0),
    }


BY_SPEED = ("iso", "iso at 1.6 m/s", "tum", "extreme")
BY_ACCELERATION = ("tum", "extreme", "gentle", "gentle")


def _option_model(name: str, profile: Profile, held_m: float) -> OptionModel:
    made = {
        "iso13855": Iso13855,
        "articulated_velocity": ArticulatedVelocity,
        "articulated_position": ArticulatedPosition,
        "articulated_acceleration": ArticulatedAcceleration,
        "pedestrian": Pedestrian,
    }
    return made[name](profile, held_object_m=held_m)


@lru_cache(maxsize=64)
def _cached_model(name: str, profile: str, left: LeftOut, held_m: float) -> OptionModel:
    return _option_model(name, left.profile(_profiles()[profile]), left.held(held_m))


@cache
def _buffer(large: bool) -> Block:
    return new_reach_sets() if large else new_people_sets()


def _told(people: Block, plan: Block, left: LeftOut) -> tuple[Block, Block]:
    told = people.copy(), plan.copy()
    left.data(*told)
    return told


def _settle(worst: Array, open_cases: Array, out: Block) -> Array:
    """The worst case, those that were left undecided included: their distances are computed otherwise."""
    rows = out[0]
    for case in open_cases[1 : 1 + int(open_cases[0, 0])]:
        row = int(case[0])
        hull = rows["points"][row, : rows["n_points"][row]]
        case[EXCESS] = min(case[EXCESS], distance_to_hull(hull, case[1:4]) - case[4])  # both are attained
        if not case[EXCESS] <= worst[EXCESS]:
            worst = case
    return worst


def _words(worst: Array, seed: int, where: str) -> str:
    if worst[EXCESS] == -math.inf:
        return f"seed {seed}, {where}"
    of_slice, person, part = (int(x) for x in worst[6:9])
    what = PART_NAMES[part] if part >= 0 else "point"
    return (
        f"seed {seed}, {where}: {what} of {person} at ({worst[1]:.6f}, {worst[2]:.6f}, {worst[3]:.6f}) m, "
        f"slice {of_slice}, t = {worst[9]:.6f} s"
    )


def _bodies_trial(name: str) -> Trial:
    """Whole bodies against a model whose rows are hulls of measured points."""
    accelerated = name == "articulated_acceleration"

    def trial(seed: int, aligned: bool, left: LeftOut = WHOLE) -> Outcome:
        rng = np.random.default_rng(seed)
        chosen = str(rng.choice(BY_ACCELERATION if accelerated else BY_SPEED))
        profile, held = _profiles()[chosen], float(rng.choice([0.0, HELD_M]))
        level = unit(rng, 1)[0] * (1.0, 1.0, 0.0)
        if accelerated:
            crowd = accelerating(rng, profile, aligned=aligned, without=left.velocity)
        else:
            crowd = bodies(
                rng,
                profile,
                aligned=aligned,
                along=level / np.linalg.norm(level) if name == "pedestrian" else None,
            )
        model = _cached_model(name, chosen, left, held)
        out = _buffer(False)
        model.occupy(*_told(crowd.people, crowd.plan, left), out)
        worst, covered = _worst_body(rng, crowd, out, profile, held)
        if left is WHOLE and name in ("iso13855", "articulated_velocity", "pedestrian"):
            assert (covered == ALL_PARTS).all(), "whoever was seen has rows for all parts"
        everywhere = np.bitwise_and.reduce(covered, axis=0)
        parts = int(np.bitwise_count(everywhere).sum())
        motions = parts // MAX_PARTS if name == "pedestrian" else parts
        return Outcome(float(worst[EXCESS]), motions, _words(worst, seed, chosen))

    return trial


def _worst_body(
    rng: np.random.Generator, crowd: Crowd, out: Block, profile: Profile, held: float
) -> tuple[Array, NDArray[np.uint32]]:
    flesh = THINNER * profile.radius
    flesh[list(HANDS)] += held * THINNER
    covered = np.zeros((SLICES, MAX_PEOPLE), np.uint32)
    open_cases = np.zeros((MOST_OPEN, OPEN_WIDTH))
    anatomy = ENDS, HAND_POINTS, flesh
    worst = worst_of_bodies(rng, out, crowd.at, crowd.times, anatomy, covered, open_cases)
    return _settle(worst, open_cases, out), covered


def _arms_trial(seed: int, aligned: bool, left: LeftOut = WHOLE) -> Outcome:
    rng = np.random.default_rng(seed)
    crowd = arms(rng, aligned=aligned)
    held = float(rng.choice([0.0, HELD_M]))
    profile = left.profile(crowd.profile)
    people, plan = _told(crowd.people, crowd.plan, left)
    out = _buffer(True)
    ArmReach(profile, held_object_m=left.held(held)).occupy(people, plan, out)
    if left.twin:
        out = _twin_rows(out, crowd, left.twin, held)
    radius = crowd.profile.radius
    flesh = THINNER * radius[Part.L_FOREARM], THINNER * (radius[Part.L_HAND] + held)
    covered = np.zeros((SLICES, MAX_PEOPLE), np.uint32)
    open_cases = np.zeros((MOST_OPEN, OPEN_WIDTH))
    worst = worst_of_arms(rng, out, crowd.at, crowd.times, BITS, flesh, covered, open_cases)
    worst = _settle(worst, open_cases, out)
    everywhere = np.bitwise_and.reduce(covered, axis=0)
    motions = int(sum((everywhere >> side[2] & 1).sum() for side in BITS))
    return Outcome(float(worst[EXCESS]), motions, _words(worst, seed, crowd.kind))


def _twin_rows(out: Block, crowd: ArmCrowd, without: str, held: float) -> Block:
    """The same rows as a twin has them that leaves out one term; where it has none, neither are there any."""
    made = out.copy()
    rows = made[0]
    for row in range(int(rows["n"])):
        covers, k, i = (int(rows[name][row]) for name in ("covers", "owner", "slice"))
        side = 0 if covers & sum(1 << int(bit) for bit in BITS[0]) else 1
        twin = Twin(crowd.profile, crowd.people[0], crowd.plan[0], k, side, float, frozenset({without}))
        hand = covers >> int(BITS[side, 2]) & 1
        found = twin.sound(i)
        if found is None:
            rows["covers"][row] = 0
            continue
        points = np.array(found[0], dtype=float)
        rows["points"][row, : len(points)], rows["n_points"][row] = points, len(points)
        rows["radius"][row] = found[1] + twin.radii()[hand] + held * hand
    return made


ENTERING = 1000
"""Motions of a trial of unobserved space, of which those that began inside are dropped."""


def _unobserved_trial(seed: int, aligned: bool, left: LeftOut = WHOLE) -> Outcome:
    rng = np.random.default_rng(seed)
    chosen = str(rng.choice(BY_SPEED))
    profile = _profiles()[chosen]
    made = entering(rng, profile, ENTERING, aligned=aligned)
    model = UnobservedSpace(left.monitored(made.watched), left.profile(profile))
    out = _buffer(False)
    model.occupy(*_told(made.people, made.plan, left), out)
    assert out["n"][0] == SLICES * len(made.watched.region.offset)
    worst = worst_of_entering(out, made.at, made.times)
    return Outcome(float(worst[EXCESS]), made.at.shape[2], _words(worst, seed, chosen))


def _frame_trial(seed: int, aligned: bool, left: LeftOut = WHOLE) -> Outcome:
    """A person seen by a sensor that is not quite where and what it is said to be, against e_p of the gate.

    With the declared pose (R, p), the true one (R', p') and an own error d, what is seen at s is truly at
    R' (s - d) + p'.
    """
    rng = np.random.default_rng(seed)
    place, turn = rng.uniform(-3.0, 3.0, 3), float(rng.uniform(0.0, 0.1))
    shift, own = rng.uniform(0.0, 0.05, 2) * rng.choice([0.0, 1.0, 1.0], 2)
    declared = SensorFrame(_rotation(unit(rng, 1)[0], rng.uniform(0.0, 3.0)), place, shift, turn)
    seen = (standing(*rng.uniform(-4.0, 4.0, 2)) - place) @ declared.rotation
    axis, way, towards = unit(rng, 1)[0], unit(rng, 1)[0], unit(rng, len(seen))
    if aligned:
        axis = np.cross(seen[Point.PELVIS], axis)
    true = _rotation(axis / np.linalg.norm(axis), turn * THINNER) @ declared.rotation
    chord = seen @ (true - declared.rotation).T
    if aligned:
        way = chord[Point.PELVIS] / np.linalg.norm(chord[Point.PELVIS])
        towards = chord + shift * way
        towards /= np.linalg.norm(towards, axis=1)[:, None]
    world = seen @ true.T + own * THINNER * towards + place + shift * THINNER * way
    settings = GateSettings(
        clock_error_s=0.0,
        stamp_error_s=0.0,
        position_error_m=left.own_error * own,
        frames={"sensor": left.frame(declared)},
    )
    gate = Gate(_profiles()["iso"], settings)
    gate.admit(report(0.0, ("a", seen), frame="sensor"), 0.0)
    record = gate.people[0]
    excess = np.linalg.norm(record["xyz"][0] - world, axis=1) - record["e_p"][0]
    return Outcome(float(excess.max()), len(seen), f"seed {seed}: {Point(int(excess.argmax())).name.lower()}")


def _rotation(axis: Array, angle: float) -> Array:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out: Array = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return out


TRIALS: dict[str, Trial] = {
    **{
        name: _bodies_trial(name)
        for name in (
            "iso13855",
            "articulated_velocity",
            "articulated_position",
            "articulated_acceleration",
            "pedestrian",
        )
    },
    "arm_reach": _arms_trial,
    "unobserved": _unobserved_trial,
    "frame of a sensor": _frame_trial,
}
"""The names are those of :data:`tests.occupancy.left_out.TERMS`."""
