"""Camera: (1) to (4) against closed forms, tilts there and back again, and what is refused."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting.camera import (
    FEMTO_BOLT_IMU,
    GRAVITY_M_S2,
    LEVEL,
    Intrinsics,
    Mounting,
    Tilt,
    TiltOutcome,
    pitch_matrix,
    points_of_pixels,
    roll_matrix,
    tilt_of,
)
from occupancy.body import MAX_POINTS, load_profile
from occupancy.measurement import Gate
from occupancy.report import GateSettings, RawMeasurement, RawPerson
from robots.errors import SetupError

Array = NDArray[np.float64]

CAMERA = Intrinsics(fx=600.0, fy=500.0, cx=320.0, cy=240.0, width=640, height=480)
NAMES = ("fx", "fy", "cx", "cy", "width", "height")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [0, 0.0, -1.0, math.nan, math.inf, "600", True, None])
def test_wrong_intrinsics_are_refused_by_name(name: str, value: Any) -> None:
    for make in (lambda: replace(CAMERA, **{name: value}), lambda: table_with(name, value)):
        with pytest.raises(SetupError, match=rf"^camera: {name} [^\n]+$"):
            make()


def table_with(name: str, value: Any) -> Intrinsics:
    return Intrinsics.of_table({**asdict(CAMERA), name: value})


@pytest.mark.parametrize("name", NAMES)
def test_missing_intrinsics_are_refused_by_name(name: str) -> None:
    table = asdict(CAMERA)
    assert Intrinsics.of_table(table) == CAMERA
    del table[name]
    with pytest.raises(SetupError, match=f"^camera: {name} is missing"):
        Intrinsics.of_table(table)


def test_unknown_intrinsics_and_principal_points_outside_are_refused() -> None:
    with pytest.raises(SetupError, match="'k1' is not known"):
        Intrinsics.of_table({**asdict(CAMERA), "k1": 0.1})
    with pytest.raises(SetupError, match="cx"):
        replace(CAMERA, cx=700.0)


def test_equation_1_by_hand() -> None:
    """A metre to the right and half a metre up at 2 m: 300 px right, 125 px up."""
    xyz = points_of_pixels(np.array([620.0, 115.0]), np.array(2.0), CAMERA)
    assert xyz == pytest.approx([1.0, 2.0, 0.5], abs=1e-12)
    assert CAMERA.pixels(np.array([1.0, 2.0, 0.5])) == pytest.approx([620.0, 115.0])
    assert np.isnan(CAMERA.pixels(np.array([1.0, -2.0, 0.5]))).all()


def test_pixels_and_points_there_and_back(rng: np.random.Generator) -> None:
    uv, depth = rng.uniform(0.0, 480.0, (50, 2)), rng.uniform(0.3, 5.0, 50)
    xyz = points_of_pixels(uv, depth, CAMERA)
    assert xyz[:, 1] == pytest.approx(depth)
    assert CAMERA.pixels(xyz) == pytest.approx(uv)


def test_signs_of_the_angles() -> None:
    ahead, right = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    assert roll_matrix(0.3) @ ahead == pytest.approx([0.0, math.cos(0.3), math.sin(0.3)])
    assert pitch_matrix(0.3) @ right == pytest.approx([math.cos(0.3), 0.0, -math.sin(0.3)])


@pytest.mark.parametrize(
    ("up", "roll", "pitch"),
    [
        ((0.0, 0.0, 1.0), 0.0, 0.0),
        ((0.0, math.sin(0.4), math.cos(0.4)), 0.4, 0.0),  # the lens looks up: up is ahead of it, too
        ((0.0, -1.0, 0.0), -math.pi / 2, 0.0),  # looks straight down: up is behind it
        ((-math.sin(0.4), 0.0, math.cos(0.4)), 0.0, 0.4),  # its right side is low: up is to the left
        ((0.0, 0.0, -1.0), math.pi, 0.0),  # hangs upside down
    ],
)
def test_tilts_by_hand(up: tuple[float, ...], roll: float, pitch: float) -> None:
    tilt = tilt_of(GRAVITY_M_S2 * np.array(up))
    assert tilt.outcome is TiltOutcome.KNOWN
    assert abs(tilt.roll) == pytest.approx(abs(roll)) and math.sin(tilt.roll - roll) == pytest.approx(0.0)
    assert tilt.pitch == pytest.approx(pitch)


def test_random_tilts_there_and_back(rng: np.random.Generator) -> None:
    """SciPy's rotations about fixed axes x, then y; the accelerometer sees up through their inverse."""
    for _ in range(200):
        roll, pitch = rng.uniform(-math.pi, math.pi), rng.uniform(-1.5, 1.5)
        turn = Rotation.from_euler("xy", (roll, pitch))
        found = tilt_of(turn.inv().apply((0.0, 0.0, GRAVITY_M_S2)))
        assert (found.roll, found.pitch) == pytest.approx((roll, pitch), abs=1e-9)
        xyz = rng.normal(size=(4, 3))
        assert Mounting().to_world(xyz, found) == pytest.approx(turn.apply(xyz), abs=1e-9)


