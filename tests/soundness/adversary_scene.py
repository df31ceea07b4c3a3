"""Random scenes for the adversary: a cell, how the plant and the sensors err within what it declares."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Part
from tests.soundness.adversary_arm import MAX_JOINTS, MOUNTS, model
from tests.soundness.adversary_kernels import PLAN, PLANS, ROBOT
from tests.soundness.adversary_people_kernels import MAX_PEOPLE, MODES, PEOPLE
from tests.soundness.persons import WHOLE_BODY, Truth, flesh, random_body
from verifier.cell import Cell

Array = NDArray[np.float64]
Block = NDArray[np.void]

STANDSTILL_M_S = 1.25e-3
"""Links that are commanded slower than 1 mm/s may be touched; a delay that drifts makes them 1.2 times as
fast."""
DRIFT = 0.2
"""The delay changes by at most this [s/s]."""
REGION_M = 4.5
"""Half the side of the region of which complete reports list everybody, where there is one."""
SILENCE_S = (0.7, 1.5)
"""Where sensors fall silent, they do so this often."""


@dataclass(frozen=True)
class Scene:
    """What a run is like. Times [s], lengths [m]; ``kind_*``: what :func:`see` and the loop know."""

    robot: str
    mounted: int
    cycle: float
    delay: tuple[float, float]
    q_error: float
    q_error_rate: float
    slice_s: float
    models: tuple[str, ...]
    speed: float
    persons: int
    period: float
    latency: tuple[float, float]
    dropped: float
    in_order: bool
    missing: float
    wrists_only: bool
    position_error: float
    stated: bool
    kind_error: int
    doubt: tuple[float, float]
    kind_stamp: int
    complete: bool
    detection: float
    late: float
    missed: float
    withdrawn: float
    renamed: float
    silent: float
    load: float
    epoch: float
    weights: tuple[float, ...] = field(default=(0.04, 0.15, 0.6, 0.1, 0.05, 0.03, 0.03))
    true_speed: float = 1.0
    """Share of the profile's speed at which people truly move."""
    parts: int = WHOLE_BODY
    distance: tuple[float, float] = (1.8, 3.0)
    """Where people stand at first, from the axis of the robot."""
    readings: float = 0.01
    """In how many cycles joints are read."""

    def table(self) -> dict[str, Any]:
        """The cell, as a table."""
        mount = MOUNTS[self.mounted]
        yaw = float(np.rad2deg(np.arctan2(mount.rotation[1, 0], mount.rotation[0, 0])))
        tracking = {
            "position_error_rad": self.q_error,
            "velocity_error_rad_s": self.q_error_rate,
            "delay_min_s": self.delay[0],
            "delay_max_s": self.delay[1],
        }
        people: dict[str, Any] = {
            "models": list(self.models),
            "approach_speed_m_s": self.speed,
            "clock_error_s": self.doubt[0],
            "stamp_error_s": self.doubt[1],
            "position_error_m": self.position_error,
            "repeated_points": "measured",
            "ignored_parts": [part.name.lower() for part in Part if not self.parts >> part & 1],
        }
        if self.complete:
            side = [REGION_M, REGION_M]
            people["monitored"] = {
                "around": {
                    "kind": "box",
                    "min_m": [-side[0], -side[1], -1.5],
                    "max_m": [*side, 4.0],
                    "detection_time_s": self.detection,
                }
            }
        return {
            "cycle_s": self.cycle,
            "robot": {
                "name": self.robot,
                "bare_flange": True,
                "mount": {"xyz_m": mount.translation.tolist(), "rpy_deg": [0.0, 0.0, yaw]},
                "tracking": tracking,
            },
            "stop": {"slice_s": self.slice_s},
            "people": people,
        }

    def cell(self) -> Cell:
        """The cell that the supervisor is made from."""
        return Cell.from_table(self.table())


