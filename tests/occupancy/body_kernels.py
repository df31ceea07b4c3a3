"""Compiled motions of bodies and points that use up the limits of a profile; nothing here is of the models.

A motion is a list of pieces: on piece i, from the instant t_i on, every point has the position x + h v + a
h² / 2 with h the time since t_i. Bodies with limbs: velocities are constant on a piece. Limbs whose
lengths are allowed at both ends of a piece are so in between, because the distance of two points that move
on lines is convex in time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tests.occupancy.inclusion_kernels import Array, Indices

LEAST = 1e-12
"""Lengths below this give no direction [m]."""
Skeleton = tuple[Indices, Array, Array]
"""Tree (20, 3): points in the order in which they are placed, each with its parent (-1: none) and another
point (-1: none) if it lies between the two; (persons, 20): greatest distance from the parent [m]; (persons,
20): share of the way from the parent to the other point."""
ROUNDING = 1e-11
"""A limb that is too long by no more is not torn [m]: what roundings of earlier pieces have left adds up.
What is tested with bodies is looked at to 1e-9 m."""
ALMOST = 1.0 - 1e-12
"""Limits are used up to this share, so that rounding exceeds none."""


@njit(cache=True, error_model="numpy")
def one_of(rng: np.random.Generator, options: tuple[float, ...]) -> float:
    """One of the options, each as likely as any other."""
    return options[int(rng.random() * len(options))]


@njit(cache=True, error_model="numpy")
def direction(rng: np.random.Generator, u: Array) -> None:
    """Write a random unit vector into ``u`` (3,)."""
    size = 0.0
    while not size > 1e-3:
        size = 0.0
        for axis in range(3):
            u[axis] = rng.standard_normal()
            size += u[axis] ** 2
    u /= np.sqrt(size)


@njit(cache=True, error_model="numpy")
def child_moves(start: Array, parent: Array, longest: float, far: float, u: Array, end: Array) -> bool:
    """Write where a point that moves by at most ``far`` [m] gets along ``u`` (3,): into ``end`` (3,).

    It ends within ``longest`` [m] of where its ``parent`` ends; if possible it moves by all of ``far``.
    False if there is no such point.
    """
    far, longest = far * ALMOST, longest * ALMOST
    apart = beyond = 0.0
    for axis in range(3):
        end[axis] = start[axis] + far * u[axis]
        beyond += (end[axis] - parent[axis]) ** 2
        apart += (parent[axis] - start[axis]) ** 2
    beyond, apart = np.sqrt(beyond), np.sqrt(apart)
    if beyond <= longest:
        return True
    if apart + longest <= far or apart < LEAST:  # all within reach of the parent is within reach of the point
        for axis in range(3):
            end[axis] = parent[axis] + longest * (end[axis] - parent[axis]) / beyond
        return True
    if not apart <= far + longest + ROUNDING:
        return False
    along = min((apart * apart + far * far - longest * longest) / (2.0 * apart), far)
    across, dot = np.sqrt(max(0.0, far * far - along * along)), 0.0
    n, side = np.empty(3), np.empty(3)
    for axis in range(3):
        n[axis] = (parent[axis] - start[axis]) / apart
        dot += n[axis] * u[axis]
    size = 0.0
    for axis in range(3):
        side[axis] = u[axis] - dot * n[axis]
        size += side[axis] ** 2
    size = np.sqrt(size)
    if size < 1e-6:
        least = 0 if abs(n[0]) < 0.6 else 1
        size = np.sqrt(1.0 - n[least] ** 2)
        for axis in range(3):
            side[axis] = (1.0 if axis == least else 0.0) - n[least] * n[axis]
    for axis in range(3):
        end[axis] = start[axis] + along * n[axis] + across * side[axis] / size
    return True


@njit(cache=True, error_model="numpy")
def shape_bodies(rng: np.random.Generator, skeleton: Skeleton, along: Array, x: Array) -> None:
    """Write bodies whose limbs often have their greatest lengths into ``x`` (persons, 20, 3) [m].

    With ``along`` (3,) all limbs lie along that direction at their greatest lengths; branches of the tree go
    forth or back.
    """
    tree, longest, between = skeleton
    u, sign, children = np.empty(3), np.ones(20), np.zeros(20, np.int64)
    for row in range(tree.shape[0]):
        if tree[row, 1] >= 0 and tree[row, 2] < 0:
            children[tree[row, 1]] += 1
    aligned = along[0] ** 2 + along[1] ** 2 + along[2] ** 2 > 0.0
    for k in range(x.shape[0]):
        full = rng.random()
        for row in range(tree.shape[0]):
            p, parent, other = tree[row]
            direction(rng, u)
            if aligned:
                if parent < 0 or children[parent] > 1:
                    sign[p] = one_of(rng, (-1.0, 1.0))
                else:
                    sign[p] = sign[parent]
                u[:] = sign[p] * along
            if parent < 0:
                for axis in range(3):
                    x[k, p, axis] = rng.uniform(-2.0, 2.0)
            elif other >= 0:
                x[k, p] = (1.0 - between[k, p]) * x[k, parent] + between[k, p] * x[k, other]
            else:
                length = longest[k, p] * ALMOST
                if not aligned and rng.random() > full:
                    length *= rng.uniform(0.2, 1.0)
                for axis in range(3):
                    x[k, p, axis] = x[k, parent, axis] + length * u[axis]


@njit(cache=True, error_model="numpy")
def move_bodies(
    rng: np.random.Generator,
    t: Array,
    skeleton: Skeleton,
    speed: Array,
    along: Array,
    x: Array,
    v: Array,
) -> int:
    """Move bodies at full speed in directions that change at once; return how many moves were not possible.

    ``t`` (B + 1,) [s]: when they change; ``speed`` (persons, 20) [m/s]; ``x`` and ``v`` (persons, B, 20,
    3) become the pieces, ``x[:, 0]`` is given; otherwise as :func:`shape_bodies`. Some persons move as a
    whole, in some every point has its own direction; some points rest for a while.
    """
    tree, longest, between = skeleton
    aligned = along[0] ** 2 + along[1] ** 2 + along[2] ** 2 > 0.0
    u, way, end = np.empty(3), np.empty((20, 3)), np.empty((20, 3))
    failed = 0
    for k in range(x.shape[0]):
        whole, change = rng.random() < 0.3, one_of(rng, (0.0, 0.3, 1.0))
        idle = one_of(rng, (0.0, 0.0, 0.3))
        for i in range(x.shape[1]):
            h = t[i + 1] - t[i]
            direction(rng, u)
            for row in range(tree.shape[0]):
                p, parent, other = tree[row]
                if aligned:
                    way[p] = along
                elif i == 0 or rng.random() < change:
                    if whole:
                        way[p] = u
                    else:
                        direction(rng, way[p])
                far = speed[k, p] * h
                if other >= 0:
                    end[p] = (1.0 - between[k, p]) * end[parent] + between[k, p] * end[other]
                elif parent < 0:
                    end[p] = x[k, i, p] + far * ALMOST * way[p]
                else:
                    rests = not aligned and rng.random() < idle
                    done = rests and child_moves(x[k, i, p], end[parent], longest[k, p], 0.0, way[p], end[p])
                    if not done and not child_moves(
                        x[k, i, p], end[parent], longest[k, p], far, way[p], end[p]
                    ):
                        failed += 1
            for p in range(20):
                v[k, i, p] = (end[p] - x[k, i, p]) / h
                if i + 1 < x.shape[1]:
                    x[k, i + 1, p] = end[p]
    return failed


@njit(cache=True, error_model="numpy")
def accelerate_points(
    rng: np.random.Generator, t: Array, speed: Array, limit: Array, along: Array, x: Array, v: Array, a: Array
) -> None:
    """Move points with full acceleration in directions that change at once, up to full speed.

    ``t`` (B + 1,) [s]; ``speed`` [m/s] and ``limit`` [m/s²] (n,); ``x``, ``v``, ``a`` (n, B, 3) become the
    pieces, ``x[:, 0]`` is given. A piece that would end too fast has as much of the acceleration as the
    speed allows: a ball of velocities is convex. With ``along`` (3,) all motion is along that direction,
    from some speed against it on.
    """
    aligned = along[0] ** 2 + along[1] ** 2 + along[2] ** 2 > 0.0
    u = np.empty(3)
    for n in range(x.shape[0]):
        change = one_of(rng, (0.0, 0.2, 1.0))
        direction(rng, u)
        begin = speed[n] * rng.random()
        if aligned:
            u[:] = along
            begin = -speed[n] * one_of(rng, (0.0, 0.5, 1.0))
        v[n, 0] = begin * ALMOST * u
        if not aligned:
            direction(rng, u)
        for i in range(x.shape[1]):
            h = t[i + 1] - t[i]
            if not aligned and rng.random() < change:
                direction(rng, u)
            step = limit[n] * h * ALMOST
            square = along_u = 0.0
            for axis in range(3):
                square += v[n, i, axis] ** 2
                along_u += v[n, i, axis] * u[axis]
            room = (speed[n] * ALMOST) ** 2 - square
            most = -along_u + np.sqrt(max(0.0, along_u * along_u + max(0.0, room)))
            step = min(step, max(0.0, most) * ALMOST)
            a[n, i] = step / h * u
            if i + 1 < x.shape[1]:
                x[n, i + 1] = x[n, i] + h * v[n, i] + 0.5 * h * h * a[n, i]
                v[n, i + 1] = v[n, i] + h * a[n, i]


@njit(cache=True, error_model="numpy")
def places(t: Array, x: Array, v: Array, a: Array, when: Array, place: Array, velocity: Array) -> None:
    """Write where points are, and how fast: ``place`` [m] and ``velocity`` [m/s], both (n, m, 3).

    Pieces ``x``, ``v``, ``a`` (n, B, 3) from ``t`` (B + 1,) on; ``when`` (n, m) [s].
    """
    for n in range(x.shape[0]):
        for m in range(when.shape[1]):
            i = min(max(int(np.searchsorted(t, when[n, m], side="right")) - 1, 0), x.shape[1] - 1)
            h = when[n, m] - t[i]
            for axis in range(3):
                place[n, m, axis] = x[n, i, axis] + h * v[n, i, axis] + 0.5 * h * h * a[n, i, axis]
                velocity[n, m, axis] = v[n, i, axis] + h * a[n, i, axis]
