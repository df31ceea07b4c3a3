"""The check of a plan as an engineer writes it in an afternoon: pinocchio and coal from Python, slice
by slice.

For the same slices, people, enclosure and error terms as the verifier, so that both answer the same question:
forward kinematics at every slice end, one convex shape for every link and slice from its axis at both ends,
capsules for body parts, grown by v Δt. Distances are believed as the library gives them. Nothing is shared
with the verifier but these inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from occupancy.body import Part, Point, Profile
from robots.model import RobotModel
from robots.motion import Block
from verifier.cycle import CycleCheck

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_TRUNK = (Point.PELVIS, Point.THORAX, Point.NECK_BASE, Point.HEAD)
_PARTS: tuple[tuple[Part, tuple[Point, ...]], ...] = (
    (Part.TORSO, _TRUNK),
    (Part.L_UPPER_ARM, (Point.L_SHOULDER, Point.L_ELBOW)),
    (Part.R_UPPER_ARM, (Point.R_SHOULDER, Point.R_ELBOW)),
    (Part.L_FOREARM, (Point.L_ELBOW, Point.L_WRIST)),
    (Part.R_FOREARM, (Point.R_ELBOW, Point.R_WRIST)),
    (Part.L_HAND, (Point.L_WRIST,)),
    (Part.R_HAND, (Point.R_WRIST,)),
    (Part.L_THIGH, (Point.L_HIP, Point.L_KNEE)),
    (Part.R_THIGH, (Point.R_HIP, Point.R_KNEE)),
    (Part.L_SHANK, (Point.L_KNEE, Point.L_ANKLE)),
    (Part.R_SHANK, (Point.R_KNEE, Point.R_ANKLE)),
    (Part.L_FOOT, (Point.L_ANKLE,)),
    (Part.R_FOOT, (Point.R_ANKLE,)),
)
"""What ISO 13855 encloses of a person all of whose points were measured."""


class NaiveCheck:
    """Answers whether every moving link stays apart from every body part on every slice.

    Parameters
    ----------
    arm:
        Pinocchio model of the robot, its joints in the order of ``robot``.
    robot, profile:
        Capsules of the links with their reach; speeds and sizes of people.
    margin_m:
        A gap must exceed this [m].
    """

    def __init__(self, arm: Any, robot: RobotModel, profile: Profile, margin_m: float) -> None:
        self._arm, self._data = arm, arm.createData()
        capsules, n = robot.enclosure[0], len(robot.joints)
        links = int(capsules["n"])
        self._joint = [int(joint) + 1 for joint in capsules["joint"][:links]]
        self._a, self._b = capsules["a"][:links], capsules["b"][:links]
        self._radius = capsules["radius"][:links]
        self._reach = capsules["reach"][:links, :n]
        self._n = n
        self._profile = profile
        self._speed = float(profile.speed.max())
        self._margin = margin_m
        self._here = coal.Transform3s.Identity()
        self._request, self._result = coal.CollisionRequest(), coal.CollisionResult()

    def separated(self, slices: Block, people: Block, moving: Mask) -> bool:
        """Ask coal about one pair after the other until one meets; ``moving`` (slices, links)."""
        bodies = list(self._bodies(people))
        for i, links in self._swept(slices):
            grown = [e_p + self._growth(slices, people, i, t_obs) for _, _, e_p, t_obs in bodies]
            for link in np.flatnonzero(moving[i]):
                points, radius = links[link]
                shape = _convex(points)
                for (body, place, _, _), growth in zip(bodies, grown, strict=True):
                    self._request.security_margin = radius + growth + self._margin
                    self._result.clear()
                    if coal.collide(shape, self._here, body, place, self._request, self._result):
                        return False
        return True

    def separated_by_managers(self, slices: Block, people: Block, moving: Mask) -> bool:
        """The same with the trees of bounding boxes that coal offers: two for every slice."""
        bodies = list(self._bodies(people))
        for i, links in self._swept(slices):
            arm, crowd = coal.DynamicAABBTreeCollisionManager(), coal.DynamicAABBTreeCollisionManager()
            kept = []
            for link in np.flatnonzero(moving[i]):
                points, radius = links[link]
                kept.append(_register(arm, _convex(points), self._here, radius + self._margin))
            for body, place, e_p, t_obs in bodies:
                growth = e_p + self._growth(slices, people, i, t_obs)
                kept.append(_register(crowd, body, place, growth))
            arm.setup()
            crowd.setup()
            found = coal.CollisionCallBackDefault()
            arm.collide(crowd, found)
            if found.data.result.isCollision():
                return False
        return True

    def smallest_gap(self, slices: Block, people: Block, moving: Mask) -> float:
        """Smallest distance [m] over all pairs, radii subtracted; to look into answers that differ."""
        gap = np.inf
        for i, links in self._swept(slices):
            for body, place, e_p, t_obs in self._bodies(people):
                growth = e_p + self._growth(slices, people, i, t_obs)
                for link in np.flatnonzero(moving[i]):
                    points, radius = links[link]
                    pair = (_convex(points), self._here, body, place)
                    distance = coal.distance(*pair, coal.DistanceRequest(), coal.DistanceResult())
                    gap = min(gap, distance - radius - growth)
        return gap

    def _swept(self, slices: Block) -> Iterator[tuple[int, list[tuple[Array, float]]]]:
        """Yield every slice with four points and a radius for each link."""
        plan, n = slices[0], self._n
        before = self._axes(plan["q"][0, :n])
        for i in range(int(plan["n"])):
            after = self._axes(plan["q"][i + 1, :n])
            h = plan["t"][i + 1] - plan["t"][i]
            dq, ddq = plan["dq_max"][i, :n], plan["ddq_max"][i, :n]
            acceleration = self._reach @ (ddq + dq * dq + 2.0 * dq * (np.cumsum(dq) - dq))
            radii = self._radius + h * h / 8.0 * acceleration + self._reach @ plan["q_error"][:n]
            yield i, [(np.vstack(pair), r) for *pair, r in zip(before, after, radii, strict=True)]
            before = after

    def _axes(self, q: Array) -> list[Array]:
        """End points of every link's axis, each (2, 3)."""
        pinocchio.forwardKinematics(self._arm, self._data, q)
        places = [self._data.oMi[joint] for joint in self._joint]
        return [
            np.array([place.act(a), place.act(b)])
            for place, a, b in zip(places, self._a, self._b, strict=True)
        ]

    def _bodies(self, people: Block) -> Iterator[tuple[Any, Any, float, float]]:
        """Yield shape, placement, largest position error [m] and oldest time of seeing [s] of every part."""
        seen = people[0]
        for k in range(int(seen["n"])):
            for part, points in _PARTS:
                xyz = seen["xyz"][k, list(points)]
                radius = float(self._profile.radius[part])
                shape, place = _body(xyz, radius)
                yield shape, place, seen["e_p"][k, list(points)].max(), seen["t_obs"][k, list(points)].min()

    def _growth(self, slices: Block, people: Block, i: int, t_obs: float) -> float:
        """How far [m] a point may have come on slice i since it was seen."""
        plan, seen = slices[0], people[0]
        age = plan["t"][i + 1] + plan["delay"][1] - t_obs + seen["clock_error"]
        return float(self._speed * age)


