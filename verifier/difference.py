"""What changed between two results of `verify`: cycles, numbers, assumptions, inputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from verifier.changes import (
    TOLERANCE,
    AssumptionChange,
    Changed,
    InputChange,
    TextChange,
    Value,
    changed_assumptions,
    changed_inputs,
    changed_numbers,
    changed_texts,
    plain,
)
from verifier.result import Pair, VerifyResult
from verifier.verdict import Status

MAX_RANGES = 1000
"""Ranges of changed cycles that are listed; all are counted."""
WITNESSES = ("first_witness", "deepest", "tightest")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Status and reason of cycles."""

    status: int
    reason: str


@dataclass(frozen=True, slots=True)
class Range:
    """Consecutive cycles whose outcome changed in one way.

    Attributes
    ----------
    t:
        Instants of the first and the last of them [s, as in A].
    cycles:
        How many.
    a, b:
        Their outcomes.
    """

    t: tuple[float, float]
    cycles: int
    a: Outcome
    b: Outcome


@dataclass(frozen=True, slots=True)
class Extreme:
    """The cycle with the largest change: its instant [s, as in A], and both values."""

    t: float
    a: float
    b: float


@dataclass(frozen=True, slots=True)
class SeriesChange:
    """How a quantity of every cycle changed.

    Attributes
    ----------
    changed:
        Cycles in which it differs by more than the tolerance, or is there only in one result.
    fall, rise:
        Where it became smaller, and larger, most, of gaps among the cycles that A or B verifies; ``None``:
        nowhere.
    """

    changed: int
    fall: Extreme | None
    rise: Extreme | None


@dataclass(frozen=True, slots=True)
class Cycles:
    """How the cycles of two results compare.

    Attributes
    ----------
    clock:
        They are matched by the recording's clock where both are of one recording, else by the time since the
        start of each.
    compared, only_in_a, only_in_b:
        Cycles with and without one at the same instant in the other.
    status_changed, reason_changed:
        Of those compared; the second has the same status for another reason.
    ranges, ranges_total:
        The first ``MAX_RANGES``, and how many there are.
    """

    clock: Literal["recording", "start"]
    compared: int
    only_in_a: int
    only_in_b: int
    status_changed: int
    reason_changed: int
    ranges: tuple[Range, ...]
    ranges_total: int
    gap_m: SeriesChange
    stop_time_s: SeriesChange


@dataclass(frozen=True, slots=True)
class Difference:
    """What changed from result A to result B."""

    cycles: Cycles
    numbers: tuple[Changed, ...]
    assumptions: tuple[AssumptionChange, ...]
    inputs: tuple[InputChange, ...]
    texts: tuple[TextChange, ...]

    @property
    def changed(self) -> bool:
        """Whether anything did."""
        some = self.cycles
        moved = some.only_in_a + some.only_in_b + some.status_changed + some.reason_changed
        return bool(
            moved
            or some.gap_m.changed
            or some.stop_time_s.changed
            or self.numbers
            or self.assumptions
            or self.inputs
            or self.texts
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"changed": self.changed, **plain(asdict(self))}


def difference(a: VerifyResult, b: VerifyResult, tolerance: float = TOLERANCE) -> Difference:
    """Compare two results.

    Parameters
    ----------
    a, b:
        The results; what differs is stated from A to B.
    tolerance:
        Metres and seconds that count as no change; other numbers may differ by 1e-9 of their value.
        Computing time, version, and names and folders of files are not compared.
    """
    return Difference(
        _cycles(a, b, tolerance),
        tuple(changed_numbers(facts(a), facts(b), tolerance)),
        tuple(changed_assumptions(a.assumptions, b.assumptions)),
        tuple(changed_inputs(a.inputs, b.inputs)),
        (*changed_texts("waived", a.waived, b.waived), *changed_texts("notes", a.notes, b.notes)),
    )


def facts(result: VerifyResult) -> dict[str, tuple[str, Value]]:
    """Return unit and value of every number and name that is compared, by its place in the JSON."""
    found: dict[str, tuple[str, Value]] = {
        name: ("", getattr(result, name)) for name in ("robot", "profile", "stop_model", "cell_hash")
    }
    counts = ("cycles", "verified", "not_verified", "contradicted", "not_checked", "stops_in_joint_space")
    found |= {name: ("cycles", getattr(result, name)) for name in counts}
    found |= {
        f"reasons.{status}.{reason}": ("cycles", n)
        for status, of in result.reasons.items()
        for reason, n in of.items()
    }
    found["stop_time_s.median"], found["stop_time_s.max"] = (
        ("s", result.stop_time_s.median), ("s", result.stop_time_s.max),
    )  # fmt: skip
    found["refused_measurements_total"] = ("readings", result.refused_measurements_total)
    for reason, n in result.refused_measurements_by_reason.items():
        found[f"refused_measurements_by_reason.{reason}"] = ("readings", n)
    for item in result.contradictions:
        key = f"contradictions.{item.assumption}.{item.reason}"
        found |= {f"{key}.cycles": ("cycles", item.cycles), f"{key}.first_t": ("s", item.first_t)}
        found[f"{key}.text"] = ("", item.text)
    found["criteria"] = ("", ", ".join(result.criteria))
    found["criteria_not_checked"] = ("", ", ".join(result.criteria_not_checked))
    for name in WITNESSES:
        found |= _of_pair(name, getattr(result, name))
    excess = result.first_limit_excess
    if excess is not None:
        key = "first_limit_excess"
        found |= {f"{key}.t": ("s", excess.t), f"{key}.joint": ("", excess.joint)}
        found |= {f"{key}.quantity": ("", excess.quantity)}
        found |= {f"{key}.value": (excess.unit, excess.value), f"{key}.limit": (excess.unit, excess.limit)}
    return found