def random_scene(rng: np.random.Generator, robot: str) -> Scene:
    """Return a scene for an arm; about half of what can go wrong does."""

    def sometimes(share: float, value: float) -> float:
        return value if rng.random() < share else 0.0

    cycle = float(rng.choice([0.001, 0.002, 0.004, 0.004, 0.008, 0.01, 0.02]))
    q_error = float(rng.choice([1e-4, 1e-3, 3e-3]))
    delay = np.sort(rng.uniform(0.0, rng.choice([0.01, 0.06]), 2)) * rng.choice([0.0, 1.0], p=[0.3, 0.7])
    latency = float(rng.choice([0.0, 0.01, 0.04, 0.1]))
    models = ("iso13855",) if rng.random() < 0.8 else ("iso13855", "articulated_velocity")
    complete = bool(rng.random() < 0.25)
    return Scene(
        robot=robot,
        mounted=int(rng.random() < 0.4),
        cycle=cycle,
        delay=(float(delay[0]), float(delay[1])),
        q_error=q_error,
        q_error_rate=float(rng.choice([0.0, 20.0, 100.0])) * q_error,
        slice_s=float(rng.choice([0.01, 0.02, 0.05])),
        models=models,
        speed=float(rng.choice([1.6, 2.0])),
        persons=int(rng.choice([1, 1, 1, 2, 3])),
        period=float(rng.choice([0.008, 0.02, 0.033, 0.06])),
        latency=(latency, float(rng.choice([0.0, 0.3, 1.5])) * max(latency, 0.005)),
        dropped=sometimes(0.4, 0.1),
        in_order=bool(rng.random() < 0.6),
        missing=sometimes(0.25, 0.05),
        wrists_only=bool(rng.random() < 0.3),
        position_error=float(rng.choice([0.0, 0.005, 0.02, 0.05])),
        stated=bool(rng.random() < 0.5),
        kind_error=int(rng.choice([0, 0, 1, 2])),
        doubt=(sometimes(0.4, float(rng.uniform(0.0, 0.01))), sometimes(0.4, float(rng.uniform(0.0, 0.01)))),
        kind_stamp=int(rng.choice([0, 0, 1, 2])),
        complete=complete,
        detection=float(rng.choice([0.0, 0.05, 0.1])),
        late=sometimes(0.5, 0.05),
        missed=sometimes(0.4, 0.002),
        withdrawn=sometimes(0.4, 0.005),
        renamed=sometimes(0.3, 0.004) if complete else 0.0,
        silent=sometimes(0.5, float(rng.uniform(0.1, 0.5))),
        load=float(rng.uniform(0.3, 0.75)),
        epoch=float(rng.choice([0.0, 1.7e9 + 0.123])),
    )


def robot_block(scene: Scene, q: Array) -> tuple[Block, Block]:
    """Plans and robot of a scene: it stands at ``q`` (n,), as its commands 0 and 1 say."""
    limits = model(scene.robot, scene.mounted).limits
    n = len(q)
    block: Block = np.zeros(1, dtype=ROBOT)
    rec = block[0]
    rec["n"], rec["cycle"], rec["newest"] = n, scene.cycle, 1
    rec["last"][0, :n] = q
    plans: Block = np.zeros(PLANS, dtype=PLAN)
    plans[0]["spans"], plans[0]["breaks"][1] = 1, np.inf
    plans[0]["powers"][0, 0, :n] = q
    rec["q"][:n] = q
    rows = (limits.velocity, limits.acceleration, limits.jerk, limits.position_lower, limits.position_upper)
    rec["limits"][:, :n] = rows
    rec["delay"], rec["drift"] = scene.delay, DRIFT
    rec["lag"] = rec["lag_goal"] = scene.delay[1]
    rec["bound"][:n] = max(0.0, scene.q_error - 1e-6)
    rec["rate"] = scene.q_error_rate
    assert n <= MAX_JOINTS
    return plans, block


@dataclass(frozen=True)
class Crowd:
    """People of a scene: PEOPLE block, their parts, which points are reported, errors that stay."""

    block: Block
    parts: tuple[NDArray[np.int64], NDArray[np.int64], Array]
    shown: NDArray[np.bool_]
    bias: Array


def crowd(scene: Scene, rng: np.random.Generator) -> Crowd:
    """Return people who stand about the arm; some come from outside where reports are complete."""
    block: Block = np.zeros(1, dtype=PEOPLE)
    rec = block[0]
    rec["n"], rec["speed"] = scene.persons, scene.speed * scene.true_speed
    rec["random"] = rng.integers(1, 2**63)
    rec["base"] = MOUNTS[scene.mounted].translation
    rec["weights"] = scene.weights
    seen = np.ones((2, 20), dtype=bool)
    if scene.wrists_only:
        seen[:, [7, 8, 12, 13]] = False
    radii = []
    for p in range(scene.persons):
        body = random_body(rng, bent=bool(rng.random() < 0.4))
        angle, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 1.1)
        off = rng.uniform(*scene.distance)
        if scene.complete and p > 0 and rng.random() < 0.5:
            off = REGION_M * 1.45 + 1.5
        place = rec["base"] + np.array([off * np.cos(angle), off * np.sin(angle), 0.0])
        place[2] = height
        rec["points"][p] = rec["before"][p] = body + place
        rec["height"][p] = height
        truth = Truth(f"p{p}", body, np.zeros(3), seen, np.zeros((2, 20, 3)), np.zeros(20))
        segments = flesh(truth, scene.parts, 0.0)
        radii.append([segment.radius for segment in segments])
    rec["until"][:] = -1.0
    flesh_of = np.zeros((MAX_PEOPLE, len(radii[0])))
    flesh_of[: scene.persons] = radii
    bias = rng.normal(size=(MAX_PEOPLE, 20, 3))
    bias /= np.linalg.norm(bias, axis=2, keepdims=True)
    begin = np.array([segment.start for segment in segments], dtype=np.int64)
    end = np.array([segment.end for segment in segments], dtype=np.int64)
    assert len(scene.weights) == MODES
    return Crowd(block, (begin, end, flesh_of), seen[0], bias)
