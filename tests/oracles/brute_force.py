"""Can anybody touch a moving link? Brute force over time, surface points and people who run at their fastest.

Shares nothing with the checked software: its arm, meshes, kinematics and bodies are its own, and only arrays
come in. It never says that something is impossible, only that it found nothing; every contact it reports is
one that a person within the assumptions can bring about, and :func:`chase` shows it by moving that person.

What counts is contact with a link that is faster than it may be there: than one speed [m/s] wherever it is
touched, or than a speed for each link (L,) by the name of the part that it touches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tests.oracles.approach_search import Body, Search, in_order
from tests.oracles.situation import Approach, Contact, Motion, Person
from tests.oracles.urdf_arm import Arm

Array = NDArray[np.float64]


Allowed = float | Mapping[str, Array]
"""How fast links may be [m/s]: all of them, or each (L,) by the name of the part that it touches."""


def speeds(arm: Arm, motion: Motion) -> Array:
    """Speed (L, T) [m/s] of the fastest probe of each link: the less of just before and just after.

    Where a link becomes slower at an instant, a person may come near only after it has.
    """
    rotations, positions = arm.poses(motion.q, motion.free)
    step = np.diff(motion.time)
    found = np.empty((len(arm.links), len(motion.time)))
    for link, probes in enumerate(arm.probes):
        places = probes @ np.swapaxes(rotations[link], -1, -2) + positions[link][:, None]
        between = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1) / step
        found[link, 0], found[link, -1] = between[0], between[-1]
        found[link, 1:-1] = np.minimum(between[:-1], between[1:])
    return found


def too_fast(arm: Arm, motion: Motion, parts: Sequence[str], allowed: Allowed) -> NDArray[np.bool_]:
    """Whether (K, L, T) a link is faster than it may be when it touches each of ``parts`` (K names)."""
    speed = speeds(arm, motion)
    if not isinstance(allowed, Mapping):
        return np.broadcast_to(speed > allowed, (len(parts), *speed.shape))
    limits = np.stack([allowed[part] for part in parts])
    return speed > limits[:, :, None]


def nearest_approach(
    arm: Arm, motion: Motion, people: Sequence[Person], allowed: Allowed, *, below: float = np.inf
) -> Approach | None:
    """Search all links that are too fast, surface points, instants, people and parts for the smallest slack.

    Groups of points, then the clusters in them, then the points are taken in the order of a lower bound of
    their slack, until the bound exceeds the best found. None if nothing is faster than ``allowed`` or nothing
    below ``below`` [m].

    Raises
    ------
    ValueError
        If a number is not finite: nothing can be found then, and that must not look like a result.
    """
    _check_finite(motion, people, allowed)
    bodies = [
        Body(np.broadcast_to(p.points, (len(motion.time), *p.points.shape)), p.growth(motion.time), p.parts)
        for p in people
    ]
    return _search(arm, motion, bodies, allowed, below)


def _search(
    arm: Arm, motion: Motion, bodies: Sequence[Body], allowed: Allowed, below: float
) -> Approach | None:
    search = Search(arm, motion, bodies, below)
    counts = too_fast(arm, motion, [part.name for _, part in search.parts], allowed)
    counts = counts[:, arm.clusters.group_link]
    groups, samples = np.nonzero(counts.any(axis=0))
    if len(groups) == 0:
        return None
    bounds = search.group_bounds(groups, samples)
    bounds[~counts[:, groups, samples].T] = np.inf
    groups, samples, parts = (
        np.repeat(groups, bounds.shape[1]),
        np.repeat(samples, bounds.shape[1]),
        np.tile(np.arange(bounds.shape[1]), len(groups)),
    )
    bounds = bounds.ravel()
    for chosen in in_order(bounds, search):
        search.open_groups(groups[chosen], samples[chosen], parts[chosen])
    return search.found


def _check_finite(motion: Motion, people: Sequence[Person], allowed: Allowed) -> None:
    used = [
        p
        for person in people
        for part in person.parts
        for p in (person.points[part.start], person.points[part.end])
    ]
    arrays = [
        motion.time,
        motion.q,
        *used,
        *(person.slack for person in people),
        *(person.seen for person in people),
        *(allowed.values() if isinstance(allowed, Mapping) else [np.array(allowed)]),
    ]
    if not all(np.isfinite(array).all() for array in arrays):
        raise ValueError("times, joint positions, people and speeds must be finite")
    if np.diff(motion.time).max(initial=0.0) > 1.001e-3:
        raise ValueError("a motion must be sampled at least once a millisecond")


def lean_towards(arm: Arm, motion: Motion, approach: Approach, error: Array) -> Array:
    """Joint error (n,), ``error`` (n,) with signs, that brings the found link point nearest to the body."""
    person_side = approach.body_point - approach.link_point
    link = arm.links.index(approach.link)
    q = motion.q[[approach.sample]]
    rotation, position = arm.poses(q, motion.free)
    local = rotation[link, 0].T @ (approach.link_point - position[link, 0])
    signs = np.empty(q.shape[1])
    for joint in range(q.shape[1]):
        moved = q.copy()
        moved[0, joint] += 1e-6
        rotation, position = arm.poses(moved, motion.free)
        step = rotation[link, 0] @ local + position[link, 0] - approach.link_point
        signs[joint] = 1.0 if step @ person_side >= 0.0 else -1.0
    return signs * error


def chase(arm: Arm, motion: Motion, person: Person, approach: Approach, allowed: Allowed) -> Contact | None:
    """Move the person straight to where ``approach`` says that a link can be met; report the deepest contact.

    From the start, every point is off its measured place by at most its slack; then it runs at full speed
    towards the meeting point and halts where the part's surface gets there. Contact means that a surface
    point of a link that is faster than ``allowed`` lies within the flesh of a part at the same instant.
    """
    part, share = approach.part, approach.share
    direction = approach.link_point - approach.body_point
    distance = float(np.linalg.norm(direction))
    direction = direction / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
    reach = person.growth(np.array([approach.time]))[0]
    needed = max(distance - part.radius, 0.0)
    available = (1.0 - share) * reach[part.start] + share * reach[part.end]
    stop = reach * min(1.0, needed / available) if available > 0.0 else np.zeros_like(reach)
    travelled = np.minimum(person.growth(motion.time), stop)
    step = np.diff(motion.time)[:, None]
    fastest = float((np.diff(travelled, axis=0) / step).max(initial=0.0))
    if (np.diff(travelled, axis=0) > person.speed * step + 1e-9).any():
        raise AssertionError(f"the simulated person moves at {fastest} m/s, faster than {person.speed} m/s")
    ends = person.points + travelled[..., None] * direction
    body = Body(ends, np.zeros(ends.shape[:2]), person.parts)
    met = _search(arm, motion, [body], allowed, 1e-9)
    return None if met is None else Contact(met.time, met.link, met.part.name, -met.slack, fastest)
