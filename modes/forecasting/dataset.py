"""Recordings of people as windows of 3 s that were seen and the 1 s that followed, as networks see them.

Windows are the paper's: 30 frames in, 10 out, at 10 Hz. Each is looked at from its last frame: the root is at
the origin, and the person faces along x. The network sees directions of bones and the way of the root from
frame to frame. Of a recording that began less than 3 s before, the first frame stands for what was before.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.skeleton import BONES, JOINTS, ROOT, Joint, bones_of, joints_of_bones, joints_of_points
from modes.settings import require_count, require_number
from occupancy.body import MAX_POINTS, Point
from robots.errors import SetupError

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

RATE_HZ = 10.0
SEEN, AHEAD = 30, 10
"""Frames of a window that were seen, and that follow."""
FEATURES = 3 * len(BONES) + 3
WAY_UNIT_M = 0.1
"""Ways of the root between frames are fed to networks in this unit: 1 is 1 m/s."""
COPYLEFT = "GPL"
"""Recordings whose licence begins so are looked at, and never trained on."""

_LEFT_RIGHT = tuple(
    Joint[{"L": "R", "R": "L"}[each.name[0]] + each.name[1:]]
    if each.name[0] in "LR" and each.name != "L3"
    else each
    for each in Joint
)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Somebody's joints over time.

    Attributes
    ----------
    name, subject:
        Of the file, and of who is in it: the first two words of the name, as in ``cmu_02``.
    licence:
        What the file says of it.
    t:
        ``(frames,)`` [s].
    joints:
        ``(frames, 15, 3)`` [m]; NaN: not known.
    """

    name: str
    subject: str
    licence: str
    t: Array
    joints: Array

    @property
    def may_train(self) -> bool:
        """Whether its licence lets weights be trained on it that are given away under another one."""
        return not self.licence.startswith(COPYLEFT)


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """What was seen, and what followed.

    Attributes
    ----------
    history, future:
        ``(windows, 30, 15, 3)`` and ``(windows, 10, 15, 3)`` [m]; NaN: joints that a recording lacks.
    names:
        Of the recordings that they are from.
    """

    history: Array
    future: Array
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.history)

    @staticmethod
    def of(parts: Iterable[Windows]) -> Windows:
        """Return the windows of all parts, one after another."""
        each = list(parts)
        history = [part.history for part in each] or [np.empty((0, SEEN, JOINTS, 3))]
        future = [part.future for part in each] or [np.empty((0, AHEAD, JOINTS, 3))]
        names = tuple(name for part in each for name in part.names)
        return Windows(np.concatenate(history), np.concatenate(future), names)


