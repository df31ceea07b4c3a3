"""Adapters of robot sources, against messages that rosbags encoded and decoded."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores

from tests.verifier.recordings.robot_sources.messages import (
    CONTROLLER,
    CONTROLLER_BOTH,
    CONTROLLER_NEW,
    CONTROLLER_OLD,
    FRANKA,
    FRANKA_1,
    FRANKA_NEW,
    FRANKA_OLD,
    JOINTS,
    NANO,
    STATE,
    header,
    joint_state,
    loose,
    point,
    store,
    through,
)
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.robot_sources import ADAPTERS

STAMP = 1_700_000_000 * NANO + 123_456_789


def read(message):
    return ADAPTERS[message.schema].read(message)


def refused(message):
    with pytest.raises(SourceError) as caught:
        read(message)
    text = str(caught.value)
    assert "\n" not in text and ";" in text
    return text


def same(state, stamp_ns, names, position, velocity=()):
    assert (state.stamp_ns, state.names) == (stamp_ns, names)
    np.testing.assert_array_equal(state.position, position)
    np.testing.assert_array_equal(state.velocity, velocity)


def test_every_adapter_is_found_by_its_type():
    assert set(ADAPTERS) == {STATE, CONTROLLER, FRANKA, FRANKA_1}


@pytest.mark.parametrize("ros1", [False, True])
def test_joint_state_of_both_ros(rng, count, ros1):
    types = store(base=Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for _ in range(count(300)):
        stamp = int(rng.integers(1, 2**31)) * NANO + int(rng.integers(NANO))
        q, dq, tau = rng.normal(size=(3, 3))
        dq, tau = dq[: rng.choice([0, 3])], tau[: rng.choice([0, 3])]
        sample = read(through(types, STATE, joint_state(types, stamp, JOINTS, q, dq, tau), ros1=ros1))
        same(sample.state, stamp, JOINTS, q, dq)
        np.testing.assert_array_equal(sample.state.effort, tau)
        assert (sample.state.frame, sample.reference) == ("base", None)


def test_a_stamp_of_zero_is_the_time_of_arrival():
    types = store()
    message = through(types, STATE, joint_state(types, 0, JOINTS, [1, 2, 3]), log_time_ns=STAMP)
    assert read(message).state.stamp_ns == STAMP


def test_joints_without_names_stay_without():
    types = store()
    assert read(through(types, STATE, joint_state(types, 1, (), [1, 2, 3]))).state.names == ()


def test_numbers_do_not_change_with_the_buffer_they_came_from():
    types = store()
    message = through(types, STATE, joint_state(types, 1, JOINTS, [1, 2, 3]))
    q = np.array([1.0, 2.0, 3.0])
    sample = read(loose(message, position=q))
    q[:] = 9.0
    np.testing.assert_array_equal(sample.state.position, [1, 2, 3])


@pytest.mark.parametrize(
    ("names", "position", "velocity", "why"),
    [
        (JOINTS, (1, math.nan, 3), (), "joint elbow is nan; every position must be a number"),
        (JOINTS, (1, 2, math.inf), (), "joint wrist is inf; every position must be a number"),
        (
            JOINTS,
            (1, 57300.0, 3),
            (),
            "elbow is 57300; beyond 1000 a path loses digits; give rad, or m",
        ),
        (JOINTS, (1, 2), (), "2 positions for 3 joints; one for each"),
        (JOINTS, (), (), "0 positions for 3 joints; one for each"),
        ((), (), (), "0 positions for 0 joints; one for each"),
        (JOINTS, (1, 2, 3), (1, 2), "2 velocities for 3 joints; one for each, or none"),
        (("elbow", "elbow", "wrist"), (1, 2, 3), (), "joint elbow stands there twice"),
        (("elbow", "", "wrist"), (1, 2, 3), (), "a joint has no name"),
    ],
)
def test_a_joint_state_that_says_nothing_usable(names, position, velocity, why):
    types = store()
    assert why in refused(through(types, STATE, joint_state(types, 1, names, position, velocity)))


@pytest.mark.parametrize("stamp", [SimpleNamespace(sec=-1, nanosec=0), SimpleNamespace(sec=1, nanosec=NANO)])
def test_a_stamp_that_is_none(stamp):
    types = store()
    message = through(types, STATE, joint_state(types, 1, JOINTS, [1, 2, 3]))
    assert "its stamp is" in refused(loose(message, header=SimpleNamespace(stamp=stamp, frame_id="")))


@pytest.mark.parametrize("wrong", ["text", [[1.0, 2.0, 3.0]], [1.0, None, "x"]])
def test_positions_that_are_no_numbers(wrong):
    types = store()
    message = through(types, STATE, joint_state(types, 1, JOINTS, [1, 2, 3]))
    assert "holds no" in refused(loose(message, position=wrong)) or "shape" in refused(
        loose(message, position=wrong)
    )


@pytest.mark.parametrize("field", ["header", "name", "position", "velocity", "effort"])
def test_a_definition_that_only_has_the_name_of_the_type(field):
    types = store()
    message = through(types, STATE, joint_state(types, 1, JOINTS, [1, 2, 3]))
    assert f"without {field}" in refused(loose(message, **{field: None}))
    assert refused(loose(message, **{field: 3}))


# control_msgs/JointTrajectoryControllerState.


def controller(definition, base=Stores.ROS2_HUMBLE, **points):
    types = store(CONTROLLER, definition, base)
    ros1 = base == Stores.ROS1_NOETIC
    kind = types.types[CONTROLLER]
    fields = [
        name for name in kind.__dataclass_fields__ if name not in ("header", "joint_names", "__msgtype__")
    ]
    parts = {name: point(types, *points.get(name, ())) for name in fields}
    message = kind(header(types, STAMP), list(JOINTS), **parts)
    return through(types, CONTROLLER, message, ros1=ros1)


OUTPUT = {"error": ([9, 9, 9],), "output": ([8, 8, 8],)}


@pytest.mark.parametrize("definition", [CONTROLLER_NEW, CONTROLLER_BOTH])
def test_controller_state_of_today(definition):
    points = {"reference": ([1, 2, 3], [4, 5, 6]), "feedback": ([1.5, 2.5, 3.5], [4.5, 5.5, 6.5])}
    sample = read(controller(definition, **points, **OUTPUT))
    same(sample.state, STAMP, JOINTS, [1.5, 2.5, 3.5], [4.5, 5.5, 6.5])
    same(sample.reference, STAMP, JOINTS, [1, 2, 3], [4, 5, 6])


@pytest.mark.parametrize("base", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_controller_state_with_the_old_names(base):
    sample = read(controller(CONTROLLER_OLD, base, desired=([1, 2, 3],), actual=([4, 5, 6],)))
    same(sample.state, STAMP, JOINTS, [4, 5, 6])
    same(sample.reference, STAMP, JOINTS, [1, 2, 3])


def test_controller_state_whose_new_fields_are_empty():
    sample = read(controller(CONTROLLER_BOTH, desired=([1, 2, 3],), actual=([4, 5, 6],)))
    same(sample.state, STAMP, JOINTS, [4, 5, 6])
    same(sample.reference, STAMP, JOINTS, [1, 2, 3])


def test_a_controller_that_is_given_velocities_has_no_reference():
    sample = read(controller(CONTROLLER_NEW, feedback=([1, 2, 3],), reference=([], [1, 1, 1])))
    assert sample.reference is None


@pytest.mark.parametrize(
    ("points", "why"),
    [
        ({"reference": ([1, 2, 3],)}, "feedback without positions"),
        ({"feedback": ([1, 2],)}, "feedback has 2 positions for 3 joints"),
        ({"feedback": ([1, 2, 3],), "reference": ([1, math.nan, 3],)}, "reference: joint elbow is nan"),
        ({"feedback": ([1, 2, 3], [1])}, "feedback has 1 velocities for 3 joints"),
    ],
)
def test_controller_states_that_say_nothing_usable(points, why):
    assert why in refused(controller(CONTROLLER_NEW, **points))


def test_controller_states_of_an_unknown_version():
    message = controller(CONTROLLER_NEW, feedback=([1, 2, 3],), reference=([1, 2, 3],))
    assert "without feedback or actual" in refused(loose(message, feedback=None))
    assert "without reference or desired" in refused(loose(message, reference=None))
    assert "without joint_names" in refused(loose(message, joint_names=None))
    assert "names no joints" in refused(loose(message, joint_names=[]))


# franka_msgs.

ARM = tuple(f"fr3_joint{number}" for number in range(1, 8))
Q = np.arange(7.0)


def franka(measured=ARM, desired=ARM, q_d=Q + 0.5):
    types = store(FRANKA, FRANKA_NEW)
    state = joint_state(types, 1, measured, Q, Q + 1, Q + 2)
    wanted = joint_state(types, 1, desired, q_d, (), ())
    motor = joint_state(types, 1, measured, Q + 9)
    message = types.types[FRANKA](header(types, STAMP), state, wanted, motor, np.zeros(7), np.zeros(7))
    return through(types, FRANKA, message)


def test_franka_robot_state():
    sample = read(franka())
    same(sample.state, STAMP, ARM, Q, Q + 1)
    np.testing.assert_array_equal(sample.state.effort, Q + 2)
    same(sample.reference, STAMP, ARM, Q + 0.5)
    same(read(franka(desired=())).reference, STAMP, ARM, Q + 0.5)
    assert read(franka(q_d=())).reference is None


def test_franka_robot_states_that_say_nothing_usable():
    assert "both must be of the same joints" in refused(franka(desired=ARM[::-1]))
    assert "measured_joint_state names no joints" in refused(franka(measured=()))
    assert "desired_joint_state has 6 positions for 7 joints" in refused(franka(q_d=Q[:6]))
    assert "without desired_joint_state" in refused(loose(franka(), desired_joint_state=None))


@pytest.mark.parametrize("schema", [FRANKA, FRANKA_1])
@pytest.mark.parametrize("base", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_franka_state_with_numbers_alone(schema, base):
    ros1 = base == Stores.ROS1_NOETIC
    definition = FRANKA_OLD if ros1 else FRANKA_OLD.replace("tau_J", "tau_j")
    types = store(schema, definition, base)
    kind = types.types[schema]
    names = list(kind.__dataclass_fields__)[1:-1]
    values = {name: (np.zeros(6) if "cartesian" in name else Q + place) for place, name in enumerate(names)}
    message = through(types, schema, kind(header(types, STAMP), **values), ros1=ros1)
    sample = read(message)
    same(sample.state, STAMP, (), values["q"], values["dq"])
    same(sample.reference, STAMP, (), values["q_d"], values["dq_d"])
    tau = "tau_J" if ros1 else "tau_j"
    np.testing.assert_array_equal(sample.state.effort, values[tau])
    np.testing.assert_array_equal(sample.reference.effort, values[tau + "_d"])
    assert "q has 6 numbers; a Franka arm has 7 joints" in refused(loose(message, q=Q[:6]))
    assert "without q" in refused(loose(message, q=None))


def test_a_message_of_an_unknown_type_has_no_adapter():
    assert "std_msgs/msg/String" not in ADAPTERS
    assert isinstance(Decoded("/a", "b", 1, {}), Decoded)
