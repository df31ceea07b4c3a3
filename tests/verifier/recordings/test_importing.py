"""Import of joints and people from files of every kind."""

import math

import numpy as np
import pytest

from failsafe.trajectory import FitSettings
from occupancy.body import Point
from robots.assumption import Certainty
from robots.errors import SetupError
from tests.verifier.recordings.imports import ROBOT, SETTINGS, imported, people_file, written
from tests.verifier.recordings.samples import NANO, joint_states, reports, write_all
from verifier.recordings import (
    ImportSettings,
    OutputExistsError,
    PeopleFile,
    Place,
    Recording,
    RecordingError,
    import_recording,
    inspect_recording,
)
from verifier.recordings.import_summary import NOT_COMPLETE
from verifier.recordings.importing import FEWEST_SAMPLES
from verifier.recordings.joint_state import decode
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.reading import Reading


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


def test_where_people_stand_is_said_where_nobody_says_where_their_frame_does(tmp_path, joints):
    """Read off the table: a person walks along x beside the base, another one stands 3 m beside it."""
    path = tmp_path / "p.csv"
    rows = "".join(f"{k / 10},a,{k / 10 - 1},0.6,{1.5 + k / 100}\n{k / 10},b,0,3,0\n" for k in range(31))
    path.write_text("t,person,head_x,head_y,head_z\n" + rows)
    summary, _, _ = imported(tmp_path, joints, [PeopleFile(path)])
    where = "m from the robot's base, as no --place says where the frame of p.csv stands (seen from above)"
    assert [note for note in summary.notes if "heights" in note] == [
        f"a: heights 1.50 to 1.70 m, nearest 0.60 {where}",
        f"b: heights 0.00 to 0.00 m, nearest 3.00 {where}",
    ]
    seen = inspect_recording(tmp_path / "out.mcap")
    origin = "m from the origin of frame world (seen from above)"
    assert seen.standing[0] == f"a: heights 1.50 to 1.70 m, nearest 0.60 {origin}"
    assert seen.standing[0] in seen.lines()
    settled = import_recording(tmp_path / "b.mcap", joints, [PeopleFile(path, Place(1.0))], SETTINGS)
    assert not any("heights" in note for note in settled.notes)


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
    *others, last = summary.lines()
    (line,) = (line for line in others if line.startswith("look at: "))
    assert line.startswith(
        "look at: point names that are not known and were ignored: abdomen; --point-name abdomen=OURS takes"
    )
    assert last == f"note: {NOT_COMPLETE}"


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
    assert summary.unknown_points == ("abdomen",) and summary.remarks == ()
    settings = ImportSettings("arm", ROBOT, point_names={"RightHand": "r_hand", "LeftHand": "l_hand"})
    summary = import_recording(tmp_path / "b.mcap", joints, [PeopleFile(path)], settings)
    assert summary.remarks == ("--point-name LeftHand: no file has a point of that name",)
    settings = ImportSettings("arm", ROBOT, point_names={"RightHand": "head", "abdomen": "head"})
    with pytest.raises(RecordingError, match="abdomen: is a second head; each point must have one name"):
        import_recording(tmp_path / "c.mcap", joints, [PeopleFile(path)], settings)


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


# What was left out, and what the files' own times say.


def test_what_is_outside_of_the_stretch_is_said(tmp_path, joints, people):
    """Of 201 samples up to 2 s and 151 reports from 0.5 s to 3.5 s, 1.5 s are left of each."""
    settings = ImportSettings("arm", ROBOT, time_offset_s=0.5)
    summary, _, _ = imported(tmp_path, joints, [PeopleFile(people)], settings)
    outside = "outside of the stretch that all files cover and left out: "
    assert [line for line in summary.lines() if line.startswith("outside")] == [
        f"{outside}50 of 201 samples of joints.npz",
        f"{outside}75 of 151 reports of people.npz",
    ]
    states = written(tmp_path / "states.mcap", joint_states(start_ns=NANO, names=ROBOT))
    seen = write_all(tmp_path / "seen.mcap", reports(start_ns=9 * NANO, seconds=1.0))
    summary = import_recording(tmp_path / "b.mcap", states, [PeopleFile(seen)], SETTINGS)
    assert summary.left_out == ((100, 201, "samples", "states.mcap"),)
    summary = import_recording(tmp_path / "c.mcap", states, [], SETTINGS)
    assert summary.left_out == () and not any("left out" in line for line in summary.lines())