def read_people(path: Path) -> Recording:
    """Return a recording of one person, NPZ with ``t`` [s], ``joints`` and ``xyz`` [m].

    Names of points that are not ours are passed over.

    Raises
    ------
    SetupError
        It is no such file, times do not increase, or it knows neither the trunk nor an arm.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            t, names, xyz = (np.asarray(file[key]) for key in ("t", "joints", "xyz"))
            licence = str(file["licence"]) if "licence" in file else ""
    except (OSError, KeyError, ValueError) as error:
        raise SetupError(f"{path.name}: no NPZ of people with t, joints and xyz: {error}") from error
    if xyz.shape != (len(t), len(names), 3) or t.ndim != 1 or len(t) < 2 or not (np.diff(t) > 0.0).all():
        raise SetupError(f"{path.name}: xyz of shape {xyz.shape} does not fit {len(t)} increasing times")
    points = np.full((len(t), MAX_POINTS, 3), np.nan)
    known = {point.name.lower(): point for point in Point}
    for k, name in enumerate(str(each) for each in names):
        if name in known:
            points[:, known[name]] = xyz[:, k]
    joints = joints_of_points(points)
    if not np.isfinite(joints[:, [ROOT, Joint.C7]]).all(axis=2).any():
        raise SetupError(f"{path.name}: pelvis, base of the neck and shoulders are needed for the trunk")
    subject = "_".join(path.stem.split("_")[:2])
    return Recording(path.stem, subject, licence, np.asarray(t, dtype=float), joints)


def resampled(t: Array, values: Array, at: Array) -> Array:
    """Return ``values (frames, …)`` at other instants ``at`` [s], straight between neighbours.

    NaN where a neighbour is NaN, and outside the recording.
    """
    after = np.clip(np.searchsorted(t, at, side="left"), 1, len(t) - 1)
    share = (at - t[after - 1]) / (t[after] - t[after - 1])
    share = np.where((share < -1e-9) | (share > 1.0 + 1e-9), np.nan, np.clip(share, 0.0, 1.0))
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    with np.errstate(invalid="ignore"):
        between = values[after - 1] * (1.0 - share) + values[after] * share
    at_one = np.where(share == 0.0, values[after - 1], np.where(share == 1.0, values[after], between))
    return np.asarray(at_one)


def windows_of(recording: Recording, every_s: float = 0.1, least_seen_s: float = 1.0) -> Windows:
    """Return windows that end every ``every_s`` [s], of which ``least_seen_s`` [s] at least were recorded.

    The first recorded frame is held before its time. Joints that a recording lacks stay NaN.
    """
    require_number("windows: every_s", every_s, 1e-3, 10.0)
    require_number("windows: least_seen_s", least_seen_s, 0.0, SEEN / RATE_HZ)
    step = 1.0 / RATE_HZ
    last = recording.t[-1] - AHEAD * step
    ends = np.arange(recording.t[0] + least_seen_s, last + 1e-9, every_s)
    if len(ends) == 0:
        return Windows.of([])
    before = ends[:, None] + step * np.arange(1 - SEEN, 1)
    after = ends[:, None] + step * np.arange(1, AHEAD + 1)
    before, after = np.maximum(before, recording.t[0]), np.minimum(after, recording.t[-1])
    history = resampled(recording.t, recording.joints, before.ravel()).reshape(-1, SEEN, JOINTS, 3)
    future = resampled(recording.t, recording.joints, after.ravel()).reshape(-1, AHEAD, JOINTS, 3)
    return Windows(history, future, (recording.name,) * len(ends))


def made_up(joints: Sequence[Array], rate_hz: float) -> list[Recording]:
    """Return made-up people ``(frames, 15, 3)`` [m] as recordings."""
    return [
        Recording(f"synthetic_{k}", "synthetic", "made up", np.arange(len(each)) / rate_hz, each)
        for k, each in enumerate(joints)
    ]


def mirrored(joints: Array) -> Array:
    """Return joints ``(..., 15, 3)`` as a mirror shows them: left is right."""
    return np.asarray(joints[..., list(_LEFT_RIGHT), :] * (1.0, -1.0, 1.0))


def faster(recording: Recording, factor: float) -> Recording:
    """Return the same motion at another speed."""
    require_number("faster: factor", factor, 0.1, 10.0)
    return Recording(
        recording.name, recording.subject, recording.licence, recording.t / factor, recording.joints
    )


def canonical(history: Array) -> tuple[Array, Array]:
    """Return where people are, ``(..., 3)`` [m], and how they are turned, ``(..., 3, 3)``, in the last frame.

    The columns of the rotation are ahead, left and up; ahead is level, across shoulders and hips. Somebody
    who lies on the side is taken to face along x.
    """
    last = history[..., -1, :, :]
    left = last[..., Joint.LSHO, :2] - last[..., Joint.RSHO, :2]
    left = left + last[..., Joint.LHIP, :2] - last[..., Joint.RHIP, :2]
    length = np.linalg.norm(left, axis=-1, keepdims=True)
    left = np.where(length > 1e-6, left / np.maximum(length, 1e-6), (0.0, 1.0))
    turn = np.zeros((*left.shape[:-1], 3, 3))
    turn[..., 0, 0], turn[..., 1, 0] = left[..., 1], -left[..., 0]
    turn[..., 0, 1], turn[..., 1, 1] = left[..., 0], left[..., 1]
    turn[..., 2, 2] = 1.0
    return last[..., ROOT, :], turn


def seen_from(joints: Array, origin: Array, turn: Array) -> Array:
    """Return joints ``(..., frames, 15, 3)`` as :func:`canonical` looks at them."""
    return np.asarray((joints - origin[..., None, None, :]) @ turn[..., None, :, :])


def back_in_world(joints: Array, origin: Array, turn: Array) -> Array:
    """Return joints ``(..., frames, 15, 3)`` in the world again: :func:`seen_from` undone."""
    return np.asarray(joints @ np.swapaxes(turn, -1, -2)[..., None, :, :] + origin[..., None, None, :])


def features(joints: Array) -> Array:
    """Return what networks see ``(..., frames, 45)`` of joints ``(..., frames, 15, 3)`` [m].

    Joints are looked at as :func:`canonical` does.

    Unit vectors of bones, and the way of the root from the frame before, in units of 0.1 m.
    """
    unit, _ = bones_of(joints)
    root = joints[..., ROOT, :]
    way = np.diff(root, axis=-2, prepend=root[..., :1, :]) / WAY_UNIT_M
    return np.concatenate((unit.reshape(*unit.shape[:-2], -1), way), axis=-1)


def joints_of_features(values: Array, root: Array, length: Array) -> Array:
    """Return joints ``(..., frames, 15, 3)`` [m] that follow a root ``(..., 3)`` [m], of what networks say.

    Lengths of bones ``(..., 14)`` [m] are kept; directions are made to have length 1.
    """
    unit = values[..., :-3].reshape(*values.shape[:-1], len(BONES), 3)
    roots = root[..., None, :] + WAY_UNIT_M * np.cumsum(values[..., -3:], axis=-2)
    return joints_of_bones(roots, unit, np.broadcast_to(length[..., None, :], unit.shape[:-1]))


def split_by_subject(
    recordings: Sequence[Recording], train: Sequence[str]
) -> tuple[list[Recording], list[Recording]]:
    """Return recordings of the subjects ``train``, and of all others.

    Raises
    ------
    SetupError
        There is none of such a subject, or its licence does not let it be trained on.
    """
    subjects = {each.subject for each in recordings}
    for subject in train:
        if subject not in subjects:
            raise SetupError(f"subject {subject!r} is not among {', '.join(sorted(subjects))}")
    chosen = [each for each in recordings if each.subject in train]
    for each in chosen:
        if not each.may_train:
            raise SetupError(f"{each.name}: weights are not trained on recordings under {each.licence}")
    return chosen, [each for each in recordings if each.subject not in train]


def read_folder(folder: Path, least: int = 1) -> list[Recording]:
    """Return all recordings of people in a folder and the folders in it, in the order of their names.

    NPZ files without ``joints`` and ``xyz``, or without a trunk, are passed over.

    Raises
    ------
    SetupError
        There are fewer than ``least``.
    """
    require_count("recordings: least", least, 0, 1_000_000)
    found = []
    for path in sorted(folder.rglob("*.npz"), key=lambda each: each.name):
        try:
            found.append(read_people(path))
        except SetupError:
            continue
    if len(found) < least:
        raise SetupError(f"{folder}: {len(found)} recordings of people, of which {least} are needed")
    return found
