"""Which arm a recording is of: a name of the catalogue, or name and content of a URDF."""

from __future__ import annotations

import hashlib
import re

_OF_URDF = re.compile(r"urdf:.*:([0-9a-f]{12})", re.DOTALL)


def urdf_identity(name: str, content: bytes) -> str:
    """Return what a recording of the arm of a URDF states, ``urdf:<name>:<hash>``; no arm is called so."""
    return f"urdf:{name}:{urdf_hash(content)}"


def urdf_hash(content: bytes) -> str:
    """Return the first 12 hexadecimal digits of the SHA-256 of a URDF file."""
    return hashlib.sha256(content).hexdigest()[:12]


def stated_hash(identity: str | None) -> str | None:
    """Return the hash of the URDF that a recording states, None where it states none."""
    found = _OF_URDF.fullmatch(identity or "")
    return found.group(1) if found else None
