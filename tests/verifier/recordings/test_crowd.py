"""People of one file of an import: somebody must be seen, and who is cut away is named."""

import math

import numpy as np
import pytest

from tests.verifier.recordings.imports import SETTINGS, imported, raw_people, report_text
from verifier.recordings import (
    PeopleFile,
    RecordingError,
    import_recording,
)


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0])
def test_people_of_whom_nothing_can_be_read_are_refused(tmp_path, joints, people, value):
    t = np.arange(101) / 50
    xyz = np.full((101, 2, 3), value)
    blind = tmp_path / "blind.npz"
    np.savez(blind, t=t, joints=np.array(["head", "nose"]), xyz=xyz)
    text = r"blind\.npz: shows nobody in the 2 s that all files cover: no point of any person could be read"
    for sources in ([blind], [people, blind]):
        with pytest.raises(RecordingError, match=text):
            import_recording(tmp_path / "out.mcap", joints, [PeopleFile(path) for path in sources], SETTINGS)
        assert not (tmp_path / "out.mcap").exists()
    xyz[:, 1] = 1.0  # a point, but not of a known name
    np.savez(blind, t=t, joints=np.array(["head", "nose"]), xyz=xyz)
    with pytest.raises(RecordingError, match=text):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(blind)], SETTINGS)


def test_people_who_are_readable_only_outside_of_the_stretch_are_refused(tmp_path, joints):
    t = np.arange(151) / 50
    xyz = np.where(t[:, None, None] > 2.0, 1.0, np.full((151, 1, 3), math.nan))
    np.savez(tmp_path / "p.npz", t=t, joints=np.array(["head"]), xyz=xyz)
    with pytest.raises(RecordingError, match="shows nobody in the 2 s that all files cover"):
        import_recording(tmp_path / "out.mcap", joints, [PeopleFile(tmp_path / "p.npz")], SETTINGS)


def test_one_readable_point_is_enough_and_everybody_stays(tmp_path, joints):
    t = np.arange(101) / 50
    xyz = np.full((101, 1, 3), math.nan)
    xyz[70] = 1.0
    np.savez(tmp_path / "p.npz", t=t, joints=np.array(["head"]), xyz=xyz)
    summary, _, window = imported(tmp_path, joints, [PeopleFile(tmp_path / "p.npz")])
    assert summary.reports == 101
    assert all([person.id for person in report.people] == ["p1"] for report in window.people)


def test_reports_of_nobody_are_imported(tmp_path, joints):
    source = raw_people(tmp_path / "people.mcap", *(report_text(n) for n in range(101)))
    summary, _, window = imported(tmp_path, joints, [PeopleFile(source)])
    assert summary.people == () and len(window.people) == 101
