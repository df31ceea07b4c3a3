"""NPZ and CSV tables: what they hold, and what they are refused for."""

import gzip
import math
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from verifier.recordings import RecordingError
from verifier.recordings.csv_table import read_joints as csv_joints
from verifier.recordings.csv_table import read_people as csv_people
from verifier.recordings.npz import read_joints as npz_joints
from verifier.recordings.npz import read_people as npz_people

T = np.arange(5) / 100.0
Q = np.arange(10.0).reshape(5, 2)
XYZ = np.arange(30.0).reshape(5, 2, 3)
finite = st.floats(-1e6, 1e6)


def refusal(read, path, *arguments):
    with pytest.raises(RecordingError) as caught:
        read(path, *arguments)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def npz(path, **arrays):
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def csv(path, text):
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text, encoding="utf-8")
    return path


# What they hold.


@settings(max_examples=50, derandomize=True, deadline=None)
@given(
    q=hnp.arrays(np.float64, st.tuples(st.integers(1, 8), st.integers(1, 4)), elements=finite),
    steps=st.lists(st.integers(1, 10**9), min_size=8, max_size=8),
)
def test_joints_come_out_as_they_went_in(tmp_path_factory, q, steps):
    folder = tmp_path_factory.mktemp("tables")
    t_ns = np.cumsum(steps)[: len(q)]
    t = t_ns / 1e9
    names = [f"j{n}" for n in range(q.shape[1])]
    rows = [",".join(["t", *names])]
    rows += [",".join(map(repr, [float(time), *map(float, row)])) for time, row in zip(t, q, strict=True)]
    for table in (
        npz_joints(npz(folder / "a.npz", t=t, q=q, joints=np.array(names))),
        csv_joints(csv(folder / "a.csv", "\n".join(rows))),
        csv_joints(csv(folder / "a.csv.gz", "\n".join(rows).replace(",", ";") + "\n")),
        csv_joints(csv(folder / "b.csv", "\ufeff" + "\r\n".join(rows).replace(",", " "))),
    ):
        assert table.names == tuple(names)
        np.testing.assert_array_equal(table.q, q)
        np.testing.assert_array_equal(table.t_ns, t_ns - t_ns[0])


def test_npz_of_float32_without_names_with_rates(tmp_path):
    tau = Q + 20.0
    tau[-1] = math.nan
    table = npz_joints(npz(tmp_path / "a.npz", t=T, q=Q.astype(np.float32), dq=Q + 10.0, tau=tau))
    assert table.names is None
    assert table.q.dtype == np.float64
    np.testing.assert_array_equal(table.q, Q)
    np.testing.assert_array_equal(table.dq, Q + 10.0)
    np.testing.assert_array_equal(table.tau, tau)


def test_runs_are_chosen_and_start_at_zero(tmp_path):
    run = np.array([1, 1, 2, 2, 2])
    t = np.array([0.0, 0.1, 5.0, 5.1, 5.2])
    path = npz(tmp_path / "a.npz", t=t, q=Q, run=run)
    table = npz_joints(path, 2)
    np.testing.assert_array_equal(table.t_ns, [0, 100_000_000, 200_000_000])
    np.testing.assert_array_equal(table.q, Q[2:])
    assert refusal(npz_joints, path) == "run: has 2 runs (1 … 2); choose one with --run N"
    assert refusal(npz_joints, path, 3) == "run: has no run 3; its runs are 1 … 2"
    assert "has no runs, so no run 1" in refusal(npz_joints, npz(tmp_path / "b.npz", t=T, q=Q), 1)


def test_people_of_npz(tmp_path):
    names = np.array(["head", "abdomen"])
    table = npz_people(npz(tmp_path / "a.npz", t=T, joints=names, xyz=XYZ, position_error_m=0.03))
    (track,) = table.tracks
    assert (track.person, track.names, table.position_error_m) == (None, ("head", "abdomen"), 0.03)
    np.testing.assert_array_equal(track.xyz, XYZ)


def test_people_of_csv(tmp_path):
    text = """t,person,head_x,head_y,head_z,r_wrist_x,r_wrist_y,r_wrist_z
    1.0,anna,1,2,3,4,5,6
    1.0,ben,7,8,9,,,
    1.1,anna,1,2,3,nan,5,6

    1.3,ben,7,8,9,1,1,1
    """
    table = csv_people(csv(tmp_path / "a.csv", text))
    anna, ben = table.tracks
    assert (anna.person, ben.person) == ("anna", "ben")
    np.testing.assert_array_equal(anna.t_ns, [0, 100_000_000])
    np.testing.assert_array_equal(ben.t_ns, [0, 300_000_000])
    np.testing.assert_array_equal(anna.xyz[0], [[1, 2, 3], [4, 5, 6]])
    assert np.isnan(ben.xyz[0, 1]).all()
    assert np.isnan(anna.xyz[1, 1, 0])


