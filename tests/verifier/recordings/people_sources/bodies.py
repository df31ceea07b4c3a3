"""A person of known size in a known posture, and the joints of trackers by their makers' names and order.

The orders are typed from the makers' enumerations, or public listings of them, names and all: which name is
which of our points is said here by name, never by number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]
SIDES = ("left", "right")


@dataclass(frozen=True)
class Posture:
    """Angles [degrees]: trunk, upper arms and thighs forwards from upright, elbows and knees bent."""

    trunk: float = 2.0
    upper_arm: float = 8.0
    elbow: float = 12.0
    thigh: float = 2.0
    knee: float = 4.0


STANDING = Posture()
BENT = Posture(trunk=70.0, upper_arm=80.0, elbow=30.0, thigh=60.0, knee=80.0)


def person(stature: float = 1.75, posture: Posture = STANDING) -> dict[str, FloatArray]:
    """Places [m] of joints by name; x forwards, y left, z up, the pelvis 1 m above the origin.

    Lengths are shares of stature (Drillis and Contini 1966).
    """
    h = stature
    turned = Rotation.from_euler("y", posture.trunk, degrees=True)
    at = {"pelvis": np.array([0.0, 0.0, 1.0])}

    def trunk(x: float, y: float, z: float) -> FloatArray:
        return at["pelvis"] + turned.apply(np.array([x, y, z]) * h)

    for name, up in (("spine_low", 0.08), ("spine_high", 0.16), ("chest", 0.22), ("neck", 0.288)):
        at[name] = trunk(0.0, 0.0, up)
    at["head"] = trunk(0.01, 0.0, 0.288 + 0.1)
    at["nose"] = trunk(0.06, 0.0, 0.288 + 0.09)
    for side, y in zip(SIDES, (1.0, -1.0), strict=True):
        at[f"eye_{side}"] = trunk(0.05, 0.02 * y, 0.288 + 0.105)
        at[f"ear_{side}"] = trunk(0.0, 0.045 * y, 0.288 + 0.1)
        at[f"mouth_{side}"] = trunk(0.055, 0.015 * y, 0.288 + 0.07)
        at[f"clavicle_{side}"] = trunk(0.0, 0.03 * y, 0.275)
        at[f"shoulder_{side}"] = trunk(0.0, 0.115 * y, 0.28)
        _limb(at, f"shoulder_{side}", (f"elbow_{side}", 0.186 * h, posture.upper_arm))
        _limb(at, f"elbow_{side}", (f"wrist_{side}", 0.146 * h, posture.upper_arm + posture.elbow))
        out = at[f"wrist_{side}"] - at[f"elbow_{side}"]
        out /= np.linalg.norm(out)
        sideways = np.array([0.0, y, 0.0])
        for name, along, across in (
            ("hand", 0.045, 0.0), ("handtip", 0.1, 0.0), ("middle_1", 0.055, 0.0), ("middle_4", 0.108, 0.0),
            ("index_1", 0.055, -0.012), ("index_4", 0.1, -0.015), ("pinky_1", 0.05, 0.02),
            ("pinky_4", 0.085, 0.03), ("thumb", 0.06, -0.03), ("finger", 0.07, 0.01),
        ):  # fmt: skip
            at[f"{name}_{side}"] = at[f"wrist_{side}"] + h * (along * out + across * sideways)
        at[f"hip_{side}"] = at["pelvis"] + np.array([0.0, 0.055 * y * h, -0.01 * h])
        _limb(at, f"hip_{side}", (f"knee_{side}", 0.245 * h, posture.thigh))
        _limb(at, f"knee_{side}", (f"ankle_{side}", 0.246 * h, posture.thigh - posture.knee))
        for name, x in (("foot", 0.09), ("big_toe", 0.11), ("small_toe", 0.1), ("heel", -0.03)):
            at[f"{name}_{side}"] = at[f"ankle_{side}"] + h * np.array([x, 0.01 * y, -0.03])
    at["mid_hips"] = 0.5 * (at["hip_left"] + at["hip_right"])
    at["mid_shoulders"] = 0.5 * (at["shoulder_left"] + at["shoulder_right"])
    at["mid_ears"] = 0.5 * (at["ear_left"] + at["ear_right"])
    return at


def _limb(at: dict[str, FloatArray], begin: str, limb: tuple[str, float, float]) -> None:
    end, length, angle = limb
    radians = np.deg2rad(angle)
    at[end] = at[begin] + length * np.array([np.sin(radians), 0.0, -np.cos(radians)])


def _both(*names: str) -> list[str]:
    return [f"{name}_{side}" for name in names for side in SIDES]


def _fingers(side: str) -> list[str]:
    return [
        f"{finger}_{number}_{side}" if f"{finger}_{number}" in ("middle_1", "middle_4", "index_1", "index_4",
        "pinky_1", "pinky_4") else f"finger_{side}"
        for finger in ("thumb", "index", "middle", "ring", "pinky") for number in (1, 2, 3, 4)
    ]  # fmt: skip


_ARM = ("clavicle", "shoulder", "elbow", "wrist", "hand", "handtip", "thumb")
_ARMS = [f"{name}_{side}" for side in SIDES for name in _ARM]
_LEGS = [f"{name}_{side}" for side in SIDES for name in ("hip", "knee", "ankle", "foot")]
_EYES_AND_EARS = [f"{name}_{side}" for side in SIDES for name in ("eye", "ear")]
_AZURE = ["pelvis", "spine_low", "chest", "neck", *_ARMS, *_LEGS, "head", "nose", *_EYES_AND_EARS]
_FACE = ["nose", *_both("eye", "ear")]
_RIGHT_FIRST = [
    f"{name}_{side}" for side in ("right", "left") for name in ("shoulder", "elbow", "wrist")
]  # fmt: skip
_LEGS_RIGHT_FIRST = [f"{name}_{side}" for side in ("right", "left") for name in ("hip", "knee", "ankle")]
_ZED_TRUNK = [
    "pelvis", "spine_low", "spine_high", "chest", "neck", *_FACE,
    *_both("clavicle", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "big_toe", "small_toe", "heel"),
]  # fmt: skip

ORDER: dict[str, list[str]] = {
    "azure_kinect_32": _AZURE,
    "zed_body_34": [*_AZURE, "heel_left", "heel_right"],
    "zed_body_38": [*_ZED_TRUNK, *_both("thumb", "index_1", "middle_4", "pinky_1")],
    "zed_body_70": [*_ZED_TRUNK, *_fingers("left"), *_fingers("right")],
    "zed_body_18": [
        "nose", "neck", *_RIGHT_FIRST, *_LEGS_RIGHT_FIRST, "eye_right", "eye_left", "ear_right", "ear_left",
    ],
    "body_25": [
        "nose", "neck", *_RIGHT_FIRST, "mid_hips", *_LEGS_RIGHT_FIRST, "eye_right", "eye_left", "ear_right",
        "ear_left", "big_toe_left", "small_toe_left", "heel_left", "big_toe_right", "small_toe_right",
        "heel_right",
    ],
    "coco_17": [*_FACE, *_both("shoulder", "elbow", "wrist", "hip", "knee", "ankle")],
    "mediapipe_33": [
        "nose", *["eye_left"] * 3, *["eye_right"] * 3, "ear_left", "ear_right",
        *_both("mouth", "shoulder", "elbow", "wrist", "pinky_1", "index_1", "thumb"),
        *_both("hip", "knee", "ankle", "heel", "foot"),
    ],
    "kinect_v2_25": [
        "pelvis", "spine_high", "neck", "head",
        *(f"{name}_{side}" for side in SIDES for name in ("shoulder", "elbow", "wrist", "hand")), *_LEGS,
        "chest", *(f"{name}_{side}" for side in SIDES for name in ("handtip", "thumb")),
    ],
    "smpl_24": [
        "pelvis", *_both("hip"), "spine_low", *_both("knee"), "spine_high", *_both("ankle"), "chest",
        *_both("foot"), "neck", *_both("clavicle"), "head", *_both("shoulder", "elbow", "wrist", "hand"),
    ],
}  # fmt: skip
"""Joint set -> the names of its joints in the order of the maker."""

_HEAD = {"zed_body_18": "nose", "body_25": "nose"} | dict.fromkeys(
    ("zed_body_38", "zed_body_70", "coco_17", "mediapipe_33"), "mid_ears"
)
_PALM = {"zed_body_38": "index_1", "zed_body_70": "middle_1"}
_TIP = {"zed_body_38": "middle_4", "zed_body_70": "middle_4", "mediapipe_33": "index_1"}
_NO_PALM = {"zed_body_18", "body_25", "coco_17", "mediapipe_33"}
_NO_TIP = {"zed_body_18", "body_25", "coco_17", "smpl_24"}
_FROM_MIDDLES = {"coco_17", "mediapipe_33"}
_NO_TRUNK = {"zed_body_18", "body_25", *_FROM_MIDDLES}


def expected(set_name: str, at: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Our points of a person, by the names that the maker of a set gives its joints."""
    found = {
        "head": at[_HEAD.get(set_name, "head")],
        "neck_base": at["mid_shoulders" if set_name in _FROM_MIDDLES else "neck"],
        "pelvis": at["mid_hips" if set_name in _NO_TRUNK else "pelvis"],
    }
    if set_name not in _NO_TRUNK:
        found["thorax"] = at["chest"]
    for side, short in zip(SIDES, "lr", strict=True):
        for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
            found[f"{short}_{name}"] = at[f"{name}_{side}"]
        if set_name not in _NO_PALM:
            found[f"{short}_hand"] = at[f"{_PALM.get(set_name, 'hand')}_{side}"]
        if set_name not in _NO_TIP:
            found[f"{short}_fingertip"] = at[f"{_TIP.get(set_name, 'handtip')}_{side}"]
    return found


def joints(set_name: str, at: dict[str, FloatArray]) -> FloatArray:
    """Joints (J, 3) of a person in the order of a set."""
    return np.array([at[name] for name in ORDER[set_name]])


def in_a_camera(xyz: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The same in the frame of some camera 2 to 5 m away."""
    away = np.array([rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0), rng.uniform(2.0, 5.0)])
    turned: FloatArray = xyz @ Rotation.random(rng=rng).as_matrix().T + away
    return turned
