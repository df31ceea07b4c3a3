"""Joint sets: a known person comes out at the right points, wrong indices are refused, real people fit."""

from __future__ import annotations

import itertools
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import POINT_NAMES, Point
from robots.assumption import Certainty
from tests.verifier.recordings.people_sources.bodies import (
    BENT,
    ORDER,
    STANDING,
    Posture,
    expected,
    in_a_camera,
    joints,
    person,
)
from verifier.recordings import joint_sets, limb_test
from verifier.recordings.decoded import SourceError
from verifier.recordings.joint_sets import JointSet, joint_set
from verifier.recordings.limb_test import BODIES, LimbTest
from verifier.recordings.npz import read_people
from verifier.recordings.people_report import COLUMN, ReportedPerson
from verifier.recordings.people_source import Place, TablePeople

INDEXED = sorted(ORDER)
UNVERIFIED = {"body_25", "coco_17", "mediapipe_33", "kinect_v2_25", "smpl_24"}


def read(used: JointSet, xyz: np.ndarray) -> ReportedPerson:
    return used.person("p", xyz, np.zeros(len(xyz), bool))


def judge(people: list[ReportedPerson], title: str = "the set") -> LimbTest:
    test = LimbTest(title)
    for each in people:
        test.add(each)
    test.finish()
    return test


def walk(used: JointSet, rng: np.random.Generator, count: int = 8) -> list[ReportedPerson]:
    """Somebody who stands, bends and reaches, as a camera sees them."""
    stature = rng.uniform(1.5, 1.9)
    postures = [
        STANDING,
        BENT,
        *(Posture(*rng.uniform((0, -30, 0, -20, 0), (60, 120, 130, 60, 90))) for _ in range(count)),
    ]
    return [read(used, in_a_camera(joints(used.name, person(stature, each)), rng)) for each in postures]


def test_every_indexed_set_has_its_makers_order() -> None:
    assert {n for n, s in joint_sets.joint_sets().items() if isinstance(s.joints[0], int)} == set(ORDER)
    for name, order in ORDER.items():
        assert len(joint_set(name).joints) == len(order)


@pytest.mark.parametrize("posture", [STANDING, BENT], ids=["standing", "bent"])
@pytest.mark.parametrize("name", INDEXED)
def test_a_known_person_comes_out_at_the_right_points(name: str, posture: Posture) -> None:
    at = person(1.8, posture)
    found = read(joint_set(name), joints(name, at))
    for point, place in expected(name, at).items():
        np.testing.assert_allclose(found.xyz[COLUMN[point]], place, atol=1e-12, err_msg=point)
        assert found.measured >> COLUMN[point] & 1
    others = set(POINT_NAMES) - set(expected(name, at))
    assert all(np.isnan(found.xyz[COLUMN[point]]).all() for point in others)
    assert found.measured == sum(1 << COLUMN[point] for point in expected(name, at))


@pytest.mark.parametrize("name", INDEXED)
def test_people_of_any_size_and_posture_fit(name: str, rng: np.random.Generator, count) -> None:
    for _ in range(count(200)):
        assert judge(walk(joint_set(name), rng)).bodies > 0


@pytest.mark.parametrize("name", INDEXED)
def test_missing_is_missing_inferred_is_inferred_and_a_midpoint_needs_both(name: str) -> None:
    used, at = joint_set(name), person()
    whole = read(used, joints(name, at)).measured
    for row in range(len(used.joints)):
        needing = {column for column, rows in used.at.items() if row in rows}
        mask = sum(1 << column for column in needing)
        for missing in ((np.nan, 0.0, 1.0), (0.0, np.inf, 0.0), (0.0, 0.0, 0.0)):
            xyz = joints(name, at)
            xyz[row] = missing
            found = read(used, xyz)
            assert found.measured == whole & ~mask
            assert all(np.isnan(found.xyz[column]).all() for column in needing)
        inferred = np.arange(len(used.joints)) == row
        found = used.person("p", joints(name, at), inferred)
        assert found.measured == whole & ~mask
        assert all(np.isfinite(found.xyz[column]).all() for column in needing)


@pytest.mark.parametrize("rows", [0, 1, 31, 33])
def test_another_number_of_joints_is_refused(rows: int) -> None:
    with pytest.raises(SourceError, match=f"{rows} x 3.*has 32 x 3"):
        read(joint_set("azure_kinect_32"), np.ones((rows, 3)))
    with pytest.raises(SourceError, match="32 x 2"):
        read(joint_set("azure_kinect_32"), np.ones((32, 2)))


def test_an_unknown_set_is_refused() -> None:
    for name in ("halpe_26", "", None, 32, "azure_kinect_32 "):
        with pytest.raises(SourceError, match="is not known; known are azure_kinect_32"):
            joint_set(name)


