"""What goes wrong between people and the gate, put into recorded motion on purpose.

Independent of the gate: the recorded points are the truth, a report says what a sensor with a bounded error
makes of them, and a fault spoils reports. Afterwards the recorded bodies, flesh included, are held against
the rows that a model writes, whosever they are and whatever part they call it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point, Profile, load_profile
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.unobserved import UnobservedSpace
from occupancy.measurement import Gate, RawMeasurement, RawPerson
from occupancy.region import Monitored, Region
from occupancy.report import GateSettings
from occupancy.sets import distance_to_hull
from robots.motion import new_slices
from tests.occupancy.moving_people import HANDS, SEGMENTS, unit

Array = NDArray[np.float64]
Reports = list[RawMeasurement]

E_P = 0.005
DETECTION_S = 0.05
HORIZONS_S = (0.0, 0.1, 0.25)
WINDOW_S, LOOK_AHEAD_S = 1.2, 0.3
FAULT_S = (0.4, 0.8)
"""Begin and end of a fault in its window [s]."""
SHORT_S = 0.08
"""How long somebody may be somewhere else in reports, before they can have walked there [s]."""
BESIDE_M = 1.5
PAIRS = [(point, Point["R" + point.name[1:]]) for point in Point if point.name.startswith("L_")]
ARM = ("SHOULDER", "ELBOW", "WRIST", "HAND", "FINGERTIP")
HAND_FLESH_M = 0.03


@dataclass(frozen=True)
class Scene:
    """Two people over a window: stamps (T,) [s], points (2, T, 20, 3) [m], and what may be believed."""

    t: Array
    truth: Array
    profile: Profile
    monitored: tuple[Monitored, ...]

    @property
    def spoilt(self) -> range:
        """Numbers of the reports that a fault may spoil."""
        first, last = np.searchsorted(self.t - self.t[0], FAULT_S)
        return range(int(first), int(last))

    @property
    def shortly(self) -> range:
        """Numbers of the reports that may put somebody somewhere else."""
        begin = self.spoilt.start
        return range(begin, int(np.searchsorted(self.t, self.t[begin] + SHORT_S)))


def scene(rng: np.random.Generator, t: Array, xyz: Array) -> Scene | None:
    """Cut a window out of a clip (T,), (T, 20, 3), and put the same motion, a little later, beside it.

    ``None``: the window shows nobody, or somebody faster than 8 m/s, which is a glitch of the recording.
    """
    step = float(np.median(np.diff(t)))
    length, lag = round((WINDOW_S + LOOK_AHEAD_S) / step), round(0.1 / step)
    if len(t) < length + lag + 1:
        return None
    begin = int(rng.integers(len(t) - length - lag))
    beside = BESIDE_M * np.array([np.cos(a := rng.uniform(0.0, 6.28)), np.sin(a), 0.0])
    first = xyz[begin : begin + length]
    truth = np.array([first, xyz[begin + lag : begin + lag + length] + beside])
    clock = t[begin : begin + length]
    speed = _speeds(clock, truth)
    if not np.isfinite(truth[:, 0]).any() or speed.max() > 8.0:
        return None
    for left, right in PAIRS:
        speed[[left, right]] = max(speed[left], speed[right])
    return Scene(clock, truth, _profile(1.001 * speed + 0.05), _region(truth, float(speed.max())))


def _speeds(t: Array, truth: Array) -> Array:
    """Greatest speed (20,) [m/s] between successive appearances of each point."""
    out = np.zeros(MAX_POINTS)
    for body in truth:
        for p in range(MAX_POINTS):
            seen = np.flatnonzero(np.isfinite(body[:, p, 0]))
            moved = np.linalg.norm(np.diff(body[seen, p], axis=0), axis=1)
            out[p] = max(out[p], float((moved / np.diff(t[seen])).max(initial=0.0)))
    return out


def _profile(speed: Array) -> Profile:
    """A profile with the speeds of a window, and limbs that are long enough for everybody."""
    base = load_profile("extreme")
    limits = base.limits.copy()
    limits["speed"], limits["acceleration"] = speed, np.inf
    limits["chain"] *= 1.5
    limits["limb_max"] *= 1.5
    limits["limb_min"] /= 1.5
    return replace(base, speed=speed, chain=1.5 * base.chain, limits=limits)


def _region(truth: Array, speed: float) -> tuple[Monitored, ...]:
    """A box with both people so deep inside that they cannot have left within a second."""
    room = 1.3 * speed + 1.0
    low, high = np.nanmin(truth, axis=(0, 1, 2)) - room, np.nanmax(truth, axis=(0, 1, 2)) + room
    return (Monitored("cell", Region.box(low, high), DETECTION_S),)


def reports(rng: np.random.Generator, of: Scene) -> Reports:
    """What a sensor says, each point within its error, everybody in every report."""
    out = []
    for i, stamp in enumerate(of.t):
        people = tuple(person(rng, name, of.truth[k, i]) for k, name in enumerate("ab"))
        out.append(RawMeasurement(float(stamp), float(stamp), "world", True, people))
    return out


def person(rng: np.random.Generator, name: str, xyz: Array) -> RawPerson:
    seen = xyz + E_P * rng.random((MAX_POINTS, 1)) * unit(rng, MAX_POINTS)
    return RawPerson(name, seen, np.full(MAX_POINTS, np.nan), _mask(seen))


def _mask(xyz: Array) -> int:
    return sum(1 << int(p) for p in np.flatnonzero(np.isfinite(xyz).all(axis=1)))


# ----------------------------------------------------------------------------------------------------- faults

Fault = Callable[[np.random.Generator, Scene, Reports], Reports]


def _changed(
    report: RawMeasurement, change: Callable[[RawPerson], RawPerson], name: str = "a"
) -> RawMeasurement:
    return report._replace(people=tuple(change(p) if p.id == name else p for p in report.people))


Change = Callable[[int, RawMeasurement], RawMeasurement]


def _each(of: Scene, said: Reports, change: Change, when: range | None = None) -> Reports:
    spoilt = of.spoilt if when is None else when
    return [change(i, report) if i in spoilt else report for i, report in enumerate(said)]


def _points(
    change: Callable[[np.random.Generator, Array], Array], *, every: int = 1, shortly: bool = False
) -> Fault:
    """Change the coordinates of person a in every so many reports."""

    def fault(rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
        def spoil(i: int, report: RawMeasurement) -> RawMeasurement:
            if i % every:
                return report
            return _changed(report, lambda p: p._replace(xyz=change(rng, p.xyz.copy())))

        return _each(of, said, spoil, of.shortly if shortly else None)

    return fault


def _some(value: float) -> Callable[[np.random.Generator, Array], Array]:
    def change(rng: np.random.Generator, xyz: Array) -> Array:
        xyz[(rng.random(MAX_POINTS) < 0.3) & np.isfinite(xyz[:, 0])] = value
        return xyz

    return change


def _outlier(rng: np.random.Generator, xyz: Array) -> Array:
    xyz[rng.choice(np.flatnonzero(np.isfinite(xyz[:, 0])))] += 1.5 * unit(rng, 1)[0]
    return xyz


def _exchange(*names: str) -> Callable[[np.random.Generator, Array], Array]:
    pairs = [pair for pair in PAIRS if not names or pair[0].name[2:] in names]

    def change(_rng: np.random.Generator, xyz: Array) -> Array:
        for left, right in pairs:
            xyz[[left, right]] = xyz[[right, left]]
        return xyz

    return change


def inferred(rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """The tracker makes points up, and says so."""

    def spoil(p: RawPerson) -> RawPerson:
        made_up = rng.random(MAX_POINTS) < 0.5
        xyz = np.where(made_up[:, None], p.xyz + rng.normal(size=(MAX_POINTS, 3)), p.xyz)
        return p._replace(xyz=xyz, measured=p.measured & ~sum(1 << int(q) for q in np.flatnonzero(made_up)))

    return _each(of, said, lambda _i, report: _changed(report, spoil))


def lost(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """No reports at all."""
    return [report for i, report in enumerate(said) if i not in of.spoilt]


def late(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Every second report comes after all others of the stretch."""
    held = [report for i, report in enumerate(said) if i in of.spoilt and i % 2]
    rest = [report for i, report in enumerate(said) if not (i in of.spoilt and i % 2)]
    at = sum(i not in of.spoilt or i % 2 == 0 for i in range(of.spoilt.stop))
    return [*rest[:at], *held, *rest[at:]]


