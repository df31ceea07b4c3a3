"""Made-up people have bodies, keep to the ground, and move as they are said to."""

from __future__ import annotations

import numpy as np
import pytest

from modes.forecasting.skeleton import JOINTS, Joint, bones_of
from modes.forecasting.synthetic import PersonSettings, minimum_jerk, people, person
from robots.errors import SetupError


@pytest.mark.parametrize(
    ("setting", "value", "message"),
    [
        ("height_m", (0.0, 2.0), "height_m"),
        ("height_m", (2.0, 1.5), "height_m"),
        ("speed_m_s", (1.0, 9.0), "speed_m_s"),
        ("still", 1.5, "still"),
        ("pause_s", (float("nan"), 1.0), "pause_s"),
    ],
)
def test_settings_out_of_range_are_refused(setting: str, value: object, message: str) -> None:
    with pytest.raises(SetupError, match=message):
        PersonSettings(**{setting: value})  # type: ignore[arg-type]  # wrong on purpose
    with pytest.raises(SetupError, match="seconds"):
        person(-1.0, 10.0, 0)


def test_bones_keep_their_lengths_and_shares_of_the_height() -> None:
    """Winter: upper arm 0.186, forearm 0.146, thigh 0.245, shank 0.246 of the height."""
    shares = {
        (Joint.LSHO, Joint.LAEL): 0.186,
        (Joint.RAEL, Joint.RWPS): 0.146,
        (Joint.LHIP, Joint.LKNE): 0.245,
        (Joint.RKNE, Joint.RHEE): 0.246,
    }
    for height in (1.5, 1.7, 1.95):
        settings = PersonSettings(height_m=(height, height))
        for seed in range(6):
            joints = person(8.0, 30.0, seed, settings)
            for (a, b), share in shares.items():
                found = np.linalg.norm(joints[:, a] - joints[:, b], axis=1)
                assert found == pytest.approx(np.full(len(joints), share * height), abs=1e-9)
            _, length = bones_of(joints)
            assert np.ptp(length, axis=0).max() < 0.005
            top = joints[:, Joint.C7, 2].max()
            assert 0.7 * height < top < 0.9 * height


def test_people_are_the_same_for_the_same_seed_only() -> None:
    first, again, other = people(3, 4.0, 10.0, 5), people(3, 4.0, 10.0, 5), people(3, 4.0, 10.0, 6)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not any(np.array_equal(a, b) for a, b in zip(first, other, strict=True))
    assert not np.array_equal(first[0], first[1])


def test_nobody_sinks_flies_or_races() -> None:
    for joints in people(40, 10.0, 30.0, 1):
        assert joints.shape == (300, JOINTS, 3) and np.isfinite(joints).all()
        heels = joints[:, [Joint.LHEE, Joint.RHEE], 2]
        assert heels.min() > 0.0 and heels.min(axis=1).max() < 0.25
        speed = 30.0 * np.linalg.norm(np.diff(joints, axis=0), axis=2)
        assert speed[:, [Joint.L3, Joint.C7]].max() < 2.6
        assert speed.max() < 7.5


def test_who_stands_stays_and_who_walks_gets_on_and_swings_legs_against_each_other() -> None:
    standing = PersonSettings(still=1.0)
    for seed in range(5):
        root = person(10.0, 10.0, seed, standing)[:, Joint.L3, :2]
        assert np.linalg.norm(root - root[0], axis=1).max() < 0.4
    walking, far, against = PersonSettings(still=0.0, pause_s=(0.01, 0.1)), [], []
    for seed in range(8):
        joints = person(10.0, 30.0, seed, walking)
        far.append(np.abs(np.diff(joints[:, Joint.L3, :2], axis=0)).sum())
        way = np.diff(joints[:, Joint.L3, :2], axis=0)
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        left, right = (
            ((joints[:-1, heel, :2] - joints[:-1, Joint.L3, :2]) * way).sum(axis=1)
            for heel in (Joint.LHEE, Joint.RHEE)
        )
        against.append(np.corrcoef(left, right)[0, 1])
    assert np.median(far) > 5.0
    assert np.median(against) < -0.5


def test_minimum_jerk_rests_at_both_ends_and_is_fastest_midway() -> None:
    """Flash and Hogan 1985: the peak is 1.875 times the mean speed, and speed is 30 s²(1 - s)²."""
    s = np.linspace(-0.5, 1.5, 4001)
    x = minimum_jerk(s)
    inside = (s > 0.0) & (s < 1.0)
    speed = np.gradient(x, s)
    assert speed.max() == pytest.approx(1.875, rel=1e-4) and abs(s[np.argmax(speed)] - 0.5) < 1e-3
    assert np.allclose(speed[inside][1:-1], (30.0 * s**2 * (1.0 - s) ** 2)[inside][1:-1], atol=1e-3)
    assert (x[s <= 0.0] == 0.0).all() and (x[s >= 1.0] == 1.0).all()
