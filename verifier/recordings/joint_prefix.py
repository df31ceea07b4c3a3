"""Prefixes of joint names: what a driver puts before them so that several arms fit into one system."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from verifier.recordings.joint_state import JointState


def prefixes(names: Iterable[str], arm: Iterable[str]) -> tuple[str, ...]:
    """Return every text that, put before each joint of ``arm``, gives names that are all there.

    ``("",)`` where the joints are there as the model names them, whatever else is.
    """
    there, joints = dict.fromkeys(names), tuple(arm)
    if not joints or set(joints) <= there.keys():
        return ("",)
    starts = [name.removesuffix(joints[0]) for name in there if name.endswith(joints[0])]
    return tuple(start for start in starts if start and all(start + joint in there for joint in joints))


def without_prefix(state: JointState, prefix: str) -> JointState:
    """Take a prefix off the names that have it; others stay as they are."""
    return replace(state, names=tuple(name.removeprefix(prefix) for name in state.names))