def ahead(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Stamps lie half a second ahead."""
    return _each(of, said, lambda _i, report: report._replace(stamp=report.stamp + 0.5))


def stuck_clock(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Stamps do not advance while people move."""
    stamp = float(of.t[of.spoilt.start - 1])
    return _each(of, said, lambda _i, report: report._replace(stamp=stamp))


def frozen(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Stamps advance, coordinates do not."""
    people = said[of.spoilt.start - 1].people
    return _each(of, said, lambda _i, report: report._replace(people=people))


def frozen_arm(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """The tracker passes the last coordinates of one arm on."""
    arm = [Point[f"R_{name}"] for name in ARM]
    before = said[of.spoilt.start - 1].people[0].xyz[arm]

    def spoil(p: RawPerson) -> RawPerson:
        xyz = p.xyz.copy()
        xyz[arm] = before
        return p._replace(xyz=xyz, measured=_mask(xyz))

    return _each(of, said, lambda _i, report: _changed(report, spoil))


def split(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Arms are somebody else."""
    arms = [Point[f"{side}_{name}"] for side in "LR" for name in ARM]

    def spoil(_i: int, report: RawMeasurement) -> RawMeasurement:
        a, *others = report.people
        rest, limbs = a.xyz.copy(), np.full_like(a.xyz, np.nan)
        rest[arms], limbs[arms] = np.nan, a.xyz[arms]
        parts = (
            a._replace(xyz=rest, measured=_mask(rest)),
            a._replace(id="arms", xyz=limbs, measured=_mask(limbs)),
        )
        return report._replace(people=(*(p for p in parts if p.measured), *others))

    return _each(of, said, spoil)


def merged(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Two become one in the middle between both."""

    def spoil(_i: int, report: RawMeasurement) -> RawMeasurement:
        a, b = report.people
        return report._replace(
            people=(a._replace(xyz=0.5 * (a.xyz + b.xyz), measured=a.measured & b.measured),)
        )

    return _each(of, said, spoil, of.shortly)


def merged_parts(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Two become one with the legs of the other."""
    legs = [p for p in Point if p.name[2:] in ("HIP", "KNEE", "ANKLE")]

    def spoil(_i: int, report: RawMeasurement) -> RawMeasurement:
        a, b = report.people
        xyz = a.xyz.copy()
        xyz[legs] = b.xyz[legs]
        return report._replace(people=(a._replace(xyz=xyz, measured=_mask(xyz)),))

    return _each(of, said, spoil, of.shortly)


def left_out(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """A complete report lacks somebody who is there."""
    return _each(of, said, lambda _i, report: report._replace(people=report.people[:1]))


def new_name(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """The tracker loses somebody and finds them again under another name."""
    return _each(of, said, lambda _i, report: _changed(report, lambda p: p._replace(id="c")))


def names_exchanged(_rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Two persons have each other's names."""

    def spoil(_i: int, report: RawMeasurement) -> RawMeasurement:
        a, b = report.people
        return report._replace(people=(a._replace(id="b"), b._replace(id="a")))

    return _each(of, said, spoil)


def ghost(rng: np.random.Generator, of: Scene, said: Reports) -> Reports:
    """Somebody is there twice."""

    def spoil(_i: int, report: RawMeasurement) -> RawMeasurement:
        again = report.people[0]._replace(id="g", xyz=report.people[0].xyz + 1e-3 * unit(rng, MAX_POINTS))
        return report._replace(people=(*report.people, again))

    return _each(of, said, spoil)


FAULTS: dict[str, Fault] = {
    "none": lambda _rng, _of, said: said,
    "not a number": _points(_some(np.nan)),
    "zero": _points(_some(0.0)),
    "inferred": inferred,
    "outlier": _points(_outlier, every=7),
    "jump": _points(lambda _rng, xyz: xyz + np.array([2.0, 0.0, 0.0]), shortly=True),
    "millimetres": _points(lambda _rng, xyz: 1e3 * xyz),
    "kilometres": _points(lambda _rng, xyz: 1e-3 * xyz),
    "axes exchanged": _points(lambda _rng, xyz: xyz[:, [0, 2, 1]], shortly=True),
    "lost": lost,
    "late": late,
    "ahead": ahead,
    "stuck clock": stuck_clock,
    "frozen": frozen,
    "frozen arm": frozen_arm,
    "left and right": _points(_exchange()),
    "arms exchanged, now and then": _points(_exchange(*ARM), every=4),
    "wrists exchanged, now and then": _points(_exchange("WRIST"), every=4),
    "split": split,
    "merged": merged,
    "merged parts": merged_parts,
    "left out": left_out,
    "new name": new_name,
    "names exchanged": names_exchanged,
    "ghost": ghost,
}


# ----------------------------------------------------------------------------------------------------- check


@dataclass
class Outcome:
    """Greatest distance [m] of a body from all rows, how often it was looked, what was said."""

    worst: float = -np.inf
    looked: int = 0
    blocked: int = 0
    contradicted: int = 0
    refused: int = 0


def run(of: Scene, said: Reports, settings: GateSettings | None = None, every: int = 5) -> Outcome:
    """Admit the reports; after every so many hold later truth against what is believed."""
    gate = Gate(of.profile, settings or gate_settings(of))
    unobserved = [UnobservedSpace(each, of.profile, index=1) for each in of.monitored]
    models = (Iso13855(of.profile), *unobserved)
    blocks = [model.new_sets() for model in models]
    out, now = Outcome(), -np.inf
    for number, report in enumerate(said):
        now = max(now, report.arrived)
        found = gate.admit(report, now)
        out.refused += len(found.refusals)
        out.contradicted += bool(found.contradictions) or gate.contradicted
        if number % every or now < of.t[of.spoilt.start] or now > of.t[0] + WINDOW_S:
            continue
        for horizon in HORIZONS_S:
            i = int(np.searchsorted(of.t, now + horizon - 1e-9))
            plan = new_slices()
            plan["n"], plan["t"][0, :2] = 1, of.t[i]
            for model, block in zip(models, blocks, strict=True):
                model.occupy(gate.people, plan, block)
            out.looked += 1
            rows = gate.people[0]
            if gate.overflow or not rows["present"][: rows["n"]].all():
                out.blocked += 1
                continue
            for body in of.truth[:, i]:
                out.worst = max(out.worst, uncovered(*flesh(body, of.profile), blocks))
    return out


def gate_settings(of: Scene, **changes: object) -> GateSettings:
    values: dict[str, object] = {
        "clock_error_s": 0.0,
        "stamp_error_s": 0.0,
        "position_error_m": E_P,
        "monitored": of.monitored,
    }
    return GateSettings(**(values | changes))


def flesh(body: Array, profile: Profile) -> tuple[Array, Array]:
    """Centres (n, 3) and radii (n,) [m] of balls that the recorded body (20, 3) fills."""
    centres, radii = [], []
    ends = [(pair, float(profile.radius[part])) for part, pair in SEGMENTS.items()]
    for part, (wrist, _hand, tip) in HANDS.items():
        room = float(profile.radius[part]) - float(np.linalg.norm(body[wrist] - body[tip]))
        if room >= 0.0:  # else this hand is longer than the profile has it
            ends.append(((wrist, tip), min(HAND_FLESH_M, room)))
    for (a, b), radius in ends:
        centre = body[a] + np.array([[0.0], [0.5], [1.0]]) * (body[b] - body[a])
        if np.isfinite(centre).all():
            centres.append(centre)
            radii.append(np.full(3, radius))
    return np.concatenate(centres), np.concatenate(radii)


def uncovered(centres: Array, radii: Array, blocks: list[NDArray[np.void]]) -> float:
    """Greatest distance [m] by which a ball is outside of every row."""
    used = [(block["points"][0, :n], block["n_points"][0, :n], block["radius"][0, :n])
            for block in blocks if (n := int(block["n"][0]))]  # fmt: skip
    if not used:
        return np.inf
    points, counts, sizes = (np.concatenate(column) for column in zip(*used, strict=True))
    excess, nearest = _excess(centres, radii, points, counts, sizes)
    for c in np.flatnonzero(excess > 0.0):
        for r in nearest[c]:
            exact = distance_to_hull(points[r, : counts[r]], centres[c]) - sizes[r] + radii[c]
            excess[c] = min(excess[c], exact)
    return float(excess.max())


@njit(cache=True)
def _excess(
    centres: Array, radii: Array, points: Array, counts: NDArray[np.int32], sizes: Array
) -> tuple[Array, NDArray[np.int64]]:
    """By how much each ball is outside of every row at most, and the twelve rows that come nearest to it.

    Distances are those from the segments between a row's points: never below that from its hull.
    """
    excess, nearest = np.empty(len(centres)), np.empty((len(centres), min(12, len(sizes))), np.int64)
    for c in range(len(centres)):
        out = np.empty(len(sizes))
        for r in range(len(sizes)):
            far = np.inf
            for i in range(counts[r]):
                for j in range(i, counts[r]):
                    square = along = 0.0
                    for axis in range(3):
                        edge = points[r, j, axis] - points[r, i, axis]
                        square += edge * edge
                        along += edge * (centres[c, axis] - points[r, i, axis])
                    share = min(max(along / max(square, 1e-30), 0.0), 1.0)
                    off = 0.0
                    for axis in range(3):
                        at = points[r, i, axis] + share * (points[r, j, axis] - points[r, i, axis])
                        off += (centres[c, axis] - at) ** 2
                    far = min(far, np.sqrt(off))
            out[r] = far - sizes[r] + radii[c]
        excess[c] = out.min()
        nearest[c] = np.argsort(out)[: nearest.shape[1]]
    return excess, nearest
