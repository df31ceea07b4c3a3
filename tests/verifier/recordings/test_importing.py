"""Import of joints and people from files of every kind."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from failsafe.trajectory import FitSettings
from occupancy.body import Point
from robots.assumption import Certainty
from robots.errors import SetupError
from tests.verifier.recordings.samples import NANO, joint_states, person, reports, write_all
from verifier.recordings import (
    ImportSettings,
    OutputExistsError,
    PeopleFile,
    Place,
    Recording,
    RecordingError,
    import_recording,
    new_recording,
)
from verifier.recordings.importing import FEWEST_SAMPLES
from verifier.recordings.joint_state import JointState, decode
from verifier.recordings.mcap_file import Channel, McapFile, Message
from verifier.recordings.people_report import PeopleReport
from verifier.recordings.reading import Reading

ROBOT = ("j1", "j2")
SETTINGS = ImportSettings("arm", ROBOT)


@pytest.fixture
def joints(tmp_path):
    """Two seconds at 100 Hz that start at 7 s."""
    t = np.arange(201) / 100
    q = np.sin(t[:, None] + [0.0, 1.0])
    np.savez(tmp_path / "joints.npz", t=7.0 + t, q=q, dq=q + 1, tau=q + 2, joints=np.array(ROBOT))
    return tmp_path / "joints.npz"


@pytest.fixture
def people(tmp_path):
    """Three seconds at 50 Hz that start at 100 s; a walk along x."""
    return people_file(tmp_path / "people.npz")


def people_file(path, seconds=3.0, start=100.0, names=("head", "r_wrist", "abdomen"), **more):
    t = np.arange(round(seconds * 50) + 1) / 50
    xyz = np.ones((len(t), len(names), 3)) * np.arange(1, len(names) + 1)[:, None]
    xyz[:, :, 0] += t[:, None]
    np.savez(path, t=start + t, joints=np.array(names), xyz=xyz, **more)
    return path


def imported(tmp_path, joints, sources, settings=SETTINGS):
    out = tmp_path / "out.mcap"
    summary = import_recording(out, joints, sources, settings)
    reading = Reading(Recording(out), settings.robot_joints, people=bool(sources))
    (window,) = reading.windows(1000.0, 0.0, 0.0)
    return summary, reading, window


def test_both_start_at_zero_and_the_overlap_is_used(tmp_path, joints, people):
    summary, reading, window = imported(tmp_path, joints, [PeopleFile(people)])
    assert reading.overlap == (0.0, 2.0)
    assert summary.duration_s == 2.0
    assert (summary.joint_samples, summary.reports) == (201, 101)
    np.testing.assert_allclose(window.t, np.arange(201) / 100, atol=1e-12)
    np.testing.assert_array_equal(window.q, np.load(joints)["q"])
    assert [r.stamp for r in window.people] == [r.arrived for r in window.people]
    assert [r.stamp for r in window.people] == pytest.approx(np.arange(101) / 50)
    assert {r.frame for r in window.people} == {"world"}
    assert not any(r.complete for r in window.people)
    head = np.array([r.people[0].xyz[Point.HEAD] for r in window.people])
    np.testing.assert_allclose(head, [[1 + n / 50, 1, 1] for n in range(101)])
    assert window.people[0].people[0].measured == 1 << Point.HEAD | 1 << Point.R_WRIST
    assert summary.people == ("p1",)
    assert summary.unknown_points == ("abdomen",)


def test_velocities_and_torques_are_kept(tmp_path, joints, people):
    imported(tmp_path, joints, [PeopleFile(people)])
    message = next(McapFile(tmp_path / "out.mcap").messages(["/joint_states"]))
    state = decode(message.data)
    np.testing.assert_array_equal(state.velocity, state.position + 1)
    np.testing.assert_array_equal(state.effort, state.position + 2)


@pytest.mark.parametrize(
    ("offset", "joint_samples", "n_reports", "overlap"),
    [
        (0.5, 151, 76, (0.0, 1.5)),
        (-2.5, 51, 26, (0.0, 0.5)),
        (2.0, None, None, None),
        (-3.0, None, None, None),
    ],
)
def test_time_offset(tmp_path, joints, people, offset, joint_samples, n_reports, overlap):
    settings = ImportSettings("arm", ROBOT, time_offset_s=offset)
    if overlap is None:
        with pytest.raises(RecordingError, match="do not overlap in time; choose another --time-offset"):
            imported(tmp_path, joints, [PeopleFile(people)], settings)
        return
    summary, reading, window = imported(tmp_path, joints, [PeopleFile(people)], settings)
    assert (summary.joint_samples, summary.reports) == (joint_samples, n_reports)
    assert reading.overlap == overlap
    first = window.people[0]
    seen = first.people[0].xyz[Point.HEAD][0] - 1.0  # how far into its file the report is [s]
    assert seen + offset == pytest.approx(first.stamp + max(offset, 0.0))
    assert window.q[0, 0] == pytest.approx(math.sin(max(offset, 0.0)))


def test_place_moves_and_turns(tmp_path, joints, people):
    place = Place(10.0, 20.0, 30.0, 90.0)
    _, _, window = imported(tmp_path, joints, [PeopleFile(people, place)])
    np.testing.assert_allclose(window.people[0].people[0].xyz[Point.R_WRIST], [10 - 2, 20 + 2, 30 + 2])
    np.testing.assert_allclose(window.people[50].people[0].xyz[Point.R_WRIST], [10 - 2, 20 + 3, 30 + 2])


def test_places_compose_like_rotation_matrices(rng, count):
    for _ in range(count(1000)):
        x, y, z = rng.normal(size=3)
        yaw = rng.uniform(-720, 720)
        points = rng.normal(size=(4, 20, 3))
        placed = Place(x, y, z, yaw).apply(points)
        complex_plane = (points[..., 0] + 1j * points[..., 1]) * np.exp(1j * np.deg2rad(yaw)) + x + 1j * y
        np.testing.assert_allclose(placed[..., 0], complex_plane.real, atol=1e-12)
        np.testing.assert_allclose(placed[..., 1], complex_plane.imag, atol=1e-12)
        np.testing.assert_allclose(placed[..., 2], points[..., 2] + z, atol=1e-12)


def test_several_files_are_several_persons_in_one_report(tmp_path, joints, people):
    other = people_file(tmp_path / "other.npz", seconds=1.0)
    sources = [PeopleFile(people, Place(1.0)), PeopleFile(other, Place(5.0))]
    summary, reading, window = imported(tmp_path, joints, sources)
    assert summary.people == ("p1", "p2")
    assert reading.overlap == (0.0, 1.0)
    assert len(window.people) == 51
    for report in window.people:
        assert [p.id for p in report.people] == ["p1", "p2"]
        one, two = (p.xyz[Point.HEAD] for p in report.people)
        np.testing.assert_allclose(two - one, [4.0, 0.0, 0.0])


def test_zero_and_nan_points_are_missing_wherever_they_are_placed(tmp_path, joints):
    t = np.arange(101) / 50
    xyz = np.ones((101, 3, 3))
    xyz[10, 0] = 0.0
    xyz[11, 1] = math.nan
    xyz[12, 1, 2] = math.inf
    np.savez(tmp_path / "p.npz", t=t, joints=np.array(["head", "r_wrist", "l_wrist"]), xyz=xyz)
    place = Place(3.0, 2.0, 1.0, 45.0)
    summary, _, window = imported(tmp_path, joints, [PeopleFile(tmp_path / "p.npz", place)])
    assert summary.missing_points == 3
    seen = [report.people[0].measured for report in window.people]
    everything = 1 << Point.HEAD | 1 << Point.R_WRIST | 1 << Point.L_WRIST
    assert seen[10] == everything - (1 << Point.HEAD)
    assert seen[11] == seen[12] == everything - (1 << Point.R_WRIST)
    assert np.isnan(window.people[10].people[0].xyz[Point.HEAD]).all()
    assert seen[:10] == [everything] * 10


@pytest.mark.parametrize(
    ("in_file", "option", "error", "certainty"),
    [
        (0.05, 0.02, 0.05, Certainty.DECLARED),
        (None, 0.02, 0.02, Certainty.DECLARED),
        (None, None, 0.01, Certainty.DEFAULT),
        (None, 0.0, 0.0, Certainty.DECLARED),
    ],
)
def test_position_error(tmp_path, joints, in_file, option, error, certainty):
    stated = {} if in_file is None else {"position_error_m": in_file}
    path = people_file(tmp_path / "p.npz", **stated)
    settings = ImportSettings("arm", ROBOT, position_error_m=option)
    summary, _, window = imported(tmp_path, joints, [PeopleFile(path)], settings)
    assert window.people[0].people[0].error_m[Point.HEAD] == error
    (assumption,) = [a for a in summary.assumptions if "position_error" in a.name]
    assert (assumption.value, assumption.unit, assumption.certainty) == (error, "m", certainty)


def test_assumptions_are_written_into_the_recording(tmp_path, joints, people):
    summary, reading, _ = imported(tmp_path, joints, [PeopleFile(people)])
    assert reading.recording.assumptions == summary.assumptions
    assert reading.recording.robot == "arm"
    certainties = {a.name: a.certainty for a in summary.assumptions}
    assert certainties == {
        "recording.time_offset": Certainty.DEFAULT,
        "recording.place.people.npz": Certainty.DEFAULT,
        "recording.position_error.people.npz": Certainty.DEFAULT,
    }
    assert any("people.npz" in line for line in summary.lines())
    assert "point names that are not known and were ignored: abdomen" in summary.lines()


def test_joints_without_names_take_the_order_of_the_catalogue(tmp_path, people):
    np.savez(tmp_path / "j.npz", t=np.arange(201) / 100, q=np.ones((201, 2)))
    summary, reading, _ = imported(tmp_path, tmp_path / "j.npz", [PeopleFile(people)])
    assert reading.recording.joint_names == ROBOT
    (assumption,) = [a for a in summary.assumptions if a.name == "recording.joint_order"]
    assert (assumption.value, assumption.certainty) == ("j1, j2", Certainty.ASSUMED)
    settings = ImportSettings("arm", ("a", "b", "c"))
    with pytest.raises(RecordingError, match="has 2 joints without names; arm has 3: a, b, c"):
        import_recording(tmp_path / "b.mcap", tmp_path / "j.npz", [PeopleFile(people)], settings)


def test_extra_joints_are_kept_and_listed_missing_ones_refused(tmp_path, joints, people):
    summary, reading, window = imported(
        tmp_path, joints, [PeopleFile(people)], ImportSettings("arm", ("j2",))
    )
    assert summary.extra_joints == reading.extra_joints == ("j1",)
    np.testing.assert_array_equal(window.q[:, 0], np.load(joints)["q"][:, 1])
    with pytest.raises(RecordingError, match=r"joints\.npz: lacks joint j3 of arm \(it has j1, j2\)"):
        import_recording(
            tmp_path / "b.mcap", joints, [PeopleFile(people)], ImportSettings("arm", ("j1", "j3"))
        )


def test_names_go_through_a_map(tmp_path, joints):
    path = people_file(tmp_path / "p.npz", names=("RightHand", "abdomen"))
    with pytest.raises(RecordingError, match=r"has no known point name \(it has RightHand, abdomen\)"):
        import_recording(tmp_path / "b.mcap", joints, [PeopleFile(path)], SETTINGS)
    settings = ImportSettings("arm", ROBOT, point_names={"RightHand": "r_hand"})
    summary, _, window = imported(tmp_path, joints, [PeopleFile(path)], settings)
    assert window.people[0].people[0].measured == 1 << Point.R_HAND
    assert summary.unknown_points == ("abdomen",)
    settings = ImportSettings("arm", ROBOT, point_names={"RightHand": "head", "abdomen": "head"})
    with pytest.raises(RecordingError, match="abdomen: is a second head; each point must have one name"):
        import_recording(tmp_path / "b.mcap", joints, [PeopleFile(path)], settings)


def test_csv_gives_the_same_recording_as_npz(tmp_path, joints, people):
    imported(tmp_path, joints, [PeopleFile(people)])
    wanted = [(m.log_time, m.data) for m in McapFile(tmp_path / "out.mcap").messages(["/people"])]
    data = np.load(people)
    header = ["t", *(f"{name}_{axis}" for name in data["joints"] for axis in "xyz")]
    rows = [header, *([t, *xyz.ravel()] for t, xyz in zip(data["t"], data["xyz"], strict=True))]
    (tmp_path / "people.csv").write_text("\n".join(",".join(map(str, row)) for row in rows))
    q = np.load(joints)
    rows = [["t", *ROBOT], *([t, *row] for t, row in zip(q["t"], q["q"], strict=True))]
    (tmp_path / "joints.csv").write_text("\n".join(",".join(map(str, row)) for row in rows))
    out = tmp_path / "csv.mcap"
    import_recording(out, tmp_path / "joints.csv", [PeopleFile(tmp_path / "people.csv")], SETTINGS)
    assert [(m.log_time, m.data) for m in McapFile(out).messages(["/people"])] == wanted
    (window,) = Reading(Recording(out), ROBOT).windows(100.0, 0.0, 0.0)
    np.testing.assert_array_equal(window.q, q["q"])


def test_persons_of_a_csv_keep_their_names(tmp_path, joints, people):
    path = tmp_path / "two.csv"
    rows = [f"{n / 50},{who},1,2,3" for n in range(101) for who in ("anna", "ben")]
    path.write_text("t,person,head_x,head_y,head_z\n" + "\n".join(rows))
    summary, _, window = imported(tmp_path, joints, [PeopleFile(path)])
    assert summary.people == ("anna", "ben")
    assert [p.id for p in window.people[7].people] == ["anna", "ben"]
    summary = import_recording(
        tmp_path / "b.mcap", joints, [PeopleFile(path), PeopleFile(path), PeopleFile(people)], SETTINGS
    )
    assert summary.people == ("1/anna", "1/ben", "2/anna", "2/ben", "p3")


# From MCAP.


def test_joints_of_an_mcap_are_copied_with_every_other_topic(tmp_path, people):
    start = 1_700_000_000 * NANO
    states = joint_states(start_ns=start, names=ROBOT)

    def also(writer):
        writer.verdict(start, {"old": True})
        channel = Channel(id=0, topic="/wrench", message_encoding="cdr", metadata={"a": "b"}, schema_id=0)
        for n in range(3):
            writer.copy(Message(channel, start + n * NANO, start, 0, bytes([n])), None)

    source = write_all(tmp_path / "in.mcap", [*states, *reports(start_ns=start)], also)
    _, reading, window = imported(tmp_path, source, [PeopleFile(people)])
    assert reading.epoch_ns == start
    assert reading.overlap == (0.0, 2.0)
    np.testing.assert_array_equal(window.q, [s.position for s in states])
    assert {r.people[0].id for r in window.people} == {"p1"}
    file = McapFile(tmp_path / "out.mcap")
    wrench = list(file.messages(["/wrench"]))
    assert [(m.log_time, m.data) for m in wrench] == [(start + n * NANO, bytes([n])) for n in range(3)]
    assert wrench[0].channel.metadata == {"a": "b"}
    assert not list(file.messages(["/verdict"]))


def test_people_of_an_mcap_keep_their_delay(tmp_path, joints):
    source = write_all(tmp_path / "in.mcap", reports(start_ns=55 * NANO, delay_s=0.03))
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source, Place(0.0, 0.0, 1.0))])
    assert summary.people == ("p1",)
    assert [r.stamp for r in window.people] == pytest.approx(np.arange(101) / 50)
    assert [r.arrived for r in window.people] == pytest.approx(np.arange(101) / 50 + 0.03)
    np.testing.assert_allclose(window.people[0].people[0].xyz[Point.R_WRIST], [1.0, 2.0, 4.0])
    assert window.people[0].people[0].error_m[Point.R_WRIST] == 0.01


def test_people_of_an_mcap_in_two_frames_are_refused(tmp_path, joints):
    people = [
        PeopleReport(r.stamp_ns, r.arrived_ns, f"f{n % 2}", True, (person(),))
        for n, r in enumerate(reports())
    ]
    source = write_all(tmp_path / "in.mcap", people)
    with pytest.raises(RecordingError, match="is in the frames f0 and f1; one place needs one frame"):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(source)], SETTINGS)
    assert not (tmp_path / "out.mcap").exists()


def test_mcap_without_people_is_refused(tmp_path, joints):
    source = write_all(tmp_path / "in.mcap", joint_states())
    with pytest.raises(RecordingError, match="has no messages on /people"):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(source)], SETTINGS)


# An MCAP source is refused for what verify refuses, in the same words.


def written(path, states, stamps=None):
    """Write messages in the order given, the message time of each its stamp or that of ``stamps``."""
    with new_recording(path) as writer:
        for number, state in enumerate(states):
            stamp = state.stamp_ns if stamps is None else stamps[number]
            writer.joints(JointState(stamp, state.names, state.position))
    return path


def bad_joints(path, kind):
    states = joint_states(start_ns=NANO, names=ROBOT)
    stamps = [state.stamp_ns for state in states]
    if kind in ("nan", "infinite"):
        states[150].position[1] = math.nan if kind == "nan" else -math.inf
    elif kind == "repeats":
        stamps[150] = stamps[149]
    elif kind == "lacks":
        states[150] = JointState(stamps[150], ROBOT[:1], np.zeros(1))
    else:
        stamps[150] -= NANO // 20
    return written(path, states, stamps)


@pytest.mark.parametrize("with_people", [False, True])
@pytest.mark.parametrize("kind", ["backwards", "repeats", "nan", "infinite", "lacks"])
def test_joints_of_an_mcap_are_refused_as_verify_refuses_them(tmp_path, kind, with_people):
    """Also where the bad sample is outside of the stretch that is written."""
    source = bad_joints(tmp_path / "in.mcap", kind)
    with pytest.raises(RecordingError) as verified:
        list(Reading(Recording(source), ROBOT, people=False).windows(0.5, 0.1, 0.1))
    sources = [PeopleFile(people_file(tmp_path / "p.npz", seconds=1.0))] if with_people else []
    out = tmp_path / "out.mcap"
    with pytest.raises(RecordingError) as imports:
        import_recording(out, source, sources, SETTINGS)
    assert str(imports.value) == str(verified.value)
    assert str(imports.value).startswith(f"{source}: /joint_states, ")
    assert not out.exists()


def test_long_joints_of_an_mcap_are_checked_to_the_end(tmp_path):
    states = joint_states(seconds=25.0, names=ROBOT)
    good = import_recording(tmp_path / "o.mcap", written(tmp_path / "a.mcap", states), [], SETTINGS)
    assert good.joint_samples == len(states) == 2501
    for row in (1000, 1001, 2400, 2500):
        stamps = [state.stamp_ns for state in states]
        stamps[row] = stamps[row - 1]
        source = written(tmp_path / "b.mcap", states, stamps)
        with pytest.raises(RecordingError, match=rf"{(row - 1) / 100:.6f} s after .*: time repeats"):
            import_recording(tmp_path / "p.mcap", source, [], SETTINGS)
        source.unlink()


def raw_people(path, *texts):
    """Reports as text, one each 20 ms."""
    channel = Channel(id=0, topic="/people", message_encoding="json", metadata={}, schema_id=0)
    with new_recording(path) as writer:
        for n, text in enumerate(texts):
            writer.copy(Message(channel, n * NANO // 50, n * NANO // 50, 0, text.encode()), None)
    return path


def report_text(n, *people):
    return json.dumps({"stamp": n / 50, "frame": "world", "people": people})


@pytest.mark.parametrize("kind", ["two clocks", "no names", "no points", "no report"])
def test_people_of_an_mcap_are_refused_as_verify_refuses_them(tmp_path, joints, kind):
    if kind == "two clocks":
        people = [replace(r, arrived_ns=r.arrived_ns + 60 * NANO) for r in reports()]
        source = write_all(tmp_path / "in.mcap", [*joint_states(names=ROBOT), *people])
    else:
        points = {"nose": {"xyz": [1, 2, 3], "state": "measured"}} if kind == "no names" else {}
        text = "[]" if kind == "no report" else ""
        texts = [text or report_text(n, {"id": "a", "points": points}) for n in range(101)]
        raw_people(tmp_path / "people.mcap", *texts)
        source = tmp_path / "in.mcap"
        with new_recording(source) as writer:
            for state in joint_states(names=ROBOT):
                writer.joints(state)
            for message in McapFile(tmp_path / "people.mcap").messages():
                writer.copy(message, None)
    with pytest.raises(RecordingError) as verified:
        Reading(Recording(source), ROBOT)
    with pytest.raises(RecordingError) as imports:
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(source)], SETTINGS)
    assert str(imports.value) == str(verified.value)


def test_what_could_not_be_read_of_reports_is_said(tmp_path, joints):
    """Of what verify counts in the source, nothing is gone without a word."""
    good = {"xyz": [1, 2, 3], "state": "measured"}
    texts = [report_text(n, {"id": "a", "points": {"head": good}}) for n in range(101)]
    texts[10] = report_text(10, {"id": "a", "points": {"head": {**good, "xyz": [1]}}})
    texts[20] = report_text(20, {"id": "a", "points": {"head": good, "pelvis": {**good, "xyz": [0, 0, 0]}}})
    texts[30] = report_text(30, {"id": "a", "points": {"head": good, "pelvis": {**good, "xyz": [None] * 3}}})
    texts[40] = report_text(40, {"id": "b", "points": {"head": good}, "position_error_m": -1})
    texts[50] = "[]"
    texts[60] = report_text(600, {"id": "c", "points": {"head": good}})  # 10.8 s ahead of its message
    source = raw_people(tmp_path / "people.mcap", *texts)
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source)])
    assert (summary.missing_points, summary.unreadable_reports, summary.refused) == (2, 2, 2)
    assert summary.people == ("a", "b", "c")
    lines = summary.lines()
    assert "points that were NaN, infinite or zero and were left out: 2" in lines
    assert "reports that could not be read but for the names in them: 2" in lines
    (line,) = [line for line in lines if line.startswith("persons and points that could not be read")]
    assert line.endswith('left out: 2, the first: a, head: "xyz" must be three numbers, not [1]')
    stamps = {r.stamp: r.people for r in window.people}
    assert np.isnan(stamps[0.8][0].xyz).all() and stamps[0.8][0].id == "b"
    assert np.isnan(stamps[1.2][0].xyz).all() and stamps[1.2][0].id == "c"


def test_two_reports_of_one_instant_do_not_make_two_persons_of_one(tmp_path, joints):
    """Verify counts the second as one that does not advance; a new report is begun, as in the source."""
    people = [report for report in reports() for _ in range(2)]
    source = write_all(tmp_path / "in.mcap", people)
    other = people_file(tmp_path / "other.npz")
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source), PeopleFile(other)])
    assert summary.people == ("1/p1", "p2")
    assert {person.id for report in window.people for person in report.people} == {"1/p1", "p2"}


# What else is refused.


def test_files_of_no_known_kind_are_refused(tmp_path, joints, people):
    for path in (tmp_path / "a.txt", tmp_path / "noending"):
        path.write_text("t,a")
        with pytest.raises(RecordingError, match=r"no kind of file that holds joints .*must end in \.npz"):
            import_recording(tmp_path / "o.mcap", path, [PeopleFile(people)], SETTINGS)
        with pytest.raises(RecordingError, match=r"no kind of file that holds people .*must end in \.npz"):
            import_recording(tmp_path / "o.mcap", joints, [PeopleFile(path)], SETTINGS)


def test_nothing_is_overwritten_unless_forced(tmp_path, joints, people):
    out = tmp_path / "out.mcap"
    out.write_bytes(b"mine")
    with pytest.raises(OutputExistsError):
        import_recording(out, joints, [PeopleFile(people)], SETTINGS)
    assert out.read_bytes() == b"mine"
    import_recording(out, joints, [PeopleFile(people)], SETTINGS, force=True)
    Reading(Recording(out), ROBOT)


def test_a_run_of_a_file_without_runs_is_refused(tmp_path, people):
    settings = ImportSettings("arm", ROBOT, run=1)
    (tmp_path / "j.csv").write_text("t,j1,j2\n0,1,2\n1,1,2\n")
    with pytest.raises(RecordingError, match=r"j\.csv: has no runs, so no run 1; leave --run away"):
        import_recording(tmp_path / "o.mcap", tmp_path / "j.csv", [PeopleFile(people)], settings)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, 1e300])
def test_settings_are_checked(value):
    with pytest.raises(SetupError, match=r"position error .*: it must be at least 0 m and at most 1000 m"):
        ImportSettings("arm", ROBOT, position_error_m=value)
    if value != -0.1:
        with pytest.raises(SetupError, match=r"time offset .*: it must be within 1e\+09 s"):
            ImportSettings("arm", ROBOT, time_offset_s=value)
        for numbers in ((value, 0.0, 0.0, 0.0), (0.0, value, 0.0, 0.0), (0.0, 0.0, -value, 0.0)):
            with pytest.raises(SetupError, match=r"place .*: it must be three numbers within 10000 m"):
                Place(*numbers)
        with pytest.raises(SetupError, match="an angle within 3600 degrees"):
            Place(0.0, 0.0, 0.0, value)


def test_the_fewest_samples_are_those_of_a_fit():
    assert FitSettings().degree + 1 == FEWEST_SAMPLES


@pytest.mark.parametrize("n", [5, 6])
def test_a_stretch_with_too_few_samples_is_refused(tmp_path, people, n):
    lines = "".join(f"{k * 0.01:g},1,2\n" for k in range(n))
    (tmp_path / "j.csv").write_text(f"t,j1,j2\n{lines}")
    out = tmp_path / "o.mcap"
    if n == 6:
        assert import_recording(out, tmp_path / "j.csv", [PeopleFile(people)], SETTINGS).joint_samples == 6
        return
    with pytest.raises(
        RecordingError,
        match=r"has 5 samples in the 0.04 s that all files cover; 6 are needed; .* must be in seconds",
    ):
        import_recording(out, tmp_path / "j.csv", [PeopleFile(people)], SETTINGS)
    assert not out.exists()


@pytest.mark.parametrize("lag_s", [-0.5, 0.03, 0.5])
def test_joints_of_an_mcap_are_chosen_by_their_stamps(tmp_path, lag_s):
    start = 100 * NANO
    joints = tmp_path / "in.mcap"
    with new_recording(joints) as writer:
        plain = write_all(tmp_path / "plain.mcap", joint_states(start_ns=start, names=ROBOT))
        for message in McapFile(plain).messages():
            moved = message._replace(log_time=message.log_time + round(lag_s * NANO))
            writer.copy(moved, McapFile(plain).schemas[message.channel.schema_id])
    people = write_all(tmp_path / "people.mcap", reports(start_ns=start))
    summary, reading, window = imported(tmp_path, joints, [PeopleFile(people)])
    assert summary.joint_samples == len(window.t) == 201
    assert reading.overlap == (0.0, 2.0)


def test_people_that_arrive_before_time_begins_are_refused(tmp_path, joints):
    ahead = [replace(r, arrived_ns=max(0, r.stamp_ns - 5 * NANO)) for r in reports(start_ns=6 * NANO)]
    people = write_all(tmp_path / "people.mcap", ahead)
    with pytest.raises(
        RecordingError,
        match=r"out\.mcap: a message would get the time -5\.000000 s; message times count from 0",
    ):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(people)], SETTINGS)
    assert not (tmp_path / "out.mcap").exists()


def test_who_is_named_in_a_report_that_cannot_be_read_is_imported(tmp_path, joints):
    plain = write_all(tmp_path / "plain.mcap", reports())
    with new_recording(tmp_path / "people.mcap") as writer:
        for number, message in enumerate(McapFile(plain).messages()):
            bad = b'{"stamp": "late", "people": [{"id": "p2"}]}'
            content = message._replace(data=bad) if number == 50 else message
            writer.copy(content, McapFile(plain).schemas[message.channel.schema_id])
    summary, _, window = imported(tmp_path, joints, [PeopleFile(tmp_path / "people.mcap")])
    assert summary.unreadable_reports == 1 and summary.people == ("p1", "p2")
    assert "reports that could not be read but for the names in them: 1" in summary.lines()
    (report,) = (r for r in window.people if r.people[0].id == "p2")
    assert report.stamp == pytest.approx(1.02)
    assert np.isnan(report.people[0].xyz).all()
