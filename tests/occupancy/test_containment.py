"""Recorded people against rows: by hand, against plain NumPy with another hull distance, on real clips."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Part, Point, Profile, load_profile, profile_names
from occupancy.conformance_kernels import worst_points
from occupancy.containment import (
    FOUND,
    HORIZONS_S,
    INSIDE,
    Containment,
    ContainmentError,
    contain,
    parts_table,
)
from occupancy.humans.catalog import MODEL_NAMES, build_models
from occupancy.humans.model import HumanModel
from occupancy.humans.options import HANDS, SEGMENTS
from occupancy.measurement import Gate
from occupancy.recorded import Recorded, read_people
from occupancy.report import RawMeasurement
from occupancy.separation import new_scratch
from occupancy.sets import distance_to_hull
from robots.motion import MAX_SLICES, new_slices
from tests.occupancy.people import clip, only, report, settings, standing
from tests.oracles.hulls import pad, point_distance

Array = np.ndarray
PROFILES = [load_profile(name) for name in profile_names()]
ISO, EXTREME = load_profile("iso"), load_profile("extreme")
E_P = 0.004


def models(profile: Profile) -> Sequence[HumanModel]:
    names = [name for name in MODEL_NAMES if name in profile.models and name != "unobserved"]
    return build_models(profile, names)


def recorded(t: Array, xyz: Array, e_p: float = E_P) -> Recorded:
    reports = [report(float(stamp), ("a", points)) for stamp, points in zip(t, xyz, strict=True)]
    return read_people(reports, PROFILES, e_p, believe_repeats=True)


def one(name: str, profile: Profile = ISO) -> tuple[HumanModel, ...]:
    return tuple(model for model in models(profile) if model.name == name)


def moving(point: Point | None, speed: float, samples: int = 30, step: float = 0.01) -> tuple[Array, Array]:
    """A person of whom one point moves along x; ``None``: all of them."""
    t = step * np.arange(samples)
    xyz = np.repeat(standing()[None], samples, axis=0)
    xyz[:, slice(None) if point is None else [point], 0] += speed * t[:, None]
    return t, xyz


# -------------------------------------------------------------------------------------------------- by hand


def test_people_who_stand_still_are_inside_of_everything() -> None:
    t, xyz = moving(Point.HEAD, 0.0)
    for profile in PROFILES:
        for rows in contain(recorded(t, xyz), profile, models(profile)):
            assert [row.horizon_s for row in rows] == list(HORIZONS_S)
            for row in rows[:4]:
                assert row.inside == row.frames > 0 and row.apart == 0
                assert row.worst_excess_m < -E_P and row.volume_m3 > 0.1


@pytest.mark.parametrize("point", [Point.R_WRIST, Point.HEAD, Point.PELVIS, Point.L_ANKLE, Point.R_ELBOW])
def test_a_point_is_outside_by_what_speed_and_errors_do_not_explain(point: Point) -> None:
    t, xyz = moving(point, 3.0, samples=6)
    (rows,) = contain(recorded(t, xyz), ISO, one("articulated_velocity"), horizons_s=(0.02, 0.05))
    for row, horizon in zip(rows, (0.02, 0.05), strict=True):
        assert row.worst_excess_m == pytest.approx((3.0 - 2.0) * horizon - 2 * E_P, abs=1e-6)
        assert row.worst_point == point.name.lower()
        assert row.inside == 0 and row.frames == 6 - round(horizon / 0.01)


def test_exactly_the_speed_of_the_profile_is_inside() -> None:
    t, xyz = moving(None, 2.0)
    (rows,) = contain(recorded(t, xyz), ISO, one("articulated_velocity"))
    assert all(row.inside == row.frames for row in rows)
    assert rows[0].worst_excess_m == pytest.approx(-2.0 * E_P, abs=1e-6)


def test_fingertip_in_the_hand_needs_no_depth_and_the_wrist_does() -> None:
    table = parts_table(ISO)
    wrist, hand, tip = HANDS[Part.R_HAND]
    assert table["point"][0, Part.R_HAND].tolist() == [wrist, hand, tip]
    assert table["n_axis"][0, Part.R_HAND] == 1
    assert table["n_axis"][0, Part.R_FOREARM] == 2
    t, xyz = moving(Point.R_FINGERTIP, 3.0, samples=6)
    (rows,) = contain(recorded(t, xyz), ISO, one("articulated_velocity"), horizons_s=(0.05,))
    assert rows[0].inside == rows[0].frames


def test_every_point_belongs_to_some_part() -> None:
    points = {point for segment in SEGMENTS.values() for point in segment}
    assert points | {point for some in INSIDE.values() for point in some} == set(Point)


def test_a_sample_is_predicted_for_its_own_instant() -> None:
    """30 Hz: the sample nearest to 20 ms is 33 ms away; predicted for 20 ms it would lie outside."""
    t, xyz = moving(None, 2.0, samples=12, step=1.0 / 30.0)
    (rows,) = contain(recorded(t, xyz), ISO, one("articulated_velocity"), horizons_s=(0.02, 0.2))
    assert all(row.inside == row.frames for row in rows)
    assert [row.frames for row in rows] == [11, 6]


def test_samples_too_far_from_the_horizon_are_not_looked_at() -> None:
    t = np.array([0.0, 0.3, 0.6, 0.9])
    (rows,) = contain(recorded(t, np.repeat(standing()[None], 4, axis=0)), ISO, one("iso13855"))
    assert [row.frames for row in rows] == [0, 0, 0, 0, 0]
    assert math.isnan(rows[0].worst_excess_m) and math.isnan(rows[0].volume_m3)


def test_pairs_across_a_jump_are_apart() -> None:
    t, xyz = moving(Point.HEAD, 0.0, samples=40)
    xyz[20, Point.HEAD, 0] += 0.3  # 30 m/s, there and back
    found = recorded(t, xyz)
    marked = np.flatnonzero(found.tracks["a"].marked)
    assert 20 in marked and 21 in marked and not found.tracks["a"].marked[:20].any()
    for profile in PROFILES:
        for rows in contain(found, profile, models(profile), horizons_s=(0.05,)):
            assert rows[0].apart == sum(bool(((marked >= j) & (marked <= j + 5)).any()) for j in range(35))
            assert rows[0].frames + rows[0].apart + rows[0].without_rows == 35
            assert rows[0].inside == rows[0].frames


def test_a_limb_that_no_person_has_marks_and_missing_points_do_not() -> None:
    t, xyz = moving(Point.HEAD, 0.0, samples=10)
    xyz[3] = only(xyz[3], Point.HEAD, Point.NECK_BASE)
    xyz[5, Point.L_WRIST] = 0.0
    xyz[7, Point.L_WRIST, 2] += 3.0
    marked = recorded(t, xyz).tracks["a"].marked
    assert marked[7] and not marked[:7].any()


def test_a_model_without_rows_says_nothing() -> None:
    t, xyz = moving(Point.HEAD, 0.0, samples=10)
    (rows,) = contain(recorded(t, xyz), EXTREME, one("articulated_acceleration", EXTREME), horizons_s=(0.02,))
    assert (rows[0].without_rows, rows[0].frames) == (1, 7), "no velocity is known at the first sample"


def test_a_point_on_the_border_is_inside_and_the_worst_one_is_kept() -> None:
    rows, found = Containment(0.1), np.zeros(1, dtype=FOUND)[0]
    for frame, (tested, excess) in enumerate(
        [(0, 9.0), (1, -0.5), (2, 0.0), (1, -0.2), (1, 0.25), (1, 0.25)]
    ):
        found["tested"], found["excess"], found["part"], found["point"] = tested, excess, frame, frame + 1
        rows.add(found, frame, f"p{frame}")
    assert (rows.frames, rows.inside, rows.without_rows) == (5, 3, 1)
    assert (rows.worst_excess_m, rows.worst_frame, rows.worst_person) == (0.25, 4, "p4")
    assert (rows.worst_part, rows.worst_point) == (Part(4).name.lower(), Point(5).name.lower())


def test_every_third_sample() -> None:
    t, xyz = moving(None, 1.0, samples=31)
    for every, frames in ((1, 26), (3, 9), (100, 1)):
        (rows,) = contain(recorded(t, xyz), ISO, one("iso13855"), horizons_s=(0.05,), every=every)
        assert rows[0].frames == frames


def test_people_are_held_against_their_own_rows() -> None:
    """Two people far apart: rows of the other one help nobody."""
    t, xyz = moving(None, 3.0, samples=12)
    reports = [
        report(float(stamp), ("still", standing(-5.0)), ("fast", points))
        for stamp, points in zip(t, xyz, strict=True)
    ]
    found = read_people(reports, PROFILES, E_P, believe_repeats=True)
    (rows,) = contain(found, ISO, one("articulated_velocity"), horizons_s=(0.1,))
    assert (rows[0].frames, rows[0].inside, rows[0].worst_person) == (4, 2, "fast")


def test_reports_may_come_in_any_order_and_twice() -> None:
    t, xyz = moving(Point.R_WRIST, 1.0, samples=12)
    reports = [report(float(stamp), ("a", points)) for stamp, points in zip(t, xyz, strict=True)]
    shuffled: list[RawMeasurement] = [*reports[6:], *reports[:6]]
    for some in (shuffled, [*reports, reports[4]]):
        track = read_people(some, PROFILES, E_P).tracks["a"]
        np.testing.assert_array_equal(track.samples.t, t)
    assert track.marked.tolist() == [i == 4 for i in range(12)], "two readings of one instant"


@pytest.mark.parametrize(
    ("horizons", "every", "said"),
    [((), 1, "horizons"), ((0.1, 0.1), 1, "increasing"), ((-0.1,), 1, "positive"), ((0.1,), 0, "at least 1")],
)
def test_settings_refuse(horizons: tuple[float, ...], every: int, said: str) -> None:
    t, xyz = moving(Point.HEAD, 0.0)
    with pytest.raises(ContainmentError, match=said):
        contain(recorded(t, xyz), ISO, one("iso13855"), horizons_s=horizons, every=every)


def test_as_many_horizons_as_fit_into_slices_and_one_more() -> None:
    t, xyz = moving(Point.HEAD, 0.0, samples=3)
    most = MAX_SLICES // 2
    steps = 0.01 * np.arange(1, most + 2)
    (rows,) = contain(recorded(t, xyz), ISO, one("iso13855"), horizons_s=steps[:most].tolist())
    assert [row.frames for row in rows] == [2, 1] + [0] * (most - 2)
    with pytest.raises(ContainmentError, match=f"1 to {most}"):
        contain(recorded(t, xyz), ISO, one("iso13855"), horizons_s=steps.tolist())


# ---------------------------------------------------------------------------------------- against plain NumPy


def distances(sets: np.void, rows: range, sample: Array) -> dict[tuple[int, int], float]:
    """Distance of every point that was seen from the hull of every row, by (row, point)."""
    hulls = {r: sets["points"][r, : sets["n_points"][r]] for r in rows}
    seen = np.flatnonzero(~np.isnan(sample[:, 0]))
    small = [r for r in rows if len(hulls[r]) <= 4]
    found = {(r, p): distance_to_hull(hulls[r], sample[p]) for r in rows if r not in small for p in seen}
    if small and len(seen):
        corners = np.array([pad(hulls[r]) for r in small])
        far = point_distance(sample[seen][None], corners[:, None])
        found |= {(r, p): float(far[i, k]) for i, r in enumerate(small) for k, p in enumerate(seen)}
    return found


def plain(
    sets: np.void, gate: Gate, i: int, sample: Array, e_p: Array, profile: Profile
) -> tuple[int, float, Array]:
    """Number of points tested, worst excess, and the excess of each (part, point); NaN: not tested."""
    people = gate.people[0]
    owners = list(range(int(people["n"])))
    rows = range(int(sets["first"][i]), int(sets["first"][i + 1]))
    found = np.full((16, MAX_POINTS), np.nan)
    far = distances(sets, rows, sample)
    for part in Part:
        covering = [r for r in rows if sets["covers"][r] >> part & 1]
        own = {k: [r for r in covering if sets["owner"][r] == k] for k in owners}
        if not all(own.values()):
            continue
        for point in {*SEGMENTS[part], *INSIDE.get(part, ())}:
            if np.isnan(sample[point, 0]):
                continue
            excess = []
            for k in owners:
                axis = set(SEGMENTS[part])
                if part in HANDS:
                    known = [bool(people["present"][k] >> p & 1) for p in HANDS[part]]
                    ages = np.where(known, people["t_obs"][k, list(HANDS[part])], -1.0)
                    axis = {HANDS[part][int(np.argmax(ages))]}
                depth = profile.radius[part] if point in axis else 0.0
                for r in own[k]:
                    excess.append(far[r, point] - sets["radius"][r] + depth - e_p[point])
            found[part, point] = min(excess)
    tested = int(np.isfinite(found).sum())
    return tested, float(np.nanmax(found)) if tested else -math.inf, found


def test_worst_points_equal_plain_numpy(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Points missing, several hypotheses, every model: with another hull distance."""
    contradicted = 0
    own = [models(profile) for profile in PROFILES]
    for trial in range(count(1_500)):
        profile = PROFILES[trial % len(PROFILES)]
        gate = Gate(profile, settings(position_error_m=E_P))
        for stamp in 0.01 * np.arange(4):
            shown = standing() + rng.normal(scale=rng.choice([0.002, 0.03]), size=(MAX_POINTS, 3))
            shown[rng.random(MAX_POINTS) < 0.2] = np.nan
            gate.admit(report(float(stamp), ("a", shown)), float(stamp))
        contradicted += gate.contradicted
        slices = new_slices()
        slices["n"], slices["t"][0, :4] = 3, np.repeat([0.05, 0.13], 2)
        samples = standing() + rng.normal(scale=0.2, size=(2, MAX_POINTS, 3))
        samples[rng.random((2, MAX_POINTS)) < 0.3] = np.nan
        e_p = rng.uniform(0.0, 0.02, (2, MAX_POINTS))
        for model in own[trial % len(PROFILES)]:
            sets, found = model.new_sets(), np.zeros(2, dtype=FOUND)
            model.occupy(gate.people, slices, sets)
            tables = (parts_table(profile), new_scratch())
            worst_points(sets, gate.people, 0, np.array([0, 1]), (samples, e_p), tables, found)
            for h in range(2):
                tested, worst, excess = plain(sets[0], gate, 2 * h, samples[h], e_p[h], profile)
                assert found[h]["tested"] == tested
                if tested:
                    assert found[h]["excess"] == pytest.approx(worst, abs=1e-8)
                    where = excess[found[h]["part"], found[h]["point"]]
                    assert where == pytest.approx(worst, abs=1e-8)
    assert contradicted > 0