def test_sets_that_nobody_checked_are_shown_as_unverified() -> None:
    for name, used in joint_sets.joint_sets().items():
        shown = used.assumption()
        assert (shown.certainty is Certainty.UNVERIFIED) == (name in UNVERIFIED)
        assert shown.value == used.title and shown.source


def shifted(used: JointSet, by: int) -> JointSet:
    n = len(used.joints)
    return replace(
        used, at={column: tuple((row + by) % n for row in rows) for column, rows in used.at.items()}
    )


@pytest.mark.parametrize("by", [-2, -1, 1, 2])
@pytest.mark.parametrize("name", INDEXED)
def test_indices_that_are_shifted_are_refused(name: str, by: int, rng: np.random.Generator) -> None:
    with pytest.raises(SourceError, match=f"not those of {joint_set(name).title[:5]}"):
        judge(walk(shifted(joint_set(name), by), rng), joint_set(name).title)


WRONG_38 = {
    "pelvis": 0, "thorax": 2, "neck_base": 3, "head": 4, "l_shoulder": 11, "l_elbow": 12, "l_wrist": 13,
    "l_hand": 14, "l_fingertip": 15, "r_shoulder": 18, "r_elbow": 19, "r_wrist": 20, "r_hand": 21,
    "r_fingertip": 22, "l_hip": 24, "l_knee": 25, "l_ankle": 26, "r_hip": 30, "r_knee": 31, "r_ankle": 32,
}  # fmt: skip
"""A public listing of BODY_38 that has the arms and legs one after the other."""


def test_the_known_wrong_listing_of_body_38_is_refused(rng: np.random.Generator) -> None:
    wrong = replace(joint_set("zed_body_38"), at={COLUMN[p]: (row,) for p, row in WRONG_38.items()})
    with pytest.raises(SourceError, match="not those of ZED BODY_38"):
        judge(walk(wrong, rng), wrong.title)


SAID_TO_BE = [
    (recorded, said)
    for recorded, said in itertools.permutations(INDEXED, 2)
    if max(itertools.chain(*joint_set(said).at.values())) < len(ORDER[recorded])
]
"""Pairs of sets that cannot be told by the number of joints alone."""


@pytest.mark.parametrize(("recorded", "said"), SAID_TO_BE)
def test_a_set_that_is_called_another_one_is_refused(
    recorded: str, said: str, rng: np.random.Generator
) -> None:
    used = joint_set(said)
    people = []
    for posture in (STANDING, BENT):
        xyz = np.full((len(used.joints), 3), np.nan)
        given = joints(recorded, person(1.75, posture))[: len(xyz)]
        xyz[: len(given)] = in_a_camera(given, rng)
        people.append(read(used, xyz))
    theirs, ours = ORDER[recorded], ORDER[said]
    if all(theirs[row] == ours[row] for rows in used.at.values() for row in rows):
        judge(people)
    else:
        with pytest.raises(SourceError, match="not those of"):
            judge(people)


def swapped(used: JointSet, a: int, b: int) -> JointSet:
    return replace(used, at=dict(used.at) | {a: used.at[b], b: used.at[a]})


NOT_SEEN = {
    frozenset(pair)
    for pair in (
        (Point.HEAD, Point.NECK_BASE),
        (Point.NECK_BASE, Point.THORAX),
        (Point.L_HAND, Point.L_FINGERTIP),
        (Point.R_HAND, Point.R_FINGERTIP),
        (Point.L_HIP, Point.R_HIP),
        (Point.L_KNEE, Point.R_KNEE),
        (Point.L_ANKLE, Point.R_ANKLE),
    )
}
"""Points that lie so near to each other that lengths do not tell them apart (docs/sources.md)."""


@pytest.mark.parametrize("name", INDEXED)
def test_two_indices_that_are_swapped_are_refused(name: str, rng: np.random.Generator, count) -> None:
    used = joint_set(name)
    seen = [in_a_camera(joints(name, person(1.75, each)), rng) for each in (STANDING, BENT, STANDING)]
    pairs = [pair for pair in itertools.combinations(sorted(used.at), 2) if set(pair) not in NOT_SEEN]
    for a, b in rng.permutation(pairs)[: count(500)]:
        with pytest.raises(SourceError):
            judge([read(swapped(used, a, b), xyz) for xyz in seen])


def named(points: dict[Point, tuple[float, float, float]]) -> ReportedPerson:
    xyz = np.full((20, 3), np.nan)
    for point, place in points.items():
        xyz[point] = place
    return ReportedPerson("p", xyz, np.full(20, np.nan), sum(1 << point for point in points))


