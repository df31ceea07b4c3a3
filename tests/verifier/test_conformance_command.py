"""``stopproof conformance``: tables, refusals in one line, identified profiles that miss nothing."""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from occupancy.body import POINT_NAMES, load_profile
from occupancy.report import RefusalReason
from robots.errors import SetupError
from tests.conftest import Some
from tests.occupancy.people import standing
from verifier import conformance
from verifier.commands import cli
from verifier.reports.conformance import NO_LIMIT
from verifier.reports.text import DISCLAIMER
from verifier.snapshot import choose_moment

ROOT = Path(__file__).resolve().parents[2]


def run(*arguments: object) -> str:
    result = CliRunner().invoke(cli, ["conformance", *map(str, arguments)], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    assert result.return_value == 0
    return result.stdout


def refused(*arguments: object) -> str:
    with pytest.raises(SetupError) as refusal:
        run(*arguments)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    t = 0.01 * np.arange(80)
    xyz = np.repeat(standing()[None], 80, axis=0)
    xyz[:, 11:14, 0] += 0.25 * np.sin(10.0 * t)[:, None]
    np.savez(tmp_path / "clip.npz", t=t, joints=np.array(POINT_NAMES), xyz=xyz, position_error_m=0.002)
    return tmp_path / "clip.npz"


def test_the_table_says_what_was_held_against_what(clip: Path) -> None:
    lines = run(clip, "--profile", "iso", "--human", "iso13855").splitlines()
    assert lines[0].startswith("people as recorded against what was predicted of them, every sample")
    assert lines[1] == (
        "clip: 80 samples, none marked by the gate, position error 0.002 m (stated by the file); inside:"
    )
    still = 17 * 79  # all but the arm's three points never move
    assert lines[2] == f"  refused: {still} points: {RefusalReason.REPEATED}"
    profile, model, *shares = lines[4].split()
    assert (profile, model, shares[1]) == ("iso", "iso13855", "%")
    assert float(shares[0]) < 100.0 and "+0.0" in lines[4]
    assert lines[-1] == DISCLAIMER
    assert "all recordings" not in "\n".join(lines)


def test_position_errors_are_stated_or_default(tmp_path: Path, clip: Path) -> None:
    with np.load(clip) as data:
        np.savez(tmp_path / "bare.npz", **{key: data[key] for key in ("t", "joints", "xyz")})
    bare = tmp_path / "bare.npz"
    assert "position error 0.004 m (default)" in run(bare, "--every", 20)
    assert "position error 0.02 m (stated by the user)" in run(bare, "--every", 20, "--position-error", 0.02)
    both = run(bare, clip, "--every", 20)
    assert "all recordings, inside:" in both and "every 20th sample" in both


def test_every_row_of_the_json_says_what_it_was_found_with(tmp_path: Path, clip: Path) -> None:
    with np.load(clip) as data:
        np.savez(tmp_path / "bare.npz", **{key: data[key] for key in ("t", "joints", "xyz")})
    bare = tmp_path / "bare.npz"
    for arguments, error, source, every in (
        ((clip,), 0.002, "stated by the file", 1),
        ((bare, "--every", 3), 0.004, "default", 3),
        ((bare, "--position-error", 0.02), 0.02, "stated by the user", 1),
    ):
        for row in json.loads(run(*arguments, "--profile", "iso", "--human", "iso13855", "--json", "-")):
            assert (row["position_error_m"], row["position_error_source"], row["every"]) == (
                error,
                source,
                every,
            )
            assert (row["samples"], row["marked"], row["version"]) == (80, 0, version("stopproof"))


def test_the_time_of_the_worst_frame_is_what_at_takes(tmp_path: Path, clip: Path) -> None:
    t = 0.0083 * np.arange(80)
    with np.load(clip) as data:
        once = data["xyz"].copy()
        once[:, 11:14, 0] = standing()[11:14, 0] + 0.25 * np.tanh((t - 0.2) / 0.06)[:, None]
        np.savez(clip, **{**data, "t": 5.0 + t, "xyz": once})
    chosen = (clip, "--profile", "iso", "--human", "iso13855", "--every", 7)
    rows = json.loads(run(*chosen, "--json", "-"))
    for row in rows:
        assert row["worst_frame"] in range(0, 80, 7)
        assert row["worst_t_s"] == pytest.approx(0.0083 * row["worst_frame"], abs=1e-9)
    worst = max(rows, key=lambda row: row["worst_excess_m"])
    (said,) = re.findall(r" ms after p1 at ([\d.]+) s \(frame (\d+)\)", run(*chosen))
    assert int(said[1]) == worst["worst_frame"] > 0
    (file,) = conformance.open_recordings([str(clip)], [], None)
    assert choose_moment(file, float(said[0]), None).sample == worst["worst_frame"]


def test_mcap_and_csv_are_read_too(tmp_path: Path) -> None:
    assert "demo: " in run(ROOT / "data/demo.mcap", "--every", 50, "--profile", "iso")
    rows = ["t,person,head_x,head_y,head_z,nose_x,nose_y,nose_z"]
    rows += [
        f"{0.01 * i},{who},{x + 0.01 * i},0,1.7,0,0,1" for i in range(30) for who, x in (("a", 0), ("b", 5))
    ]
    (tmp_path / "two.csv").write_text("\n".join(rows), encoding="utf-8")
    text = run(tmp_path / "two.csv", "--profile", "iso")
    assert "two: 60 samples" in text and "ignored: nose" in text


def test_refusals(tmp_path: Path, clip: Path) -> None:
    assert "there is no model of people 'x'" in refused(clip, "--human", "x")
    assert (
        "cannot test it" in refused(clip, "--human", "unobserved")
        or "unobserved" not in conformance.MODEL_NAMES
    )
    assert "follows from the profiles iso" in refused(
        clip, "--human", "articulated_acceleration", "--profile", "iso"
    )
    assert "profile x: not found" in refused(clip, "--profile", "x")
    assert "position_error_m -1.0" in refused(ROOT / "data/demo.mcap", "--position-error", -1)
    assert "every 0" in refused(clip, "--every", 0)
    assert "stands there twice" in refused(clip, clip)
    assert "does not exist" in refused(tmp_path / "none.npz")
    assert "margin 0.5" in refused(clip, "--identify", tmp_path / "a.toml", "--margin", 0.5)
    assert "must end in .toml" in refused(clip, "--identify", tmp_path / "a.txt")
    assert "none of the bundled" in refused(clip, "--identify", tmp_path / "iso.toml")
    assert not list(tmp_path.glob("*.toml"))
    (tmp_path / "there.toml").touch()
    assert "exists already" in refused(clip, "--identify", tmp_path / "there.toml")
    assert "give --identify too" in refused(clip, "--margin", 1.2)
    assert "two of the profiles are called 'iso'" in refused(clip, "--profile", "iso", "--profile", "iso")
    nobody = tmp_path / "nobody.npz"
    np.savez(nobody, t=np.arange(3.0), joints=np.array(["head"]), xyz=np.full((3, 1, 3), np.nan))
    assert "shows nobody" in refused(nobody)


def test_profiles_are_told_apart_by_their_names(tmp_path: Path, clip: Path) -> None:
    source = Path(load_profile.__code__.co_filename).parent / "profiles" / "iso.toml"
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        text = source.read_text(encoding="utf-8").replace('name = "iso"', 'name = "ours"')
        (tmp_path / folder / "ours.toml").write_text(text, encoding="utf-8")
    one, two = tmp_path / "one/ours.toml", tmp_path / "two/ours.toml"
    told = "two of the profiles are called 'ours': name each once"
    assert told in refused(clip, "--profile", one, "--profile", two)
    assert told in refused(clip, "--profile", one, "--profile", tmp_path / "two/../one/ours.toml")
    made = tmp_path / "ours.toml"
    assert told in refused(clip, "--profile", one, "--identify", made)
    assert not made.exists()
    rows = json.loads(run(clip, "--profile", one, "--profile", "iso", "--json", "-"))
    assert {row["profile"] for row in rows} == {"ours", "iso"}


def test_long_names_of_profiles_do_not_run_into_the_next_column(tmp_path: Path, clip: Path) -> None:
    source = Path(load_profile.__code__.co_filename).parent / "profiles" / "iso.toml"
    text = source.read_text(encoding="utf-8").replace('name = "iso"', 'name = "mine_profile_of_us"')
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    found = run(clip, "--profile", tmp_path / "own.toml", "--profile", "iso", "--human", "iso13855")
    rows = [line for line in found.splitlines() if " iso13855 " in line]
    assert [row.split()[0] for row in rows] == ["mine_profile_of_us", "iso"]
    (title,) = (line for line in found.splitlines() if line.startswith("  profile"))
    assert {row.index("iso13855") for row in rows} == {title.index("model")}


def test_a_picture_is_drawn(tmp_path: Path, clip: Path) -> None:
    assert "wrote " in run(clip, "--every", 10, "--picture", tmp_path / "p.png")
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


def test_an_identified_profile_loads_and_says_where_numbers_come_from(tmp_path: Path, clip: Path) -> None:
    text = run(clip, "--identify", tmp_path / "shop-floor.toml", "--margin", 1.1)
    assert NO_LIMIT in text
    profile = load_profile(tmp_path / "shop-floor.toml")
    assert profile.name == "shop-floor" and "no limit for other people or tasks" in profile.title
    assert profile.speed[11] == pytest.approx(1.1 * 2.5, rel=1e-2)
    table = tomllib.loads((tmp_path / "shop-floor.toml").read_text(encoding="utf-8"))
    measured = table["speed"]["r_wrist"]
    assert measured["certainty"] == "measured"
    for word in ("80 readings", "clip.npz", "successive readings", "margin 1.1"):
        assert word in measured["source"]


RECORDINGS: list[tuple[tuple[str, ...], int]] = [
    (("cmu_02_08_swordplay",), 4),
    (("cmu_02_04_jump_balance", "cmu_02_01_walk"), 2),
    (("cmu_03_02_uneven_walk_with_tracking_glitch",), 1),
    (("kth_handover_new_giver", "kth_handover_new_taker"), 4),
    (("icl_assembly_Task4_Human1_trial1",), 2),
    (("ad_cmu1_jumping_jacks",), 1),
]
"""Clips that are taken together, and of how many frames one is looked at."""


@pytest.mark.real_data
@pytest.mark.rarely("identification by itself, tests/occupancy")
def test_an_identified_profile_misses_nothing_of_its_own_recordings(
    tmp_path: Path, real_data: Path, some: Some
) -> None:
    for number, (names, every) in enumerate(some(RECORDINGS, 2)):
        clips = [real_data / f"human/{name}.npz" for name in names]
        options = ("--identify", tmp_path / str(number) / "own.toml", "--every", every, "--json", "-")
        (tmp_path / str(number)).mkdir()
        found = json.loads(run(*clips, *options))
        assert {each["profile"] for each in found} == {"own"}
        assert {each["model"] for each in found} >= {"iso13855", "articulated_acceleration"}
        for each in found:
            assert each["outside"] == 0, each
            assert each["frames"] > 0
