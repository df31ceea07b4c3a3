"""Separation of the arm from people: broad phase, narrow phase, certificate.

A pair of rows is separated iff a direction n is found with ``min_B n.b - max_A n.a - radii - rounding >
margin``. Whatever proposes n - a segment witness, compiled GJK, coal, python-fcl - only a proof can be lost
by it. (docs/method.md, section 5.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy import kernels, ledger_kernels
from occupancy.engines import CoalEngine, Engine
from occupancy.sets import MAX_MODELS, MAX_PEOPLE, MAX_PEOPLE_SETS
from robots.enclosure import MAX_LINKS
from robots.errors import SetupError
from robots.motion import MAX_SLICES, Block

Array = NDArray[np.float64]

LEDGER: Final = np.dtype(
    [
        ("n_slices", np.int64),
        ("n_links", np.int64),
        ("n_people", np.int64),
        ("open", np.uint32, (MAX_SLICES, MAX_LINKS, MAX_PEOPLE)),
    ]
)
"""What is still to be proven: ``open[i, l, k]`` is the mask of canonical parts of people row k that have not
been proven apart from enclosure row l over slice i. Only the maker of a ledger sets bits; criteria clear
them."""

_PAIRS: Final = np.dtype(
    [
        ("offset", np.int64, (MAX_SLICES + 1,)),
        ("state", np.int8, (MAX_SLICES * MAX_LINKS * MAX_PEOPLE_SETS,)),
        ("gap", np.float64, (MAX_SLICES * MAX_LINKS * MAX_PEOPLE_SETS,)),
        ("link_ball", np.float64, (MAX_SLICES * MAX_LINKS, 5)),
        ("people_ball", np.float64, (MAX_SLICES * MAX_PEOPLE_SETS, 5)),
        ("written", np.uint32, (MAX_MODELS, MAX_PEOPLE)),
        ("blocked", np.uint32, (MAX_LINKS, MAX_MODELS, MAX_PEOPLE)),
        ("cleared", np.uint32, (MAX_LINKS, MAX_PEOPLE)),
        ("rows", np.int64, (MAX_LINKS,)),
    ]
)
_SCRATCH: Final = np.dtype(
    [
        ("ends", np.float64, (2, 3)),
        ("point_a", np.float64, (3,)),
        ("point_b", np.float64, (3,)),
        ("direction", np.float64, (3,)),
        ("gap", np.float64),
        ("attained", np.float64),
        ("n_simplex", np.int64),
        ("index", np.int64, (4, 2)),
        ("w", np.float64, (4, 3)),
        ("normal", np.float64, (3,)),
        ("weight", np.float64, (4,)),
    ]
)
_NEAREST: Final = np.dtype(
    [
        ("slice", np.int64),
        ("link", np.int64),
        ("link_row", np.int64),
        ("people_row", np.int64),
        ("person", np.int64),
        ("model", np.int64),
        ("parts", np.int64),
        ("gap", np.float64),
        ("direction", np.float64, (3,)),
        ("link_point", np.float64, (3,)),
        ("people_point", np.float64, (3,)),
    ]
)


class SeparationSettingError(SetupError):
    """A setting of the separation criterion that cannot be used."""


class Nearest(NamedTuple):
    """Answer of one check: the tightest pair when separated, else the nearest blocking pair of the first open
    slice.

    Attributes
    ----------
    separated:
        No bit is open after the check. True also when none was open before: who counts obligations is the
        caller.
    slice, link, people_row, person, model, parts:
        Slice, enclosure row, row of the people sets, row of the people block, model that wrote it, and the
        parts concerned. -1
        (and 0) when there is no such pair: nothing was to be proven, or an open part is in no row of that
        slice; then ``slice``, ``link`` and ``person`` name the first open obligation and ``people_row`` is
        -1.
    gap_m:
        Certified lower bound of the gap [m]; negative when the sets overlap, ``-inf`` when a row is not
        usable or missing, ``inf`` when nothing was to be proven.
    direction, link_point, people_point:
        Unit vector from the link to the person and the points (3,) [m] where both surfaces come closest; NaN
        when there is none.
    gjk_calls, unresolved:
        Calls of the engine, and pairs that remained undecided.
    disagreement_m:
        With ``cross_check``: by how much [m] the engines disagree most, with each other or with the certified
        bounds; NaN otherwise.
    """

    separated: bool
    slice: int
    link: int
    people_row: int
    person: int
    model: int
    parts: int
    gap_m: float
    direction: Array
    link_point: Array
    people_point: Array
    gjk_calls: int
    unresolved: int
    disagreement_m: float


def new_ledger() -> Block:
    """Return a ledger without obligations."""
    return np.zeros(1, dtype=LEDGER)


def new_scratch() -> Block:
    """Return a block that the compiled distances work in."""
    return np.zeros(1, dtype=_SCRATCH)


def open_obligations(ledger: Block, n_slices: int, n_links: int, parts: Sequence[int]) -> None:
    """Open, for every slice and link, the parts ``parts[k]`` (mask) of each people row k.

    Raises
    ------
    SeparationSettingError
        When there are more slices, links or people rows than a ledger holds.
    """
    for name, number, most in (
        ("slices", n_slices, MAX_SLICES),
        ("links", n_links, MAX_LINKS),
        ("people rows", len(parts), MAX_PEOPLE),
    ):
        if not 0 <= number <= most:
            raise SeparationSettingError(f"a ledger holds 0 to {most} {name}, not {number}")
    book = ledger[0]
    book["n_slices"], book["n_links"], book["n_people"] = n_slices, n_links, len(parts)
    book["open"][:] = 0
    book["open"][:n_slices, :n_links, : len(parts)] = np.asarray(parts, dtype=np.uint32)


class Separation:
    """The separation criterion on blocks of rows.

    Parameters
    ----------
    margin:
        A pair counts as separated when its certified gap exceeds this [m].
    engine:
        Narrow phase for what the compiled pass leaves undecided; coal when None.
    gjk_limit:
        Most calls of the engine until :meth:`renew`, nearest pair first; None: no limit.
    boxes_first:
        Prove what boxes around a whole person keep apart before pairs are looked at. Quicker; the gap of what
        is proven so is a lower bound, and not near the largest one.
    cross_check:
        A second engine: both are asked about every pair that comes near, and their largest disagreement is
        reported. The certificate still decides.

    Raises
    ------
    SeparationSettingError
        When the margin is not a finite length, or the limit is negative.
    """

    def __init__(
        self,
        margin: float = 1e-4,
        engine: Engine | None = None,
        gjk_limit: int | None = None,
        cross_check: Engine | None = None,
        boxes_first: bool = False,
    ) -> None:
        if not 0.0 <= margin < np.inf:
            raise SeparationSettingError(f"the margin must be finite and not negative, not {margin} m")
        if gjk_limit is not None and gjk_limit < 0:
            raise SeparationSettingError(f"the number of GJK calls must not be negative, not {gjk_limit}")
        self.margin = float(margin)
        self.engine: Engine = CoalEngine() if engine is None else engine
        self.gjk_limit = gjk_limit
        self._left = np.inf if gjk_limit is None else gjk_limit
        self.cross_check = cross_check
        self._pairs = np.zeros(1, dtype=_PAIRS)
        self._scratch = np.zeros(1, dtype=_SCRATCH)
        self._nearest, self._proven = _NO_PAIR.copy(), _NO_PAIR.copy()
        self._boxes_first = boxes_first
        self._boxes = np.zeros((MAX_PEOPLE + 1, 2, 3))
        self._by_boxes = np.zeros(3, dtype=np.int64)
        self._calls = self._unresolved = 0
        self._disagreement = np.nan

    def check(self, links: Block, people: Block, ledger: Block) -> Nearest:
        """Clear the bits of ``ledger`` that are proven; never sets one, never raises.

        For each slice, link and person a model proves the parts of all its rows less those of its rows that
        are not separated from every row of the link; one model suffices. Blocks that do not belong together
        (rows out of order, other numbers of slices) prove nothing.
        """
        self._calls, self._unresolved, self._disagreement = 0, 0, np.nan
        coarse = self._prove_by_boxes(links, people, ledger) if self._boxes_first else None
        if coarse is not None and not ledger_kernels.anything_open(ledger):
            return coarse
        found = self._check_pairs(links, people, ledger)
        if coarse is not None and found.separated and coarse.gap_m < found.gap_m:
            return coarse._replace(gjk_calls=self._calls)
        return found

    def _prove_by_boxes(self, links: Block, people: Block, ledger: Block) -> Nearest | None:
        """Clear what boxes keep apart; return the tightest gap among it, if any."""
        where = self._by_boxes
        gap = ledger_kernels.prove_apart(links, people, ledger, self.margin, self._boxes, where)
        if not gap < np.inf:
            return None
        return Nearest(
            True, int(where[0]), int(where[1]), -1, int(where[2]), -1, 0, gap, *_NO_POINTS, 0, 0, np.nan
        )

    def _check_pairs(self, links: Block, people: Block, ledger: Block) -> Nearest:
        """Look at every pair that something open depends on."""
        _copy(_NO_PAIR, self._nearest)
        _copy(_NO_PAIR, self._proven)
        undecided = kernels.classify(links, people, ledger, self.margin, self._pairs, self._scratch)
        if undecided < 0:
            return self._uncovered(ledger)
        n_slices = int(ledger[0]["n_slices"])
        if self.cross_check is not None:
            self._disagreement = self._compare_engines(links, people, self.cross_check)
        if undecided > 0:
            self._resolve(links, people, ledger)
            self._unresolved = undecided - self._calls
        first_open = self._settle(links, people, ledger, 0, n_slices)
        if first_open < 0:
            return self._answer(self._nearest, True)
        _copy(self._nearest, self._proven)
        return self._left_open(links, people, ledger, first_open)

    def renew(self) -> None:
        """Allow as many calls of the engine again as the limit says."""
        self._left = np.inf if self.gjk_limit is None else self.gjk_limit

    def proven(self) -> Nearest:
        """Return the tightest pair that proved something in the last check, if that left something open.

        Its gap is infinite when nothing was proven.
        """
        return self._answer(self._proven, False)

    def _settle(self, links: Block, people: Block, ledger: Block, begin: int, end: int) -> int:
        return int(
            kernels.settle(links, people, ledger, begin, end, self._pairs, self._scratch, self._nearest)
        )

    def _resolve(self, links: Block, people: Block, ledger: Block) -> None:
        """Ask the engine about undecided pairs."""
        n_slices = int(ledger[0]["n_slices"])
        state, offset = self._pairs[0]["state"], self._pairs[0]["offset"]
        undecided = np.flatnonzero(state[: offset[n_slices]] == kernels.UNDECIDED)
        if self.gjk_limit is not None:
            nearest_first = undecided[np.argsort(self._pairs[0]["gap"][undecided], kind="stable")]
            for pair in nearest_first[: int(self._left)]:
                self._ask_engine(links, people, int(pair))
            return
        for pair in undecided:
            self._ask_engine(links, people, int(pair))

    def _ask_engine(self, links: Block, people: Block, pair: int) -> None:
        """Decide one pair by the certificate of the direction that the engine proposes."""
        a, b = self._rows_of(links, people, pair)
        gap, _ = self._engine_gap(links, people, a, b)
        work = self._pairs[0]
        work["gap"][pair] = np.fmax(gap, work["gap"][pair])
        work["state"][pair] = kernels.SEPARATED if gap > self.margin else kernels.OVERLAPPING
        self._calls += 1

    def _engine_gap(self, links: Block, people: Block, a: int, b: int) -> tuple[float, Array]:
        """Certified gap [m] and direction (3,) as proposed by the engine; NaN when it has none."""
        self._left -= 1
        direction, _ = self.engine.propose(_points(links, a), _points(people, b))
        gap = kernels.certified_gap(links, people, self._pairs, a, b, direction)
        return float(gap), direction

    def _rows_of(self, links: Block, people: Block, pair: int) -> tuple[int, int]:
        offset = self._pairs[0]["offset"]
        i = int(np.searchsorted(offset, pair, side="right")) - 1
        begin, end = (int(x) for x in people[0]["first"][i : i + 2])
        a, b = divmod(pair - int(offset[i]), end - begin)
        return int(links[0]["first"][i]) + a, begin + b

    def _compare_engines(self, links: Block, people: Block, second_engine: Engine) -> float:
        """Largest disagreement [m] of both engines and the certified brackets, over pairs that come near."""
        work, worst = self._pairs[0], 0.0
        n_pairs = int(work["offset"][-1])
        for pair in np.flatnonzero(work["state"][:n_pairs] != kernels.SKIPPED):
            a, b = self._rows_of(links, people, int(pair))
            if kernels.ball_gap(work["link_ball"][a], work["people_ball"][b]) <= self.margin:
                low, high = kernels.hull_distance(links, people, self._pairs, a, b, self._scratch)
                asked = (_points(links, a), _points(people, b))
                claimed = np.maximum(
                    0.0, [engine.propose(*asked)[1] for engine in (self.engine, second_engine)]
                )
                nearer, farther = claimed.min(), claimed.max()  # NaN stays, unlike with min and max
                off = float(np.max([low - nearer, farther - high, farther - nearer]))
                worst = max(worst, off) if off >= 0.0 else np.inf
        return worst

    def _left_open(self, links: Block, people: Block, ledger: Block, first_open: int) -> Nearest:
        """Answer with what blocks the first slice that is still open."""
        blocks = (links, people, ledger)
        if not kernels.blocking(*blocks, first_open, self._pairs, self._scratch, self._nearest):
            return self._uncovered(ledger)
        found, work = self._nearest[0], self._pairs[0]
        a, b = int(found["link_row"]), int(found["people_row"])
        radii = float(links[0]["radius"][a] + people[0]["radius"][b])
        usable = np.isfinite(work["link_ball"][a, 4] + work["people_ball"][b, 4])
        if usable and not found["gap"] + radii > 0.0:
            self._report_penetration(links, people, a, b)
        return self._answer(self._nearest, False)

    def _report_penetration(self, links: Block, people: Block, a: int, b: int) -> None:
        """Improve the answer for hulls that meet: in the best of some directions they part soonest."""
        found, points_a, points_b = self._nearest[0], _points(links, a), _points(people, b)
        between = points_b.mean(axis=0) - points_a.mean(axis=0)
        across = np.cross(points_a[1 % len(points_a)] - points_a[0], points_b[-1] - points_b[0])
        directions = [between, across, -across, *np.eye(3)]
        if self._left > 0:
            _, proposed = self._engine_gap(links, people, a, b)
            directions += [proposed, -proposed]
        for direction in directions:
            gap = kernels.certified_gap(links, people, self._pairs, a, b, direction)
            if gap > found["gap"]:
                n = direction / np.linalg.norm(direction)
                found["gap"], found["direction"] = gap, n
                deepest_a, deepest_b = np.argmax(points_a @ n), np.argmin(points_b @ n)
                found["link_point"] = points_a[deepest_a] + links[0]["radius"][a] * n
                found["people_point"] = points_b[deepest_b] - people[0]["radius"][b] * n

    def _uncovered(self, ledger: Block) -> Nearest:
        """Answer with the first open obligation: no row is there that could prove it."""
        book, found = ledger[0], self._nearest[0]
        inside = book["open"][: book["n_slices"], : book["n_links"], : book["n_people"]]
        where = np.argwhere(inside)
        _copy(_NO_PAIR, self._nearest)
        if len(where) == 0:
            return self._answer(self._nearest, True)
        found["slice"], found["link"], found["person"] = where[0]
        found["parts"], found["gap"] = inside[tuple(where[0])], -np.inf
        return self._answer(self._nearest, False)

    def _answer(self, nearest: Block, separated: bool) -> Nearest:
        i, link, _, row, person, model, parts = nearest.view(np.int64)[:7].tolist()
        gap, vectors = float(nearest.view(np.float64)[7]), nearest.view(np.float64)[8:].copy()
        return Nearest(
            separated,
            i,
            link,
            row,
            person,
            model,
            parts,
            gap,
            vectors[:3],
            vectors[3:6],
            vectors[6:],
            self._calls,
            self._unresolved,
            self._disagreement,
        )


_NOWHERE = np.full(3, np.nan)
_NOWHERE.flags.writeable = False
_NO_POINTS = (_NOWHERE, _NOWHERE, _NOWHERE)


def _no_pair() -> Block:
    """No pair is known yet, and nothing was to be proven."""
    found = np.zeros(1, dtype=_NEAREST)
    for name in ("slice", "link", "link_row", "people_row", "person", "model"):
        found[name] = -1
    found["gap"] = np.inf
    for name in ("direction", "link_point", "people_point"):
        found[name] = np.nan
    found.flags.writeable = False
    return found


_NO_PAIR: Final = _no_pair()


def _copy(source: Block, target: Block) -> None:
    """Copy a block of one record; numpy takes ten times as long when it copies field by field."""
    np.copyto(target.view(np.uint8), source.view(np.uint8))


def _points(block: Block, row: int) -> Array:
    """Points (P, 3) of a row."""
    points: Array = block[0]["points"][row, : block[0]["n_points"][row]]
    return points
