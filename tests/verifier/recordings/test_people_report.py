"""Reports about people in JSON: what goes in comes out; what is wrong is left out and listed."""

import json
import math

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occupancy.body import POINT_NAMES
from verifier.recordings import people_report
from verifier.recordings.people_report import (
    PeopleReport,
    ReportedPerson,
    ReportError,
    _PersonReader,
    decode,
    encode,
)
from verifier.recordings.people_schema import SCHEMA

coordinate = st.floats(-100.0, 100.0)
error = st.floats(0.0, 1.0)


@st.composite
def people(draw):
    count = draw(st.integers(1, 20))
    columns = draw(st.permutations(range(20)))[:count]
    xyz, error_m, measured = np.full((20, 3), np.nan), np.full(20, np.nan), 0
    common = draw(st.one_of(st.none(), error))
    for column in columns:
        xyz[column] = draw(st.tuples(coordinate, coordinate, coordinate))
        own = common if common is not None else draw(error)
        error_m[column] = own
        measured |= draw(st.booleans()) << column
    return ReportedPerson(draw(st.text(min_size=1, max_size=5)), xyz, error_m, measured)


@st.composite
def reports(draw):
    persons = draw(st.lists(people(), max_size=3, unique_by=lambda p: p.id))
    stamp = draw(st.integers(-(10**12), 10**12) | st.integers(10**18, 2 * 10**18))
    return PeopleReport(stamp, 7, draw(st.text(max_size=5)), draw(st.booleans()), tuple(persons))


@settings(max_examples=50, derandomize=True, deadline=None)
@given(reports())
def test_round_trip(report):
    data = encode(report)
    jsonschema.validate(json.loads(data), json.loads(SCHEMA))
    back = decode(data, 7)
    assert (back.stamp_ns, back.arrived_ns, back.frame, back.complete) == (
        report.stamp_ns,
        7,
        report.frame,
        report.complete,
    )
    assert not back.flaws
    for one, two in zip(report.people, back.people, strict=True):
        assert (one.id, one.measured) == (two.id, two.measured)
        np.testing.assert_array_equal(one.xyz, two.xyz)
        np.testing.assert_array_equal(one.error_m, two.error_m)


def test_the_format_is_that_of_the_documentation():
    xyz = np.full((20, 3), np.nan)
    xyz[POINT_NAMES.index("r_wrist")] = 0.1, 0.2, 0.3
    error_m = np.full(20, 0.02)
    person = ReportedPerson("p1", xyz, error_m, 1 << POINT_NAMES.index("r_wrist"))
    assert json.loads(encode(PeopleReport(1_500_000_000, 0, "world", True, (person,)))) == {
        "stamp": 1.5,
        "frame": "world",
        "complete": True,
        "people": [
            {
                "id": "p1",
                "position_error_m": 0.02,
                "points": {"r_wrist": {"xyz": [0.1, 0.2, 0.3], "state": "measured"}},
            }
        ],
    }


def message(**changes):
    content = {"stamp": 1.0, "frame": "world", "complete": True, "people": [person()]} | changes
    return json.dumps({key: value for key, value in content.items() if value is not ...}).encode()


def person(**changes):
    content = {"id": "p1", "position_error_m": 0.02, "points": {"r_wrist": point(), "head": point()}}
    return content | changes


def point(**changes):
    return {"xyz": [0.1, 0.2, 0.3], "state": "measured"} | changes


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"stamp": ' + b"[" * 100_000, "not JSON"),
        (message().replace(b"1.0", b"1" * 5000), "not JSON: a number has too many digits"),
        (message()[:-1] + b', "people": []}', "key 'people' is given twice in one object"),
        (message().replace(b'"head"', b'"r_wrist"'), "key 'r_wrist' is given twice in one object"),
        (b"[]", "not a JSON object"),
        (message(stamp=...), '"stamp" must be a number of seconds, not None'),
        (message(stamp="1"), "\"stamp\" must be a number of seconds, not '1'"),
        (message(stamp=True), '"stamp" must be'),
        (message(stamp=math.nan), '"stamp" must be'),
        (message(stamp=math.inf), '"stamp" must be'),
        (message(stamp=1e300), '"stamp" must be'),
        (message(stamp=10**400), '"stamp" must be'),
        (message(frame=...), '"frame" must name'),
        (message(complete="yes"), '"complete" must be'),
        (message(people=...), '"people" must be a list'),
        (message(people={}), '"people" must be a list'),
    ],
)
def test_what_is_no_report(data, why):
    with pytest.raises(ReportError) as caught:
        decode(data, 0)
    assert why in str(caught.value)


