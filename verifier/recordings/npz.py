"""NumPy archives: joints ``t, q, dq?, tau?, joints?, run?``; people ``t, joints, xyz, position_error_m?``."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verifier.recordings.errors import RecordingError
from verifier.recordings.table import (
    MAX_JOINT_STEP_S,
    MAX_PEOPLE_STEP_S,
    MAX_TABLE_BYTES,
    FloatArray,
    JointTable,
    PeopleTable,
    Track,
    check_joints,
    check_unit,
    nanoseconds,
)

DAMAGE = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    RuntimeError,
    MemoryError,
    OverflowError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
"""What numpy and zipfile raise on damaged files."""
NO_HEADER = (SyntaxError, TypeError, tokenize.TokenError)
"""What numpy raises besides on a header that is no Python literal, and mended as one of Python 2 is none."""

KEYS_OF_JOINTS = ("t", "q", "dq", "tau", "joints", "run")
KEYS_OF_PEOPLE = ("t", "joints", "xyz", "position_error_m")
KEYS = tuple(dict.fromkeys(KEYS_OF_JOINTS + KEYS_OF_PEOPLE))
MAX_POSITION_ERROR_M = 1e3
LARGEST_RUN = 2.0**53
JOINT_KEYS = "t (T), q (T, J) in rad or m, and, if known, joints (J) names, dq and tau (T, J)"
PEOPLE_KEYS = "t (T), joints (P) names and xyz (T, P, 3) in m"


class _Archive:
    """The wanted arrays of a file, each checked as it is taken; pickled objects are never loaded."""

    def __init__(self, path: Path, wanted: tuple[str, ...]) -> None:
        self.path = path
        if not path.exists():
            raise RecordingError(path, "", "does not exist", "name an NPZ file")
        if path.is_dir():
            raise RecordingError(path, "", "is a folder", "name an NPZ file")
        self._arrays: dict[str, NDArray[np.generic]] = {}
        self.keys: tuple[str, ...] = ()
        try:
            if not zipfile.is_zipfile(path):
                raise zipfile.BadZipFile("it is no archive")
            with np.load(path, allow_pickle=False) as arrays:
                self.keys = tuple(arrays.files)
                self._check_size(arrays.zip, wanted)
                self._arrays = {key: arrays[key] for key in wanted if key in self.keys}
        except RecordingError:
            raise
        except NO_HEADER as error:
            wrong = "is no readable NPZ file (an array has a header that numpy does not write)"
            raise RecordingError(path, "", wrong, "write it with numpy.savez") from error
        except DAMAGE as error:
            if "allow_pickle" in str(error):
                wrong = "holds pickled Python objects, which are not loaded"
                right = "store numbers and text only; names as numpy.array([...], dtype=str)"
            else:
                wrong, right = f"is no readable NPZ file ({error})", "write it with numpy.savez"
            raise RecordingError(path, "", wrong, right) from error
        for key, array in self._arrays.items():
            if not isinstance(array, np.ndarray):  # what does not begin as an array does comes as bytes
                raise RecordingError(path, key, "is no array", "write it with numpy.savez")

    def _check_size(self, archive: zipfile.ZipFile, wanted: tuple[str, ...]) -> None:
        """Before anything is unpacked: never more is than the archive states."""
        names = {f"{key}.npy" for key in wanted}
        size = sum(entry.file_size for entry in archive.infolist() if entry.filename in names)
        self._refuse_above_limit(size, ", ".join(key for key in wanted if key in self.keys))

    def _refuse_above_limit(self, size: int, place: str) -> None:
        if size > MAX_TABLE_BYTES:
            wrong = f"unpacks to {size / 2**20:.0f} MiB, more than {MAX_TABLE_BYTES / 2**20:.0f} MiB"
            raise RecordingError(self.path, place, wrong, "split the file")

    def has(self, key: str) -> bool:
        return key in self._arrays

    def require(self, keys: tuple[str, ...], right: str) -> None:
        missing = [key for key in keys if not self.has(key)]
        if missing:
            wrong = f"lacks {', '.join(missing)} (it has {', '.join(self.keys)})"
            raise RecordingError(self.path, "", wrong, f"needed: {right}")

    def numbers(self, key: str, shape: tuple[int | None, ...], *, flags: bool = False) -> FloatArray:
        """Array ``key`` as float64; ``None`` in ``shape``: any length; ``flags``: truth values as well."""
        array = self._arrays[key]
        if array.dtype.kind not in ("fiub" if flags else "fiu"):
            raise RecordingError(self.path, key, f"holds {array.dtype}", "it must hold numbers")
        fits = array.ndim == len(shape) and all(
            want is None or want == have for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits:
            want = ", ".join("any" if size is None else str(size) for size in shape)
            raise RecordingError(self.path, key, f"has shape {array.shape}", f"it must be ({want})")
        self._refuse_above_limit(8 * array.size, key)
        return array.astype(np.float64)

    def names(self, key: str, length: int) -> tuple[str, ...]:
        array = self._arrays[key]
        if array.dtype.kind != "U" or array.shape != (length,):
            wrong = f"holds {array.dtype} in shape {array.shape}"
            raise RecordingError(self.path, key, wrong, f"it must be {length} names as text")
        return tuple(str(name) for name in array)


def read_joints(path: str | Path, run: int | None = None) -> JointTable:
    """Read joint motion; ``run`` chooses among the runs of a file that numbers them.

    Raises
    ------
    RecordingError
        The file is not readable, lacks an array, has wrong shapes, NaN or infinite values, or times that do
        not increase; a run is needed and not given, or given and not there.
    """
    archive = _Archive(Path(path), KEYS_OF_JOINTS)
    archive.require(("t", "q"), JOINT_KEYS)
    t = archive.numbers("t", (None,))
    q = archive.numbers("q", (len(t), None))
    if not q.size:
        raise RecordingError(archive.path, "", "is empty", "it must hold samples")
    rows = _rows_of_run(archive, len(t), run)
    names = archive.names("joints", q.shape[1]) if archive.has("joints") else None
    check_joints(archive.path, "q", names, t[rows], q[rows])
    dq, tau = (archive.numbers(key, q.shape)[rows] if archive.has(key) else None for key in ("dq", "tau"))
    t_ns = nanoseconds(archive.path, "t", t[rows], float(t[rows][0]))
    check_unit(archive.path, "t", t[rows], MAX_JOINT_STEP_S, whole=True)
    return JointTable(archive.path, t_ns, names, q[rows], dq, tau, begins_s=float(t[rows][0]))


def read_beside(path: str | Path, keys: Sequence[str], run: int | None = None) -> dict[str, FloatArray]:
    """Read those of ``keys`` that an archive of joints has, row by row as the joints; raises as
    :func:`read_joints` does. Numbers, true and false alike; ``(T,)``, or ``(T, J)`` as ``q``."""
    archive = _Archive(Path(path), ("t", "q", "run", *keys))
    archive.require(("t", "q"), JOINT_KEYS)
    samples, joints = archive.numbers("q", (None, None)).shape
    rows = _rows_of_run(archive, samples, run)
    shape = {"q_command": (samples, joints)}
    found = {
        key: archive.numbers(key, shape.get(key, (samples,)), flags=True)[rows]
        for key in keys
        if archive.has(key)
    }
    for key, values in found.items():
        if not np.isfinite(values).all():
            raise RecordingError(archive.path, key, "has a value that is NaN or infinite", "fill it in")
    return found


def _rows_of_run(archive: _Archive, samples: int, run: int | None) -> NDArray[np.bool_]:
    if not archive.has("run"):
        if run is not None:
            raise RecordingError(archive.path, "", f"has no runs, so no run {run}", "leave --run away")
        return np.ones(samples, np.bool_)
    runs = archive.numbers("run", (samples,))
    bad = np.flatnonzero(~(np.abs(runs) < LARGEST_RUN) | (runs != np.rint(runs)))
    if len(bad):
        row = int(bad[0])
        raise RecordingError(
            archive.path, f"run, sample {row}", f"is {runs[row]}", "runs must be numbered by whole numbers"
        )
    known = sorted({int(number) for number in runs})
    shown = f"{known[0]} … {known[-1]}" if known == list(range(known[0], known[-1] + 1)) else str(known)
    if run is None:
        if len(known) == 1:
            return np.ones(samples, np.bool_)
        raise RecordingError(
            archive.path, "run", f"has {len(known)} runs ({shown})", "choose one with --run N"
        )
    if run not in known:
        raise RecordingError(archive.path, "run", f"has no run {run}", f"its runs are {shown}")
    return np.equal(runs, run)


def read_people(path: str | Path) -> PeopleTable:
    """Read the points of one person.

    Raises
    ------
    RecordingError
        The file is not readable, lacks an array, has wrong shapes, a point twice, or times that do not
        increase.
    """
    archive = _Archive(Path(path), KEYS_OF_PEOPLE)
    archive.require(("t", "joints", "xyz"), PEOPLE_KEYS)
    t = archive.numbers("t", (None,))
    xyz = archive.numbers("xyz", (len(t), None, 3))
    names = archive.names("joints", xyz.shape[1])
    if not len(t):
        raise RecordingError(archive.path, "", "is empty", "it must hold samples")
    for name in names:
        if names.count(name) > 1:
            raise RecordingError(
                archive.path, "joints", f"point {name} stands there twice", "each point once"
            )
    error = float(archive.numbers("position_error_m", ())) if archive.has("position_error_m") else None
    if error is not None and not 0.0 <= error <= MAX_POSITION_ERROR_M:
        right = f"it must be at least 0 m and at most {MAX_POSITION_ERROR_M:g} m"
        raise RecordingError(archive.path, "position_error_m", f"is {error}", right)
    t_ns = nanoseconds(archive.path, "t", t, float(t[0]))
    check_unit(archive.path, "t", t, MAX_PEOPLE_STEP_S)
    return PeopleTable(archive.path, (Track(None, t_ns, names, xyz),), error, begins_s=float(t[0]))
