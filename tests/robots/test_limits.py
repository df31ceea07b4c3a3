"""Joint limits: validation, sources, and one message for all gaps."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest

from robots.assumption import Certainty
from robots.errors import SetupError
from robots.limits import (
    QUANTITIES,
    JointLimits,
    Limit,
    MissingLimits,
    assemble,
    declared_limits,
    file_limits,
    key_of,
    override,
    unit_of,
    urdf_limits,
)
from robots.urdf import UrdfJoint

GOOD = {
    "position_lower": [-1.0, -math.inf],
    "position_upper": [1.0, math.inf],
    "velocity": [2.0, 3.0],
    "acceleration": [5.0, 5.0],
    "jerk": [50.0, 50.0],
    "torque": [10.0, math.inf],
}


def limits(**changes: list[float]) -> JointLimits:
    return JointLimits(("a", "b"), **{key: np.array(value) for key, value in (GOOD | changes).items()})


def test_good_limits_are_kept_and_cannot_be_written() -> None:
    kept = limits()
    for quantity in QUANTITIES:
        values = getattr(kept, quantity)
        assert values.dtype == np.float64 and values.tolist() == GOOD[quantity]
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0.0


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk"])
def test_speed_acceleration_and_jerk_must_be_finite_and_positive(quantity: str, value: float) -> None:
    with pytest.raises(SetupError, match=f"joint b: {quantity}"):
        limits(**{quantity: [1.0, value]})


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, -math.inf])
def test_torque_must_be_positive(value: float) -> None:
    with pytest.raises(SetupError, match="joint a: torque"):
        limits(torque=[value, 1.0])


@pytest.mark.parametrize(
    ("lower", "upper"), [(1.0, 1.0), (1.0, -1.0), (math.nan, 1.0), (-1.0, math.nan), (math.inf, math.inf)]
)
def test_lower_position_limit_must_be_below_the_upper_one(lower: float, upper: float) -> None:
    with pytest.raises(SetupError, match="joint a: lower position limit"):
        limits(position_lower=[lower, -1.0], position_upper=[upper, 1.0])


def test_one_value_for_each_joint() -> None:
    with pytest.raises(SetupError, match=r"jerk limits have shape \(1,\)"):
        limits(jerk=[1.0])


def known(*joints: str, skip: tuple[str, ...] = ()) -> dict[tuple[str, str], Limit]:
    values = dict(zip(QUANTITIES, (-1.0, 1.0, 2.0, 3.0, 4.0, 5.0), strict=True))
    return {
        (joint, quantity): Limit(joint, quantity, value, "?", "test", Certainty.SOURCED)
        for joint in joints
        for quantity, value in values.items()
        if quantity not in skip
    }


def test_all_gaps_are_named_in_one_message_with_the_table_that_fills_them() -> None:
    entries = known("a", "rail x", skip=("acceleration", "jerk"))
    del entries["a", "position_lower"]
    prismatic = {"a": False, "rail x": True}
    with pytest.raises(MissingLimits) as caught:
        assemble("robot", prismatic, entries)
    error = caught.value
    assert isinstance(error, SetupError) and "\n" not in str(error)
    assert error.gaps == {
        "a": ("position_lower_rad", "acceleration_rad_s2", "jerk_rad_s3"),
        "rail x": ("acceleration_m_s2", "jerk_m_s3"),
    }
    named = str(error).split("none is assumed: ")[1].split(". Add")[0]
    assert named == (
        "robot.limits.a.position_lower_rad = ____, robot.limits.a.acceleration_rad_s2 = ____, "
        "robot.limits.a.jerk_rad_s3 = ____, "
        'robot.limits."rail x".acceleration_m_s2 = ____, robot.limits."rail x".jerk_m_s3 = ____'
    )
    table = tomllib.loads(error.table)["limits"]
    assert {joint: tuple(row) for joint, row in table.items()} == error.gaps
    assert "[limits.a]" in error.table and '[limits."rail x"]' in error.table
    inline = tomllib.loads(str(error).split("under [robot]: ")[1])["limits"]
    dotted = tomllib.loads(named.replace("____", '"?"').replace(", ", "\n"))["robot"]["limits"]
    assert inline == dotted == table

    with pytest.raises(SetupError, match="is not a number"):
        declared_limits(table, prismatic, "user")
    filled = {joint: dict.fromkeys(row, -0.5) | {"jerk_rad_s3": 9.0} for joint, row in table.items()}
    filled["rail x"] = {"acceleration_m_s2": 1.0, "jerk_m_s3": 9.0}
    filled["a"]["acceleration_rad_s2"] = 1.0
    complete, rows = assemble("robot", prismatic, entries | declared_limits(filled, prismatic, "user"))
    assert complete.jerk.tolist() == [9.0, 9.0] and complete.position_lower.tolist() == [-0.5, -1.0]
    assert {row.certainty for row in rows if row.quantity == "jerk"} == {Certainty.DECLARED}


def test_an_unknown_torque_limit_is_infinite_and_says_so() -> None:
    complete, rows = assemble("robot", {"a": False}, known("a", skip=("torque",)))
    assert complete.torque.tolist() == [math.inf]
    (row,) = (row for row in rows if row.quantity == "torque")
    assert row.certainty is Certainty.UNVERIFIED and "none is checked" in row.source


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"c": {"jerk_rad_s3": 1.0}}, "no such commanded joint; there are: a, rail"),
        ({"a": {"jerk_m_s3": 1.0}}, r"limits\.a\.jerk_m_s3: unknown key"),
        ({"a": {"velocity_deg_s": 1.0}}, "unknown key; possible are: position_lower_rad"),
        ({"rail": {"velocity_rad_s": 1.0}}, "unknown key; possible are: position_lower_m"),
        ({"a": {"jerk_rad_s3": "?"}}, "is not a number"),
        ({"a": {"jerk_rad_s3": True}}, "is not a number"),
        ({"a": {"jerk_rad_s3": math.nan}}, "is not a number"),
        ({"a": {"jerk_rad_s3": 1e308}}, r"limits\.a\.jerk_rad_s3 = 1e\+308 is beyond 1e\+06"),
        ({"rail": {"position_upper_m": -1_000_001}}, "is beyond"),
        ({"a": {"jerk_rad_s3": 10**400}}, "is beyond"),
        ({"a": {"jerk_rad_s3": 16**6000}}, "= a huge int is beyond"),
        ({"a": 3.0}, "must be a table"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(table: dict[str, dict[str, object]], message: str) -> None:
    with pytest.raises(SetupError, match=message) as caught:
        declared_limits(table, {"a": False, "rail": True}, "user")
    assert "\n" not in str(caught.value)


def test_messages_name_the_table_of_the_user() -> None:
    with pytest.raises(SetupError, match=r"^cell\.toml: robot\.limits\.elbow: no such commanded joint"):
        declared_limits({"elbow": {}}, {"a": False}, "user", "cell.toml: robot.limits")
    entries = known("a")
    stated = declared_limits({"a": {"position_lower_rad": 2}}, {"a": False}, "user")
    with pytest.raises(SetupError) as caught:
        assemble("robot", {"a": False}, entries | stated, "cell.toml: robot.limits")
    rule = "lower position limit 2 (user) must be below the upper one, 1 (test)"
    assert str(caught.value) == f"cell.toml: robot.limits.a: {rule}"


def test_limits_out_of_a_file_that_are_beyond_reason_are_refused_with_their_source() -> None:
    entries = urdf_limits([urdf_joint(velocity=1e308, lower=-math.inf, upper=math.inf)], "x.urdf")
    rest = {key: limit for key, limit in known("j").items() if key not in entries}
    with pytest.raises(
        SetupError, match=r"joint j: velocity limit 1e\+308 rad/s \(x\.urdf\) is beyond 1e\+06"
    ):
        assemble("robot", {"j": False}, entries | rest)
    endless = {("j", name): entries["j", name] for name in QUANTITIES[:2]}
    limits, _ = assemble("robot", {"j": False}, known("j") | endless)
    assert limits.position_upper.tolist() == [math.inf]


def urdf_joint(kind: str = "revolute", **values: float | None) -> UrdfJoint:
    numbers = {"lower": -1.0, "upper": 1.0, "velocity": 2.0, "effort": 3.0} | values
    return UrdfJoint("j", kind, "p", "c", mimics=None, **numbers)


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        (urdf_joint(), {"position_lower": -1.0, "position_upper": 1.0, "velocity": 2.0, "torque": 3.0}),
        (urdf_joint(velocity=0.0), {"position_lower": -1.0, "position_upper": 1.0, "torque": 3.0}),
        (urdf_joint(velocity=math.inf), {"position_lower": -1.0, "position_upper": 1.0, "torque": 3.0}),
        (urdf_joint(effort=0.0), {"position_lower": -1.0, "position_upper": 1.0, "velocity": 2.0}),
        (urdf_joint(lower=0.0, upper=0.0), {"velocity": 2.0, "torque": 3.0}),
        (urdf_joint(lower=None), {"velocity": 2.0, "torque": 3.0}),
        (
            urdf_joint("continuous", lower=None, upper=None, velocity=None, effort=None),
            {"position_lower": -math.inf, "position_upper": math.inf},
        ),
    ],
)
def test_zeros_and_empty_ranges_in_a_urdf_are_gaps(joint: UrdfJoint, expected: dict[str, float]) -> None:
    found = urdf_limits([joint], "x.urdf")
    assert {quantity: limit.value for (_, quantity), limit in found.items()} == expected
    assert all(limit.urdf_value == limit.value for limit in found.values())


def test_a_stronger_source_overrides_and_the_urdf_value_is_remembered() -> None:
    weak = urdf_limits([urdf_joint()], "x.urdf")
    entry = {"unit": "deg/s", "values": [90.0], "source": "maker", "certainty": "sourced"}
    strong = file_limits({"velocity": entry, "jerk": entry | {"unit": "rad/s³"}}, ["j"], {"j": False})
    merged = override(weak, strong)
    assert merged["j", "velocity"].value == pytest.approx(np.pi / 2)
    assert merged["j", "velocity"].urdf_value == 2.0 and merged["j", "velocity"].differs_from_urdf
    assert merged["j", "velocity"].source == "maker" and merged["j", "velocity"].unit == "rad/s"
    assert merged["j", "jerk"].urdf_value is None and not merged["j", "jerk"].differs_from_urdf
    assert not merged["j", "torque"].differs_from_urdf


def test_keys_and_units_name_the_same_quantity() -> None:
    assert key_of("jerk", False) == "jerk_rad_s3" and unit_of("jerk", False) == "rad/s³"
    assert key_of("torque", True) == "force_N" and unit_of("torque", True) == "N"
    assert key_of("torque", False) == "torque_Nm" and unit_of("torque", False) == "N m"


def test_units_of_a_model_file_become_those_of_the_model() -> None:
    units = ("rad", "rad/s", "rad/s²", "rad/s³", "N m", "m", "m/s", "m/s²", "m/s³", "N", "deg", "deg/s")
    for unit in units:
        entry = {"unit": unit, "values": [180.0, 7.0], "source": "maker", "certainty": "assumed"}
        for slides in (False, True):
            found = file_limits({"jerk": entry}, ["j", "not commanded"], {"j": slides})
            expected = math.pi if unit.startswith("deg") else 180.0
            assert set(found) == {("j", "jerk")}
            assert found["j", "jerk"].value == pytest.approx(expected, rel=1e-15)
            assert found["j", "jerk"].unit == ("m/s³" if slides else "rad/s³")


def test_a_model_file_has_one_value_for_each_joint_that_it_lists() -> None:
    entry = {"unit": "rad/s", "values": [1.0], "source": "maker", "certainty": "sourced"}
    with pytest.raises(ValueError, match="shorter"):
        file_limits({"velocity": entry}, ["j", "k"], {"j": False, "k": False})


def test_small_limits_and_the_largest_ones_are_limits() -> None:
    small = limits(velocity=[0.5, 1e-3], acceleration=[0.25, 1e-3], jerk=[0.1, 1e-3], torque=[0.5, 1e-3])
    assert small.torque.tolist() == [0.5, 1e-3]
    found = urdf_limits([urdf_joint(velocity=0.25, effort=0.125)], "x.urdf")
    assert (found["j", "velocity"].value, found["j", "torque"].value) == (0.25, 0.125)
    table = {"a": {"position_lower_rad": -1e6, "position_upper_rad": 0, "jerk_rad_s3": 1_000_000}}
    complete, _ = assemble("robot", {"a": False}, known("a") | declared_limits(table, {"a": False}, "user"))
    assert (complete.position_lower[0], complete.position_upper[0], complete.jerk[0]) == (-1e6, 0.0, 1e6)
    just_above = {"a": {"jerk_rad_s3": 1_000_001}}
    with pytest.raises(SetupError, match="is beyond"):
        declared_limits(just_above, {"a": False}, "user")
    far = known("a") | {("a", "jerk"): Limit("a", "jerk", 1_000_001.0, "rad/s³", "maker", Certainty.SOURCED)}
    with pytest.raises(SetupError, match=r"jerk limit 1e\+06 rad/s³ \(maker\) is beyond"):
        assemble("robot", {"a": False}, far)


@pytest.mark.parametrize("upper", [-1.0, -1.5])
def test_an_empty_range_is_refused_by_who_stated_its_ends(upper: float) -> None:
    entries = known("a")
    entries["a", "position_upper"] = Limit("a", "position_upper", upper, "rad", "maker", Certainty.SOURCED)
    with pytest.raises(SetupError, match=r"^robot: joint a: lower position limit -1 \(test\) must be below"):
        assemble("robot", {"a": False}, entries)


def test_a_limit_differs_from_the_urdf_by_more_than_a_thousandth() -> None:
    def differs(value: float, urdf: float | None) -> bool:
        return Limit("a", "jerk", value, "rad/s³", "x", Certainty.SOURCED, urdf_value=urdf).differs_from_urdf

    assert not differs(2.0, None) and not differs(2.0, 2.0) and not differs(math.inf, math.inf)
    assert not differs(2.0, 2.0019) and not differs(2.0019, 2.0) and not differs(0.0, 9e-10)
    assert differs(2.0, 2.0021) and differs(2.0021, 2.0) and differs(0.0, 1.1e-9) and differs(2.0, 1.5)
