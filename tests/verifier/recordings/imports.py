"""Files to import, and what becomes of them."""

import json

import numpy as np

from tests.verifier.recordings.samples import NANO
from verifier.recordings import (
    ImportSettings,
    Recording,
    import_recording,
    new_recording,
)
from verifier.recordings.joint_state import JointState
from verifier.recordings.mcap_file import Channel, Message
from verifier.recordings.reading import Reading

ROBOT = ("j1", "j2")
SETTINGS = ImportSettings("arm", ROBOT)


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


def written(path, states, stamps=None):
    """Write messages in the order given, the message time of each its stamp or that of ``stamps``."""
    with new_recording(path) as writer:
        for number, state in enumerate(states):
            stamp = state.stamp_ns if stamps is None else stamps[number]
            writer.joints(JointState(stamp, state.names, state.position))
    return path


def raw_people(path, *texts):
    """Reports as text, one each 20 ms."""
    channel = Channel(id=0, topic="/people", message_encoding="json", metadata={}, schema_id=0)
    with new_recording(path) as writer:
        for n, text in enumerate(texts):
            writer.copy(Message(channel, n * NANO // 50, n * NANO // 50, 0, text.encode()), None)
    return path


def report_text(n, *people):
    return json.dumps({"stamp": n / 50, "frame": "world", "people": people})