def test_yaw_and_position_come_after_the_tilt(rng: np.random.Generator) -> None:
    """Looking along y at yaw 0; a quarter turn to the left, and it looks along -x."""
    mounting = Mounting(np.array([1.0, 2.0, 3.0]), math.pi / 2)
    assert mounting.to_world(np.array([0.0, 1.0, 0.0]), LEVEL) == pytest.approx([0.0, 2.0, 3.0])
    down = Tilt(TiltOutcome.KNOWN, -0.5, 0.0)
    seen = mounting.to_world(np.array([0.0, 1.0, 0.0]), down)
    assert seen == pytest.approx([1.0 - math.cos(0.5), 2.0, 3.0 - math.sin(0.5)])


def test_axes_of_the_femto_bolt() -> None:
    """Level, it measures up along its negative z axis, for z points down; X backwards, Y left."""
    assert tilt_of((0.0, 0.0, -GRAVITY_M_S2), FEMTO_BOLT_IMU)[1:] == pytest.approx((0.0, 0.0))
    lens_up = tilt_of((-GRAVITY_M_S2 * math.sin(0.2), 0.0, -GRAVITY_M_S2 * math.cos(0.2)), FEMTO_BOLT_IMU)
    assert (lens_up.roll, lens_up.pitch) == pytest.approx((0.2, 0.0))
    left_up = tilt_of((0.0, GRAVITY_M_S2 * math.sin(0.2), -GRAVITY_M_S2 * math.cos(0.2)), FEMTO_BOLT_IMU)
    assert (left_up.roll, left_up.pitch) == pytest.approx((0.0, 0.2))


@pytest.mark.parametrize(
    ("readings", "outcome"),
    [
        ((0.0, 0.0, 12.0), TiltOutcome.MOVING),
        ((0.0, 0.0, 0.0), TiltOutcome.MOVING),
        ([(0.0, 0.0, 9.81), (0.0, 0.5, 9.8)], TiltOutcome.MOVING),  # lengths fit; the direction does not rest
        ((9.81, 0.0, 0.0), TiltOutcome.ON_ITS_SIDE),
        ((0.0, math.nan, 9.81), TiltOutcome.NOT_READ),
        ((0.0, 9.81), TiltOutcome.NOT_READ),
        ([], TiltOutcome.NOT_READ),
        (None, TiltOutcome.NOT_READ),
        ("up", TiltOutcome.NOT_READ),
        ([[0.0, 0.0, 9.81], [0.0]], TiltOutcome.NOT_READ),
    ],
)
def test_a_tilt_that_is_not_known_says_why(readings: object, outcome: TiltOutcome) -> None:
    found = tilt_of(readings)
    assert found.outcome is outcome and math.isnan(found.roll) and math.isnan(found.pitch)
    with pytest.raises(SetupError, match="tilt not known"):
        Mounting().frame(found)


def test_a_mirror_is_no_rotation_of_an_accelerometer() -> None:
    with pytest.raises(SetupError, match=r"imu = .* should be a rotation"):
        tilt_of((0.0, 0.0, 9.81), np.diag((1.0, 1.0, -1.0)))


def test_a_gate_places_points_of_the_camera_where_the_mounting_does(rng: np.random.Generator) -> None:
    tilt = Tilt(TiltOutcome.KNOWN, -0.4, 0.1)
    mounting = Mounting(np.array([0.5, -1.0, 2.2]), 0.7, 0.02, 0.01)
    xyz = np.full((MAX_POINTS, 3), np.nan)
    xyz[3] = rng.uniform(0.5, 2.0, 3)
    settings = GateSettings(0.0, 0.0, 0.05, frames={"camera": mounting.frame(tilt)})
    person = RawPerson("p1", xyz, np.full(MAX_POINTS, 0.05), 1 << 3)
    report = RawMeasurement(0.0, 0.0, "camera", False, (person,))
    read = Gate(load_profile("iso"), settings).read(report, person)
    assert read is not None
    assert read.xyz[3] == pytest.approx(mounting.to_world(xyz[3], tilt))
    assert read.e_p[3] == pytest.approx(0.05 + float(mounting.error_m(xyz[3])), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("position_m", (0.0, 1.0)),
        ("yaw_rad", math.nan),
        ("position_error_m", -1.0),
        ("rotation_error_rad", 4.0),
    ],
)
def test_wrong_mountings_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SetupError, match=f"^mounting: {name} [^\n]+$"):
        Mounting(**{name: value})
