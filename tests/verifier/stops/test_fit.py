"""A model that is fitted bounds the motion that it was fitted on, and says what it is worth on others."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from tests.docs.test_schemas import faults
from tests.verifier.stops.made_up import KnownStop, Motion, random_stops, sampled, write_csv
from tests.verifier.stops.test_stops_command import HOME, UR5, columns, found, refused
from tests.verifier.stops.test_stops_command import run as run_measured
from verifier.commands import cli
from verifier.recordings.motion import RecordedMotion, StateChannel
from verifier.reports.stops import stops_lines
from verifier.stop_model import read_model
from verifier.stops.finding import find_stops
from verifier.stops.fit import SLOWEST, fit, traces_of
from verifier.stops.measuring import measure
from verifier.stops.model_file import model_text
from verifier.stops.recorded import AllStops, StopSettings, StopsOf
from verifier.stops.speeds import speeds

SETTINGS = StopSettings()


def all_stops(*motions: Motion, joints=("a", "b", "c"), **beside) -> AllStops:
    recordings = []
    for number, motion in enumerate(motions):
        given = {name: getattr(motion, each) for name, each in beside.items()}
        recorded = motion.recorded(joints, f"r{number}.csv", **given)
        seen = speeds(recorded, SETTINGS.standstill)
        result = find_stops(recorded, seen)
        stops = tuple(measure(recorded, seen, stop, None) for stop in result.stops)
        recordings.append(StopsOf(recorded, seen, result, stops))
    return AllStops(SETTINGS, None, tuple(recordings))


@pytest.mark.parametrize("beside", [{}, {"dq": "dq"}])
@pytest.mark.parametrize("step", [0.001, 0.008, 0.04])
def test_the_true_motion_stays_within_the_model_between_samples_too(beside, step, rng, count):
    for _ in range(count(600)):
        stops = random_stops(rng, 3, int(rng.integers(1, 5)))
        motion = sampled(rng, stops, step, np.zeros(3))
        model = fit(all_stops(motion, **beside), margin=0.0).model
        for known in stops:
            top = np.abs(known.speed)
            seen = top >= 1.05 * SLOWEST * SETTINGS.standstill
            x = np.linspace(0.0, known.rest - known.asked, 400)
            true = np.abs(known.velocity(known.asked + x))
            for elapsed, speed in zip(x, true, strict=True):
                left = SETTINGS.standstill * (1.0 + 1e-6)  # a joint below that counts as standing
                assert (speed <= model.speed(top, float(elapsed)) + left)[seen].all()
            assert (known.angle <= model.way(top) + 1e-3)[seen].all()


@pytest.mark.parametrize("step", [0.004, 0.02])
def test_no_sample_of_a_stop_that_it_was_fitted_on_is_above_the_model(step, rng, count):
    """Not by a rounding, without a margin; and each number of it is as large as some sample needs."""
    for _ in range(count(500)):
        motion = sampled(rng, random_stops(rng, 3, int(rng.integers(1, 5))), step, np.zeros(3))
        recorded = all_stops(motion, dq="dq")
        model = fit(recorded, margin=0.0).model
        traces = [t for pair in recorded.stops for t in traces_of(*pair, SETTINGS.standstill)]
        assert max(trace.excess(model) for trace in traces) <= 1e-12
        for changed in (
            replace(
                model, braking_time_s=0.98 * model.braking_time_s, deceleration=model.deceleration / 0.98
            ),
            replace(model, delay_s=0.98 * model.delay_s),
        ):
            shorter = changed.delay_s < model.delay_s or changed.braking_time_s < model.braking_time_s
            assert not shorter or max(trace.excess(changed) for trace in traces) > 0.0


def test_the_model_is_not_far_from_what_was_there():
    """Two stops with the same delay and deceleration, sampled finely: found again from the slow side."""
    brake = np.array([5.0, 8.0, 4.0])
    stops = [
        KnownStop(2.0, 0.1, np.array([2.0, -1.0, 0.5]), brake),
        KnownStop(5.0, 0.1, np.array([0.8, 0.4, -2.0]), brake, begin=4.0),
    ]
    motion = Motion(stops, np.arange(0.0, 6.0, 0.001), np.zeros(3))
    for beside, late in (({"dq": "dq"}, 0.003), ({}, 0.025)):
        result = fit(all_stops(motion, **beside), margin=0.0)
        for known in stops:
            top = np.abs(known.speed)
            way, time = result.model.way(top), result.model.time(top)
            fast = top > 0.5 * result.model.fastest
            assert (way >= known.angle - 1e-4).all()
            assert (way <= known.angle + top * (late + 0.02))[fast].all()
            assert time.max() <= known.rest - known.asked + late + 0.05


def test_a_margin_makes_every_time_longer():
    motion = motion_of_two()
    without, some = (fit(all_stops(motion), margin=each) for each in (0.0, 0.25))
    speed = np.array([1.0, 0.5, 1.5])
    assert some.model.time(speed) == pytest.approx(1.25 * without.model.time(speed))
    for bad in (-0.1, np.nan):
        with pytest.raises(SetupError, match="margin"):
            fit(all_stops(motion), margin=bad)


def motion_of_two(second: float = 5.0, delay: float = 0.05) -> Motion:
    stops = [
        KnownStop(1.0, 0.05, np.array([1.0, 0.5, -1.5]), np.full(3, 5.0)),
        KnownStop(3.0, delay, np.array([1.0, 0.5, -1.5]), np.full(3, second), begin=2.0),
    ]
    return Motion(stops, np.arange(0.0, 5.0, 0.004), np.zeros(3))


def test_a_stop_that_is_held_out_is_held_against_the_others():
    good = fit(all_stops(motion_of_two()))
    assert [held.within for held in good.held] == [True] and good.fitted_on == 1 and not good.in_doubt
    for worse in (motion_of_two(second=3.0), motion_of_two(delay=0.2)):
        bad = fit(all_stops(worse))
        (held,) = bad.held
        assert not held.within and held.excess > 0.05 and bad.in_doubt
        # the model itself is of both
        again = fit(all_stops(Motion([worse.stops[1]], worse.t, np.zeros(3))), margin=0.0)
        top = np.array([1.0, 0.5, 1.5])
        assert (bad.model.way(top) >= again.model.way(top) - 1e-9).all()
    alone = fit(all_stops(Motion(motion_of_two().stops[:1], np.arange(0.0, 2.0, 0.004), np.zeros(3))))
    assert not alone.held and not alone.in_doubt


def test_the_excess_is_what_was_seen_above_the_model():
    motion = motion_of_two(delay=0.2)
    result = fit(all_stops(motion, dq="dq"), margin=0.1)
    (held,) = result.held
    of_first = fit(all_stops(Motion([motion.stops[0]], motion.t, np.zeros(3)), dq="dq"), margin=0.1).model
    x = np.arange(0.0, 0.6, 1e-4)
    top = np.abs(motion.stops[1].speed)
    true = np.abs(motion.stops[1].velocity(3.0 + x))
    bound = np.array([of_first.speed(top, float(each)) for each in x])
    assert held.excess == pytest.approx(float((true - bound).max()), abs=0.06)
    assert held.joint == 2


def rebounding(sag: float, back: float) -> AllStops:
    """Told at 1 s at 1 rad/s: a gets faster by ``sag`` first, and goes back at ``back`` in the end."""
    t = np.arange(0.0, 2.0, 0.004)
    x = t - 1.0
    down = np.where(x < 0.05, 1.0 + sag * (x > 0.0), np.maximum(1.0 - 4.0 * (x - 0.05), 0.0))
    dq = np.column_stack(
        [np.where((x > 0.31) & (x < 0.4), -back, down), np.zeros(len(t)), np.where(x < 0.0, 0.5, 0.0)]
    )
    flag = StateChannel("stop", t, tuple("stop" if each >= 0.0 else "" for each in x))
    q = np.cumsum(dq, axis=0) * 0.004
    recorded = RecordedMotion(Path("r0.csv"), None, ("a", "b", "c"), t, q, dq, states=(flag,))
    seen = speeds(recorded, SETTINGS.standstill)
    result = find_stops(recorded, seen)
    stops = tuple(measure(recorded, seen, stop, None) for stop in result.stops)
    return AllStops(SETTINGS, None, (StopsOf(recorded, seen, result, stops),))


@pytest.mark.parametrize(
    ("sag", "back", "faster"), [(0.0, 0.0, 0.0), (0.2, 0.0, 0.2), (0.0, 0.15, 0.15), (0.2, 0.3, 0.3)]
)
def test_a_joint_that_gets_faster_than_when_it_was_told_is_named(sag: float, back: float, faster: float):
    """A plan does not intend it, so that only the tracking error of a cell can contain it."""
    recorded = rebounding(sag, back)
    result = fit(recorded)
    assert result.faster == pytest.approx((faster, 0.0, 0.0), abs=1e-9)
    said = "\n".join(stops_lines(recorded, result))
    assert ("velocity_error_rad_s of [robot.tracking] must cover" in said) == (faster > 0.0)
    assert f"a {faster:g} rad/s" in said or faster == 0.0
    assert (f"got up to {faster:.2g} faster" in model_text(recorded, result)) == (faster > 0.0)


def test_where_no_sample_shows_the_braking_that_is_said():
    stop = KnownStop(1.0, 0.05, np.array([1.0, 0.5, -1.5]), np.full(3, 20.0))
    for step, unseen in ((0.4, True), (0.004, False)):
        recorded = all_stops(Motion([stop], np.arange(0.1, 4.0, step), np.zeros(3)), dq="dq")
        said = "\n".join(stops_lines(recorded, fit(recorded)))
        assert ("no sample shows how it brakes" in said) == unseen


def test_recordings_that_differ_are_flagged():
    first = motion_of_two()
    assert not fit(all_stops(first, motion_of_two())).drift
    worn = fit(all_stops(first, motion_of_two(second=3.5)))
    assert {each.joint for each in worn.drift} == {"a", "b", "c"}
    for each in worn.drift:
        assert each.recording == "r1.csv" and each.now > 1.1 * each.first
    assert not fit(all_stops(motion_of_two(second=3.5), first)).drift, "shorter is no drift"


def test_slow_joints_of_an_arm_that_stops_on_its_path_take_as_long_as_fast_ones():
    together = KnownStop(1.0, 0.05, np.array([1.5, 0.15, -0.3]), np.array([5.0, 0.5, 1.0]))
    motion = Motion([together], np.arange(0.0, 3.0, 0.002), np.zeros(3))
    model = fit(all_stops(motion), margin=0.0).model
    assert model.braking_time_s == pytest.approx(0.3, abs=0.03)
    assert (model.way(np.array([1.5, 0.15, 0.3])) >= together.angle - 1e-4).all()


def test_what_tells_nothing_makes_no_model():
    still = KnownStop(1.0, 0.05, np.array([0.03, 0.0, 0.0]), np.full(3, 5.0))
    with pytest.raises(SetupError, match=r"no joint was faster than 0\.05 rad/s"):
        fit(all_stops(Motion([still], np.arange(0.0, 3.0, 0.004), np.zeros(3))))
    nothing = all_stops(motion_of_two())
    ends = tuple(
        replace(
            each, stops=tuple(replace(s, stop=replace(s.stop, causes=("end of motion",))) for s in each.stops)
        )
        for each in nothing.recordings
    )
    with pytest.raises(SetupError, match="an end of motion is none"):
        fit(replace(nothing, recordings=ends))


@pytest.fixture
def table(tmp_path: Path, rng) -> Path:
    motion = sampled(rng, random_stops(rng, 6, 4), 0.008, HOME)
    return write_csv(tmp_path / "r.csv", columns(motion, stop=motion.flag(motion.t).astype(int)))


def run(*arguments: object) -> tuple[int, str]:
    from click.testing import CliRunner

    result = CliRunner().invoke(cli, ["stops", *map(str, arguments)], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return int(result.return_value), result.stdout


def test_the_command_fits_writes_and_says_what_it_is_worth(tmp_path: Path, table: Path):
    target = tmp_path / "m.toml"
    status, text = run(table, "--robot", "ur5", "--model", target, "--margin", 0.2)
    assert "every time 20 % longer" in text and "validated: a model of every second stop (2)" in text
    assert f"wrote {target}\nin a cell: " in text
    (use,) = re.findall(r"^in a cell: (.*)$", text, re.MULTILINE)
    stop = tomllib.loads(use.replace(" model", "\nmodel").replace(", measured", "\nmeasured"))["stop"]
    assert stop == {"model": "measured", "measured": str(target)}
    assert ("not bounded: " in text) == ("what can be done: record more stops" in text) == (status == 1)
    model = read_model(target)
    assert (model.robot, model.joints, model.margin) == ("ur5", UR5, 0.2)
    assert "worst of 4 stops in r.csv (stop)" in model.source
    status_again, printed = run(table, "--robot", "ur5", "--fit", "--margin", 0.2, "--json", "-")
    assert not faults("stops", json.loads(printed))
    fitted = json.loads(printed)["fit"]
    assert status == status_again == (not all(each["within"] for each in fitted["held_out"]))
    assert fitted["delay_s"] == model.braking.delay_s
    assert fitted["deceleration_rad_s2"] == model.braking.deceleration.tolist()
    assert len(fitted["held_out"]) == 2
    assert found(table)["fit"] is None
    assert "validated" not in run_measured(table)


def test_refusals_of_models(tmp_path: Path, table: Path):
    assert "give --fit or --model too" in refused(table, "--margin", 0.1)
    assert "must end in .toml" in refused(table, "--model", tmp_path / "m.json")
    assert "margin -1.0" in refused(table, "--fit", "--margin", -1)
    target = tmp_path / "m.toml"
    run(table, "--model", target)
    good = tomllib.loads(target.read_text(encoding="utf-8"))
    assert good["robot"] == ""
    for key, value, said in (
        ("delay_s", "true", "delay_s must be a number"),
        ("delay_s", "[0.1]", "delay_s must be a number"),
        ("delay_s", "nan", "delay of nan s"),
        ("margin", '"x"', "margin must be a number"),
        ("margin", "nan", "margin nan: should be a finite share"),
        ("margin", "-0.1", "margin -0.1: should be a finite share"),
        ("deceleration_rad_s2", "[1.0]", "has 1 values for 6 joints"),
        ("fastest_rad_s", "[0.0, 1.0, 1.0, 1.0, 1.0, 1.0]", "should be one finite value > 0"),
        ("joints", "[1]", "joints must be text"),
        ("robot", "1", "robot, source and joints must be text"),
        ("extra", "1", "extra is no key of a stop model"),
    ):
        lines = [line for line in target.read_text(encoding="utf-8").splitlines() if not line.startswith(key)]
        bad = tmp_path / "bad.toml"
        bad.write_text("\n".join([*lines, f"{key} = {value}"]), encoding="utf-8")
        with pytest.raises(SetupError, match=r"bad\.toml") as refusal:
            read_model(bad)
        assert said in str(refusal.value)
        if key != "extra":
            bad.write_text("\n".join(lines), encoding="utf-8")
            with pytest.raises(SetupError, match=rf"{key} is missing"):
                read_model(bad)


def test_names_are_escaped_in_the_file(tmp_path: Path):
    recorded = all_stops(motion_of_two(), joints=('a"\\', "b\n", "c"))
    (tmp_path / "m.toml").write_text(model_text(recorded, fit(recorded)), encoding="utf-8")
    assert read_model(tmp_path / "m.toml").joints == ('a"\\', "b\n", "c")
