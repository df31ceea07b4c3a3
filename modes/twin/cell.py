"""The digital twin: a UR16e and people in MuJoCo (extra ``twin``).

Kinematics, limits and masses of the links are the UR16e's (``robots/models/ur16e.toml`` and its URDF).
Friction, rotors and drives are **made up**, of the size that such an arm has. People are capsules that go
where they are put; nothing holds them up, and a contact pushes neither side: contacts are counted, not
simulated.

Distances are MuJoCo's own, between the capsules of links and of body parts: another engine than those that
verify and plan.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from modes.people_capsules import around_parts
from modes.settings import require_count, require_kind, require_numbers
from modes.twin.arm import (
    STEP_S,
    add_arm,
    begin_model,
    cross,
    cubic,
    import_mujoco,
    require_per_joint,
    steps_of,
)
from occupancy.body import Part, Profile
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]

_HIDDEN_Z_M = -1000.0
"""Where capsules are of parts that nobody has."""
_FAR_M = 10.0
LINKS = 6


@dataclass(frozen=True, slots=True)
class Ur16eMade:
    """What the twin's UR16e is made of, joint by joint.

    Attributes
    ----------
    link_kg:
        Masses as in the maker's model, spread over the capsules here [kg].
    rotor_kg_m2, coulomb_Nm, viscous_Nm_s, stiffness_Nm, damping_Nm_s:
        Made up.
    """

    link_kg: Sequence[float] = (7.369, 10.45, 4.321, 2.18, 2.033, 0.907)
    rotor_kg_m2: Sequence[float] = (1.5, 1.5, 0.8, 0.2, 0.2, 0.2)
    coulomb_Nm: Sequence[float] = (8.0, 8.0, 5.0, 1.5, 1.5, 1.5)
    viscous_Nm_s: Sequence[float] = (15.0, 15.0, 8.0, 2.0, 2.0, 2.0)
    stiffness_Nm: Sequence[float] = (150000.0, 150000.0, 60000.0, 12000.0, 12000.0, 12000.0)
    damping_Nm_s: Sequence[float] = (2500.0, 2500.0, 1000.0, 200.0, 200.0, 200.0)

    def __post_init__(self) -> None:
        require_per_joint(self)


class Nearest(NamedTuple):
    """The least distance of a link from a body part.

    Attributes
    ----------
    gap_m:
        Between their surfaces [m]; below 0: how deep they overlap.
    link:
        Number of the link, from 0.
    speed_m_s:
        Fastest point of that link's capsule [m/s].
    """

    gap_m: float
    link: int
    speed_m_s: float


def mjcf(robot: RobotModel, people: int, profile: Profile, made: Ur16eMade) -> str:
    """Return the cell as a MuJoCo model: the arm, and a capsule for each part of ``people`` people.

    Raises
    ------
    SetupError
        The arm is no chain of six revolute joints.
    """
    root = begin_model(robot.name)
    add_arm(root, robot, made)
    world = root.find("worldbody")
    assert world is not None
    for person in range(people):
        for part in Part:
            name = f"person_{person + 1}_{part.name.lower()}"
            at = ElementTree.SubElement(
                world, "body", name=name, mocap="true", pos=f"0 0 {_HIDDEN_Z_M - 10.0 * person - int(part)}"
            )
            ElementTree.SubElement(
                at, "geom", name=name, type="capsule", size=f"{profile.radius[part]} 0.1", contype="0",
                conaffinity="0",
            )  # fmt: skip
    return ElementTree.tostring(root, encoding="unicode")


class CellTwin:
    """The cell, from one cycle to the next.

    Parameters
    ----------
    robot:
        The UR16e, or another arm of six joints with numbers of its own in ``made``.
    q:
        ``(6,)`` where it rests at first [rad].
    people:
        How many there are.
    profile:
        Whose radii they have.
    period_s:
        Length of a cycle, a whole number of milliseconds [s].
    made:
        What the arm is made of.

    Attributes
    ----------
    t:
        Instant [s].

    Raises
    ------
    SetupError
        MuJoCo is not installed, or a number does not fit.
    """

    def __init__(
        self,
        robot: RobotModel,
        q: Array,
        people: int,
        profile: Profile,
        period_s: float = 0.01,
        made: Ur16eMade | None = None,
    ) -> None:
        require_kind("twin: robot", robot, RobotModel, written="an arm of six joints")
        require_kind("twin: profile", profile, Profile, written="radii of people, as load_profile gives them")
        require_count("twin: people", people, 0, 1000)
        made = Ur16eMade() if made is None else made
        require_kind("twin: made", made, Ur16eMade, written="Ur16eMade(...)")
        self._mujoco = mujoco = import_mujoco()
        self._model = mujoco.MjModel.from_xml_string(mjcf(robot, people, profile, made))
        self._data = mujoco.MjData(self._model)
        self._profile, self._people = profile, people
        self._steps = steps_of(period_s)
        self._lead = np.array(made.damping_Nm_s) / np.array(made.stiffness_Nm)
        self._arm = np.flatnonzero(self._model.geom_bodyid <= LINKS)
        self._person = [
            [self._geom(f"person_{k + 1}_{part.name.lower()}") for part in Part] for k in range(people)
        ]
        self._there: list[int] = []
        self.t = 0.0
        self._wanted, self._speed = require_numbers("twin: q", q, (6,)), np.zeros(6)
        self._data.qpos[:] = self._data.ctrl[:] = self._wanted
        for _ in range(500):  # its drives take up its weight
            mujoco.mj_step(self._model, self._data)

    @property
    def q(self) -> Array:
        """Where the joints are (6,) [rad]."""
        return np.array(self._data.qpos)

    @property
    def dq(self) -> Array:
        """How fast they turn (6,) [rad/s]."""
        return np.array(self._data.qvel)

    def go(self, q: Array, dq: Array) -> None:
        """Let the drives follow a cubic to ``q`` and ``dq`` (6,) [rad, rad/s] within a cycle."""
        q, dq = require_numbers("twin: q", q, (6,)), require_numbers("twin: dq", dq, (6,))
        wanted, speed = cubic(self._wanted, self._speed, q, dq, self._steps)
        for control in wanted + self._lead * speed:
            self._data.ctrl[:] = control
            self._mujoco.mj_step(self._model, self._data)
        self._wanted, self._speed = q, dq
        self.t += self._steps * STEP_S

    def put(self, points: Array) -> None:
        """Put people where their points ``(people, 20, 3)`` [m] are; parts without points are nowhere.

        Raises
        ------
        SetupError
            There are others than the model was made for.
        """
        if len(points) != self._people:
            raise SetupError(f"twin: {len(points)} people are put, the model was made for {self._people}")
        self._there = []
        for person, geoms in zip(points, self._person, strict=True):
            whole = around_parts(person[None], tuple(Part), self._profile)
            if len(whole.radius) == len(geoms):
                for k, geom in enumerate(geoms):
                    self._place(geom, whole.a[k], whole.b[k])
                self._there += geoms
                continue
            for part, geom in zip(Part, geoms, strict=True):
                found = around_parts(person[None], (part,), self._profile)
                if len(found.radius):
                    self._place(geom, found.a[0], found.b[0])
                    self._there.append(geom)
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)

    def moving(self, faster_m_s: float) -> frozenset[int]:
        """Return the numbers of the links with a point that is faster [m/s]."""
        links = (self._model.geom_bodyid[self._arm] - 1).tolist()
        return frozenset(link for link in links if self._link_speed(link) > faster_m_s)

    def nearest(self, enough_m: float = _FAR_M, links: Collection[int] = range(LINKS)) -> Nearest:
        """Return which of ``links`` is nearest to a body part; ``enough_m``: when none is nearer."""
        best, link = enough_m, -1
        arms = self._arm[np.isin(self._model.geom_bodyid[self._arm] - 1, list(links))]
        if not self._there or not len(arms):
            return Nearest(best, link, 0.0)
        bounds = self._bounds(arms)
        for k in np.argsort(bounds, axis=None).tolist():
            arm, part = arms[k // bounds.shape[1]], self._there[k % bounds.shape[1]]
            if bounds.flat[k] >= best:
                break
            gap = self._mujoco.mj_geomDistance(self._model, self._data, int(arm), part, best, None)
            if gap < best:
                best, link = float(gap), int(self._model.geom_bodyid[arm]) - 1
        return Nearest(best, link, self._link_speed(link) if link >= 0 else 0.0)

    def _bounds(self, arms: NDArray[np.signedinteger]) -> Array:
        """Return, for each of these capsules of the arm and each part, no more than their distance [m]."""
        at, sizes = self._data.geom_xpos, self._model.geom_size[:, :2].sum(axis=1)
        away = np.linalg.norm(at[arms][:, None] - at[self._there][None], axis=2)
        return np.asarray(away - sizes[arms][:, None] - sizes[self._there][None])

    def _link_speed(self, link: int) -> float:
        twist, found = np.zeros(6), 0.0
        for geom in self._arm[self._model.geom_bodyid[self._arm] == link + 1].tolist():
            kind = self._mujoco.mjtObj.mjOBJ_GEOM
            self._mujoco.mj_objectVelocity(self._model, self._data, kind, geom, twist, 0)
            axis = self._data.geom_xmat[geom].reshape(3, 3)[:, 2]
            radius, half = self._model.geom_size[geom, :2]
            for end in (half * axis, -half * axis):
                v = twist[3:] + cross(twist[:3], end)
                found = max(
                    found, float(np.linalg.norm(v)) + float(radius) * float(np.linalg.norm(twist[:3]))
                )
        return found

    def _place(self, geom: int, a: Array, b: Array) -> None:
        length = float(np.linalg.norm(b - a))
        body = int(self._model.geom_bodyid[geom])
        mocap = int(self._model.body_mocapid[body])
        self._model.geom_size[geom, 1] = max(0.5 * length, 1e-6)
        self._data.mocap_pos[mocap] = 0.5 * (a + b)
        turn = np.zeros(4)
        axis = (b - a) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
        self._mujoco.mju_quatZ2Vec(turn, axis)
        self._data.mocap_quat[mocap] = turn

    def _geom(self, name: str) -> int:
        return int(self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_GEOM, name))
