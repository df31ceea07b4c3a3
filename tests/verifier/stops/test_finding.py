"""Stops that are known are found and measured to one sample at either end."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.verifier.stops.made_up import KnownStop, Motion, random_stops, sampled
from verifier.recordings.motion import StateChannel, falling_scale
from verifier.stops.finding import COMMAND, Stop, Unmeasured, find_stops
from verifier.stops.measuring import measure
from verifier.stops.speeds import SPAN_S, STANDSTILL_RAD_S, over_windows, speeds, standstills

JOINTS = ("a", "b", "c")
FEW = 1e-9


def found(recorded, standstill: float = STANDSTILL_RAD_S):
    seen = speeds(recorded, standstill)
    return seen, find_stops(recorded, seen)


def early(stop: KnownStop, recorded_speeds: bool, step: float) -> float:
    """How much too early an arm that slows down steadily may count as standing still [s]."""
    slowest = float(stop.brake.min())
    if recorded_speeds:
        return STANDSTILL_RAD_S / slowest
    # on a window of length w the mean of what is left of a v = a x, a v²/(2 a w), is below the threshold
    return math.sqrt(2.0 * STANDSTILL_RAD_S * max(SPAN_S + step, step) / slowest)


@pytest.mark.parametrize("recorded_speeds", [False, True])
@pytest.mark.parametrize("step", [0.001, 0.008, 0.04])
def test_times_and_angles_of_known_stops_to_one_sample(recorded_speeds, step, rng, count):
    for _ in range(count(2_000)):
        stops = random_stops(rng, 3, int(rng.integers(1, 4)))
        motion = sampled(rng, stops, step, rng.uniform(-1.0, 1.0, 3))
        recorded = motion.recorded(JOINTS, dq=motion.dq if recorded_speeds else None)
        seen, result = found(recorded)
        assert not result.unmeasured and not result.ends_of_motion
        assert len(result.stops) == len(stops)
        for known, stop in zip(stops, result.stops, strict=True):
            assert stop.causes == ("stop",)
            measured = measure(recorded, seen, stop, None)
            assert stop.asked_after - FEW <= known.asked <= stop.asked_by + FEW
            true = known.rest - known.asked
            assert measured.time_s.least - FEW <= true
            assert measured.time_s.most + early(known, recorded_speeds, step) + FEW >= true
            assert measured.time_s.most - measured.time_s.least <= 2.0 * step + FEW
            left = 2.0 * STANDSTILL_RAD_S * (SPAN_S + step)
            for angle, exact in zip(measured.angle, known.angle, strict=True):
                assert angle.least - FEW <= exact <= angle.most + left
                assert angle.most - angle.least <= 2.0 * step + FEW  # at most 2 rad/s, for one sample
            for speed, exact in zip(measured.speed, np.abs(known.speed), strict=True):
                assert speed == pytest.approx(exact, abs=1e-6)
            assert measured.reaction_s.least - FEW <= known.delay + 0.1 * true
            assert measured.reaction_s.most + FEW >= known.delay


def one(asked: float = 1.0, delay: float = 0.1, speed: float = 1.0, brake: float = 4.0, **more) -> KnownStop:
    return KnownStop(asked, delay, np.array([speed]), np.array([brake]), **more)


def motion_of(*stops: KnownStop, step: float = 0.01, until: float = 1.0) -> Motion:
    return Motion(stops, np.arange(0.0, stops[-1].rest + until, step), np.zeros(1))


def test_a_flag_that_is_written_where_it_changes_is_exact():
    """Of a channel that never repeats itself, what stands there is when it happened."""
    motion = motion_of(one(asked=1.0042))
    channel = StateChannel("/stop", np.array([0.0, 1.0042]), ("", "stop"))
    assert not channel.sampled
    _, result = found(motion.recorded("a", states=(channel,)))
    (stop,) = result.stops
    assert stop.asked_after == stop.asked_by == 1.0042
    assert motion.t[stop.before] == pytest.approx(1.0) and motion.t[stop.at] == pytest.approx(1.01)
    repeated = StateChannel("/stop", np.array([0.0, 0.9, 1.0042]), ("", "", "stop"))
    (stop,) = found(motion.recorded("a", states=(repeated,)))[1].stops
    assert (stop.asked_after, stop.asked_by) == (0.9, 1.0042)


def test_what_is_no_stop_is_counted():
    motion = motion_of(one())
    for times, why in (
        ((0.1, 9.0), Unmeasured.AT_REST),  # before it sets out at 0.25 s
        ((1.0, 1.2), Unmeasured.RELEASED),
    ):
        flag = np.zeros(len(motion.t), np.bool_)
        flag[(motion.t >= times[0]) & (motion.t < times[1])] = True
        late = KnownStop(1.0, 0.1, np.array([1.0]), np.array([4.0]), begin=0.25)
        moved = Motion([late], motion.t, np.zeros(1))
        channel = StateChannel("stop", motion.t, tuple("stop" if each else "" for each in flag))
        _, result = found(moved.recorded("a", states=(channel,)))
        assert not result.stops and result.unmeasured == {why: 1}
        assert len(result.ends_of_motion) == 1
    cut = Motion(motion.stops, motion.t[motion.t < 1.3], np.zeros(1))
    assert found(cut.recorded("a"))[1].unmeasured == {Unmeasured.UNFINISHED: 1}


def test_what_had_been_told_before_the_recording_says_so_is_counted():
    """Not passed over as an end of motion of which nothing says why."""
    motion = motion_of(one())
    late = Motion(motion.stops, motion.t[motion.t > 1.05], np.zeros(1))
    flagged = late.recorded("a")
    assert flagged.states[0].cause[0] and speeds(flagged, STANDSTILL_RAD_S).moving[0]
    channel = StateChannel("/stop", np.array([1.05, 1.06, 3.0]), ("stop", "stop", ""))
    for recorded in (flagged, motion.recorded("a", states=(channel,))):
        _, result = found(recorded)
        assert not result.stops and not result.ends_of_motion
        assert result.unmeasured == {Unmeasured.BEFORE: 1}
    at_rest = Motion(motion.stops, motion.t[motion.t > 1.5], np.zeros(1))
    assert not found(at_rest.recorded("a"))[1].unmeasured


@pytest.mark.parametrize("late", [0.02, 0.12, 0.3])
def test_a_button_that_is_let_go_has_begun_the_stop(late: float):
    """Else the stop would be as much shorter as the safety mode comes later."""
    motion = motion_of(one(brake=2.0))
    pressed = StateChannel("/stop", np.array([0.0, 1.0, 1.06]), ("", "stop", ""))
    mode = StateChannel("/mode", np.array([0.0, 1.0 + late]), ("", "protective stop"))
    for states in ((pressed, mode), (mode, pressed)):
        _, result = found(motion.recorded("a", states=states))
        (stop,) = result.stops
        assert stop.causes == ("stop", "protective stop") and not result.unmeasured
        assert stop.asked_after == stop.asked_by == 1.0
        assert motion.t[stop.before] <= 1.0 <= motion.t[stop.at] + 1e-9
        assert motion.t[stop.rest] >= 1.6 - 0.02


def test_what_was_released_long_before_a_stop_has_not_begun_it():
    motion = motion_of(one(asked=3.0))
    pressed = StateChannel("/stop", np.array([0.0, 1.0, 1.1]), ("", "stop", ""))
    mode = StateChannel("/mode", np.array([0.0, 3.0]), ("", "protective stop"))
    _, result = found(motion.recorded("a", states=(pressed, mode)))
    (stop,) = result.stops
    assert stop.causes == ("protective stop",) and stop.asked_by == 3.0
    assert result.unmeasured == {Unmeasured.RELEASED: 1}


def test_a_topic_that_begins_with_the_stop_tells_it():
    """A flag that is written where it changes need not have been written before."""
    motion = motion_of(one(asked=1.0042))
    for times, cause in (([1.0042], ("stop",)), ([1.0042, 1.8], ("stop", ""))):
        channel = StateChannel("/stop", np.array(times), cause)
        (stop,) = found(motion.recorded("a", states=(channel,)))[1].stops
        assert stop.asked_after == stop.asked_by == 1.0042


def test_a_recording_that_ends_too_soon_after_is_not_at_rest():
    motion = motion_of(one(), until=0.5 * SPAN_S)
    assert found(motion.recorded("a"))[1].unmeasured == {Unmeasured.UNFINISHED: 1}


@pytest.mark.parametrize(("rests_s", "measured"), [(0.03, False), (0.08, False), (0.15, True)])
def test_a_pause_at_the_end_of_a_recording_is_no_rest(rests_s, measured):
    """What was seen for less than a tenth of a second may go on after it."""
    result = found(motion_of(one(), until=rests_s).recorded("a"))[1]
    assert len(result.stops) == measured
    assert result.unmeasured == ({} if measured else {Unmeasured.UNFINISHED: 1})


def test_standing_still_is_longer_than_a_turning_point():
    t = np.arange(0.0, 2.0, 0.01)
    q = np.sin(2.0 * (t - 1.0))[:, None] ** 2  # turns round at 1 s
    assert not [
        each for each in standstills(t, np.abs(over_windows(t, q)[0][:, 0]) > 0.3) if 40 < each[0] < 150
    ]
    motion = motion_of(one(), one(asked=3.0, begin=2.0))
    seen = speeds(motion.recorded("a"), STANDSTILL_RAD_S)
    first, last = standstills(motion.t, seen.moving)[0]
    assert motion.t[first] == pytest.approx(1.35, abs=0.02)
    assert motion.t[last] == pytest.approx(2.0, abs=SPAN_S + 0.01)


def test_velocities_that_say_nothing_do_not_shorten_a_stop():
    """A driver that fills in zeros must not make an arm stand still while its positions move."""
    motion = motion_of(one())
    silent = motion.recorded("a", dq=np.zeros_like(motion.q))
    assert found(silent)[1].stops[0].rest == found(motion.recorded("a"))[1].stops[0].rest


def test_a_command_that_stands_still_at_once_is_a_stop_and_a_ramp_is_none():
    motion = motion_of(one(), step=0.004)
    held = np.where(motion.t[:, None] < 1.0, motion.q, motion.q[np.searchsorted(motion.t, 1.0)])
    for given in ({"command_q": held}, {"command_dq": np.where(motion.t[:, None] < 1.0, motion.dq, 0.0)}):
        _, result = found(motion.recorded("a", states=(), **given))
        (stop,) = result.stops
        assert stop.causes == (COMMAND,)
        assert stop.asked_after <= 1.0 <= stop.asked_by + 1e-9 and stop.asked_by - stop.asked_after < 0.0041
    lag = 0.02
    ahead = Motion(motion.stops, motion.t + lag, np.zeros(1))
    _, result = found(motion.recorded("a", states=(), command_q=ahead.q))
    assert not result.stops and len(result.ends_of_motion) == 1
    _, result = found(motion.recorded("a", command_q=held))
    assert result.stops[0].causes == ("stop", COMMAND)


def test_a_speed_scaling_that_falls_to_zero_is_a_stop_from_where_it_begins_to_fall():
    motion = motion_of(one(delay=0.0, brake=2.0))
    scale = np.clip(1.0 - 2.0 * (motion.t - 1.0), 0.0, 1.0)
    channel = falling_scale("speed_scaling", motion.t, scale)
    _, result = found(motion.recorded("a", states=(channel,)))
    (stop,) = result.stops
    assert stop.causes == ("speed scaling",) and stop.asked_after == pytest.approx(1.0)
    half = falling_scale("speed_scaling", motion.t, np.maximum(scale, 0.5))
    assert not any(half.cause), "slower is not standing"
    # one that only says that the arm stands is no reason for that
    after = falling_scale("speed_scaling", motion.t, (motion.t < motion.stops[0].rest).astype(float))
    _, result = found(motion.recorded("a", states=(after,)))
    assert not result.stops and not result.unmeasured and len(result.ends_of_motion) == 1
    assert not any(falling_scale("x", motion.t, np.zeros(len(motion.t))).cause)


def test_two_causes_of_one_stop_are_one_stop():
    motion = motion_of(one())
    late = StateChannel("mode", np.array([0.0, 0.5, 1.12]), ("", "", "fault"))
    flag = motion.recorded("a").states[0]
    for states in ((flag, late), (late, flag)):
        _, result = found(motion.recorded("a", states=states))
        (stop,) = result.stops
        assert stop.causes == ("stop", "fault") and stop.asked_by == pytest.approx(1.0)


def test_an_end_of_motion_begins_where_the_arm_slows_down():
    motion = motion_of(one(delay=0.0), step=0.002)
    seen, result = found(motion.recorded("a", states=()))
    (end,) = result.ends_of_motion
    assert isinstance(end, Stop)
    assert end.asked_after == pytest.approx(1.0, abs=0.02)
    measured = measure(motion.recorded("a", states=()), seen, end, None)
    assert measured.time_s.most == pytest.approx(0.25, abs=0.03)


def test_a_recording_of_one_window_counts_as_moving():
    motion = motion_of(one())
    short = replace(motion.recorded("a", states=()), t=motion.t[:2], q=motion.q[:2])
    assert speeds(short, STANDSTILL_RAD_S).moving.all()
