"""Numbers that stand in files, what each reason stands for, and what to work on first."""

from __future__ import annotations

import math
from enum import IntEnum

import pytest

from verifier.verdict import (
    CRITERION_OF_REASON,
    STATUS_OF_REASON,
    Budget,
    CriterionKind,
    Reason,
    Status,
    Witness,
    not_followed,
    verdict,
)


@pytest.mark.parametrize(("kind", "many"), [(Status, 4), (Reason, 29), (CriterionKind, 6)])
def test_numbers_go_up_from_zero_in_the_order_in_which_names_were_given(
    kind: type[IntEnum], many: int
) -> None:
    """Files of earlier versions have these numbers: a new name goes to the end."""
    assert [int(each) for each in kind] == list(range(many)) == [int(x) for x in kind.__members__.values()]


def test_every_reason_has_a_status_and_a_text_of_its_own() -> None:
    assert set(STATUS_OF_REASON) == set(Reason)
    assert len({each.text for each in Reason}) == len(Reason)
    verified = {reason for reason, status in STATUS_OF_REASON.items() if status is Status.VERIFIED}
    assert verified == {
        Reason.SEPARATED, Reason.AT_REST, Reason.NOBODY_ASSUMED, Reason.NOBODY_REPORTED,
        Reason.CONTACT_WITHIN_LIMITS,
    }  # fmt: skip


@pytest.mark.parametrize("reason", Reason)
def test_a_verdict_is_what_its_reason_stands_for(reason: Reason) -> None:
    answer = verdict(reason, 2.5, gap_m=0.25, stop_time_s=0.75, not_checked=5)
    own = CRITERION_OF_REASON.get(reason, CriterionKind.SEPARATION)
    assert answer == (STATUS_OF_REASON[reason], reason, 2.5, 0.25, 0.75, int(own), 5)
    other = verdict(
        reason, 2.5, gap_m=0.25, stop_time_s=0.75, not_checked=5, criterion=CriterionKind.TORQUE
    ).criterion
    assert other == CRITERION_OF_REASON.get(reason, CriterionKind.TORQUE)
    late = not_followed(answer)
    assert (late.status, late.reason) == (Status.NOT_VERIFIED, Reason.STOP_NOT_FOLLOWED)
    assert late[2:] == answer[2:]


def budget(**terms: float) -> Budget:
    zeros = dict.fromkeys(("latency", "stop", "error", "body", "margin", "distance", "link", "sides"), 0.0)
    return Budget(**(zeros | terms))


@pytest.mark.parametrize("largest", ["latency", "stop", "error", "sides"])
def test_the_largest_term_comes_first(largest: str) -> None:
    terms = {"latency": 0.1, "stop": 0.1, "error": 0.1, "margin": 9.0, "distance": 9.0, "link": 9.0}
    assert budget(**terms | {largest: 0.2}, body=5.0).shrink_first(inferred=False) == largest
    assert budget(**terms | {largest: 0.2}, body=0.15).shrink_first(inferred=True) == largest


def test_the_radius_of_a_body_part_counts_where_it_was_inferred() -> None:
    terms = budget(latency=0.1, stop=0.2, error=0.3, body=0.4)
    assert (terms.shrink_first(inferred=False), terms.shrink_first(inferred=True)) == ("error", "body")


@pytest.mark.parametrize("inferred", [False, True])
@pytest.mark.parametrize("unknown", ["latency", "stop", "error", "sides"])
def test_where_a_term_is_unknown_none_comes_first(unknown: str, inferred: bool) -> None:
    terms = budget(**{"latency": 0.1, "stop": 0.2} | {unknown: math.nan})
    assert terms.shrink_first(inferred=inferred) == ""


def witness(terms: Budget, model: str = "iso13855", other: str = "", *, inferred: bool = False) -> Witness:
    nowhere = (math.nan, math.nan, math.nan)
    return Witness(
        cycle_t=0.0, slice=(0.0, 0.1), link="arm", person="p", part="head", gap_m=0.0,
        points=(nowhere, nowhere), criterion="separation", model=model, inferred=inferred, age_s=0.0,
        budget=terms, other=other,
    )  # fmt: skip


TERMS = {"latency": 0.1, "stop": 0.3, "error": 0.2, "body": 0.4, "margin": 0.05}


def test_a_witness_against_somebody_listed_names_the_largest_term() -> None:
    terms = budget(**TERMS, distance=0.3, link=0.29)
    seen = witness(terms)
    assert seen.other == "" and seen.region is None and seen.room_m == pytest.approx(0.01)
    assert (seen.shrink_first, witness(terms, inferred=True).shrink_first) == ("stop", "body")


@pytest.mark.parametrize("inferred", [False, True])
def test_of_two_things_that_are_not_people_the_error_is_what_can_be_worked_on(inferred: bool) -> None:
    assert witness(budget(**TERMS), "", "floor", inferred=inferred).shrink_first == "error"


@pytest.mark.parametrize(
    ("distance", "first"), [(0.25, "region"), (0.5, "region"), (0.75, "region"), (0.78125, "stop")]
)
def test_a_link_that_is_hardly_inside_of_the_monitored_region_needs_a_larger_one(
    distance: float, first: str
) -> None:
    terms = budget(latency=0.125, stop=0.375, error=0.25, margin=0.25, distance=distance, link=0.5)
    seen = witness(terms, "unobserved:cell:2")
    assert (seen.region, seen.room_m, seen.shrink_first) == ("cell:2", distance - 0.5, first)
    listed = witness(terms, "pedestrian:cell")
    assert listed.region is None and listed.shrink_first == "stop"


def test_numbers_that_could_be_mistaken_for_one_another_are_named() -> None:
    with pytest.raises(TypeError):
        verdict(Reason.SEPARATED, 0.0, 0.25, 0.75, 5)
    with pytest.raises(TypeError):
        budget().shrink_first(True)
