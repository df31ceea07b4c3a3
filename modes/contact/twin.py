"""A six-axis arm with a force/torque sensor, simulated by MuJoCo (extra ``twin``).

Rigid links, joints with Coulomb and viscous friction, drives that follow joint positions at 1 kHz, absolute
motor currents once per control step, and a sensor between flange and tool that is read at 1 kHz.

**Masses, friction, drives and noise are made up**: none are published for the KUKA KR5 sixx R650. They are of
the size that such an arm has, and were chosen before the thresholds of the paper were tried on it. What the
twin shows is what the mode does with signals of that kind, not what a KR5 does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from modes.contact.machine import Measured
from modes.contact.touches import Spot, Touch
from modes.contact.wrench import GRAVITY
from modes.settings import require_number, require_numbers
from modes.twin.arm import (
    STEP_S,
    add_arm,
    add_bar,
    begin_model,
    cross,
    cubic,
    import_mujoco,
    require_per_joint,
    steps_of,
    text,
)
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]

_PER_JOINT = (
    "link_kg", "rotor_kg_m2", "coulomb_Nm", "viscous_Nm_s", "stiffness_Nm", "damping_Nm_s", "gains_Nm_A",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What an arm is made of, joint by joint; made up.

    Attributes
    ----------
    link_kg:
        Masses of the links, spread over their capsules [kg].
    rotor_kg_m2:
        Inertia of the motors, at the joint.
    coulomb_Nm, viscous_Nm_s:
        Friction.
    stiffness_Nm, damping_Nm_s:
        Of the drives [N m/rad, N m s/rad].
    gains_Nm_A:
        Torque at the joint per current.
    current_noise_A:
        Standard deviation of a current.
    flange_m, axis:
        Where the sensor is in the frame of the last joint; from there the tool points along ``axis``.
    tool_kg, tool_m, tool_radius_m:
        A round bar.
    bias:
        ``(6,)`` of the sensor [N, N m].
    force_noise_N, moment_noise_Nm:
        Standard deviations of a sample.
    range_N, range_Nm:
        Where the sensor ends.
    """

    link_kg: Sequence[float] = (7.0, 5.0, 3.0, 1.5, 0.8, 0.2)
    rotor_kg_m2: Sequence[float] = (0.4, 0.4, 0.2, 0.06, 0.04, 0.02)
    coulomb_Nm: Sequence[float] = (3.0, 4.0, 3.0, 1.0, 0.8, 0.4)
    viscous_Nm_s: Sequence[float] = (6.0, 6.0, 4.0, 1.0, 0.8, 0.4)
    stiffness_Nm: Sequence[float] = (30000.0, 30000.0, 12000.0, 2500.0, 1600.0, 650.0)
    damping_Nm_s: Sequence[float] = (440.0, 440.0, 170.0, 33.0, 20.0, 9.0)
    gains_Nm_A: Sequence[float] = (45.0, 60.0, 40.0, 20.0, 15.0, 10.0)
    current_noise_A: float = 0.01
    flange_m: tuple[float, float, float] = (0.0, 0.0, -0.08)
    axis: tuple[float, float, float] = (0.0, 0.0, -1.0)
    tool_kg: float = 0.5
    tool_m: float = 0.2
    tool_radius_m: float = 0.02
    bias: Array = field(default_factory=lambda: np.array([1.0, -2.0, 0.5, 0.05, 0.0, -0.02]))
    force_noise_N: float = 0.15
    moment_noise_Nm: float = 0.004
    range_N: float = 290.0
    range_Nm: float = 10.0

    def __post_init__(self) -> None:
        require_per_joint(self, _PER_JOINT)
        for name in ("tool_kg", "tool_m", "tool_radius_m", "range_N", "range_Nm"):
            require_number(f"twin: {name}", getattr(self, name), 0.0, 1e6, above=True)
        for name in ("current_noise_A", "force_noise_N", "moment_noise_Nm"):
            require_number(f"twin: {name}", getattr(self, name), 0.0, 1e6)
        for name, n in (("flange_m", 3), ("axis", 3), ("bias", 6)):
            require_numbers(f"twin: {name}", getattr(self, name), (n,))


def mjcf(robot: RobotModel, body: Body) -> str:
    """Return an arm as a MuJoCo model: its kinematics and capsules, with the masses of ``body``.

    Raises
    ------
    SetupError
        It is no chain of six revolute joints with a capsule each.
    """
    root = begin_model(robot.name, GRAVITY)
    last = add_arm(root, robot, body)
    tool = ElementTree.SubElement(last, "body", name="tool", pos=text(body.flange_m))
    add_bar(tool, np.zeros(3), body.tool_m * np.array(body.axis), body.tool_radius_m, body.tool_kg)
    ElementTree.SubElement(tool, "site", name="sensor")
    sensors = ElementTree.SubElement(root, "sensor")
    ElementTree.SubElement(sensors, "force", site="sensor")
    ElementTree.SubElement(sensors, "torque", site="sensor")
    return ElementTree.tostring(root, encoding="unicode")


