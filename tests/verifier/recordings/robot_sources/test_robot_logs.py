"""Logs of UR controllers and of libfranka, written here as their recorders write them."""

import csv
import gzip
import io
import math

import numpy as np
import pytest

from tests.verifier.recordings.samples import reports, write_all
from verifier.recordings import ImportSettings, PeopleFile, RecordingError, import_recording
from verifier.recordings.inspection import catalogue
from verifier.recordings.joint_state import decode
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.motion_source import open_motion
from verifier.recordings.motion_table import read_joint_csv

UR, PANDA = catalogue()["ur5"], catalogue()["panda"]
UPTIME_S = 1550304.53
"""Controllers count from when they were switched on."""


def rtde(rng, rows=40, step_s=0.008):
    """Columns of a log as the recorder of the official client writes it, row by row."""
    t = UPTIME_S + step_s * np.arange(rows)
    q = np.cumsum(rng.normal(size=(rows, 6)) * 1e-3, axis=0)
    names = ["_id", "timestamp", *(f"{kind}_{i}" for kind in KINDS for i in range(6)), *STATES]
    tables = [q, np.gradient(q, step_s, axis=0), q + 0.01, np.gradient(q, step_s, axis=0) + 0.01]
    cells = np.column_stack([t, *tables, np.full(rows, 0.5), np.ones(rows), np.full(rows, 1.25)])
    lines = [
        [f"2026:01:02:03:04:{row:02d}.000000", *map(repr, map(float, values))]
        for row, values in enumerate(cells)
    ]
    return names, lines, t, tables


KINDS = ("actual_q", "actual_qd", "target_q", "target_qd")
STATES = ("speed_scaling", "safety_mode", "payload")


def write(path, names, lines, delimiter=" "):
    text = io.StringIO()
    csv.writer(text, delimiter=delimiter).writerows([names, *lines])
    content = text.getvalue().encode()
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def libfranka(rng, rows=30, separator=", "):
    """Text of a log as ``franka::logToCSV`` writes it: blanks in the header, except between its parts."""
    groups = ["state.q", "state.q_d", "state.dq", "state.dq_d", "state.tau_J", "cmd.q_d"]
    header = ",".join(separator.join(f"{group}[{i}]" for i in range(7)) for group in groups)
    t_ms = 86_400_123 + np.cumsum(rng.integers(1, 4, size=rows))
    values = rng.normal(size=(rows, 7 * len(groups)))
    lines = [f"time{separator}success_rate{separator}{header}"]
    lines += [
        ",".join([str(ms), "1", *map(repr, map(float, row))]) for ms, row in zip(t_ms, values, strict=True)
    ]
    return (
        "\n".join(lines) + "\n",
        t_ms,
        dict(zip(groups, np.split(values, len(groups), axis=1), strict=True)),
    )


def refused(path, robot_joints=None):
    with pytest.raises(RecordingError) as caught:
        open_motion(path, robot_joints)
    text = str(caught.value)
    assert text.startswith(f"{path}: ") and "\n" not in text
    return text.removeprefix(f"{path}: ")


@pytest.mark.parametrize("delimiter", [" ", ",", ";", "\t"])
@pytest.mark.parametrize("ending", ["csv", "csv.gz"])
def test_every_number_of_a_ur_log_comes_out(tmp_path, rng, delimiter, ending):
    names, lines, t, (q, dq, target, speed) = rtde(rng)
    motion = open_motion(write(tmp_path / f"a.{ending}", names, lines, delimiter), UR)
    assert motion.joints == UR
    np.testing.assert_allclose(motion.t, t - t[0], atol=1e-9)
    for found, known in zip(
        (motion.q, motion.dq, motion.command_q, motion.command_dq), (q, dq, target, speed), strict=True
    ):
        np.testing.assert_array_equal(found, known)
    assert motion.begins_s == UPTIME_S
    assert {state.name for state in motion.states} == {"speed_scaling", "safety_mode"}
    assert "payload that the controller was told: 1.25 kg" in motion.notes


@pytest.mark.parametrize("separator", [", ", ","])
def test_every_number_of_a_libfranka_log_comes_out(tmp_path, rng, separator):
    text, t_ms, groups = libfranka(rng, separator=separator)
    path = tmp_path / "a.csv"
    path.write_text(text)
    motion = open_motion(path, PANDA)
    np.testing.assert_array_equal(np.rint(motion.t * 1e3), t_ms - t_ms[0])
    np.testing.assert_array_equal(motion.q, groups["state.q"])
    np.testing.assert_array_equal(motion.dq, groups["state.dq"])
    np.testing.assert_array_equal(motion.command_q, groups["state.q_d"])
    np.testing.assert_array_equal(motion.command_dq, groups["state.dq_d"])
    table = read_joint_csv(path)
    assert table.names is None
    np.testing.assert_array_equal(table.t_ns, (t_ms - t_ms[0]) * 1_000_000)
    assert table.begins_s == t_ms[0] / 1e3