@pytest.mark.parametrize(("scale", "unit"), [(1e3, "mm"), (1e2, "cm"), (1 / 0.0254, "inches")])
def test_another_unit_is_named(scale: float, unit: str, rng: np.random.Generator) -> None:
    used = joint_set("azure_kinect_32")
    seen = [read(used, scale * in_a_camera(joints(used.name, person()), rng)) for _ in range(3)]
    with pytest.raises(SourceError, match=f"as if in {unit}"):
        judge(seen)


def test_a_few_glitches_and_hidden_limbs_refuse_nothing(rng: np.random.Generator) -> None:
    used = joint_set("azure_kinect_32")
    seen = []
    for k in range(30):
        xyz = in_a_camera(joints(used.name, person()), rng)
        if k % 3 == 0:
            xyz[rng.integers(0, 32, 4)] += rng.normal(0.0, 1.0, 3)
        seen.append(used.person("p", xyz, rng.random(32) < 0.3))
    judge(seen)


@pytest.mark.parametrize(
    ("length", "fits"), [(0.1, False), (0.174, False), (0.176, True), (0.332, True), (0.334, False)]
)
def test_a_limb_is_neither_too_short_nor_too_long(length: float, fits: bool) -> None:
    seen = [named({Point.L_ELBOW: (1.0, 0.0, 1.0), Point.L_WRIST: (1.0, 0.0, 1.0 + length)})]
    if fits:
        judge(seen)
    else:
        with pytest.raises(SourceError, match="l_elbow to l_wrist is"):
            judge(seen)


def test_left_and_right_must_be_alike() -> None:
    arm = {Point.L_SHOULDER: (0.0, 0.0, 1.4), Point.L_ELBOW: (0.0, 0.0, 1.1)}
    other = {Point.R_SHOULDER: (0.3, 0.0, 1.4), Point.R_ELBOW: (0.3, 0.1, 0.98)}
    judge([named(arm)])
    judge([named(other)])
    with pytest.raises(
        SourceError, match=r"l_shoulder to l_elbow is 0.3 m, r_shoulder to r_elbow is 0.432 m"
    ):
        judge([named(arm | other)])


def test_the_flat_and_the_centred_are_refused(rng: np.random.Generator) -> None:
    used = joint_set("coco_17")
    xyz = joints(used.name, person(1.7, BENT))
    flat = xyz.copy()
    flat[:, 1] = 0.7
    with pytest.raises(SourceError, match="flat, as in a picture"):
        judge([read(used, flat)])
    centred = xyz - 0.5 * (xyz[11] + xyz[12])
    with pytest.raises(SourceError, match="centred at the hips"):
        judge([read(used, centred)])
    judge([read(used, centred), read(used, xyz)])


def test_bodies_are_judged_once_and_none_is_not_enough() -> None:
    wrist = named({Point.L_WRIST: (1.0, 0.0, 1.0)})
    long = named({Point.L_WRIST: (1.0, 0.0, 1.0), Point.L_ELBOW: (1.0, 1.0, 1.0)})
    judge([])
    with pytest.raises(SourceError, match="no limb of anybody"):
        judge([wrist])
    with pytest.raises(SourceError, match="l_elbow to l_wrist is 1 m long"):
        judge([wrist, long])
    test = LimbTest("markers", must_be_seen=False)
    for _ in range(BODIES):
        test.add(wrist)
    test.add(long)
    test.finish()
    test = LimbTest("the set")
    for _ in range(BODIES - 1):
        test.add(long)
    with pytest.raises(SourceError):
        test.add(long)


def test_the_lengths_contain_those_of_people_of_every_size() -> None:
    """Shares of stature as Drillis and Contini have them (1966), for statures of 1.5 and 1.9 m."""
    shares = {
        "upper_arm": 0.186,
        "forearm": 0.146,
        "thigh": 0.245,
        "shank": 0.246,
        "trunk": 0.288,
        "neck": 0.13,
    }
    table = tomllib.loads(Path(limb_test.__file__).with_name("limb_lengths.toml").read_text(encoding="utf-8"))
    for limb, share in shares.items():
        low, high = table["limb"][limb]
        assert low < 1.5 * share < 1.9 * share < high


@pytest.mark.real_data
def test_real_people_fit(real_data: Path, some) -> None:
    """Motion capture and noisy depth cameras; each as the first second and a half of a stream."""
    files = [*sorted(real_data.glob("human/*.npz")), *sorted(real_data.glob("human_robot/*.npz"))]
    assert len(files) > 10
    for path in some(files, 3):
        reports = TablePeople(read_people(path), None, {})
        test = LimbTest(path.name, must_be_seen=False)
        for report in itertools.islice(reports.reports(Place(), 0.0), 200):
            for each in report.people:
                test.add(each)
        test.finish()