@pytest.mark.parametrize("depth", range(100, 1000, 20))
def test_a_stamp_that_is_nested_deeply_is_no_report(depth):
    nested = b"[" * depth + b"]" * depth
    with pytest.raises(ReportError):
        decode(message().replace(b"1.0", nested), 0)


def test_digits_without_end_are_not_read_as_a_stamp():
    data = message()[:-1] + b', "more": {"stamp": ' + b"1" * 5000 + b".5}}"
    assert decode(data, 0).stamp_ns == 1_000_000_000


@pytest.mark.parametrize(
    ("data", "who"),
    [
        (b"{", ()),
        (b"[1]", ()),
        (message(people=[]), ()),
        (message(), ("p1",)),
        (message(people=[person(), person(id="p2"), person(id="p2")]), ("p1", "p2")),
        (message(people=[person(), person(id=7)]), ("p1", "nameless")),
        (message(people=[None]), ("nameless",)),
        (message(people={"p1": person()}), ("p1", "nameless")),
        (message()[:-1] + b', "people": []}', ("p1",)),
        (message().replace(b'"id": "p1"', b'"id": "p1", "id": "p2"'), ("p1", "p2")),
        (message().replace(b"0.3", b"1" * 5000), ("p1",)),
    ],
)
def test_who_is_named_in_something_that_is_no_report_is_not_lost(data, who):
    with pytest.raises(ReportError) as caught:
        decode(data.replace(b"1.0", b'"no stamp"'), 0)
    assert caught.value.people == who


@pytest.mark.parametrize("entry", [None, person(id=7), "p1"])
def test_a_report_with_a_person_that_is_no_object_with_an_id_is_refused(entry):
    with pytest.raises(ReportError, match='with an "id"'):
        decode(message(people=[person(id="p0"), entry]), 0)


@pytest.mark.parametrize(
    ("entry", "who", "why"),
    [
        (person(points=[]), "p1", '"points" must be an object'),
        (person(points={}), "p1", '"points" are none'),
        (person(points={"nose": point()}), "p1", "no known point name among ['nose']"),
        (person(position_error_m=-1), "p1", "must be at least 0 m, not -1"),
        (person(position_error_m=math.nan), "p1", "must be at least 0 m, not nan"),
        (person(position_error_m=math.inf), "p1", "must be at least 0 m, not inf"),
        (person(position_error_m="1 cm"), "p1", "must be at least 0 m, not '1 cm'"),
    ],
)
def test_a_person_that_is_not_readable_stays_without_points(entry, who, why):
    """Missing points, not a missing person: nothing is verified about somebody just known to be there."""
    report = decode(message(people=[person(id="p0"), entry]), 0)
    assert [p.id for p in report.people] == ["p0", "p1"]
    assert np.isnan(report.people[1].xyz).all() and report.people[1].measured == 0
    (flaw,) = report.flaws
    assert (flaw.person, flaw.point) == (who, None)
    assert why in flaw.reason


@pytest.mark.parametrize(
    ("entry", "why"),
    [
        ([0.1, 0.2, 0.3], "must be an object"),
        (point(state="guessed"), '"state": "measured" or "inferred"'),
        ({"xyz": [0, 0, 1]}, '"state": "measured" or "inferred"'),
        (point(xyz=[1, 2]), "must be three numbers"),
        (point(xyz=[1, 2, 3, 4]), "must be three numbers"),
        (point(xyz=[1, 2, "3"]), "must be three numbers"),
        (point(xyz=[1, 2, True]), "must be three numbers"),
        (point(error_m=-0.1), '"error_m" must be at least 0 m'),
        (point(error_m=math.nan), '"error_m" must be at least 0 m'),
        (point(error_m=math.inf), '"error_m" must be at least 0 m'),
    ],
)
def test_a_point_that_is_not_readable_is_a_missing_point(entry, why):
    report = decode(message(people=[person(points={"r_wrist": entry, "head": point()})]), 0)
    (someone,) = report.people
    assert np.isnan(someone.xyz[POINT_NAMES.index("r_wrist")]).all()
    assert someone.measured == 1 << POINT_NAMES.index("head")
    (flaw,) = report.flaws
    assert (flaw.person, flaw.point) == ("p1", "r_wrist")
    assert why in flaw.reason
    assert report.complete


