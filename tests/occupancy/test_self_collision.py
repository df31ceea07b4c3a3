"""The arm against itself: capsules at sampled instants, with the tests' own kinematics and distances."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.self_collision import SelfCollision, never_apart
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy, chains_and_strokes
from occupancy.workspace import WorkspaceError
from robots.catalog import RobotSetup, load_robot
from robots.model import RobotModel
from robots.motion import Block
from tests.occupancy.arms import ARMS, Motion, arm, axis_points, place, random_motion
from tests.oracles.hulls import segment_segment

Array = NDArray[np.float64]
Count = Callable[[int], int]
MARGIN = 1e-4
EVERY = np.ones(24, dtype=np.uint8)


def slim(name: str, rng: np.random.Generator) -> RobotModel:
    """A made-up arm whose links are thin and short enough to miss each other now and then."""
    model, share = arm(name, rng), rng.choice([0.3, 0.8])
    capsules = model.enclosure[0]
    for field in ("radius", "a", "b"):
        capsules[field] *= share
    return model


def swept(model: RobotModel, motion: Motion) -> tuple[Block, Block]:
    slices, links = motion.slices(), new_link_sets()
    LinkOccupancy(model).occupy(slices, links)
    return slices, links


def pair_gaps(model: RobotModel, q: Array) -> Array:
    """Gap (T, L, L) [m] of every two capsules at joint positions (T, n)."""
    axes = place(model, q, axis_points(model, np.array([0.0, 1.0])))
    n = len(model.links)
    a = np.broadcast_to(axes[:, :, None], (len(q), n, n, 2, 3))
    b = np.broadcast_to(axes[:, None], (len(q), n, n, 2, 3))
    radius = model.enclosure[0]["radius"][:n]
    gaps: Array = segment_segment(a[..., 0, :], a[..., 1, :], b[..., 0, :], b[..., 1, :])
    return gaps - radius[:, None] - radius[None, :]


def sampled_gaps(model: RobotModel, motion: Motion, samples: int = 33) -> Array:
    q = motion.actual(np.linspace(0.0, motion.h, samples)[:, None])
    return pair_gaps(model, q)


@pytest.mark.parametrize("name", [name for name in ARMS if len(ARMS[name]) > 2])
def test_pairs_that_are_proven_apart_stay_apart(name: str, rng: np.random.Generator, count: Count) -> None:
    seen: Counter[str] = Counter()
    for _ in range(max(60, count(6_000))):
        model = slim(name, rng)
        motion = random_motion(model, rng)
        slices, links = swept(model, motion)
        pairs = SelfCollision(model, [], MARGIN)
        gaps = sampled_gaps(model, motion)
        found = pairs.check(links, slices, EVERY)
        rows = [(model.links.index(a), model.links.index(b)) for a, b in pairs.pairs]
        if found is None:
            assert min(gaps[:, a, b].min() for a, b in rows) > MARGIN - 1e-9, motion
            seen["apart"] += 1
        else:
            other = model.links.index(found.other)
            assert (found.link, other) in rows
            assert found.gap_m <= gaps[:, found.link, other].min() + 1e-9
            seen["blocked"] += 1
    assert min(seen["apart"], seen["blocked"]) >= 4, seen


@pytest.mark.parametrize("name", ["six", "branches", "slide_between"])
def test_pairs_that_are_apart_are_proven_so(name: str, rng: np.random.Generator, count: Count) -> None:
    """On tiny slices nothing is lost, and what moves both links as one body costs nothing on long ones."""
    seen: Counter[str] = Counter()
    for _ in range(max(100, count(6_000))):
        model = slim(name, rng)
        motion = replace(random_motion(model, rng), error=np.zeros(len(model.joints)))
        common = bool(rng.random() < 0.5)
        if common:
            motion.coefficients[1:, 1:] = 0.0
        else:
            motion = replace(motion, h=1e-5)
        slices, links = swept(model, motion)
        pairs = SelfCollision(model, [], MARGIN)
        gaps = sampled_gaps(model, motion).min(axis=0)
        found = pairs.check(links, slices, EVERY)
        rows = [(model.links.index(a), model.links.index(b)) for a, b in pairs.pairs]
        truly = min(gaps[a, b] for a, b in rows)
        assert (found is None) == (truly > MARGIN) or abs(truly - MARGIN) < 2e-4
        seen[f"{'common' if common else 'short'} {'apart' if found is None else 'blocked'}"] += 1
    assert len(seen) == 4, seen


def test_a_tracking_error_of_a_joint_between_counts_and_one_below_does_not(rng: np.random.Generator) -> None:
    model = slim("six", rng)
    while SelfCollision(model, [], MARGIN).check(*reversed(swept(model, at_rest(model))), EVERY) is not None:
        model = slim("six", rng)
    motion = at_rest(model)
    for joint, apart in ((0, True), (5, False)):
        error = np.zeros(6)
        error[joint] = 3.0
        slices, links = swept(model, replace(motion, error=error))
        assert (SelfCollision(model, [], MARGIN).check(links, slices, EVERY) is None) == apart


@pytest.mark.parametrize("name", [name for name in ARMS if len(ARMS[name]) > 2])
def test_other_motions_that_a_slice_stands_for_count_like_tracking_errors(
    name: str, rng: np.random.Generator, count: Count
) -> None:
    """Swept rows and pairs of links: the same bounds, whether stated as an error or as a spread."""
    wider = 0
    for _ in range(max(20, count(1_000))):
        model = slim(name, rng)
        motion = replace(
            random_motion(model, rng), error=rng.choice([0.1, 0.6]) * rng.random(len(model.joints))
        )
        slices, links = swept(model, motion)
        moved, n = slices.copy(), len(model.joints)
        for error, spread in (("q_error", "q_spread"), ("dq_error", "dq_spread")):
            moved[spread][0, :, :n] = slices[error][0, :n]
            moved[error] = 0.0
        other, none = new_link_sets(), new_link_sets()
        occupancy = LinkOccupancy(model)
        occupancy.occupy(moved, other)
        assert other.tobytes() == links.tobytes()
        pairs = SelfCollision(model, [], MARGIN)
        answers = [pairs.check(links, each, EVERY) for each in (slices, moved)]
        assert [each and (each.link, each.other, each.gap_m, each.lost_m) for each in answers[:1]] == [
            each and (each.link, each.other, each.gap_m, each.lost_m) for each in answers[1:]
        ]
        for spread in ("q_spread", "dq_spread"):
            moved[spread] = 0.0
        occupancy.occupy(moved, none)
        rows = int(none["n"][0])
        assert (none["radius"][0, :rows] <= links["radius"][0, :rows]).all()
        alone = pairs.check(links, moved, EVERY)
        wider += answers[0] is not None and (alone is None or alone.gap_m > answers[0].gap_m)
    assert wider > 0, "vacuous: without the spread nothing would change"


def merry_go_round(name: str, rng: np.random.Generator) -> RobotModel:
    """All axes in one line, and on each a ball 1 m away from it: speeds are as large as they are bounded."""
    model = arm(name, rng)
    tree, capsules = model.kinematics[0], model.enclosure[0]
    tree["rotation"], tree["translation"], tree["axis"] = np.eye(3), 0.0, [0.0, 0.0, 1.0]
    capsules["a"] = capsules["b"] = [1.0, 0.0, 0.0]
    capsules["radius"] = 0.01
    capsules["reach"][:, : len(model.joints)] = 1.0
    return model


@pytest.mark.parametrize(
    ("name", "moving", "pair"), [("six", 2, ("link_0", "link_2")), ("branches", 1, ("link_1", "link_3"))]
)
def test_what_happens_between_the_ends_counts(
    name: str, moving: int, pair: tuple[str, str], rng: np.random.Generator
) -> None:
    model = merry_go_round(name, rng)
    n = len(model.joints)
    others = [each for each in combinations(model.links, 2) if each != pair]
    pairs = SelfCollision(model, others, MARGIN)
    assert pairs.pairs == (pair,)
    for begin, end, apart in (
        (0.3, 0.05, True),
        (0.05, 0.3, True),
        (0.3, 0.0, False),
        (0.0, 0.3, False),
        (0.1, -0.1, False),
        (-0.1, 0.1, False),
    ):
        c = np.zeros((4, n))
        c[0, moving], c[1, moving] = begin, (end - begin) / 0.1
        motion = Motion(0.1, c, np.zeros(n), np.zeros(n), np.zeros(n))
        slices, links = swept(model, motion)
        found = pairs.check(links, slices, EVERY)
        assert (found is None) == apart
        nearest = sampled_gaps(model, motion)[:, model.links.index(pair[0]), model.links.index(pair[1])].min()
        assert found is None or found.gap_m <= nearest + 1e-9


def at_rest(model: RobotModel) -> Motion:
    n = len(model.joints)
    zero = np.zeros(n)
    return Motion(0.01, np.zeros((4, n)), zero, zero, zero)


def test_not_a_number_proves_nothing(rng: np.random.Generator) -> None:
    model = slim("six", rng)
    motion = at_rest(model)
    while SelfCollision(model, [], MARGIN).check(*reversed(swept(model, motion)), EVERY) is not None:
        model = slim("six", rng)
    pairs = SelfCollision(model, [], MARGIN)
    slices, links = swept(model, motion)
    for bad in (np.nan, np.inf):
        for field in ("points",):
            broken = links.copy()
            broken[0][field][3] = bad
            found = pairs.check(broken, slices, EVERY)
            assert found is not None and not found.gap_m > MARGIN
        for field in ("dq_max", "q_error"):
            wrong = slices.copy()
            wrong[0][field][..., 4] = bad
            assert pairs.check(links, wrong, EVERY) is not None
    for field, value in (("n_points", 0), ("slice", 1), ("owner", 0)):
        broken = links.copy()
        broken[0][field][5] = value
        assert pairs.check(broken, slices, EVERY) is not None
    for field in ("dq_max", "q_error"):
        wrong = slices.copy()
        wrong[0][field][..., 4] = -1.0
        assert pairs.check(links, wrong, EVERY) is not None
    for field, value in (("n", 0), ("n", 2), ("n_joints", 5)):
        wrong = slices.copy()
        wrong[field] = value
        assert pairs.check(links, wrong, EVERY) is not None
    wrong = slices.copy()
    wrong[0]["t"][1] = -1.0
    assert pairs.check(links, wrong, EVERY) is not None


def test_pairs_of_which_neither_moves_are_passed_over(rng: np.random.Generator) -> None:
    model = arm("six", rng)
    model.enclosure[0]["radius"] = 5.0
    slices, links = swept(model, at_rest(model))
    pairs = SelfCollision(model, [], MARGIN)
    active = np.zeros(24, dtype=np.uint8)
    if pairs.pairs:
        assert pairs.check(links, slices, active) is None
        active[model.links.index(pairs.pairs[0][1])] = 1
        assert pairs.check(links, slices, active) is not None


def test_which_pairs_are_left_out(rng: np.random.Generator) -> None:
    model = slim("branches", rng)
    pairs = SelfCollision(model, [("link_4", "link_1")], MARGIN)
    why = {frozenset((each.a, each.b)): each.why for each in pairs.left_out}
    neighbours = {frozenset(x) for x in (("link_0", "link_1"), ("link_1", "link_2"), ("link_0", "link_3"))}
    neighbours.add(frozenset(("link_3", "link_4")))
    assert {pair for pair, reason in why.items() if reason == "adjacent"} == neighbours
    assert why[frozenset(("link_1", "link_4"))] == "may_touch"
    every = {frozenset(pair) for pair in combinations(model.links, 2)}
    assert set(why) | {frozenset(pair) for pair in pairs.pairs} == every
    assert len(why) + len(pairs.pairs) == len(every)
    for wrong, message in (([("link_1", "link_9")], "link_9"), ([("link_1", "link_1")], "one link")):
        with pytest.raises(WorkspaceError, match=message):
            SelfCollision(model, wrong, MARGIN)
    with pytest.raises(WorkspaceError, match="margin"):
        SelfCollision(model, [], float("nan"))


def test_links_on_one_joint_are_one_body() -> None:
    panda = load_robot("panda", setup=RobotSetup(bare_flange=True))
    left_out = SelfCollision(panda, [], MARGIN).left_out
    rigid = {(each.a, each.b) for each in left_out if each.why == "rigid"}
    fingers = {"panda_link7", "panda_hand", "panda_leftfinger"}
    assert {frozenset(pair) for pair in rigid} == {frozenset(pair) for pair in combinations(fingers, 2)}


@pytest.mark.parametrize("name", ["lwa4p", "ur5", "panda", "ur10e", "fr3"])
def test_what_is_never_apart_overlaps_in_every_posture(
    name: str, rng: np.random.Generator, count: Count
) -> None:
    model = load_robot(name, setup=RobotSetup(bare_flange=True))
    pairs = SelfCollision(model, [], MARGIN)
    never = [each for each in pairs.left_out if each.why == "never_apart"]
    assert bool(never) == (name not in ("ur5", "panda"))
    low, high = model.limits.position_lower, model.limits.position_upper
    q = rng.uniform(low, high, (max(1000, count(100_000)), len(low)))
    gaps = pair_gaps(model, q)
    for each in never:
        assert (gaps[:, model.links.index(each.a), model.links.index(each.b)] < 0.0).all()


def test_a_pair_that_is_hardly_ever_apart_is_compared(rng: np.random.Generator) -> None:
    """A proof, not a sample: balls that overlap but where the second one is turned away."""
    model = arm("planar", rng)
    capsules = model.enclosure[0]
    chain = chains_and_strokes(model)["chain"][0]
    capsules["a"][:2], capsules["b"][:2] = [0.0, 0, 0], [0.4, 0, 0]
    capsules["radius"][:2] = 0.1
    assert never_apart(model, chain, 0, 1)
    capsules["a"][0] = capsules["b"][0] = [0.3, 0, 0]
    capsules["a"][1] = capsules["b"][1] = [0.1, 0, 0]
    for radius, never in ((0.1 + 1e-3, True), (0.1 - 2.5e-4, False), (0.05, False)):
        capsules["radius"][:2] = radius
        assert never_apart(model, chain, 0, 1) == never