def _of_pair(key: str, pair: Pair | None) -> dict[str, tuple[str, Value]]:
    if pair is None:
        return {}
    names = ("link", "person", "part", "other", "criterion", "model")
    found: dict[str, tuple[str, Value]] = {f"{key}.{name}": ("", getattr(pair, name)) for name in names}
    found |= {f"{key}.cycle_t": ("s", pair.cycle_t), f"{key}.age_s": ("s", pair.age_s)}
    found |= {f"{key}.gap_m": ("m", pair.gap_m), f"{key}.inferred": ("", str(pair.inferred).lower())}
    for term, value in pair.budget_m.items():
        found[f"{key}.budget_m.{term}"] = ("" if isinstance(value, str) else "m", value)
    return found


def _cycles(a: VerifyResult, b: VerifyResult, tolerance: float) -> Cycles:
    one_recording = a.hash_of("recording") is not None and a.hash_of("recording") == b.hash_of("recording")
    later = b.start_ns - a.start_ns if one_recording else 0
    _t, ia, ib = np.intersect1d(a.t_ns, b.t_ns + later, return_indices=True)
    names = sorted({*a.reason_names.values(), *b.reason_names.values()})
    ra, rb = _reasons(a, names)[ia], _reasons(b, names)[ib]
    sa, sb = np.array(a.per_cycle.status)[ia], np.array(b.per_cycle.status)[ib]
    ranges = list(_ranges(np.array(a.per_cycle.t)[ia], ia, (sa, ra), (sb, rb), names))
    t = np.array(a.per_cycle.t)[ia]
    verified = (sa == int(Status.VERIFIED)) | (sb == int(Status.VERIFIED))
    everywhere = np.ones(len(t), np.bool_)
    return Cycles(
        clock="recording" if one_recording else "start",
        compared=len(ia),
        only_in_a=a.cycles - len(ia),
        only_in_b=b.cycles - len(ia),
        status_changed=int(np.count_nonzero(sa != sb)),
        reason_changed=int(np.count_nonzero((sa == sb) & (ra != rb))),
        ranges=tuple(ranges[:MAX_RANGES]),
        ranges_total=len(ranges),
        gap_m=_series(t, a.series("gap_m")[ia], b.series("gap_m")[ib], tolerance, verified),
        stop_time_s=_series(
            t, a.series("stop_time_s")[ia], b.series("stop_time_s")[ib], tolerance, everywhere
        ),
    )


def _reasons(result: VerifyResult, names: Sequence[str]) -> NDArray[np.int64]:
    """Return (N,) places of the cycles' reasons in ``names``: versions may number them differently."""
    place = {int(number): names.index(name) for number, name in result.reason_names.items()}
    return np.array([place[number] for number in result.per_cycle.reason], dtype=np.int64)


_Outcomes = tuple[NDArray[Any], NDArray[Any]]


def _ranges(
    t: NDArray[np.float64], index: NDArray[Any], a: _Outcomes, b: _Outcomes, names: Sequence[str]
) -> Iterator[Range]:
    """Yield the runs of cycles that are neighbours in A and changed in one way."""
    kinds = np.stack([a[0], a[1], b[0], b[1]], axis=1)
    differs = (a[0] != b[0]) | (a[1] != b[1])
    cuts = np.flatnonzero((np.diff(kinds, axis=0) != 0).any(axis=1) | (np.diff(index) != 1)) + 1
    for begin, end in zip((0, *cuts), (*cuts, len(t)), strict=True):
        if begin < end and differs[begin]:
            old, new = (Outcome(int(s[begin]), names[int(r[begin])]) for s, r in (a, b))
            yield Range((float(t[begin]), float(t[end - 1])), int(end - begin), old, new)


def _series(
    t: NDArray[np.float64],
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    tolerance: float,
    telling: NDArray[np.bool_],
) -> SeriesChange:
    """Return how a quantity changed; the largest changes are looked for where its size is ``telling``.

    The gap of a cycle that is not verified says when it fails, not how much is missing.
    """
    step = b - a
    there = np.isfinite(step)
    moved = there & (np.abs(step) > tolerance)
    missing = np.isfinite(a) != np.isfinite(b)
    fall, rise = (_largest(t, a, b, np.where(moved & telling, sign * step, 0.0)) for sign in (-1.0, 1.0))
    return SeriesChange(int(np.count_nonzero(moved | missing)), fall, rise)


def _largest(
    t: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], by: NDArray[np.float64]
) -> Extreme | None:
    """Return the cycle that changed most by ``by``; ``None`` where nothing is above zero."""
    if not (by > 0.0).any():
        return None
    i = int(np.argmax(by))
    return Extreme(float(t[i]), float(a[i]), float(b[i]))