def test_who_was_seen_only_after_the_stretch_is_named(tmp_path, joints):
    rows = [(n / 50, who) for n in range(201) for who in ("anna", "ben") if who == "anna" or n > 101]
    path = tmp_path / "two.csv"
    path.write_text("t,person,head_x,head_y,head_z\n" + "".join(f"{t},{who},{t},2,3\n" for t, who in rows))
    summary, _, _ = imported(tmp_path, joints, [PeopleFile(path)])
    assert summary.people == ("anna",)
    assert (
        "look at: two.csv: seen only after the stretch that all files cover, and not in the recording: ben"
    ) in summary.lines()


@pytest.mark.parametrize("again", [None, 1.0])
def test_who_was_seen_only_before_the_stretch_is_there_without_points(tmp_path, joints, again):
    """The people begin 1 s before the joints; ben is seen in their first half second, cid all the time."""
    rows = [(n / 50, who) for n in range(151) for who in ("ben", "cid")]
    rows = [(t, who) for t, who in rows if who == "cid" or t < 0.5 or (again and t >= 1.0 + again)]
    path = tmp_path / "two.csv"
    path.write_text("t,person,head_x,head_y,head_z\n" + "".join(f"{t},{who},1,2,3\n" for t, who in rows))
    settings = ImportSettings("arm", ROBOT, time_offset_s=-1.0)
    summary, _, window = imported(tmp_path, joints, [PeopleFile(path)], settings)
    assert set(summary.people) == {"ben", "cid"}
    assert any(
        line.startswith("look at: two.csv: seen before the stretch") and line.endswith("start on: ben")
        for line in summary.lines()
    )
    first = window.people[0]
    assert (first.stamp, first.arrived) == (0.0, 0.0)
    assert {p.id: np.isnan(p.xyz).all() for p in first.people} == {"ben": True, "cid": False}
    bens = [(r.stamp, p) for r in window.people for p in r.people if p.id == "ben"]
    assert len(bens) == (1 if again is None else 52)
    assert [t for t, p in bens if np.isfinite(p.xyz).any()][:1] == (
        [] if again is None else [pytest.approx(again)]
    )


def notes(folder, joints, people, settings=SETTINGS):
    summary = import_recording(folder / "o.mcap", joints, people, settings, force=True)
    return [note for note in summary.notes if note in "".join(summary.lines()) and "heights" not in note]


def test_files_that_begin_at_different_times_are_noted(tmp_path, joints, people):
    """The joints begin at 7 s and last for 2 s, the people begin at 100 s."""
    said = "the files begin at 7 s and 100 s; each is taken to start at 0"
    assert notes(tmp_path, joints, [PeopleFile(people)]) == [said]
    offset = ImportSettings("arm", ROBOT, time_offset_s=-0.5)
    assert notes(tmp_path, joints, [PeopleFile(people)], offset) == [f"{said}, the people -0.5 s later"]
    late = people_file(tmp_path / "late.npz", start=7.25)
    assert notes(tmp_path, joints, [PeopleFile(late)]) == [
        "the files begin at 7 s and 7.25 s; each is taken to start at 0; if their times are of one clock, "
        "import with --time-offset 0.25"
    ]
    both = [PeopleFile(late), PeopleFile(people)]
    assert notes(tmp_path, joints, both) == [
        "the files begin at 7 s, 7.25 s and 100 s; each is taken to start at 0"
    ]
    same = people_file(tmp_path / "same.npz", start=7.0004)
    assert notes(tmp_path, joints, [PeopleFile(same)]) == notes(tmp_path, joints, []) == []


def test_starts_of_every_kind_of_file_are_known(tmp_path):
    start = 1_700_000_000 * NANO
    states = joint_states(start_ns=start, names=ROBOT)
    source = write_all(tmp_path / "in.mcap", [*states, *reports(start_ns=start + NANO // 2)])
    (note,) = notes(tmp_path, source, [PeopleFile(source)])
    assert note.startswith("the files begin at 1700000000 s and 1700000000.5 s; each is taken to start at 0")
    assert note.endswith("import with --time-offset 0.5")
    (tmp_path / "j.csv").write_text("t,j1,j2\n" + "".join(f"{5 + n / 100},1,2\n" for n in range(200)))
    (tmp_path / "p.csv").write_text(
        "t,head_x,head_y,head_z\n" + "".join(f"{4.5 + n / 50},1,2,3\n" for n in range(200))
    )
    (note,) = notes(tmp_path, tmp_path / "j.csv", [PeopleFile(tmp_path / "p.csv")])
    assert note.startswith("the files begin at 5 s and 4.5 s; ") and note.endswith("--time-offset -0.5")
