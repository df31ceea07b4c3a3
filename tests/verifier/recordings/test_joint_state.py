"""JointState in CDR: against rosbags, an independent implementation."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from verifier.recordings.joint_state import SCHEMA, SCHEMA_NAME, CdrError, JointState, decode, encode, layout

ROS = get_typestore(Stores.ROS2_HUMBLE)
NAMES = ["", "a", "ab", "abc", "abcd", "Gelenk_ä", "panda_joint1", "shoulder_pan_joint"]


def random_state(rng: np.random.Generator) -> JointState:
    names = tuple(str(name) for name in rng.choice(NAMES, rng.integers(0, 9)))
    values = [rng.normal(size=rng.integers(0, 9)) for _ in range(3)]
    stamp = int(rng.integers(-(2**31), 2**31)) * 1_000_000_000 + int(rng.integers(0, 1_000_000_000))
    return JointState(stamp, names, *values, frame=str(rng.choice(NAMES)))


def ros_message(state: JointState) -> object:
    seconds, nanoseconds = divmod(state.stamp_ns, 1_000_000_000)
    stamp = ROS.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    header = ROS.types["std_msgs/msg/Header"](stamp=stamp, frame_id=state.frame)
    return ROS.types[SCHEMA_NAME](
        header=header,
        name=list(state.names),
        position=state.position,
        velocity=state.velocity,
        effort=state.effort,
    )


def assert_same(a: JointState, b: JointState) -> None:
    assert (a.stamp_ns, a.names, a.frame) == (b.stamp_ns, b.names, b.frame)
    for mine, theirs in zip(
        (a.position, a.velocity, a.effort), (b.position, b.velocity, b.effort), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)


def test_definition_is_that_of_ros():
    assert SCHEMA.decode() == ROS.generate_msgdef(SCHEMA_NAME, ros_version=2)[0]


def test_encodes_like_rosbags(rng, count):
    for _ in range(count(100_000)):
        state = random_state(rng)
        assert encode(state) == bytes(ROS.serialize_cdr(ros_message(state), SCHEMA_NAME))


@pytest.mark.parametrize("little_endian", [True, False])
def test_decodes_what_rosbags_writes(rng, count, little_endian):
    for _ in range(count(100_000)):
        state = random_state(rng)
        data = bytes(ROS.serialize_cdr(ros_message(state), SCHEMA_NAME, little_endian=little_endian))
        assert_same(decode(data), state)


def test_layout_finds_the_positions_of_messages_that_it_fits(rng, count):
    for _ in range(count(20_000)):
        state, other = random_state(rng), random_state(rng)
        place, data = layout(encode(state)), encode(other)
        if place.fits(data):
            assert place.names == other.names
            np.testing.assert_array_equal(np.frombuffer(place.position_bytes(data), "<f8"), other.position)
        later = JointState(
            state.stamp_ns // 2 + 1,
            state.names,
            state.position + 1.0,
            state.velocity,
            state.effort,
            state.frame,
        )
        assert place.fits(encode(later))
        assert place.stamp_ns(encode(later)) == later.stamp_ns


def test_layout_does_not_fit_other_names():
    one = JointState(0, ("a", "b"), np.zeros(2))
    two = JointState(0, ("b", "a"), np.zeros(2))
    assert not layout(encode(one)).fits(encode(two))


def test_every_truncation_is_refused():
    data = encode(JointState(5, ("a", "bcd"), np.ones(2), np.ones(2), np.ones(2), "base"))
    for size in range(len(data)):
        with pytest.raises(CdrError):
            decode(data[:size])


def test_no_damage_raises_anything_else(rng, count):
    data = encode(JointState(5, ("a", "bcd"), np.ones(2), np.ones(2), np.ones(2), "base"))
    refused = 0
    for _ in range(count(100_000)):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), 3):
            damaged[place] = rng.integers(0, 256)
        try:
            decode(bytes(damaged))
        except CdrError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "not plain CDR"),
        (b"\x00\x07\x00\x00" + bytes(40), "not plain CDR: the message begins with 00 07 00 00"),
        (b"\x00\x01\x00\x00" + bytes(8) + b"\xff\xff\xff\xff", "in the middle of text"),
        (b"\x00\x01\x00\x00" + bytes(12) + b"\xff\xff\xff\xff", "4294967295 names do not fit"),
    ],
)
def test_says_why(data, why):
    with pytest.raises(CdrError, match=why):
        decode(data)