def test_a_log_becomes_a_recording_with_its_commands(tmp_path, rng):
    names, lines, t, (q, dq, target, speed) = rtde(rng)
    path = write(tmp_path / "a.csv", names, lines)
    summary = import_recording(tmp_path / "a.mcap", path, [], ImportSettings("ur5", UR))
    told = {each.name: each for each in summary.assumptions}
    assert told["recording.joint_source"].value == "log of a UR controller"
    assert told["recording.joint_source"].source == "columns actual_q_0 … actual_q_5 of a.csv"
    assert "recording.joint_order" in told
    file = McapFile(tmp_path / "a.mcap")
    for topic, place, rate in (("/joint_states", q, dq), ("/joint_commands", target, speed)):
        states = [decode(message.data) for message in file.messages([topic])]
        assert {state.names for state in states} == {UR}
        np.testing.assert_array_equal([state.position for state in states], place)
        np.testing.assert_array_equal([state.velocity for state in states], rate)
        np.testing.assert_array_equal([state.stamp_ns for state in states], np.rint((t - t[0]) * 1e9))
    again = open_motion(tmp_path / "a.mcap")
    np.testing.assert_array_equal(again.command_q, target)


def test_a_log_beside_people_keeps_its_own_clock_out(tmp_path, rng):
    names, lines, _t, _tables = rtde(rng, rows=200)
    people = write_all(tmp_path / "people.mcap", reports())
    path = write(tmp_path / "a.csv", names, lines)
    summary = import_recording(
        tmp_path / "a.mcap", path, [PeopleFile(people)], ImportSettings("ur5", UR, point_names={})
    )
    assert any("the files begin at 1550304.53 s" in note for note in summary.notes)


def test_columns_of_our_own_keep_velocities_and_commands(tmp_path):
    rows = ["t,a,b,a_velocity,b_velocity,a_command,b_command,stop"]
    rows += [f"{k / 100},{k},{-k},1,2,{k + 0.5},{-k - 0.5},false" for k in range(10)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows))
    table = read_joint_csv(path)
    assert table.names == ("a", "b")
    k = np.arange(10.0)
    np.testing.assert_array_equal(table.dq, np.column_stack([np.ones(10), np.full(10, 2.0)]))
    np.testing.assert_array_equal(table.command, np.column_stack([k + 0.5, -k - 0.5]))
    motion = open_motion(path, ("b", "a"))
    np.testing.assert_array_equal(motion.command_q, np.column_stack([-k - 0.5, k + 0.5]))


def test_a_joint_may_have_a_name_that_ends_like_a_velocity(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,angular_velocity\n" + "".join(f"{k / 100},{k}\n" for k in range(10)))
    assert read_joint_csv(path).names == ("angular_velocity",)


def test_rows_with_an_empty_cell_are_left_out_and_counted(tmp_path, rng):
    names, lines, _t, (q, *_) = rtde(rng)
    lines[3][names.index("actual_q_2")] = ""
    motion = open_motion(write(tmp_path / "a.csv", names, lines, ","), UR)
    np.testing.assert_array_equal(motion.q, np.delete(q, 3, axis=0))
    assert any(note.startswith("1 rows left out") for note in motion.notes)


def changed(name, value):
    def change(names, lines):
        lines[5][names.index(name)] = value

    return change


def without(*gone):
    def change(names, lines):
        for name in gone:
            place = names.index(name)
            for row in (names, *lines):
                del row[place]

    return change


def renamed(old, new):
    def change(names, lines):
        names[names.index(old)] = new

    return change


def scaled_time(factor):
    def change(names, lines):
        for row in lines:
            row[1] = repr(float(row[1]) * factor)

    return change


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (changed("actual_q_3", "nan"), "line 7, column actual_q_3: is nan; "),
        (changed("target_q_3", "inf"), "line 7, column target_q_3: is inf; "),
        (changed("actual_q_3", "1,5"), "column actual_q_3: '1,5' is not a number"),
        (changed("actual_q_3", "86000"), "is 8.6e+04, beyond 1000; give rad"),
        (changed("timestamp", repr(UPTIME_S)), "time runs backwards"),
        (changed("safety_mode", "?"), "column safety_mode: '?' is not a number"),
        (without("actual_q_2"), "line 1: lacks column actual_q_2; a log has all joints"),
        (without("target_q_0"), "line 1: lacks column target_q_0"),
        (without("target_q_5"), "line 1: has 6 columns actual_q_N and 5 target_q_N"),
        (without(*(f"actual_q_{i}" for i in range(6))), "line 1: has no column actual_q_0, as a log of a UR"),
        (without("timestamp"), "line 1: has no column t, and is no log that is known"),
        (renamed("actual_q_1", "actual_q_0"), "line 1: has column actual_q_0 twice"),
        (renamed("target_q_1", "target_q_01"), "line 1: lacks column target_q_1"),
        (renamed("target_q_1", "target_q_\N{ARABIC-INDIC DIGIT ONE}"), "line 1: lacks column target_q_1"),
        (renamed("actual_q_1", "actual_q_01"), "line 1: lacks column actual_q_1"),
        (renamed("target_q_5", "target_q_05"), "line 1: has 6 columns actual_q_N and 5 target_q_N"),
        (scaled_time(1e3), "times are 8 apart, which does not look like seconds"),
        (scaled_time(1e6), "times must be numbers of seconds"),
        (lambda names, lines: lines.insert(7, list(names)), "line 9: is the header again"),
        (lambda names, lines: lines[7].pop(), "line 9: has 28 cells; the header has 29 columns"),
        (lambda names, lines: lines.clear(), "is empty; there must be rows below the header"),
    ],
)
def test_ur_logs_that_are_refused(tmp_path, rng, change, why):
    names, lines, _t, _tables = rtde(rng)
    change(names, lines)
    assert why in refused(write(tmp_path / "a.csv", names, lines), UR)


