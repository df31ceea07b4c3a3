"""Motion capture as BVH (``.bvh``, ``.bvh.gz``), parsed by the library pymotion (extra ``bvh``).

The library gives names, parents, offsets and channels; the forward kinematics stand here, because its own
take the offsets of joints that have position channels. A BVH names neither its unit nor its axes: both follow
from the size and posture of the skeleton, and are shown as assumptions.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NoReturn, TextIO

import numpy as np
from scipy.spatial.transform import Rotation

from occupancy.body import POINT_NAMES
from robots.assumption import Assumption, Certainty
from verifier.recordings.errors import RecordingError
from verifier.recordings.table import FloatArray, PeopleTable, Track, nanoseconds

MAX_TEXT = 512 * 1024 * 1024
"""Longest text that is read [characters]."""
UNITS_M: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "CMU: inch / 0.45": 0.0254 / 0.45}
STATURE_M: Final = (1.2, 2.3)
"""A unit that makes the skeleton's limbs those of a person of this stature is taken. Units are further apart
than these, so that at most one is."""
_LIMBS: Final = (
    (0.491, (("hip", "knee"), ("knee", "ankle"))),
    (0.332, (("shoulder", "elbow"), ("elbow", "wrist"))),
)
"""Length of leg and arm as shares of stature (Drillis and Contini 1966)."""

_POSITIONS = {"Xposition", "Yposition", "Zposition"}
_ROTATIONS = {"Xrotation", "Yrotation", "Zrotation"}
_SIDES: Final = (("left", "l_"), ("right", "r_"))
_TRUNK: Final = {"hips": "pelvis", "pelvis": "pelvis", "head": "head"}
_BY_BONE: Final = {
    **_TRUNK,
    "neck": "neck_base",
    "spine1": "thorax",
    "{}arm": "{}shoulder",
    "{}forearm": "{}elbow",
    "{}hand": "{}wrist",
    "{}fingerbase": "{}hand",
    "{}upleg": "{}hip",
    "{}leg": "{}knee",
    "{}foot": "{}ankle",
}
"""Joints that have the name of the bone that begins there (MotionBuilder, Mixamo, CMU by Hahne)."""
_BY_JOINT: Final = {
    **_TRUNK,
    "lowerneck": "neck_base",
    "chest2": "thorax",
    "{}shoulder": "{}shoulder",
    "{}elbow": "{}elbow",
    "{}wrist": "{}wrist",
    "{0[0]}hand": "{}hand",
    "{}hip": "{}hip",
    "{}knee": "{}knee",
    "{}ankle": "{}ankle",
}
"""Joints that have the name of the joint (Poser, Daz)."""


_WORDS = ("HIERARCHY", "ROOT", "JOINT", "OFFSET", "CHANNELS", "MOTION", "Frames")
_FIRST_WORDS = {*_WORDS[:5], "End", "{", "}", ""}


def read_people(path: str | Path) -> PeopleTable:
    """Read the joints of one skeleton, z up, in metres; those that are not ours keep their names.

    Raises
    ------
    RecordingError
        pymotion is not installed; the file is not readable, has not one skeleton, other channels than three
        rotations or three positions and three rotations for each joint, numbers that are missing or not
        finite, or limbs that are those of a person in no known unit.
    """
    path = Path(path)
    hierarchy, motion, step = _checked(path, _text(path))
    data = _parsed(path, hierarchy, motion, step)
    names = _names([str(name) for name in data["names"]])
    xyz = _positions(data)
    unit, said = _unit(path, names, xyz)
    upright, axes = _z_up(names, xyz)
    t_ns = nanoseconds(path, "Frame Time", step * np.arange(len(xyz), dtype=np.float64), 0.0)
    assumptions = (
        Assumption(f"recording.unit.{path.name}", unit, "m", said, Certainty.ASSUMED),
        Assumption(f"recording.axes.{path.name}", axes, "", "by the skeleton's posture", Certainty.ASSUMED),
    )
    return PeopleTable(path, (Track(None, t_ns, names, unit * upright),), None, assumptions)


def _text(path: Path) -> str:
    if path.is_dir():
        _refuse(path, "", "is a folder", "name a BVH file")
    try:
        with _opened(path) as stream:
            text = stream.read(MAX_TEXT + 1)
    except FileNotFoundError as error:
        raise RecordingError(path, "", "does not exist", "name a BVH file") from error
    except UnicodeDecodeError as error:
        raise RecordingError(path, "", "is not a text file in UTF-8", "name a BVH file") from error
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(path, "", f"cannot be read ({error})", "name a BVH file") from error
    if len(text) > MAX_TEXT:
        _refuse(path, "", f"is longer than {MAX_TEXT} characters", "cut it into pieces")
    return text


def _opened(path: Path) -> TextIO:
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig")
    return path.open(encoding="utf-8-sig")


def _checked(path: Path, text: str) -> tuple[str, list[str], float]:
    """Return the hierarchy, the lines of numbers and the time between frames [s] of a file that is whole."""
    found = re.fullmatch(
        r"\s*(HIERARCHY\s.*?)\n\s*MOTION\s*\n\s*Frames:\s*(\d+)\s*\n\s*Frame Time:\s*(\S+)[ \t]*\n(.*)",
        text,
        re.DOTALL,
    )
    if found is None:
        _refuse(path, "", "is no BVH file", "needed: HIERARCHY, MOTION, Frames:, Frame Time:")
    hierarchy, count, step, numbers = found.groups()
    if len(re.findall(r"^\s*ROOT\s", hierarchy, re.MULTILINE)) != 1:
        _refuse(path, "HIERARCHY", "has not one ROOT", "one file for each skeleton")
    _check_lines(path, hierarchy)
    channels = 0
    for line in re.findall(r"^\s*CHANNELS\s+(.*)$", hierarchy, re.MULTILINE):
        number, *kinds = line.split()
        positions, rotations = set(kinds[:-3]), set(kinds[-3:])
        if (
            number != str(len(kinds))
            or positions not in (set(), _POSITIONS)
            or rotations != _ROTATIONS
            or len(kinds) not in (3, 6)
        ):
            _refuse(
                path, "HIERARCHY", f"has CHANNELS {line.strip()}", "three positions, then three rotations"
            )
        channels += len(kinds)
    lines = [line for line in numbers.splitlines() if line.strip()]
    if len(lines) != int(count) or not lines:
        _refuse(path, "MOTION", f"has {len(lines)} frames", f"Frames: says {count}, and there must be some")
    for row, line in enumerate(lines):
        if len(line.split()) != channels:
            _refuse(
                path, f"frame {row}", f"has {len(line.split())} numbers", f"{channels} channels need one each"
            )
    try:
        seconds = float(step)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        _refuse(path, "Frame Time", f"is {step}", "it must be a positive number of seconds")
    return hierarchy, lines, seconds


def _check_lines(path: Path, hierarchy: str) -> None:
    """Refuse what the library would take for something else: it looks for its words anywhere in a line."""
    for line in hierarchy.splitlines():
        first, *rest = line.split() or [""]
        if first not in _FIRST_WORDS or any(word in each for each in rest for word in _WORDS):
            right = f"each line must begin with one of {', '.join(sorted(_FIRST_WORDS - {''}))}"
            _refuse(path, "HIERARCHY", f"has a line {line.strip()[:40]!r}", right)


def _parsed(path: Path, hierarchy: str, motion: list[str], step: float) -> dict[str, Any]:
    """Let the library read what was checked."""
    try:
        from pymotion.io.bvh import BVH
    except ImportError as error:
        raise RecordingError(
            path, "", "needs upc-pymotion, which is not installed", "pip install 'stopproof[bvh]'"
        ) from error
    reader = BVH()
    with TemporaryDirectory() as folder:
        file = Path(folder) / "checked.bvh"
        head = f"{hierarchy}\nMOTION\nFrames: {len(motion)}\nFrame Time: {step!r}\n"
        file.write_text(head + "\n".join(motion) + "\n", encoding="utf-8")
        try:
            reader.load(str(file))
        except (ValueError, LookupError, TypeError, NameError) as error:
            raise RecordingError(path, "", f"is not read ({error})", "write it anew") from error
    data: dict[str, Any] = reader.data
    numbers = (data["offsets"], data["positions"], data["rotations"])
    if not all(np.issubdtype(each.dtype, np.floating) and np.isfinite(each).all() for each in numbers):
        _refuse(path, "", "has joints without OFFSET, or numbers that are not finite", "write it anew")
    if any(parent is None for parent in data["parents"][1:]):
        _refuse(path, "", "has a joint that hangs on none, beside the root", "write it anew")
    return data


def _positions(data: dict[str, Any]) -> FloatArray:
    """Joints (T, J, 3) in the file's frame and unit: x_j = x_parent + R_parent local_j."""
    local = np.asarray(data["positions"], dtype=np.float64)
    xyz = np.empty_like(local)
    turned: list[Rotation] = []
    for joint, parent in enumerate(data["parents"]):
        order = "".join(data["rot_order"][joint]).upper()
        own = Rotation.from_euler(order, data["rotations"][:, joint], degrees=True)
        if joint == 0:
            xyz[:, 0] = local[:, 0]
            turned.append(own)
        else:
            xyz[:, joint] = xyz[:, parent] + turned[parent].apply(local[:, joint])
            turned.append(turned[parent] * own)
    return xyz


