"""Joints that a camera did not see for a while, filled in; what was filled in is said to be inferred.

The paper names autoencoders in its abstract only. Ways to fill in: carried along with what was seen, held in
place, straight between before and after (which needs what comes after: for comparison only), and a small
autoencoder that corrects the first (:class:`Autoencoder`, the extra ``forecast``). None of them measures: a
point that is filled in may be anywhere a body can be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import SEEN, back_in_world, canonical, seen_from
from modes.forecasting.skeleton import BONES, JOINTS, ROOT, Joint
from modes.forecasting.weights_file import Network, load_network
from robots.errors import SetupError

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

STANDING: Array = np.array([
    [0.06, 0.0, 1.48], [-0.06, 0.0, 1.48], [0.0, 0.2, 1.43], [0.0, -0.2, 1.43], [0.0, 0.22, 1.11],
    [0.0, -0.22, 1.11], [0.05, 0.23, 0.86], [0.05, -0.23, 0.86], [0.0, 0.0, 1.06], [0.0, 0.09, 0.93],
    [0.0, -0.09, 0.93], [0.0, 0.09, 0.5], [0.0, -0.09, 0.5], [0.0, 0.09, 0.07], [0.0, -0.09, 0.07],
])  # fmt: skip
"""Somebody 1.75 m tall who stands and faces along x: where joints are put that were never seen [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Filled:
    """Joints of somebody, and which of them nobody saw.

    Attributes
    ----------
    joints:
        ``(frames, 15, 3)`` [m]; NaN only where nothing at all was seen.
    inferred:
        ``(frames, 15)``: filled in.
    by:
        What filled them in: the filler's name, or another's where its answer was not finite.
    """

    joints: Array
    inferred: Bools
    by: str


class Filler(Protocol):
    """Fills in what was not seen."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    def fill(self, history: Array) -> Filled:
        """Fill joints ``(30, 15, 3)`` [m] at 10 Hz, newest last; NaN: not seen."""
        ...


@dataclass(frozen=True, slots=True)
class Carry:
    """What is not seen goes along with the joint before it; what never was is as when one stands."""

    name: str = "carry"

    def fill(self, history: Array) -> Filled:
        """Fill joints ``(frames, 15, 3)`` [m].

        Raises
        ------
        SetupError
            It is another skeleton.
        """
        seen = require_history(history)
        return Filled(carried_joints(history), ~seen, self.name)


@dataclass(frozen=True, slots=True)
class HoldPlace:
    """What is not seen stays where it was seen last; what never was stands below or beside the rest."""

    name: str = "hold"

    def fill(self, history: Array) -> Filled:
        """Fill joints ``(frames, 15, 3)`` [m]; raises as :class:`Carry` does."""
        seen = require_history(history)
        joints = _held(history, seen, np.zeros_like(history))
        return Filled(
            np.where(np.asarray(seen.any(axis=0))[:, None], joints, carried_joints(history)), ~seen, self.name
        )


@dataclass(frozen=True, slots=True)
class Straight:
    """Straight between before and after: it knows what comes after, and so is for comparison only."""

    name: str = "straight (knows what follows)"

    def fill(self, history: Array) -> Filled:
        """Fill joints ``(frames, 15, 3)`` [m]; raises as :class:`Carry` does."""
        seen = require_history(history)
        joints, frames = np.array(history, dtype=float), np.arange(len(history))
        for j in range(JOINTS):
            if seen[:, j].any():
                for axis in range(3):
                    joints[:, j, axis] = np.interp(frames, frames[seen[:, j]], history[seen[:, j], j, axis])
        return Filled(
            np.where(np.asarray(seen.any(axis=0))[:, None], joints, carried_joints(history)), ~seen, self.name
        )


class Autoencoder:
    """Corrects what was carried along by a network that was trained on bodies (extra ``forecast``).

    Parameters
    ----------
    network:
        From ``(n, 30, 60)``, joints as :func:`modes.forecasting.dataset.canonical` looks at them [m] and
        whether each was seen, to what is to be added ``(n, 30, 45)`` [m]; None: the shipped one.

    Raises
    ------
    SetupError
        onnxruntime is missing, or the weights are of another shape or skeleton.
    """

    name = "autoencoder"

    def __init__(self, network: Network | None = None) -> None:
        shapes = (SEEN, 4 * JOINTS), (SEEN, 3 * JOINTS)
        self._network = load_network("occlusion", *shapes) if network is None else network
        self._network.require_shapes(*shapes)

    def fill(self, history: Array) -> Filled:
        """Fill joints ``(30, 15, 3)`` [m]; raises as :class:`Carry` does.

        Without gaps nothing is corrected; where a correction is not finite, what was carried along is left,
        and ``by`` says so.
        """
        base = Carry().fill(history)
        if len(history) != SEEN:
            raise SetupError(f"autoencoder: {len(history)} frames should be {SEEN}")
        if not base.inferred.any() or not np.isfinite(base.joints).all():
            return replace(base, by=self.name)
        origin, turn = canonical(base.joints)
        looked = seen_from(base.joints, origin, turn)
        added = self._network.run(autoencoder_input(looked, ~base.inferred)[None])[0]
        if not np.isfinite(added).all():
            return base
        corrected = back_in_world(looked + added.reshape(looked.shape), origin, turn)
        return Filled(np.where(base.inferred[..., None], corrected, base.joints), base.inferred, self.name)


def autoencoder_input(looked: Array, seen: Bools) -> Array:
    """Return ``(..., 60)`` of joints ``(..., 15, 3)`` [m] looked at canonically, and which were seen."""
    flat = looked.reshape(*looked.shape[:-2], 3 * JOINTS)
    return np.concatenate((flat, seen.astype(float)), axis=-1)


def require_history(history: Array) -> Bools:
    """Return which joints were seen ``(frames, 15)``.

    Raises
    ------
    SetupError
        It is another skeleton.
    """
    if history.ndim != 3 or history.shape[1:] != (JOINTS, 3):
        raise SetupError(
            f"history: joints of shape {history.shape} should be (frames, 15, 3): "
            f"{', '.join(each.name for each in Joint)}"
        )
    return np.asarray(np.isfinite(history).all(axis=2))


def carried(history: Array) -> Array:
    """Return points ``(..., frames, points, 3)`` [m], those not seen carried along with those that are.

    They go on by the mean of the steps that others make.

    Before a point is seen for the first time it goes along, too. NaN: never seen.
    """
    seen = np.asarray(np.isfinite(history).all(axis=-1))
    both = (seen[..., 1:, :] & seen[..., :-1, :])[..., None]
    step = np.where(both, np.diff(history, axis=-3), 0.0).sum(axis=-2) / np.maximum(both.sum(axis=-2), 1)
    along = np.concatenate((np.zeros_like(step[..., :1, :]), np.cumsum(step, axis=-2)), axis=-2)
    return _held(history, seen, np.broadcast_to(along[..., None, :], history.shape))


def carried_joints(history: Array) -> Array:
    """Return joints ``(..., frames, 15, 3)`` [m]; those not seen keep the directions of their bones.

    The root goes along with the mean of what is seen. NaN only where nothing was seen.
    """
    seen = np.asarray(np.isfinite(history).all(axis=-1))
    ever = np.asarray(seen.any(axis=-2))
    out = carried(history)
    shoulders = ever[..., Joint.LSHO] & ever[..., Joint.RSHO]
    turn = np.where(shoulders[..., None, None, None], _turn_of_shoulders(out), np.eye(3))
    standing = STANDING @ np.swapaxes(turn, -1, -2)
    root = _root_when_standing(out, standing, ever)
    out[..., ROOT, :] = np.where(ever[..., None, ROOT, None], out[..., ROOT, :], root)
    for begin, end in BONES:
        held = _held(history[..., [end], :], seen[..., [end]], out[..., [begin], :])[..., 0, :]
        stood = out[..., begin, :] + standing[..., end, :] - standing[..., begin, :]
        out[..., end, :] = np.where(ever[..., None, end, None], held, stood)
    return out


def _held(history: Array, seen: Bools, along: Array) -> Array:
    """Return points where they were seen last, or first, and on as ``along (..., frames, points, 3)`` has."""
    frames = np.arange(history.shape[-3])[:, None]
    last = np.maximum.accumulate(np.where(seen, frames, -1), axis=-2)
    source = np.where(last >= 0, last, np.argmax(seen, axis=-2)[..., None, :])[..., None]
    out = np.take_along_axis(history, source, axis=-3) + along - np.take_along_axis(along, source, axis=-3)
    return np.asarray(np.where(seen[..., None], history, out))


def _root_when_standing(joints: Array, standing: Array, ever: Bools) -> Array:
    """Return where the root ``(..., frames, 3)`` is if what was seen stands; NaN: nothing was."""
    weight = ever[..., None, :, None].astype(float)
    offset = np.where(weight > 0.0, joints - (standing - standing[..., [ROOT], :]), 0.0).sum(axis=-2)
    with np.errstate(invalid="ignore"):
        return np.asarray(offset / weight.sum(axis=-2))


def _turn_of_shoulders(joints: Array) -> Array:
    """Return how people are turned by their shoulders alone, ``(..., frames, 3, 3)``."""
    level = np.zeros_like(joints)
    level[..., [Joint.LSHO, Joint.RSHO], :] = joints[..., [Joint.LSHO, Joint.RSHO], :]
    return canonical(level[..., None, :, :])[1]
