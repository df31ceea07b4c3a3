"""Plain twins of the arm reach kernels, for floats and for python-flint's balls; terms can be left out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb

from occupancy.body import Part, Point, Profile
from occupancy.humans.arm_reach import extensions

Number = Any
"""float or arb"""
Vector = list[Number]
SIDES = "LR"
TRUNK = ((Point.PELVIS, Point.NECK_BASE), (Point.PELVIS, Point.THORAX), (Point.THORAX, Point.NECK_BASE))


def sin(x: Number) -> Number:
    return x.sin() if isinstance(x, arb) else math.sin(x)


def cos(x: Number) -> Number:
    return x.cos() if isinstance(x, arb) else math.cos(x)


def asin(x: Number) -> Number:
    return x.asin() if isinstance(x, arb) else math.asin(x)


def root(x: Number) -> Number:
    return x.sqrt() if isinstance(x, arb) else math.sqrt(x)


def atan2(y: Number, x: Number) -> Number:
    return arb.atan2(y, x) if isinstance(y, arb) else math.atan2(y, x)


def dot(a: Vector, b: Vector) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def size(a: Vector) -> Number:
    return root(dot(a, a))


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(*terms: tuple[Number, Vector]) -> Vector:
    return [sum((share * vector[i] for share, vector in terms), 0 * terms[0][1][i]) for i in range(3)]


@dataclass(frozen=True)
class Twin:
    """One arm of row k of a people record, on one slice; ``without`` names terms that are left out."""

    profile: Profile
    seen: np.void
    plan: np.void
    k: int
    side: int
    number: type
    without: frozenset[str] = frozenset()

    def pi(self) -> Number:
        return arb.pi() if self.number is arb else math.pi

    def term(self, name: str, value: Number) -> Number:
        return 0 * value if name in self.without else value

    def points(self) -> tuple[Point, Point, Point]:
        return tuple(Point[f"{SIDES[self.side]}_{name}"] for name in ("SHOULDER", "ELBOW", "WRIST"))

    def of(self, field: str, p: Point) -> Number:
        return self.number(float(self.seen[field][self.k, p]))

    def vector(self, field: str, p: Point) -> Vector:
        return [self.number(float(x)) for x in self.seen[field][self.k, p]]

    def offset(self, field: str) -> Vector:
        s, e, w = self.points()
        half = self.number(0.5)
        ends = plus((half, self.vector(field, e)), (half, self.vector(field, w)))
        return plus((1, ends), (-1, self.vector(field, s)))

    def error(self, field: str, name: str) -> Number:
        s, e, w = self.points()
        value = self.of(field, s) + (self.of(field, e) + self.of(field, w)) / 2
        return self.term(name, value)

    def span(self, i: int) -> tuple[Number, Number]:
        clock = self.number(float(self.seen["clock_error"]))
        stamp = self.number(float(self.seen["stamp_error"]))
        t = self.of("t_obs", self.points()[0])
        begin, end = (self.number(float(self.plan["t"][i + j])) for j in (0, 1))
        first, last = (self.number(float(x)) for x in self.plan["delay"])
        clock, stamp = self.term("clock", clock), self.term("stamp", stamp)
        if "stamp" in self.without:
            t = t + self.number(float(self.seen["stamp_error"]))
        if "delay" in self.without:
            first = last = 0 * first
        return begin + first - 2 * stamp - clock - t, end + last + clock - t

    def longest(self, i: int) -> Number:
        first, last = self.span(i)
        return max(abs(first), abs(last))

    def radii(self) -> tuple[Number, Number]:
        _, e, w = self.points()
        half = self.number(float(self.profile.chain[e, w])) / 2
        arm, hand = (self.number(float(self.profile.radius[part])) for part in (Part.L_FOREARM, Part.L_HAND))
        half = self.term("forearm", half)
        return half + arm, half + hand

    # ---------------------------------------------------------------------------------------- sound face

    def angle_of_ball(self, radius: Number, distance: Number) -> Number:
        return asin(radius / distance) if radius < distance else self.pi()

    def cone(self, i: int) -> tuple[Number, Number] | None:
        """Longest extension and half-angle."""
        arm, d, e = self.profile.arm, self.offset("xyz"), self.error("e_p", "e_p")
        r, longest = size(d), self.longest(i)
        speed = self.term("speed", self.number(arm.relative_speed))
        stretch = self.term("extension", min(self.number(arm.extension_speed), speed))
        low, high = (self.number(x) for x in extensions(self.profile, arm.elbow))
        low, high = max(low, r - e - stretch * longest), min(high, r + e + stretch * longest)
        e_ik = self.term("ik", e)
        turn = self.term("turn", self.number(arm.angular_speed))
        angle = min(
            self.angle_of_ball(e_ik, r) + turn * longest, self.angle_of_ball(e_ik + speed * longest, r)
        )
        e_v = self.error("e_v", "e_v")
        if np.isfinite([self.seen["e_v"][self.k, p] for p in self.points()]).all():
            v = self.offset("v")
            a = self.term("acceleration", self.number(arm.relative_acceleration))
            most = wide = self.number(0)
            for t in self.span(i):
                centre = plus((1, d), (t, v))
                grown = e + abs(t) * e_v + a * t * t / 2
                away = size(centre)
                most = max(most, away + grown)
                tilt = atan2(size(cross(d, centre)), dot(d, centre))
                wide = max(wide, tilt + self.angle_of_ball(grown, away))
            high, angle = min(high, most), min(angle, wide)
        return (high, angle) if low <= high else None

    def sound(self, i: int) -> tuple[list[Vector], Number] | None:
        """Points and radius without the body's."""
        found = self.cone(i)
        if found is None:
            return None
        r, angle = found
        s, d = self.points()[0], self.offset("xyz")
        shoulder = self.vector("xyz", s)
        growth = self.term("shoulder", self.number(float(self.profile.speed[s]))) * self.longest(i)
        growth = growth + self.term("e_p", self.of("e_p", s))
        sixty, thirty = self.pi() / 3, self.pi() / 6
        if not angle <= sixty:
            return [shoulder], growth + self.number(1.0623) * r
        rings = [(r / cos(angle / 2), angle / 2)]
        if angle > thirty:
            rings = [(r / cos(thirty / 2), thirty / 2), (r / cos((angle - thirty) / 2), (angle + thirty) / 2)]
        rings.append((r, angle))
        u = [x / size(d) for x in d]
        z = [self.number(x) for x in ((0, 0, 1) if abs(u[2]) < 0.9 else (1, 0, 0))]
        x = plus((1, z), (-dot(z, u), u))
        x = [c / size(x) for c in x]
        y = cross(u, x)
        points = [shoulder]
        for distance, theta in rings:
            beyond = 1 / cos(self.pi() / 10)
            if "corners" in self.without:
                distance, beyond = r, 1
            for j in range(10):
                phi = 2 * self.pi() * j / 10
                across = distance * sin(theta) * beyond
                corner = plus((distance * cos(theta), u), (across * cos(phi), x), (across * sin(phi), y))
                points.append(plus((1, shoulder), (1, corner)))
        return points, growth

    # ------------------------------------------------------------------------------------ published face

    def rounding(self) -> float:
        """How far [m] rounding may put a corner off: the first angle has no value along its axis."""
        frame, d = self.frame(), self.offset("xyz")
        if frame is None:
            return 0.0
        return 2e-11 + 4e-15 * float(size(d) / root(dot(frame[0], d) ** 2 + dot(frame[1], d) ** 2))

    def frame(self) -> list[Vector] | None:
        own, other = (Point[f"{SIDES[j]}_SHOULDER"] for j in (self.side, 1 - self.side))
        for low, high in TRUNK:
            there = all(
                int(self.seen["present"][self.k]) >> p & 1
                and self.seen["t_obs"][self.k, p] == self.seen["t_obs"][self.k, own]
                for p in (own, other, low, high)
            )
            if there:
                out = plus((1, self.vector("xyz", own)), (-1, self.vector("xyz", other)))
                out = [c / size(out) for c in out]
                down = plus((1, self.vector("xyz", low)), (-1, self.vector("xyz", high)))
                down = plus((1, down), (-dot(down, out), out))
                down = [c / size(down) for c in down]
                front = cross(down, out)
                return [down, front if self.side == 0 else [-c for c in front], out]
        return None

    def box(self, i: int, frame: list[Vector]) -> list[tuple[Number, Number]] | None:
        arm, pi, t = self.profile.arm, self.pi(), self.longest(i)
        d, v, e = self.offset("xyz"), self.offset("v"), self.error("e_p", "e_p")
        r = size(d)
        x, y, z = (dot(axis, d) for axis in frame)
        dx, dy, dz = (dot(axis, v) for axis in frame)
        flat = root(x * x + y * y)
        q1, q2 = atan2(y, x), atan2(z, flat)
        middle = (self.number(arm.flexion) - self.number(arm.extension)) / 2
        if abs(q1 - middle) > pi:
            q1 = q1 + 2 * pi if q1 < middle else q1 - 2 * pi
        e2 = self.angle_of_ball(e, r)
        e1 = self.angle_of_ball(sin(e2), flat / r) if e2 < pi / 2 else pi
        rates = [(dy * x - dx * y) / (flat * flat), (dz * r - z * dot(v, d) / r) / (r * flat), dot(v, d) / r]
        low, high = (self.number(length) for length in extensions(self.profile, arm.elbow))
        position = [
            (-self.number(arm.extension), self.number(arm.flexion)),
            (-min(self.number(arm.adduction), pi / 2), min(self.number(arm.abduction), pi / 2)),
            (low, high),
        ]
        speed = [arm.angular_speed, arm.angular_speed, arm.extension_speed]
        change = [arm.angular_acceleration, arm.angular_acceleration, arm.extension_acceleration]
        e_v = self.error("e_v", "e_v")
        with_velocity = (
            flat > 1e-6 and np.isfinite([self.seen["e_v"][self.k, p] for p in self.points()]).all()
        )
        e_rate = [e_v / flat, e_v / r, e_v] if with_velocity else []
        found = []
        for j, (q, width) in enumerate(zip((q1, q2, r), (e1, e2, e), strict=True)):
            reach = self.number(speed[j]) * t
            low, high = max(position[j][0], q - width - reach), min(position[j][1], q + width + reach)
            if with_velocity:
                spread = e_rate[j] * t + self.number(change[j]) * t * t / 2
                low = max(low, q - width + min(0 * t, rates[j] * t - spread))
                high = min(high, q + width + max(0 * t, rates[j] * t + spread))
            if not low <= high:
                return None
            drift = self.number(0.1) * t if j < 2 else 0 * t
            found.append((low - drift, high + drift))
        found[0] = (found[0][0], min(found[0][1], found[0][0] + 2 * pi))
        found[1] = (max(found[1][0], -pi / 2), min(found[1][1], pi / 2))
        return found

    def published(self, i: int) -> tuple[list[Vector], Number] | None:
        """Points and radius without the body's."""
        frame = self.frame()
        box = None if frame is None else self.box(i, frame)
        if box is None:
            return None
        (a1, b1), (a2, b2), (_, r) = box
        best = None
        for rows in range(2, 16):
            columns = 31 // rows
            steps = (b1 - a1) / (columns - 1), (b2 - a2) / (rows - 1)
            if all(step <= self.pi() for step in steps):
                sagitta = sum((1 - cos(step / 2) for step in steps), 0 * r)
                if best is None or sagitta < best[0] - 1e-9:
                    best = (sagitta, rows, columns)
        sagitta, rows, columns = best
        shoulder = self.vector("xyz", self.points()[0])
        points = [shoulder]
        for i2 in range(rows):
            q2 = a2 + (b2 - a2) * i2 / (rows - 1)
            for i1 in range(columns):
                q1 = a1 + (b1 - a1) * i1 / (columns - 1)
                joint = [r * cos(q2) * cos(q1), r * cos(q2) * sin(q1), r * sin(q2)]
                points.append(plus((1, shoulder), *zip(joint, frame, strict=True)))
        e_p = max(self.of("e_p", p) for p in self.points())
        return points, r * sagitta + e_p + 2 * self.longest(i)
