"""The tracking error measured from positions and commands, on motions whose delay and error are known."""

import json
import math

import numpy as np
import pytest

from tests.verifier.recordings.samples import JOINTS, NANO, reports, write_all
from verifier.cell import Cell
from verifier.cell_filling import tracking_table
from verifier.recordings import Recording, inspect_recording, new_recording
from verifier.recordings.joint_state import JointState
from verifier.recordings.measured_tracking import LONGEST_DELAY_S, Samples, measure_tracking, outside_commands
from verifier.tracking import JointReading, TrackingMonitor
from verifier.tracking_note import tracking_notes


def commanded(t, turns=(1.3, 2.1)):
    """Two joints on sines: where they are commanded to be, known at every instant."""
    return np.column_stack([np.sin(w * t) for w in turns])


def recorded(t, delay, error=0.0):
    """The same with a delay, and an error of the second joint that is largest at one sample."""
    q = commanded(t - delay)
    bump = np.zeros(len(t))
    bump[len(t) // 2] = error
    q[:, 1] += bump
    return q


def test_delay_and_error_come_out(rng, count):
    for _ in range(count(200)):
        step, delay = rng.uniform(0.002, 0.01), 10.0 ** rng.uniform(-3.0, -0.7)
        t = 5.0 + np.arange(0.0, 6.0, step)
        t_ref = 5.0 + np.arange(-0.5, 6.5, rng.uniform(0.002, 0.005))
        found = measure_tracking(
            ("a", "b"), Samples(t, recorded(t, delay, 1e-3)), Samples(t_ref, commanded(t_ref))
        )
        assert found.delay_s == pytest.approx(delay, abs=2e-4)
        slack = 2.1 * 2e-4 + (2.1 * 0.005) ** 2 / 8.0  # of the delay, and of lines between commands
        assert found.error[0] <= slack
        assert found.error[1] == pytest.approx(1e-3, abs=slack)
        assert found.at_s[1] == pytest.approx(t[len(t) // 2] - t[0], abs=1e-9)
        # |sin(w t) - sin(w (t - d))| = 2 |sin(w d / 2)| |cos(...)|, whose largest value is met within a step
        most = 2.0 * np.sin(np.array([1.3, 2.1]) * delay / 2.0)
        assert np.allclose(found.without_delay, most, atol=0.012)


def test_what_no_delay_explains_has_none(rng):
    t = np.arange(0.0, 5.0, 0.008)
    q = commanded(t)
    noisy = measure_tracking(("a", "b"), Samples(t, q + 0.01 * rng.normal(size=q.shape)), Samples(t, q))
    assert noisy.delay_s is None
    early = measure_tracking(("a", "b"), Samples(t, commanded(t + 0.05)), Samples(t, q))
    assert early.delay_s is None  # an arm that is ahead of its command has no delay
    late = measure_tracking(("a", "b"), Samples(t, commanded(t - 2 * LONGEST_DELAY_S)), Samples(t, q))
    assert late.delay_s is None
    rests = measure_tracking(("a", "b"), Samples(t, 0 * q), Samples(t, 0 * q))
    assert rests.delay_s is None and rests.error.max() == 0.0


def test_without_a_delay_it_is_the_largest_difference(rng, count):
    for _ in range(count(300)):
        t = np.sort(rng.uniform(0.0, 1.0, size=60))
        q, ref = rng.normal(size=(2, 60, 3))
        found = measure_tracking(("a", "b", "c"), Samples(t, q), Samples(t, ref))
        if found.delay_s is None:
            np.testing.assert_allclose(found.error, np.abs(q - ref).max(axis=0))
        np.testing.assert_allclose(found.without_delay, np.abs(q - ref).max(axis=0))


def test_nobody_knows_what_was_commanded_in_a_pause():
    t = np.arange(0.0, 4.0, 0.01)
    keep = (t < 1.0) | (t > 2.0)
    q, ref = commanded(t), commanded(t)
    q[(t > 1.2) & (t < 1.8)] += 0.5
    found = measure_tracking(("a", "b"), Samples(t, q), Samples(t[keep], ref[keep]))
    assert found.error.max() == pytest.approx(0.0, abs=1e-12)
    assert found.samples == np.count_nonzero(keep)
    assert measure_tracking(("a", "b"), Samples(t, q), Samples(t + 100.0, ref)) is None


def test_the_rule_of_the_monitor(rng, count):
    """Straight motion, so that lines and cubics between commands are the same."""
    for _ in range(count(300)):
        delay = tuple(np.sort(rng.uniform(0.0, 0.05, size=2)))
        t = np.arange(0.0, 0.3, 0.01)
        speed = rng.normal(size=2)
        q = rng.normal(size=2) + speed * t[:, None]
        monitor = TrackingMonitor(np.zeros(2), delay, 0.01, oldest_s=0.4)
        for each, place in zip(t, q, strict=True):
            monitor.note(each, place, speed)
        at, reading = float(rng.uniform(0.1, 0.25)), rng.normal(size=2)
        found = monitor.check(JointReading(at, reading))
        away = outside_commands(Samples(np.array([at]), reading[None]), Samples(t, q), delay)[0]
        assert away.max() == pytest.approx(0.0 if found is None else found.by, abs=1e-8)


def test_outside_of_commands_by_brute_force(rng, count):
    for _ in range(count(300)):
        t_ref = np.cumsum(rng.uniform(0.005, 0.02, size=30))
        ref = np.cumsum(rng.normal(size=(30, 2)), axis=0)
        t = np.sort(rng.uniform(t_ref[5], t_ref[-1], size=8))
        q = rng.normal(size=(8, 2))
        low, high = np.sort(rng.uniform(0.0, t_ref[4] - t_ref[0], size=2))
        away = outside_commands(Samples(t, q), Samples(t_ref, ref), (low, high))
        for row, at in enumerate(t):
            fine = np.union1d(
                np.linspace(at - high, at - low, 50), t_ref[(t_ref >= at - high) & (t_ref <= at - low)]
            )
            places = np.column_stack([np.interp(fine, t_ref, ref[:, j]) for j in range(2)])
            known = np.maximum(np.maximum(places.min(0) - q[row], q[row] - places.max(0)), 0.0)
            np.testing.assert_allclose(away[row], known, atol=1e-12)


# In recordings.


def recording(path, delay_s=0.04, people=True, names=JOINTS, error=0.002):
    t = np.arange(0, 4 * NANO, 10_000_000)
    q, ref = recorded(t / NANO, delay_s, error), commanded(t / NANO)
    with new_recording(path) as writer:
        for stamp, place, want in zip(t.tolist(), q, ref, strict=True):
            writer.joints(JointState(stamp, names, place))
            writer.commands(JointState(stamp, names[::-1], want[::-1]))
    return path


def test_inspect_prints_it(tmp_path):
    found = inspect_recording(recording(tmp_path / "a.mcap"))
    assert found.tracking.joints == JOINTS
    assert found.tracking.delay_s == pytest.approx(0.04, abs=5e-4)
    text = "\n".join(found.lines())
    assert "tracking error, measured from commands: a delay of 40.0 ms explains most of it" in text
    assert "  elbow: at most 0.00" in text
    printed = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert printed["tracking"]["joints"][1]["name"] == "elbow"
    none = inspect_recording(write_all(tmp_path / "b.mcap", reports()))
    assert none.tracking is None and none.to_dict()["tracking"] is None


def test_init_proposes_it(tmp_path):
    found = inspect_recording(recording(tmp_path / "a.mcap")).tracking
    text = tracking_table(found, 'a"\n[robot]\n.mcap')
    cell = tmp_path / "cell.toml"
    cell.write_text(f'[robot]\nname = "ur5"\nbare_flange = true\n{text}')
    tracking = Cell.from_toml(cell).robot.tracking
    assert found.error.max() <= tracking.position_error_rad <= 1.01 * found.error.max()
    assert found.delay_s <= tracking.delay_max_s <= 1.01 * found.delay_s
    assert tracking.delay_min_s == 0.0


def cell(tmp_path, text):
    path = tmp_path / "cell.toml"
    path.write_text(f'[robot]\nname = "ur5"\nbare_flange = true\n{text}')
    return Cell.from_toml(path)


def test_verify_says_when_it_is_larger_than_declared(tmp_path):
    source = Recording(recording(tmp_path / "a.mcap", error=0.0))

    def notes(error, delay):
        table = f"[robot.tracking]\nposition_error_rad = {error}\ndelay_max_s = {delay}\n"
        return tracking_notes(source, cell(tmp_path, table), ())

    (note,) = notes(0.01, 0.0)
    assert (
        note.startswith("A2: elbow is ") and "from every command on /joint_commands of 0 … 0 s before" in note
    )
    assert "declared were 0.01; with a delay of 40.0 ms it is " in note
    assert (
        notes(0.0006, 0.05) == ()
    )  # lines between commands 10 ms apart are off by (2.1 * 0.01)² / 8 at most
    assert len(notes(0.001, 0.02)) == 1
    assert notes(2.1 * 0.04 + 0.001, 0.0) == ()
    assert (
        tracking_notes(Recording(write_all(tmp_path / "b.mcap", [*only_joints()])), cell(tmp_path, ""), ())
        == ()
    )


def only_joints():
    return [JointState(k * 10_000_000, JOINTS, np.array([0.1 * math.sin(k), 0.0])) for k in range(50)]