def test_person_column_may_be_missing(tmp_path):
    (track,) = csv_people(csv(tmp_path / "a.csv", "t,head_z,head_x,head_y\n0,3,1,2\n")).tracks
    assert track.person is None
    np.testing.assert_array_equal(track.xyz, [[[1, 2, 3]]])


# What they are refused for.

NAMES = np.array(["a", "b"])


@pytest.mark.parametrize(
    ("arrays", "why"),
    [
        ({"q": None}, "lacks q (it has t, joints); needed: t (T), q (T, J)"),
        ({"t": T[:0], "q": Q[:0]}, "is empty"),
        ({"t": T[:3]}, "q: has shape (5, 2); it must be (3, any)"),
        ({"t": T[:, None]}, "t: has shape (5, 1); it must be (any)"),
        ({"q": Q[:, 0]}, "q: has shape (5,); it must be (5, any)"),
        ({"dq": Q[:, :1]}, "dq: has shape (5, 1); it must be (5, 2)"),
        ({"q": Q.astype(str)}, "q: holds <U32; it must hold numbers"),
        ({"q": Q + 1j}, "q: holds complex128"),
        ({"joints": NAMES[:1]}, "joints: holds <U1 in shape (1,); it must be 2 names as text"),
        ({"joints": np.array([1, 2])}, "it must be 2 names as text"),
        ({"joints": np.array(["a", "a"])}, "joint a stands there twice"),
        ({"joints": np.array(["a", None], object)}, "holds pickled Python objects, which are not loaded"),
        ({"q": np.array([[1, 2]] * 5, object)}, "holds pickled Python objects"),
        (
            {"q": np.where(Q == 3, math.nan, Q)},
            "q, t = 0.01 s: joint b is nan; every position must be a number",
        ),
        ({"q": np.where(Q == 3, -math.inf, Q)}, "joint b is -inf"),
        ({"t": T[::-1]}, "t, sample 1: time runs backwards: 0.03 s after 0.04 s; times must increase"),
        ({"t": np.array([0, 1, 1, 2, 3])}, "t, sample 2: time repeats: 1.0 s after 1.0 s"),
        ({"t": np.array([0, 1, math.nan, 2, 3])}, "t, sample 2: time is nan"),
        ({"t": np.array([0, 1, 2, 3, math.inf])}, "t, sample 4: time is inf"),
        ({"t": np.arange(5) + 1.7e18}, "times must be numbers of seconds"),
        ({"t": 1e6 * T * 100}, "t: times go on for 4e+06 s, more than 1e+06 s; times must be in seconds"),
        ({"t": 8.0 * np.arange(5)}, "t: times are 8 apart, which does not look like seconds"),
        ({"run": np.full(5, math.nan)}, "run, sample 0: is nan; runs must be numbered by whole numbers"),
        ({"run": np.array([1, 1, math.inf, 1, 1])}, "run, sample 2: is inf"),
        ({"run": np.array([1, 1, 1, 1, 1.5])}, "run, sample 4: is 1.5"),
        ({"run": np.zeros(0)}, "run: has shape (0,); it must be (5)"),
        ({"t": T[:0], "q": Q[:0], "run": T[:0]}, "is empty"),
        ({"q": Q[:, :0], "joints": NAMES[:0]}, "is empty"),
    ],
)
def test_npz_joints_are_refused(tmp_path, arrays, why):
    path = npz(tmp_path / "a.npz", **({"t": T, "q": Q, "joints": NAMES} | arrays))
    assert why in refusal(npz_joints, path)


@pytest.mark.parametrize(
    ("arrays", "why"),
    [
        ({"xyz": None}, "lacks xyz (it has t, joints); needed: t (T), joints (P) names and xyz (T, P, 3)"),
        ({"xyz": XYZ[:, :, :2]}, "xyz: has shape (5, 2, 2); it must be (5, any, 3)"),
        ({"xyz": XYZ[:, :1]}, "joints: holds <U1 in shape (2,); it must be 1 names as text"),
        ({"joints": np.array(["a", "a"])}, "joints: point a stands there twice"),
        ({"t": T[::-1]}, "time runs backwards"),
        ({"t": T[:0], "xyz": XYZ[:0]}, "is empty"),
        ({"position_error_m": -1.0}, "position_error_m: is -1.0; it must be at least 0 m"),
        ({"position_error_m": math.nan}, "position_error_m: is nan"),
        (
            {"position_error_m": 1e300},
            "is 1e+300; it must be at least 0 m and at most 1000 m",
        ),
        ({"t": 20.0 * np.arange(5)}, "t: times are 20 apart"),
        ({"position_error_m": np.ones(5)}, "position_error_m: has shape (5,); it must be ()"),
    ],
)
def test_npz_people_are_refused(tmp_path, arrays, why):
    path = npz(tmp_path / "a.npz", **({"t": T, "joints": NAMES, "xyz": XYZ} | arrays))
    assert why in refusal(npz_people, path)