# ------------------------------------------------------------------------------------------- real recordings


def found_in(real_data: Path, name: str, profile: Profile, every: int) -> dict[str, list[Containment]]:
    (path,) = (real_data / "human").glob(f"{name}*.npz")
    own = models(profile)
    found = contain(recorded(*clip(path)), profile, own, every=every)
    return {model.name: rows for model, rows in zip(own, found, strict=True)}


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["cmu_02_04_jump", "cmu_02_05_punch", "cmu_02_08_sword"])
def test_extreme_contains_every_frame_of_the_clean_clips_and_two_metres_a_second_do_not(
    real_data: Path, name: str
) -> None:
    for model, rows in found_in(real_data, name, EXTREME, every=3).items():
        for row in rows:
            assert row.apart == 0
            assert row.inside == row.frames > 50, f"{model}: {row}"
    slow = found_in(real_data, name, ISO, every=3)
    for row in slow["iso13855"][1:4]:
        assert row.inside < 0.95 * row.frames


@pytest.mark.real_data
def test_a_glitch_is_apart_and_the_rest_of_the_clip_is_inside(real_data: Path) -> None:
    for rows in found_in(real_data, "cmu_03_02", EXTREME, every=1).values():
        assert all(row.apart > 0 and row.inside == row.frames > 200 for row in rows)