def _convex(points: Array) -> Any:
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        vertices.append(point)
    for k in range(1, len(points) - 1):
        triangles.append(coal.Triangle(0, k, k + 1))
    return coal.Convex(vertices, triangles)


def _body(points: Array, radius: float) -> tuple[Any, Any]:
    """Sphere, capsule or swept hull of one, two or more points, and its placement."""
    if len(points) > 2:
        hull = _convex(points)
        hull.setSweptSphereRadius(radius)
        return hull, coal.Transform3s.Identity()
    if len(points) == 1:
        return coal.Sphere(radius), coal.Transform3s(np.eye(3), points[0])
    along = points[1] - points[0]
    length = np.linalg.norm(along)
    turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / length).matrix()
    return coal.Capsule(radius, length), coal.Transform3s(turn, points.mean(axis=0))


def _register(manager: Any, shape: Any, place: Any, grown: float) -> Any:
    """Add a shape, grown by ``grown`` [m], to a manager; the object must outlive it."""
    shape = shape.clone()
    shape.setSweptSphereRadius(shape.getSweptSphereRadius() + grown)
    shape.computeLocalAABB()
    item = coal.CollisionObject(shape, place)
    manager.registerObject(item)
    return item


def moving_links(check: CycleCheck, slices: Block, *, going_on: bool = False) -> Mask:
    """Which links of the plan that ``check`` swept last move on which slice (S, L), in plain NumPy.

    ``going_on``: those that it commands move on every slice.
    """
    rest = check.settings.standstill
    displaced = check.robot.enclosure["reach"][0] @ slices["q_error"][0]
    n_slices = int(slices["n"][0])
    n_links = int(check.links["n"][0]) // n_slices
    speed = check.links["speed_max"][0, : n_slices * n_links].reshape(n_slices, n_links)
    moving: Mask = ~((speed <= rest.speed_m_s) & (displaced[:n_links] <= rest.error_m))
    if going_on:
        moving |= [_is_commanded(check, slices, link) for link in range(n_links)]
    return moving


def _is_commanded(check: CycleCheck, slices: Block, link: int) -> bool:
    """Whether a link hangs on a joint that the plan moves."""
    tree, joint = check.robot.kinematics[0], int(check.robot.enclosure["joint"][0, link])
    fastest = slices["dq_max"][0, : int(slices["n"][0])].max(axis=0)
    while joint >= 0:
        if not fastest[joint] <= 0.0:
            return True
        joint = int(tree["parent"][joint])
    return False