class Twin:
    """An arm that is simulated from one control step to the next.

    Parameters
    ----------
    robot:
        Kinematics and capsules.
    q:
        ``(6,)`` where it rests at first [rad].
    body:
        What it is made of.
    period_s:
        Time of a control step, a whole number of milliseconds [s].
    seed:
        Of the noise.

    Attributes
    ----------
    t:
        Instant of the last control step [s].

    Raises
    ------
    SetupError
        MuJoCo is not installed, the arm is no chain of six revolute joints, or numbers do not fit; what is
        asked of it later raises this too.
    """

    def __init__(
        self, robot: RobotModel, q: Array, body: Body | None = None, period_s: float = 0.012, seed: int = 0
    ) -> None:
        self.body = Body() if body is None else body
        self._mujoco = mujoco = import_mujoco()
        self._model = mujoco.MjModel.from_xml_string(mjcf(robot, self.body))
        self._data = mujoco.MjData(self._model)
        self._steps = steps_of(period_s)
        self._random = np.random.default_rng(seed)
        self._lead = np.array(self.body.damping_Nm_s) / np.array(self.body.stiffness_Nm)
        self._sigma = np.repeat((self.body.force_noise_N, self.body.moment_noise_Nm), 3)
        self.t = 0.0
        self.place(q)

    def place(self, q: Array) -> None:
        """Put the arm at rest at ``q`` (6,) [rad], and let its drives take up its weight."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._wanted, self._speed = require_numbers("twin: q", q, (6,)), np.zeros(6)
        self._data.qpos[:] = self._wanted
        self._data.ctrl[:] = self._wanted
        for _ in range(500):
            self._mujoco.mj_step(self._model, self._data)

    @property
    def q(self) -> Array:
        """Where the joints are (6,) [rad]."""
        return np.array(self._data.qpos)

    @property
    def dq(self) -> Array:
        """How fast they turn (6,) [rad/s]."""
        return np.array(self._data.qvel)

    def where(self, spot: Spot) -> Array:
        """Return the place of a spot (3,) [m]."""
        body = self._body(spot)
        turn = self._data.xmat[body].reshape(3, 3)
        return np.array(self._data.xpos[body] + turn @ np.array(spot.local_m))

    @property
    def torques(self) -> Array:
        """What the drives give (6,) [N m]."""
        return np.array(self._data.qfrc_actuator)

    def follow(self, dq: Array, touches: Sequence[Touch] = ()) -> Measured:
        """Let the drives go over to speeds ``dq`` (6,) [rad/s] within a control step."""
        dq = require_numbers("twin: dq", dq, (6,))
        return self.go(self._wanted + 0.5 * self.period_s * (self._speed + dq), dq, touches)

    @property
    def period_s(self) -> float:
        """Time of a control step [s]."""
        return self._steps * STEP_S

    def go(self, q: Array, dq: Array, touches: Sequence[Touch] = ()) -> Measured:
        """Let the drives follow a cubic to ``q`` and ``dq`` (6,) [rad, rad/s] within a control step.

        Returns
        -------
        Measured
            Currents at its end; the samples of the sensor during it.
        """
        q, dq = require_numbers("twin: q", q, (6,)), require_numbers("twin: dq", dq, (6,))
        data, n = self._data, self._steps
        wanted, speed = cubic(self._wanted, self._speed, q, dq, n)
        controls = wanted + self._lead * speed
        readings = self._random.normal(size=(n, 6)) * self._sigma + self.body.bias
        stamps: Array = np.asarray(self.t + STEP_S * np.arange(1, n + 1), dtype=float)
        data.xfrc_applied[:] = 0.0
        near = [each for each in touches if each.begin_s < stamps[-1] and each.end_s > self.t - STEP_S]
        for i in range(n):
            if near:
                self._touch(stamps[i] - STEP_S, near)
            data.ctrl[:] = controls[i]
            self._mujoco.mj_step(self._model, data)
            readings[i] -= data.sensordata  # what the flange does to the tool
        self._wanted, self._speed, self.t = q, dq, float(stamps[-1])
        ends = np.repeat((self.body.range_N, self.body.range_Nm), 3)
        return Measured(self.t, self._currents(), stamps, np.clip(readings, -ends, ends))

    def _currents(self) -> Array:
        """Return absolute currents (6,) [A]."""
        noise = self.body.current_noise_A * self._random.normal(size=6)
        return np.asarray(np.abs(self.torques / np.array(self.body.gains_Nm_A) + noise))

    def _body(self, spot: Spot) -> int:
        """Return MuJoCo's number of the body that a spot is on."""
        number = int(self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_BODY, spot.body))
        if number < 0:
            raise SetupError(f"twin: a spot on {spot.body!r} should be on link_1 to link_6, or on tool")
        return number

    def _touch(self, t: float, touches: Sequence[Touch]) -> None:
        """Apply what touches the arm at ``t``."""
        data, twist = self._data, np.zeros(6)
        data.xfrc_applied[:] = 0.0
        for touch in touches:
            if not touch.begin_s <= t < touch.end_s:
                continue
            body = self._body(touch.spot)
            lever = data.xmat[body].reshape(3, 3) @ np.array(touch.spot.local_m)
            place = data.xpos[body] + lever
            kind = self._mujoco.mjtObj.mjOBJ_XBODY
            self._mujoco.mj_objectVelocity(self._model, data, kind, body, twist, 0)
            force = touch.force(t, place, twist[3:] + cross(twist[:3], lever))
            data.xfrc_applied[body, :3] += force
            data.xfrc_applied[body, 3:] += cross(place - data.xipos[body], force)
