"""Profiles: numbers with sources, refusals, limb tables against an independent shortest path."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import shortest_path

import occupancy.body as body
from occupancy.body import PART_NAMES, POINT_NAMES, Part, Point, ProfileError, load_profile, profile_names
from robots.assumption import Certainty

ISO = Path(body.__file__).parent / "profiles" / "iso.toml"


def write(folder: Path, old: str, new: str) -> Path:
    """The bundled profile under another name with one piece of text replaced."""
    text = ISO.read_text(encoding="utf-8").replace('name = "iso"', 'name = "changed"')
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the profile"
    path = folder / "changed.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


SPEED = "{ value = 2.0, unit"
LEG = 'leg = { value = 0.1, unit = "m", certainty = "assumed"'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (SPEED, "{ value = nan, unit", "speed.every_point: value nan must be a finite number"),
        (SPEED, "{ value = inf, unit", "speed.every_point: value inf must be a finite number"),
        (SPEED, "{ value = -2.0, unit", "speed.every_point: value -2.0 must be positive"),
        (SPEED, "{ value = 0, unit", "speed.every_point: value 0 must be positive"),
        (SPEED, "{ value = true, unit", "speed.every_point: value True must be a finite number"),
        (SPEED, '{ value = "2", unit', "speed.every_point: value '2' must be a finite number"),
        ('2.0, unit = "m/s"', '2.0, unit = "mm/s"', "speed.every_point: unit 'mm/s' must be 'm/s'"),
        ("hand = { value = 0.205", "hand = { valu = 0.205", "radius.hand: missing value"),
        ("hand = { value = 0.205", "hand = { value = 0.2, diameter = 1", "radius.hand: unknown key diameter"),
        ("[radius]", "[radius]\nneck = 1", "radius: unknown key neck"),
        ("[speed]", "[speed]\nnose = 1", "speed: unknown key nose"),
        ("[stature]", "[size]", "missing stature"),
        ('name = "changed"', 'name = "changed"\nspeeds = 1', "unknown key speeds"),
        ('name = "changed"', 'name = ""', "name and title must be texts"),
        ("[limb.thigh]", "[limb.thighs]", "limb: missing thigh"),
        ("leg = { value = 0.1, unit", "leg = 0.1 # { value = 0.1, unit", "radius.leg must be a table"),
        (LEG, LEG.replace("assumed", "sure"), "certainty 'sure' must be one of"),
        ('source = "rounded 95th percentile of men"', 'source = " "', "stature.longest: source must say"),
        ("shortest = { value = 0.245", "shortest = { value = 2.45", "limb.thigh: shortest 3.675 m above"),
        ("[stature]", "[stature", "not readable as TOML"),
        ("[stature]", "deep = " + "[" * 5000 + "]" * 5000 + "\n[stature]", "not readable as TOML: max"),
        ("[stature]", "long = " + "9" * 5000 + "\n[stature]", "not readable as TOML: Exceeds"),
        ("value = 2.0", "value = 1" + "0" * 400, "must be a finite number"),
    ],
)  # fmt: skip
def test_a_profile_that_breaks_a_rule_is_refused_in_one_line(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    with pytest.raises(ProfileError, match=re.escape(said)) as error:
        load_profile(write(tmp_path, old, new))
    if "not readable" not in said:
        assert "\n" not in str(error.value)
    assert "changed.toml" in str(error.value)


def test_unknown_profile_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ProfileError, match=r"olympic: not found; there are extreme, iso, tum"):
        load_profile("olympic")


def test_bundled_profiles_load_and_every_number_says_where_it_comes_from() -> None:
    assert "iso" in profile_names()
    for name in profile_names():
        profile = load_profile(name)
        assert profile.name == name
        assert len({a.name for a in profile.assumptions}) == len(profile.assumptions) > 0
        for assumption in profile.assumptions:
            assert assumption.name.startswith(f"people.{name}.")
            assert len(assumption.source) > 5 and assumption.unit
            assert isinstance(assumption.certainty, Certainty)
            assert math.isfinite(float(assumption.value))


def test_iso_has_the_numbers_of_the_paper() -> None:
    """Pereira and Althoff, Online formal verification, III-A; foot, leg: docs/method.md, section 4."""
    profile = load_profile("iso")
    assert (profile.speed == 2.0).all()
    radius = dict(zip(PART_NAMES, profile.radius, strict=True))
    assert {radius[p] for p in ("head", "neck", "torso", "pelvis")} == {0.35}
    assert {radius[f"{s}_{p}"] for s in "lr" for p in ("upper_arm", "forearm", "thigh", "shank")} == {0.1}
    assert {radius["l_hand"], radius["r_hand"]} == {0.205}
    assert {radius["l_foot"], radius["r_foot"]} == {0.3}


EDGES = [
    ("neck", "neck_base", "head"), ("trunk", "pelvis", "neck_base"), ("lower_trunk", "pelvis", "thorax"),
    ("upper_trunk", "thorax", "neck_base"), ("clavicle", "neck_base", "?_shoulder"),
    ("hip", "pelvis", "?_hip"), ("upper_arm", "?_shoulder", "?_elbow"), ("forearm", "?_elbow", "?_wrist"),
    ("hand", "?_wrist", "?_fingertip"), ("palm", "?_wrist", "?_hand"), ("fingers", "?_hand", "?_fingertip"),
    ("thigh", "?_hip", "?_knee"), ("shank", "?_knee", "?_ankle"),
]  # fmt: skip


def test_chains_are_shortest_paths_over_the_longest_limbs() -> None:
    table = tomllib.loads(ISO.read_text(encoding="utf-8"))
    stature = table["stature"]["longest"]["value"]
    graph = np.zeros((20, 20))
    for limb, a, b in EDGES:
        for side in "lr":
            i, j = POINT_NAMES.index(a.replace("?", side)), POINT_NAMES.index(b.replace("?", side))
            graph[i, j] = graph[j, i] = stature * table["limb"][limb]["longest"]["value"]
    profile = load_profile("iso")
    np.testing.assert_allclose(profile.chain, shortest_path(graph, directed=False), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(profile.limits["chain"][0], profile.chain)
    assert math.isclose(profile.chain[Point.L_WRIST, Point.L_FINGERTIP], 0.2052)


def test_limb_limits_are_half_the_shortest_and_one_and_a_half_times_the_longest() -> None:
    table = tomllib.loads(ISO.read_text(encoding="utf-8"))
    limits = load_profile("iso").limits[0]
    found = {
        tuple(sorted(int(p) for p in limits["limb"][i])): (limits["limb_min"][i], limits["limb_max"][i])
        for i in range(limits["n_limbs"])
    }
    expected = {}
    for limb, a, b in EDGES:
        for side in "lr":
            pair = sorted(POINT_NAMES.index(end.replace("?", side)) for end in (a, b))
            expected[tuple(pair)] = (
                0.5 * table["stature"]["shortest"]["value"] * table["limb"][limb]["shortest"]["value"],
                1.5 * table["stature"]["longest"]["value"] * table["limb"][limb]["longest"]["value"],
            )
    assert found.keys() == expected.keys()
    for pair, (low, high) in expected.items():
        assert found[pair] == (pytest.approx(low), pytest.approx(high))


def test_a_point_may_have_its_own_speed(tmp_path: Path) -> None:
    own = 'l_wrist = { value = 9.0, unit = "m/s", certainty = "assumed", source = "a test" }\n'
    profile = load_profile(write(tmp_path, "[selectable_speed]", own + "[selectable_speed]"))
    expected = np.full(20, 2.0)
    expected[Point.L_WRIST] = 9.0
    np.testing.assert_array_equal(profile.speed, expected)
    np.testing.assert_array_equal(profile.limits["speed"][0], expected)


def test_choosing_a_speed_names_its_source_or_that_it_was_declared() -> None:
    profile = load_profile("iso")
    slow = profile.with_speed(1.6)
    assert (slow.speed == 1.6).all() and (slow.limits["speed"] == 1.6).all()
    [stated] = [a for a in slow.assumptions if ".speed." in a.name]
    assert stated.value == 1.6 and "13855" in stated.source and stated.certainty is Certainty.SOURCED
    [declared] = [a for a in profile.with_speed(3.1).assumptions if ".speed." in a.name]
    assert declared.value == 3.1 and declared.certainty is Certainty.DECLARED
    assert (profile.speed == 2.0).all() and (profile.limits["speed"] == 2.0).all()
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ProfileError, match="must be positive and finite"):
            profile.with_speed(bad)


def test_every_part_has_a_radius() -> None:
    assert (load_profile("iso").radius[: len(Part)] > 0.0).all()
