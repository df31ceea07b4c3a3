"""Output files appear whole or not at all."""

import pytest
from mcap.records import Attachment

from tests.verifier.recordings.samples import JOINTS, joint_states, reports, write_all
from verifier.recordings import (
    OutputExistsError,
    Recording,
    RecordingError,
    copy_with_verdicts,
    new_file,
    new_recording,
)
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.reading import Reading


def test_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "out.bin"
    with new_file(path) as stream:
        stream.write(b"half")
        assert not path.exists()
        stream.write(b" and half")
    assert path.read_bytes() == b"half and half"
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_is_left_after_an_exception(tmp_path):
    path = tmp_path / "out.bin"
    with pytest.raises(KeyError), new_file(path) as stream:
        stream.write(b"half")
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_an_older_file_survives_an_exception_even_when_forced(tmp_path):
    path = tmp_path / "out.bin"
    path.write_bytes(b"old")
    with pytest.raises(KeyError), new_file(path, force=True) as stream:
        stream.write(b"half")
        raise KeyError
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_is_overwritten_unless_forced(tmp_path):
    path = tmp_path / "out.bin"
    path.write_bytes(b"old")
    with pytest.raises(OutputExistsError, match=r"out\.bin: exists already; .* --force"), new_file(path):
        pytest.fail("the file must not be opened")
    assert path.read_bytes() == b"old"
    with new_file(path, force=True) as stream:
        stream.write(b"new")
    assert path.read_bytes() == b"new"


def test_whoever_reads_the_older_file_goes_on_reading_it(tmp_path):
    path = tmp_path / "out.bin"
    path.write_bytes(b"old")
    with path.open("rb") as reader:
        with new_file(path, force=True) as stream:
            stream.write(b"new")
        assert reader.read() == b"old"
    assert path.read_bytes() == b"new"


def test_a_file_that_turns_up_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "out.bin"
    with pytest.raises(OutputExistsError), new_file(path):
        path.write_bytes(b"someone else's")
    assert path.read_bytes() == b"someone else's"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="is a folder"), new_file(tmp_path):
        pass
    with (
        pytest.raises(RecordingError, match="cannot be written: its folder does not exist"),
        new_file(tmp_path / "no" / "out"),
    ):
        pass


def test_output_has_the_usual_permissions(tmp_path):
    (tmp_path / "usual").write_bytes(b"")
    with new_file(tmp_path / "ours") as stream:
        stream.write(b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_recording_that_fails_halfway_leaves_nothing(tmp_path):
    with pytest.raises(KeyError), new_recording(tmp_path / "a.mcap") as writer:
        for state in joint_states():
            writer.joints(state)
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_verdicts_are_added_and_everything_else_is_copied(tmp_path):
    def describe(writer):
        writer.describe({"robot": "ur5", "note": "a test"})
        writer.copy_metadata("someone", {"else": "1"})
        writer.copy_attachment(Attachment(1, 2, "plan.pdf", "application/pdf", b"12345"))

    path = write_all(tmp_path / "a.mcap", [*joint_states(), *reports()], describe)
    verdicts = [(n * 100_000_000, {"t": n / 10, "status": 2}) for n in range(20)]
    copy_with_verdicts(Recording(path), tmp_path / "b.mcap", verdicts)
    old, new = McapFile(path), McapFile(tmp_path / "b.mcap")
    assert new.metadata == old.metadata
    assert list(new.attachments()) == [Attachment(1, 2, "plan.pdf", "application/pdf", b"12345")]
    topics = ["/joint_states", "/people"]
    assert [(m.channel.topic, m.log_time, m.data) for m in new.messages(topics)] == [
        (m.channel.topic, m.log_time, m.data) for m in old.messages(topics)
    ]
    assert [m.log_time for m in new.messages(["/verdict"])] == [time for time, _ in verdicts]
    times = [m.log_time for m in new.messages()]
    assert times == sorted(times)
    assert Reading(Recording(tmp_path / "b.mcap"), JOINTS).overlap == (0.0, 2.0)

    copy_with_verdicts(Recording(tmp_path / "b.mcap"), tmp_path / "c.mcap", verdicts[:3])
    assert len(list(McapFile(tmp_path / "c.mcap").messages(["/verdict"]))) == 3


def test_a_verdict_that_is_no_json_leaves_nothing(tmp_path):
    path = write_all(tmp_path / "a.mcap", joint_states())
    with pytest.raises(ValueError, match="JSON"):
        copy_with_verdicts(Recording(path), tmp_path / "b.mcap", [(0, {"gap_m": float("nan")})])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("time_ns", [-1, 2**63])
def test_a_time_that_no_message_can_have_is_refused(tmp_path, time_ns):
    path = write_all(tmp_path / "a.mcap", joint_states())
    with pytest.raises(
        RecordingError, match=r"b\.mcap: a message would get the time -?\d+\.\d+ s; message times"
    ):
        copy_with_verdicts(Recording(path), tmp_path / "b.mcap", [(time_ns, {})])
    assert list(tmp_path.iterdir()) == [path]


def test_a_stamp_that_joints_cannot_have_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"a joint sample would get the stamp 2147483648\.000000 s"):
        write_all(tmp_path / "a.mcap", joint_states(start_ns=2**31 * 10**9))