def test_another_arm_is_refused(tmp_path, rng):
    names, lines, _t, _tables = rtde(rng)
    path = write(tmp_path / "a.csv", names, lines)
    assert refused(path, PANDA).startswith("has 6 joints, and the robot has 7: panda_joint1")
    with pytest.raises(RecordingError, match="7"):
        import_recording(tmp_path / "a.mcap", path, [], ImportSettings("panda", PANDA))


def test_delimiters_that_change_are_refused(tmp_path, rng):
    names, lines, _t, _tables = rtde(rng)
    path = write(tmp_path / "a.csv", names, lines)
    first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([first, *(line.replace(" ", ",") for line in rest)]))
    assert "line 2: has 1 cells; the header has 29 columns" in refused(path)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda ms: ms / 1e3, "is no whole number of ms, as libfranka writes them; give the log as"),
        (lambda ms: ms * 1_000_000, "times must be numbers of seconds"),
    ],
)
def test_libfranka_times_of_another_unit_are_refused(tmp_path, rng, wrong, why):
    text, t_ms, _groups = libfranka(rng)
    path = tmp_path / "a.csv"
    header, *rest = text.splitlines()
    rest = [f"{wrong(float(ms))!r},{line.split(',', 1)[1]}" for ms, line in zip(t_ms, rest, strict=True)]
    path.write_text("\n".join([header, *rest]))
    assert why in refused(path)


def test_speeds_alone_are_no_joints_to_import(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Timestamp,Speed_J0\n" + "".join(f"{k / 10},{k}\n" for k in range(15)))
    with pytest.raises(RecordingError, match="has speeds and no positions"):
        read_joint_csv(path)
    assert open_motion(path).q is None


def test_noise_in_place_of_a_log_is_refused_in_one_line(tmp_path, rng, count):
    names, lines, _t, _tables = rtde(rng, rows=12)
    clean = write(tmp_path / "clean.csv", names, lines).read_bytes()
    read = 0
    for trial in range(count(3000)):
        noisy = bytearray(clean)
        for place in rng.integers(len(noisy), size=int(rng.integers(1, 4))):
            noisy[place] = rng.integers(256)
        path = tmp_path / f"{trial}.csv"
        path.write_bytes(noisy[: int(rng.integers(1, len(noisy) + 1))])
        try:
            motion = open_motion(path, UR)
        except RecordingError as error:
            assert "\n" not in str(error)
        else:
            read += 1
            assert np.isfinite(motion.q).all() and (np.diff(motion.t) > 0).all()
        path.unlink()
    assert read < count(3000)


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["L0L1", "L1L2", "L2L3"])
def test_a_real_log_of_a_ur3e(tmp_path, real_data, name):
    path = real_data / f"robot/ur3e_rad_rtde_{name}.csv.gz"
    with gzip.open(path, "rt", encoding="utf-8-sig") as stream:
        rows = [row for row in csv.DictReader(stream) if row["timestamp"]]
    summary = import_recording(tmp_path / "a.mcap", path, [], ImportSettings("ur3", catalogue()["ur3"]))
    motion = open_motion(tmp_path / "a.mcap")
    for found, column in ((motion.q, "actual_q"), (motion.command_q, "target_q")):
        known = [[float(row[f"{column}_{i}"]) for i in range(6)] for row in rows]
        np.testing.assert_array_equal(found, known)
    seconds = [float(row["timestamp"]) for row in rows]
    np.testing.assert_allclose(motion.t, np.subtract(seconds, seconds[0]), atol=1e-6)
    assert math.isclose(summary.duration_s, seconds[-1] - seconds[0], abs_tol=1e-6)