def test_an_archive_is_not_unpacked_beyond_its_limit(tmp_path, monkeypatch):
    size = 50_000_000
    path = tmp_path / "a.npz"
    np.savez_compressed(path, t=T, q=Q, dq=np.zeros((size // 8, 1)), unknown=np.zeros(size // 8))
    assert path.stat().st_size < 1e6
    monkeypatch.setattr("verifier.recordings.npz.MAX_TABLE_BYTES", size)
    tracemalloc.start()
    assert refusal(npz_joints, path) == "t, q, dq: unpacks to 48 MiB, more than 48 MiB; split the file"
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    np.savez_compressed(path, t=T, q=Q, dq=Q, unknown=np.zeros(size // 8))
    assert len(npz_joints(path).q) == 5
    np.savez_compressed(path, t=T, q=np.zeros((5, size // 20), np.int8))
    assert "q: unpacks to 95 MiB" in refusal(npz_joints, path)
    assert tracemalloc.get_traced_memory()[1] < 2 * size
    tracemalloc.stop()


def test_a_packed_table_is_not_read_beyond_its_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("verifier.recordings.csv_table.MAX_TABLE_BYTES", 1600)
    rows = [f"{n / 100},1\n" for n in range(101)]
    assert len(csv_joints(csv(tmp_path / "a.csv.gz", "t,a\n" + "".join(rows[:100]))).q) == 100
    text = refusal(csv_joints, csv(tmp_path / "b.csv.gz", "t,a\n" + "".join(rows)))
    assert text == "line 102: goes on beyond 200 numbers; split the file"


@pytest.mark.parametrize("read", [npz_joints, npz_people])
def test_what_is_no_npz(tmp_path, read):
    assert refusal(read, tmp_path / "none.npz") == "does not exist; name an NPZ file"
    assert refusal(read, tmp_path) == "is a folder; name an NPZ file"
    (tmp_path / "a.npz").write_bytes(b"no archive")
    assert "is no readable NPZ file" in refusal(read, tmp_path / "a.npz")
    (tmp_path / "e.npz").write_bytes(b"")
    assert "is no readable NPZ file" in refusal(read, tmp_path / "e.npz")
    np.save(tmp_path / "b.npy", T)
    assert "is no readable NPZ file (it is no archive)" in refusal(read, tmp_path / "b.npy")


@pytest.mark.parametrize("read", [npz_joints, npz_people])
def test_a_member_that_is_no_array_is_refused(tmp_path, read):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for key in ("t", "q", "joints", "xyz"):
            archive.writestr(f"{key}.npy", b"no array")
    assert refusal(read, tmp_path / "a.npz") == "t: is no array; write it with numpy.savez"


HEADERS = ["(", "{[]: 1}", "  {}\n {}", "{'descr': " + 3 * "'", "'"]


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize("read", [npz_joints, npz_people])
def test_an_array_with_a_header_of_another_kind_is_refused(tmp_path, read, header):
    """Numpy reads it as a Python literal, at first and once more as one of Python 2."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for key in ("t", "q", "joints", "xyz"):
            text = header.encode() + b"\n"
            archive.writestr(f"{key}.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    assert "is no readable NPZ file (" in refusal(read, tmp_path / "a.npz")


def test_damaged_npz_never_raises_anything_else(tmp_path, rng, count):
    data = npz(tmp_path / "a.npz", t=T, q=Q, joints=NAMES).read_bytes()
    path = tmp_path / "b.npz"
    refused = 0
    for number in range(count(20_000)):
        bad = bytearray(data)
        for place in rng.integers(0, len(bad), 3):
            bad[place] = rng.integers(0, 256)
        path.write_bytes(bad if number % 2 else data[: rng.integers(0, len(data))])
        try:
            npz_joints(path)
        except RecordingError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is empty; there must be a header line"),
        ("\n", "is empty; there must be a header line"),
        ("t,a\n", "is empty; there must be rows below the header"),
        ("t\n1\n", "line 1: has no joint column; t,<joint>,…,<joint>_velocity,…,<joint>_command,…"),
        (
            "time,a\n1,2\n",
            "line 1: has no column t (it has time,a); the columns must be t,<joint>,…,<joint>_velocity,…,"
            "<joint>_command,…, t in s",
        ),
        ("t,a,a\n1,2,3\n", "line 1: has column a twice; each column once"),
        ("t,a,t\n1,2,3\n", "line 1: has column t twice"),
        ("t,,a\n1,2,3\n", "line 1: has a column without a name"),
        ("t,a\n0,1\n1,zwei\n", "line 3, column a: 'zwei' is not a number; write numbers with a point"),
        ("t,a\n0,1\n\n1,\n", "line 4, column a: '' is not a number"),
        ("t,a\n0,1_0\n", "line 2, column a: '1_0' is not a number"),
        ("t;a\n0;1,5\n", "line 2, column a: '1,5' is not a number"),
        ("t,a\n0,1\n1,2,3\n", "line 3: has 3 cells; the header has 2 columns"),
        ("t,a\n0,1\n\n1,nan\n", "line 4, column a: is nan; every time and position must be a number"),
        ("t,a\n0,inf\n", "line 2, column a: is inf"),
        ("t,a\nnan,0\n", "line 2, column t: is nan"),
        ("t,a\n0,1\n3,1\n6,1\n", "t: times are 3 apart, which does not look like seconds; times must be in"),
        ("t,a\n" + "".join(f"{t},1\n" for t in range(12)), "t: times are 1 apart, which does not look like"),
        ("t,a\n" + "1" * (1 << 20), "line 2: has 1048576 characters or more"),
        ("t,a\n0,1\n0,1\n", "t, sample 1: time repeats"),
        ("t,a\n1,1\n0,1\n", "t, sample 1: time runs backwards: 0.0 s after 1.0 s"),
    ],
)
def test_csv_joints_are_refused(tmp_path, text, why):
    assert why in refusal(csv_joints, csv(tmp_path / "a.csv", text))
    assert why in refusal(csv_joints, csv(tmp_path / "a.csv.gz", text))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            "t,person\n0,a\n",
            "line 1: has no point; the columns must be t,person,<point>_x,<point>_y,<point>_z,…",
        ),
        ("t,person,head\n0,a,1\n", "line 1: has an unknown column head;"),
        ("t,person,head_x,head_y\n0,a,1,2\n", "line 1: lacks column head_z;"),
        ("t,head_x,head_x,head_y,head_z\n0,1,1,1,1\n", "line 1: has column head_x twice"),
        ("t,head_x,head_y,head_z\n0,1,?,3\n", "line 2, column head_y: '?' is not a number"),
        ("t,head_x,head_y,head_z\n", "is empty"),
        (
            "t,person,head_x,head_y,head_z\n0,p1,1,1,1\n1, ,1,1,1\n",
            "line 3, column person: is empty; name everybody, or leave it away",
        ),
        (
            "t,person,head_x,head_y,head_z\n1,a,1,1,1\n1,b,1,1,1\n1,a,1,1,1\n",
            "t of person a, sample 1: time repeats",
        ),
        ("t,head_x,head_y,head_z\n1,1,1,1\n0,1,1,1\n", "t, sample 1: time runs backwards"),
        ("t,head_x,head_y,head_z\n,1,1,1\n", "line 2, column t: '' is not a number"),
        ("t,head_x,head_y,head_z\n0,1,1,1\nnan,1,1,1\n", "line 3, column t: is nan"),
        ("t,head_x,head_y,head_z\n0,1,1,1\n20,1,1,1\n", "t: times are 20 apart, which does not look like"),
    ],
)
def test_csv_people_are_refused(tmp_path, text, why):
    assert why in refusal(csv_people, csv(tmp_path / "a.csv", text))


@pytest.mark.parametrize("read", [csv_joints, csv_people])
def test_what_is_no_csv(tmp_path, read):
    assert refusal(read, tmp_path / "none.csv") == "does not exist; name a CSV file"
    assert refusal(read, tmp_path) == "is a folder; name a CSV file"
    (tmp_path / "a.csv").write_bytes(b"t,a\n\xff\xfe\n")
    assert refusal(read, tmp_path / "a.csv") == "is not a text file in UTF-8; name a CSV file"
    (tmp_path / "a.csv.gz").write_bytes(b"t,a\n0,1\n")
    assert "cannot be read (Not a gzipped file" in refusal(read, tmp_path / "a.csv.gz")
    (tmp_path / "b.csv.gz").write_bytes(gzip.compress(b"t,head_x,head_y,head_z\n" + b"0,1,2,3\n" * 99)[:40])
    assert "cannot be read" in refusal(read, tmp_path / "b.csv.gz")
