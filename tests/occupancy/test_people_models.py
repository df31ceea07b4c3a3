"""Set-up of the models of people: sizes that differ from part to part, options, bounds of settings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.body import MAX_PARTS, MAX_POINTS, Part, Point, Profile, load_profile
from occupancy.humans.arm_reach import ArmReach
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedPosition, ArticulatedVelocity
from occupancy.humans.catalog import MODEL_NAMES, build_models
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.kernels import choose_rows
from occupancy.humans.model import Occupancy
from occupancy.humans.options import ModelError, OptionModel, held_object
from occupancy.humans.pedestrian import Pedestrian
from occupancy.humans.unobserved import UnobservedSpace
from occupancy.region import Monitored, Region
from robots.assumption import Certainty
from robots.motion import Block, new_slices
from tests.occupancy.arm_scenes import person, rows, slices
from tests.occupancy.moving_people import HANDS, SEGMENTS
from tests.occupancy.people import mask

Array = NDArray[np.float64]
Count = Callable[[int], int]
TUM = load_profile("tum")
ENDS = {**SEGMENTS, **{hand: (points[0], points[0]) for hand, points in HANDS.items()}}
ARMS = {f"{side}_{name}" for side in "LR" for name in ("UPPER_ARM", "FOREARM", "HAND")}
SHOULDERS = (Point.L_SHOULDER, Point.R_SHOULDER)
BELOW_SHOULDER, BELOW_HIP = ("ELBOW", "WRIST", "HAND", "FINGERTIP"), ("KNEE", "ANKLE")


def uneven(rng: np.random.Generator) -> Profile:
    """Each part and each pair of points with a size of its own, shoulders with speeds of their own."""
    chain = TUM.chain * rng.uniform(1.0, 1.2, TUM.chain.shape)
    radius, speed = (
        TUM.radius * rng.uniform(1.0, 2.0, MAX_PARTS),
        TUM.speed * rng.uniform(0.5, 1.0, MAX_POINTS),
    )
    return replace(TUM, radius=radius, chain=np.maximum(chain, chain.T), speed=speed)


# ---------------------------------------------------------------------------------------------------- options


def of_the_limb(part: Part) -> set[Point]:
    """Points that move with the limb of a part: the position model does without them."""
    if part in (Part.HEAD, Part.NECK):
        return {Point.HEAD}
    below = BELOW_SHOULDER if part.name in ARMS else BELOW_HIP
    return {Point[f"{part.name[:2]}{each}"] for each in below}


def least_chain(model: OptionModel, part: Part, seen: list[Point]) -> float:
    """Shortest chain [m] by which a part hangs on what was seen, all ways tried; inf: it is not enclosed."""
    a, b = ENDS[part]
    chain, ways = model.profile.chain, [math.inf]
    if isinstance(model, ArticulatedPosition):
        if part in (Part.TORSO, Part.PELVIS):
            return math.inf
        return min(
            [max(chain[m, a], chain[m, b]) for m in seen if m not in of_the_limb(part)], default=math.inf
        )
    if part in HANDS and set(HANDS[part]) & set(seen):
        return 0.0
    for m1 in seen:
        ways += [max(chain[m1, a], chain[m2, b]) for m2 in (seen if a != b else [m1])]
    return float(min(ways))


@pytest.mark.parametrize("kind", [ArticulatedVelocity, ArticulatedAcceleration, ArticulatedPosition])
def test_every_part_is_enclosed_by_the_shortest_chain_of_all(
    kind: type[OptionModel], rng: np.random.Generator, count: Count
) -> None:
    """Whatever was seen, all at one time: none of the options that are kept is missing."""
    model = kind(uneven(rng), held_object_m=0.3)
    table = model._table[0]
    for _ in range(max(20, count(2_000))):
        seen = [p for p in Point if rng.random() < rng.choice([0.1, 0.5, 0.9])]
        picked, covers = np.zeros(MAX_PARTS, np.int64), np.zeros(MAX_PARTS, np.int64)
        n = choose_rows(mask(*seen), np.zeros(MAX_POINTS), table, picked, covers)
        inferred = 0
        for part in Part:
            chain = least_chain(model, part, seen)
            own = [row for row, covered in zip(picked[:n], covers[:n], strict=True) if covered >> part & 1]
            assert len(own) == (chain < math.inf)
            for row in own:
                held = 0.3 if part in HANDS else 0.0
                assert table["chain"][row] == pytest.approx(chain)
                assert table["radius"][row] == pytest.approx(model.profile.radius[part] + held + chain)
                assert {Point(p) for p in table["point"][row, : table["n_points"][row]]} <= set(seen)
                inferred |= (1 << part) * (chain > 0.0)
        assert model.inferred_parts(mask(*seen)) == inferred
    enclosed = [part for part in Part if least_chain(model, part, list(Point)) < math.inf]
    assert model.proves == sum(1 << part for part in enclosed)


def test_the_trunk_is_the_hull_of_all_that_was_measured_of_it() -> None:
    """With pelvis, thorax and neck by the velocity model; with two of them at both ends of a slice."""
    for kind, seen, points in (
        (ArticulatedVelocity, (Point.PELVIS, Point.THORAX, Point.NECK_BASE), 3),
        (ArticulatedVelocity, (Point.PELVIS, Point.NECK_BASE), 2),
        (ArticulatedAcceleration, (Point.PELVIS, Point.THORAX, Point.NECK_BASE), 2),
    ):
        model = kind(TUM)
        picked, covers = np.zeros(MAX_PARTS, np.int64), np.zeros(MAX_PARTS, np.int64)
        n = choose_rows(mask(*seen), np.zeros(MAX_POINTS), model._table[0], picked, covers)
        [row] = [
            row for row, covered in zip(picked[:n], covers[:n], strict=True) if covered >> Part.TORSO & 1
        ]
        assert model._table["n_points"][0, row] == points and model._table["chain"][0, row] == 0.0


# ----------------------------------------------------------------------------------------------------- bounds

KINDS = (
    Iso13855, ArticulatedVelocity, ArticulatedAcceleration, ArticulatedPosition, ArmReach, Pedestrian,
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_indices_that_fit_and_objects_without_length_are_accepted(kind: Callable[..., ArmReach]) -> None:
    for index in (0, 7):
        assert kind(TUM, index=index, held_object_m=0.0).index == index
    for index in (-1, 8):
        with pytest.raises(ModelError, match="index"):
            kind(TUM, index=index)
    for held in (-1e-9, math.inf, math.nan):
        with pytest.raises(ModelError, match="held_object_m"):
            kind(TUM, held_object_m=held)


def test_what_is_held_is_declared_or_assumed_to_be_nothing() -> None:
    assert (held_object(None).value, held_object(None).certainty) == (0.0, Certainty.DEFAULT)
    assert (held_object(0.0).value, held_object(0.0).certainty) == (0.0, Certainty.DECLARED)
    for kind in KINDS:
        stated = [
            {a.name: a.value for a in kind(TUM, held_object_m=held).assumptions()} for held in (None, 0.2)
        ]
        assert [each["people.held_object"] for each in stated] == [0.0, 0.2]


def test_an_approach_speed_may_be_that_of_the_profile() -> None:
    fastest = float(TUM.speed.max())
    assert (Iso13855(TUM, approach_speed=fastest)._table["speed"] == fastest).all()
    with pytest.raises(ModelError, match="approach_speed"):
        Iso13855(TUM, approach_speed=math.nextafter(fastest, 0.0))


@pytest.mark.parametrize("floor", [50.0, -50.0, 0.0])
def test_a_floor_is_at_most_fifty_metres_from_the_origin(floor: float) -> None:
    """As far as half of the column reaches, which stands for a floor that is not declared."""
    assert Pedestrian(TUM, floor_m=floor)._ends[0] == floor
    assert Pedestrian(TUM)._ends == (-100.0, 100.0)
    with pytest.raises(ModelError, match="floor_m"):
        Pedestrian(TUM, floor_m=math.copysign(math.nextafter(50.0, 51.0), floor))


@pytest.mark.parametrize("limit", [field.name for field in dataclasses.fields(TUM.arm)])
def test_each_limit_of_the_arm_may_be_zero_and_is_a_number(limit: str) -> None:
    assert ArmReach(replace(TUM, arm=replace(TUM.arm, **{limit: 0.0}))).profile.arm is not None
    for value in (-1e-9, math.inf, math.nan):
        with pytest.raises(ModelError, match=f"arm.{limit}"):
            ArmReach(replace(TUM, arm=replace(TUM.arm, **{limit: value})))


# ------------------------------------------------------------------------------------------------------ sizes


def test_rows_of_arms_have_the_largest_sizes_and_the_speed_of_their_own_shoulder(
    rng: np.random.Generator,
) -> None:
    """Half the longest forearm, the thickest of all upper arms and forearms, the largest hand."""
    for _ in range(20):
        profile, held = uneven(rng), 0.25
        half = 0.5 * max(profile.chain[Point[f"{s}_ELBOW"], Point[f"{s}_WRIST"]] for s in "LR")
        arms = max(profile.radius[part] for part in Part if part.name[2:] in ("UPPER_ARM", "FOREARM"))
        hands = max(profile.radius[part] for part in Part if part.name[2:] == "HAND") + held
        people, plan = person(e_p=0.0), slices(np.array([0.0, 0.02]))
        found = rows(ArmReach(profile, held_object_m=held), people, plan)
        wanted = [half + body + 0.02 * profile.speed[s] for s in SHOULDERS for body in (arms, hands)]
        assert [radius for _, radius, _ in found] == pytest.approx(wanted)


def test_a_capsule_of_somebody_on_the_floor_ends_where_the_larger_foot_may_reach(
    rng: np.random.Generator,
) -> None:
    for _ in range(20):
        profile, held = uneven(rng), float(rng.choice([0.0, 2.0]))
        ends = np.array([ENDS[part] for part in Part])
        extra = profile.radius + held * np.array([part in HANDS for part in Part])
        reach = (profile.chain[:, ends].max(axis=2) + extra).max(axis=1)
        model = Pedestrian(profile, floor_m=1.0, held_object_m=held)
        table = model._table[0]
        for row in range(int(table["n_rows"])):
            assert table["radius"][row] == table["chain"][row] == pytest.approx(reach[table["point"][row, 0]])
        feet = ((Part.L_FOOT, Point.L_ANKLE), (Part.R_FOOT, Point.R_ANKLE))
        assert model._ends == pytest.approx((1.0, 1.0 + max(profile.radius[f] + reach[p] for f, p in feet)))
        assert (table["speed"] == profile.speed.max()).all()


@pytest.mark.parametrize("angle", [0.5, 3.0])
def test_elevations_of_the_published_face_end_upright(angle: float) -> None:
    """Beyond a quarter turn an elevation is one on the other side; other angles are those of the profile."""
    arm = replace(TUM.arm, abduction=angle, adduction=1.1 * angle, flexion=0.7, extension=0.3)
    table = ArmReach(replace(TUM, arm=arm), face="as_published")._table[0]
    upright = 0.5 * math.pi
    assert tuple(table["low"][:2]) == (-0.3, -min(1.1 * angle, upright))
    assert tuple(table["high"][:2]) == (0.7, min(angle, upright))
    assert table["low"][2] == table["extension"][0] and table["high"][2] == table["extension"][1]


def test_rows_of_unobserved_space_contain_what_matters_and_no_more_than_they_say(
    rng: np.random.Generator,
) -> None:
    """A face at its plane, the three others at R = 100 m + 100 m + |c| from the foot c of the origin."""
    for _ in range(10):
        low = rng.uniform(-90.0, 50.0, 3)
        region = Region.box(tuple(low), tuple(low + rng.uniform(1.0, 40.0, 3)))
        faces = UnobservedSpace(Monitored("cell", region, 0.1), TUM)._faces
        for corners, normal, offset in zip(faces, region.normal, region.offset, strict=True):
            np.testing.assert_allclose(corners[:3] @ normal, offset, atol=1e-9)
            assert corners[3] @ normal > offset
            for left_out in range(3):
                a, b, c = np.delete(corners, left_out, axis=0)
                across = np.cross(b - a, c - a)
                across /= np.linalg.norm(across)
                assert abs((offset * normal - a) @ across) == pytest.approx(200.0 + abs(offset))


# -------------------------------------------------------------------------------------------------- catalogue


def test_models_are_built_in_the_order_of_the_catalogue_with_what_is_held() -> None:
    found = build_models(TUM, MODEL_NAMES[::-1], 0.2)
    assert [model.name for model in found] == list(MODEL_NAMES)
    assert [model.index for model in found] == list(range(len(MODEL_NAMES)))
    for model in found:
        assert {a.name: a.value for a in model.assumptions()}["people.held_object"] == 0.2
        assert model.profile is TUM
    assert build_models(TUM, MODEL_NAMES[3:4])[0].index == 0


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ((), "at least one"), (("iso13855", "arm_reach", "iso13855"), "each once"),
        (("iso13855", "other"), "there is no model of people 'other'"),
        (("unobserved",), "there is no model of people 'unobserved'"),
    ],
)  # fmt: skip
def test_names_are_known_and_stand_there_once(names: tuple[str, ...], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        build_models(TUM, names)


def test_models_follow_from_the_profile_and_its_own_names_are_known() -> None:
    with pytest.raises(ModelError, match=r"arm_reach does not follow from profile tum; these do: iso13855$"):
        build_models(replace(TUM, models=("iso13855", "unobserved")), ("iso13855", "arm_reach"))
    with pytest.raises(ModelError, match="names a model 'other' that is not known"):
        build_models(replace(TUM, models=("iso13855", "other")), ("iso13855",))


def test_rows_are_made_once_for_what_is_asked_and_when_somebody_looks() -> None:
    asked: list[tuple[Block, Block]] = []

    class Counting(Iso13855):
        def occupy(self, people: Block, slices: Block, out: Block) -> None:
            asked.append((people, slices))
            super().occupy(people, slices, out)

    occupancy, plan, people = Occupancy(Counting(TUM)), new_slices(), person()
    assert occupancy.sets["n"] == 0 and not asked
    plan["n"] = 1
    occupancy.begin(people, plan)
    assert not asked
    assert occupancy.sets["n"] > 0 and occupancy.sets is occupancy.sets and len(asked) == 1
    assert asked[0][0] is people and asked[0][1] is plan
    occupancy.begin(person(), plan)
    assert occupancy.sets["n"] > 0 and len(asked) == 2