def _names(joints: list[str]) -> tuple[str, ...]:
    """Return our names where a convention has them; a second joint of one name keeps its own."""
    plain = [re.sub(r"[^a-z0-9]", "", joint.rsplit(":", 1)[-1].lower()) for joint in joints]
    convention = _BY_BONE if "leftarm" in plain else _BY_JOINT
    ours = {
        theirs.format(side): our.format(short) for side, short in _SIDES for theirs, our in convention.items()
    }
    names: list[str] = []
    for joint, known in zip(joints, plain, strict=True):
        name = ours.get(known, joint)
        names.append(joint if name in names else name)
    return tuple(names)


def _unit(path: Path, names: tuple[str, ...], xyz: FloatArray) -> tuple[float, str]:
    """Return the unit [m] in which legs or arms are those of a person."""
    for share, limbs in _LIMBS:
        for side in ("l_", "r_"):
            ends = [(side + a, side + b) for a, b in limbs]
            if not all(a in names and b in names for a, b in ends):
                continue
            gaps = [xyz[:, names.index(a)] - xyz[:, names.index(b)] for a, b in ends]
            stature = float(sum(np.median(np.linalg.norm(gap, axis=1)) for gap in gaps)) / share
            for name, unit in UNITS_M.items():
                if STATURE_M[0] <= stature * unit <= STATURE_M[1]:
                    return unit, f"{name}: by its limbs the person is {stature * unit:.2f} m tall"
            _refuse(path, "HIERARCHY", f"by its limbs the person is {stature:.4g} units tall", _known_units())
    _refuse(
        path,
        "HIERARCHY",
        f"has no leg or arm that is known (it has {', '.join(names)})",
        f"known are {', '.join(POINT_NAMES)} and the names of Mixamo, MotionBuilder and Poser",
    )


def _known_units() -> str:
    return f"known units are {', '.join(UNITS_M)}: scale the file"


def _z_up(names: tuple[str, ...], xyz: FloatArray) -> tuple[FloatArray, str]:
    """Return points with z up: turned by 90° about x, unless the trunk stands along z already."""
    low, high = (
        next((names.index(n) for n in of if n in names), None) for of in (("pelvis",), ("head", "neck_base"))
    )
    if low is not None and high is not None:
        extent = np.median(np.abs(xyz[:, high] - xyz[:, low]), axis=0)
        if extent[2] > extent[1]:
            return xyz, "z up in the file"
    return np.stack([xyz[..., 0], -xyz[..., 2], xyz[..., 1]], axis=-1), "y up in the file"


def _refuse(path: Path, place: str, wrong: str, right: str) -> NoReturn:
    raise RecordingError(path, place, wrong, right)
