"""One frame of a recording: which one, what is predicted from it, and what came true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import POINT_NAMES, Part, Point, load_profile, profile_names
from occupancy.containment import INSIDE, contain
from occupancy.humans.catalog import build_models
from occupancy.humans.options import HANDS, SEGMENTS
from occupancy.recorded import read_people
from occupancy.sets import distance_to_hull
from robots.errors import SetupError
from tests.occupancy.people import standing
from verifier.conformance import RecordedFile, bundled_profiles, models_of, open_recordings
from verifier.outline import inside, outline, project
from verifier.snapshot import HORIZONS_S, Snapshot, choose_moment, take_snapshot

Array = np.ndarray
E_P = 0.002
RIGHT_HAND = [Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP]
LEFT_HAND = [Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP]


def strike(
    fastest: int, speed: float, samples: int = 100, direction: Sequence[float] = (0.6, 0.8, 0.0)
) -> Array:
    """A person who trembles, fastest with the right forearm on the way from one sample, at 100 Hz."""
    steps = 0.01 * speed * np.exp(-(((np.arange(samples) - fastest) / 6.0) ** 2))
    way = np.concatenate(([0.0], np.cumsum(steps)[:-1]))
    xyz = np.repeat(standing()[None], samples, axis=0)
    xyz[:, [Point.R_ELBOW, *RIGHT_HAND]] += way[:, None, None] * np.array(direction)
    xyz[:, :, 2] += 2e-9 * np.arange(samples)[:, None]
    return xyz


def recording(folder: Path, people: dict[str, Array], t: Array | None = None) -> RecordedFile:
    """A file of people, read; NaN: not seen."""
    rows = ["t,person," + ",".join(f"{name}_{axis}" for name in POINT_NAMES for axis in "xyz")]
    samples = max(map(len, people.values()))
    times = 5.0 + 0.01 * np.arange(samples) if t is None else t
    for i in range(samples):
        for name, xyz in people.items():
            values = xyz[i].ravel() if i < len(xyz) else np.full(60, np.nan)
            if np.isfinite(values).any():
                texts = ["" if np.isnan(value) else f"{value:.9f}" for value in values]
                rows.append(f"{times[i]:.6f},{name},{','.join(texts)}")
    (folder / "people.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (file,) = open_recordings([str(folder / "people.csv")], [], E_P)
    return file


def snapshot(file: RecordedFile, profile: str, *models: str, at: float | None = None) -> Snapshot:
    return take_snapshot(file, load_profile(profile), models, choose_moment(file, at, None))


# --------------------------------------------------------------------------------------- which frame is drawn


@pytest.mark.parametrize("fastest", [25, 40, 61])
def test_the_frame_is_that_of_the_fastest_hand(tmp_path: Path, fastest: int) -> None:
    moment = choose_moment(recording(tmp_path, {"a": strike(fastest, 2.5)}), None, None)
    assert (moment.person, moment.sample) == ("a", fastest)
    assert moment.later.tolist() == [fastest + 10, fastest + 20]
    np.testing.assert_allclose(moment.along, [0.6, 0.8, 0.0], atol=1e-6)


def test_the_head_is_no_hand_unless_there_is_none(tmp_path: Path) -> None:
    xyz = strike(25, 1.5)
    xyz[60:, Point.HEAD, 1] -= 0.02
    assert choose_moment(recording(tmp_path, {"a": xyz}), None, None).sample == 25
    xyz[:, [*RIGHT_HAND, *LEFT_HAND]] = np.nan
    moment = choose_moment(recording(tmp_path, {"a": xyz}), None, None)
    assert moment.sample == 59
    np.testing.assert_allclose(moment.along, [0.0, -1.0, 0.0], atol=1e-6)


def test_a_hand_that_moves_up_is_seen_along_x(tmp_path: Path) -> None:
    file = recording(tmp_path, {"a": strike(40, 2.0, direction=(0.0, 0.0, 1.0))})
    assert choose_moment(file, None, None).along.tolist() == [1.0, 0.0, 0.0]
    still = recording(tmp_path, {"a": strike(40, 0.0)})
    assert choose_moment(still, None, None).along.tolist() == [1.0, 0.0, 0.0]


def test_frames_next_to_marked_samples_are_not_drawn(tmp_path: Path) -> None:
    """The head jumps at sample 50 and back at 51: what lies from 30 to 51 sees it, or is it."""
    xyz = strike(40, 2.5)
    xyz[50, Point.HEAD, 0] += 0.4
    file = recording(tmp_path, {"a": xyz})
    marked = np.flatnonzero(file.people.tracks["a"].marked)
    assert {50, 51} <= set(marked)
    moment = choose_moment(file, None, None)
    assert not any(moment.sample <= k <= moment.later[-1] for k in marked)
    assert moment.sample == 29, "the last before them, where the hand is fastest"
    for at in (0.31, 0.4, 0.5):
        with pytest.raises(SetupError, match=f"^--at {at}: a sample from there to 200 ms later is marked"):
            choose_moment(file, at, None)


def test_a_time_counts_from_the_first_report(tmp_path: Path) -> None:
    file = recording(tmp_path, {"a": strike(40, 2.5)})
    for at, sample in ((0.0, 0), (0.304, 30), (0.79, 79)):
        moment = choose_moment(file, at, None)
        assert moment.sample == sample
        assert take_snapshot(file, load_profile("iso"), ["iso13855"], moment).at_s == pytest.approx(
            0.01 * sample
        )
    reports = [r._replace(stamp=r.stamp + 1e4, arrived=r.arrived + 1e4) for r in file.people.reports]
    late = replace(file, people=read_people(reports, bundled_profiles(), E_P))
    assert choose_moment(late, 0.304, None).sample == 30
    assert snapshot(late, "iso", "iso13855", at=0.3).at_s == pytest.approx(0.3)
    for at in (-0.1, 1.0, 1e9, float("nan"), float("inf")):
        with pytest.raises(SetupError, match=r"goes from 0 to 0\.99 s$"):
            choose_moment(file, at, None)
    with pytest.raises(SetupError, match="no sample lies 100 or 200 ms later"):
        choose_moment(file, 0.9, None)


def test_of_several_persons_the_one_with_the_fastest_hand(tmp_path: Path) -> None:
    far = strike(60, 2.8)[:90] + np.array([3.0, 0.0, 0.0])
    file = recording(tmp_path, {"slow": strike(40, 2.0), "fast": far})
    assert choose_moment(file, None, None).person == "fast"
    assert choose_moment(file, 0.4, None).person == "slow"
    assert choose_moment(file, None, "slow").sample == 40
    with pytest.raises(SetupError, match=r"^--person x: is not in people; these are: slow, fast$"):
        choose_moment(file, None, "x")
    with pytest.raises(SetupError, match=r"^--at 0.95: fast not seen then$"):
        choose_moment(file, 0.95, "fast")


def test_a_recording_too_short_has_no_frame(tmp_path: Path) -> None:
    with pytest.raises(
        SetupError, match=r"^--sets: people has no frame .* no sample lies 100 or 200 ms later$"
    ):
        choose_moment(recording(tmp_path, {"a": strike(5, 2.0, samples=15)}), None, None)


# ---------------------------------------------------------------------------------------- what is said of it


def test_who_is_faster_than_the_profile_is_outside_by_the_difference(tmp_path: Path) -> None:
    xyz = strike(40, 0.0) + 0.03 * np.arange(100)[:, None, None] * np.array([1.0, 0.0, 0.0])
    shot = snapshot(recording(tmp_path, {"a": xyz[:31]}), "iso", "articulated_velocity", at=0.0)
    for (predicted,), horizon in zip(shot.predicted, HORIZONS_S, strict=True):
        for point in (Point.R_WRIST, Point.HEAD, Point.L_ANKLE):
            assert predicted.excess_m[point] == pytest.approx((3.0 - 2.0) * horizon - 2.0 * E_P, abs=1e-6)
        assert predicted.flesh_m[Point.R_WRIST] == load_profile("iso").radius[predicted.part[Point.R_WRIST]]
        assert predicted.flesh_m[Point.R_HAND] == 0.0


def test_a_model_without_rows_says_nothing(tmp_path: Path) -> None:
    shot = snapshot(
        recording(tmp_path, {"a": strike(40, 2.0)}), "extreme", "articulated_acceleration", at=0.0
    )
    for (predicted,) in shot.predicted:
        assert predicted.rows == () and np.isnan(predicted.excess_m).all() and (predicted.part == -1).all()


def depth(part: Part, point: Point, seen: Array, radius: Array) -> float:
    """Of the flesh around a point: on the axis of a part, of a hand the first point that was seen."""
    axis = [next(p for p in HANDS[part] if seen[p])] if part in HANDS else SEGMENTS[part]
    return float(radius[part]) if point in axis else 0.0


def check(shot: Snapshot, e_p: float) -> tuple[int, int]:
    """Hold excesses against another hull distance, and points against outlines; counts of in and out."""
    radius = load_profile(shot.profile).radius
    seen = np.isfinite(shot.points).all(axis=1)
    counts = [0, 0]
    for later, models in zip(shot.later, shot.predicted, strict=True):
        for predicted in models:
            for point in Point:
                excess: dict[Part, float] = {}
                for part in Part:
                    if point not in {*SEGMENTS[part], *INSIDE.get(part, ())} or np.isnan(later[point, 0]):
                        continue
                    rows = [row for row in predicted.rows if row.covers >> part & 1]
                    deep = depth(part, point, seen, radius) - e_p
                    far = [distance_to_hull(row.points, later[point]) - row.radius + deep for row in rows]
                    excess |= {part: min(far)} if far else {}
                    drawn = [outline(project(row.points, shot.along), row.radius) for row in rows]
                    place = project(later[None, point], shot.along)
                    if far and min(far) <= 0.0:
                        assert any(inside(place, each, deep - 1e-9).all() for each in drawn), (part, point)
                if not excess:
                    assert np.isnan(predicted.excess_m[point]) and predicted.part[point] == -1
                    continue
                worst = max(excess.values())
                assert predicted.excess_m[point] == pytest.approx(worst, abs=1e-7)
                part = Part(predicted.part[point])
                assert excess[part] == pytest.approx(worst, abs=1e-7)
                assert predicted.flesh_m[point] == depth(part, point, seen, radius)
                counts[worst > 0.0] += 1
    return counts[0], counts[1]


@pytest.mark.parametrize("profile", profile_names())
@pytest.mark.parametrize("speed", [1.0, 3.5])
def test_excesses_equal_another_hull_distance_and_what_is_inside_is_drawn_inside(
    tmp_path: Path, profile: str, speed: float
) -> None:
    """3.5 m/s leaves hypotheses under two of the profiles; fingertips and an elbow are missing."""
    xyz = strike(40, speed)
    xyz[:, [Point.L_ELBOW, Point.L_WRIST, Point.R_FINGERTIP]] = np.nan
    shot = snapshot(recording(tmp_path, {"a": xyz}), profile, at=0.36)
    within, beyond = check(shot, E_P)
    assert within > 50 and (beyond > 0) == (speed > 3.0 and profile != "extreme")
    models = models_of(load_profile(profile), ())
    assert [[each.model for each in row] for row in shot.predicted] == [models, models]


@pytest.mark.parametrize("profile", profile_names())
def test_the_worst_of_a_frame_is_what_containment_finds(tmp_path: Path, profile: str) -> None:
    """Every 36th sample as last known: 0, where nobody moves yet, and 36."""
    file = recording(tmp_path, {"a": strike(40, 3.5)[:60]})
    shot = snapshot(file, profile, at=0.36)
    own = load_profile(profile)
    models = build_models(own, models_of(own, ()))
    found = contain(file.people, own, models, horizons_s=HORIZONS_S, every=36)
    for m, rows in enumerate(found):
        for h, row in enumerate(rows):
            predicted = shot.predicted[h][m]
            if row.worst_frame != 36:
                assert not np.nanmax(predicted.excess_m, initial=-np.inf) > row.worst_excess_m
                continue
            assert np.nanmax(predicted.excess_m) == row.worst_excess_m
            assert POINT_NAMES[int(np.nanargmax(predicted.excess_m))] == row.worst_point
    assert any(row.worst_frame == 36 for rows in found for row in rows)


def test_rows_of_every_hypothesis_are_there_if_all_have_some(tmp_path: Path) -> None:
    """After the stroke, faster than iso allows, somebody is where they were seen first, or later."""
    file = recording(tmp_path, {"a": strike(40, 3.5)})
    before, after = (snapshot(file, "iso", "articulated_velocity", at=at) for at in (0.1, 0.44))
    (few,), _ = before.predicted
    (many,), _ = after.predicted
    assert len(few.rows) == 16 and len(many.rows) % 16 == 0 and len(many.rows) > 16
    assert np.isfinite(many.excess_m).all() and check(after, E_P)[0] > 0
    first = snapshot(file, "tum", "articulated_acceleration", at=0.1)
    assert len(first.predicted[0][0].rows) == 16
    unsure = snapshot(file, "tum", "articulated_acceleration", at=0.44)
    for (predicted,) in unsure.predicted:
        assert predicted.rows == () and np.isnan(predicted.excess_m).all(), "the newest one has no velocity"


@pytest.mark.real_data
@pytest.mark.parametrize("profile", profile_names())
def test_a_punch_is_drawn_where_it_was(real_data: Path, profile: str) -> None:
    (file,) = open_recordings([str(real_data / "human/cmu_02_05_punch_strike.npz")], [], None)
    within, beyond = check(snapshot(file, profile), file.position_error_m)
    assert within > 100 and (beyond > 0) == (profile != "extreme")