def test_missing_numbers_are_left_to_the_gate():
    points = {
        "head": point(xyz=[None, 1, 2]),
        "r_wrist": point(xyz=[math.nan, 1, 2]),
        "l_wrist": point(xyz=[0, 0, 0]),
        "r_elbow": point(xyz=[math.inf, 0, 10**400]),
    }
    report = decode(message(people=[person(points=points)]), 0)
    xyz = report.people[0].xyz
    assert np.isnan(xyz[POINT_NAMES.index("head")][0])
    assert np.isnan(xyz[POINT_NAMES.index("r_wrist")][0])
    assert not xyz[POINT_NAMES.index("l_wrist")].any()
    assert xyz[POINT_NAMES.index("r_elbow")].tolist() == [math.inf, 0.0, math.inf]
    assert not report.flaws


def test_inferred_points_are_kept_but_not_measured():
    report = decode(message(people=[person(points={"head": point(state="inferred")})]), 0)
    assert report.people[0].measured == 0
    assert np.isfinite(report.people[0].xyz[0]).all()


def test_names_that_a_writer_did_not_know_are_listed():
    """They bear nothing: whatever else stands there is passed over."""
    data = message(people=[person(points={"nose": point(), "head": point()})], unknown_points=["HEAD", 3])
    assert decode(data, 0).unknown_points == {"HEAD", "nose"}
    for wrong in (None, "HEAD", {"HEAD": 1}, 7):
        report = decode(message(people=[person(points={"head": point()})], unknown_points=wrong), 0)
        assert not report.unknown_points and not report.flaws
    assert decode(encode(decode(data, 0)), 0).unknown_points == {"HEAD", "nose"}


def test_unknown_names_are_listed_and_can_be_mapped():
    data = message(people=[person(points={"RightHand": point(), "nose": point(), "head": point()})])
    report = decode(data, 0)
    assert report.unknown_points == {"RightHand", "nose"}
    report = decode(data, 0, {"RightHand": "r_hand"})
    assert report.unknown_points == {"nose"}
    assert report.people[0].measured == 1 | 1 << POINT_NAMES.index("r_hand")


def test_two_names_for_one_point_are_no_point():
    data = message(people=[person(points={"a": point(), "r_hand": point(), "b": point(), "head": point()})])
    report = decode(data, 0, {"a": "r_hand", "b": "r_hand"})
    assert report.people[0].measured == 1
    assert np.isnan(report.people[0].xyz[POINT_NAMES.index("r_hand")]).all()
    assert {flaw.point for flaw in report.flaws} == {"r_hand"}


def test_an_id_that_is_given_very_often_takes_no_longer(monkeypatch):
    """Every name is tried twice at most, not as often as the id was there before."""
    tried = 0

    class Counted(set):
        def __contains__(self, name):
            nonlocal tried
            tried += 1
            return super().__contains__(name)

    def reader(*given):
        made = _PersonReader(*given)
        made._ids = Counted()
        return made

    monkeypatch.setattr(people_report, "_PersonReader", reader)
    report = decode(message(people=[person(points={})] * 1000), 0)
    assert report.people[-1].id == "p1 (1000)"
    assert tried < 3000


def test_nobody_vanishes_behind_an_id_that_is_given_twice():
    report = decode(message(people=[person(), person(), person()]), 0)
    assert [p.id for p in report.people] == ["p1", "p1 (2)", "p1 (3)"]
    assert len(report.flaws) == 2
    assert report.complete


def test_an_empty_id_is_a_person_too():
    report = decode(message(people=[person(id=""), person(id="")]), 0)
    assert [p.id for p in report.people] == ["nameless", "nameless (2)"]


def test_own_error_of_a_point_comes_first():
    points = {"head": point(error_m=0.5), "r_wrist": point()}
    (someone,) = decode(message(people=[person(points=points)]), 0).people
    assert someone.error_m[0] == 0.5
    assert someone.error_m[POINT_NAMES.index("r_wrist")] == 0.02
    (someone,) = decode(message(people=[person(points=points, position_error_m=None)]), 0).people
    assert someone.error_m[0] == 0.5
    assert np.isnan(someone.error_m[POINT_NAMES.index("r_wrist")])
