"""The scene of a cycle, as it is judged: links, people, what both may occupy, and the pair that decided."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robots.kernels import forward
from robots.model import RobotModel
from robots.motion import MAX_JOINTS
from verifier.cell import Cell
from verifier.criteria import WorkspaceCriterion
from verifier.cycle import CycleCheck
from verifier.evidence import robot_witness, witness
from verifier.onlooker import SeenCycle
from verifier.outcome_colours import BODY_COLOURS, OUTCOME_COLOURS
from verifier.recordings.errors import RecordingError
from verifier.recordings.foxglove_scene import LATEST_NS, Colour, Entity, Frame, SceneEncoder
from verifier.recordings.spool import Spool
from verifier.reports.sets_panel import bones
from verifier.scene_sets import pieces
from verifier.shown import shown
from verifier.still import Body, Still, take_still
from verifier.verdict import Status, Witness

Array = NDArray[np.float64]

STEP_S: Final = 0.1
"""At least so often a scene is drawn; and for every cycle whose outcome or reason is another one."""
FARTHEST_M: Final = 20.0
"""Sets with corners farther from the origin are not drawn: unobserved space goes on for ever."""
HEADLINES: Final = {
    Status.VERIFIED: "VERIFIED IN THE MODEL",
    Status.NOT_VERIFIED: "NOT VERIFIED",
    Status.CONTRADICTED: "CONTRADICTED",
    Status.NOT_CHECKED: "NOT CHECKED",
}
_POINT_M = 0.015
_ABOVE_M = 0.35
_SOLID, _CLEAR = 0.9, 0.25


class SceneRecorder:
    """Draws the cycles of a run into a spool.

    Parameters
    ----------
    cell:
        What is judged.
    spool:
        Takes the scenes.
    """

    def __init__(self, cell: Cell, spool: Spool) -> None:
        self._cell = cell
        self._spool = spool
        self._encoder = SceneEncoder()
        self._start_ns = 0
        self._due_s = 0.0
        self._before: tuple[int, int] | None = None
        self._rotations, self._positions = np.zeros((MAX_JOINTS, 3, 3)), np.zeros((MAX_JOINTS, 3))

    def begin(self, start_ns: int) -> None:
        """Learn when cycle 0 is.

        Raises
        ------
        RecordingError
            Scenes cannot have such times.
        """
        if not 0 <= start_ns <= LATEST_NS:
            wrong = f"a scene would get the time {start_ns / 1e9:.6f} s"
            raise RecordingError(self._spool.beside, "", wrong, "scenes count from 1970 and end in 2106")
        self._start_ns = start_ns

    def look(self, seen: SeenCycle) -> None:
        """Draw a cycle, if it is its turn."""
        t, found = seen.k * self._cell.cycle_s, (int(seen.status), int(seen.reason))
        if t < self._due_s and found == self._before:
            return
        if self._before is None:
            self._draw_fixtures(seen)
        self._before = found
        if t >= self._due_s:
            self._due_s = (math.floor(t / STEP_S + 1e-6) + 1.0) * STEP_S - 1e-9
        time_ns = self._time_ns(seen)
        self._place(seen.check.robot, seen)
        self._spool.add(time_ns, self._encoder.scene, self._encoder.update(time_ns, self._scene(seen)))
        frames = self._frames(seen.check.robot)
        self._spool.add(time_ns, self._encoder.frames, self._encoder.transforms(time_ns, frames))

    def _time_ns(self, seen: SeenCycle) -> int:
        return self._start_ns + round(seen.k * self._cell.cycle_s * 1e9)

    def _draw_fixtures(self, seen: SeenCycle) -> None:
        colour = _colour(BODY_COLOURS["fixture"], _CLEAR)
        drawn = [
            Entity(f"fixture {number} {shown(body.name)}", colour, sets=[pieces(body.points, body.radius)])
            for number, body in enumerate(_fixtures(seen.check))
            if _near(body)
        ]
        time_ns = self._time_ns(seen)
        self._spool.add(time_ns, self._encoder.fixtures, self._encoder.update(time_ns, drawn))

    def _place(self, robot: RobotModel, seen: SeenCycle) -> None:
        """Put the robot where the samples say that it was: they are joined by straight lines."""
        window, q = seen.section.window, np.zeros(MAX_JOINTS)
        for j in range(len(robot.joints)):
            q[j] = np.interp(seen.judged.t, window.t, window.q[:, j])
        forward(robot.kinematics, q, self._rotations, self._positions)

    def _scene(self, seen: SeenCycle) -> list[Entity]:
        pair, still = _found(seen)
        links = self._links(seen.check.robot, seen.status)
        entities = [*links, *_people(seen)]
        if still is not None:
            entities += _occupied(still, pair)
        elif seen.swept:
            entities += _last_slice(seen)
        if pair is not None:
            entities.append(_pair(pair))
        highest = max(float(each.sets[0].spheres[:, 2].max()) + each.sets[0].radius for each in links)
        base = np.array(self._cell.robot.mount.xyz_m, dtype=np.float64)
        at = np.array([base[0], base[1], highest + _ABOVE_M])
        return [*entities, self._headline(seen, at)]

    def _links(self, robot: RobotModel, status: Status) -> list[Entity]:
        """Return the enclosures of the moving links, in the colour of the outcome."""
        rows, colour = robot.enclosure[0], _colour(OUTCOME_COLOURS[status], _SOLID)
        drawn = []
        for i in range(int(rows["n"])):
            turn, shift = self._rotations[rows["joint"][i]], self._positions[rows["joint"][i]]
            ends = np.stack([turn @ rows[end][i] + shift for end in ("a", "b")])
            facts = {"link": shown(robot.links[i]), "outcome": HEADLINES[status]}
            name = f"link {i} {shown(robot.links[i])}"
            drawn.append(Entity(name, colour, sets=[pieces(ends, float(rows["radius"][i]))], facts=facts))
        return drawn

    def _frames(self, robot: RobotModel) -> list[Frame]:
        return [
            Frame(f"stopproof/{shown(joint)}", self._rotations[j].copy(), self._positions[j].copy())
            for j, joint in enumerate(robot.joints)
        ]

    def _headline(self, seen: SeenCycle, at: Array) -> Entity:
        lines = [f"{HEADLINES[seen.status]}: {seen.reason.text}"]
        gap, stop = seen.answer.gap_m, seen.answer.stop_time_s
        if math.isfinite(gap):
            lines.append(f"gap {gap:+.3f} m, more than {self._cell.check.margin_m:g} m is needed")
        if math.isfinite(stop):
            lines.append(f"stop {stop:.3f} s")
        colour = _colour(OUTCOME_COLOURS[seen.status], 1.0)
        return Entity("verdict", colour, text="\n".join(lines), at=at)


def _found(seen: SeenCycle) -> tuple[Witness | None, Still | None]:
    """Return the pair that decided, and what was compared with it; ``None``: no pair was."""
    if not seen.swept:
        return None, None
    check, judged = seen.check, seen.judged
    pair = robot_witness(check, judged) or witness(check, judged, check.nearest)
    return pair, take_still(check, judged, pair)


def _people(seen: SeenCycle) -> Iterator[Entity]:
    """Yield the points of people as last admitted, and the bones between them."""
    block, colour = seen.judged.people[0], _colour(BODY_COLOURS["person-edge"], 1.0)
    for row in range(int(block["n"])):
        person, points = shown(seen.judged.ids[int(block["person"][row])]), block["xyz"][row]
        known = points[np.isfinite(points).all(axis=1)].copy()
        joined = [points[[a, b]] for a, b in bones(points)]
        lines = np.array(joined) if joined else np.zeros((0, 2, 3))
        yield Entity(
            f"person {row} {person}",
            colour,
            dots=known,
            dot_m=_POINT_M,
            lines=lines,
            facts={"person": person, "points": "as last admitted"},
        )


def _occupied(still: Still, pair: Witness | None) -> Iterator[Entity]:
    """Yield the sets that were compared, on the slice of the pair that decided."""
    groups: Sequence[tuple[str, Sequence[Body]]] = (
        ("link", still.links),
        ("person", still.people),
        ("fixture", [body for body in still.fixtures if body.decides]),
    )
    model = "" if pair is None else pair.model
    for kind, bodies in groups:
        for number, body in enumerate(bodies):
            if _near(body):
                yield _set(kind, number, body, model if kind == "person" else "")


def _last_slice(seen: SeenCycle) -> Iterator[Entity]:
    """Yield what the links occupy on the last slice of the stop, where no pair was compared."""
    check, last = seen.check, int(seen.judged.slices["n"][0]) - 1
    sets = check.links[0]
    for number, row in enumerate(range(int(sets["first"][last]), int(sets["first"][last + 1]))):
        points, radius = sets["points"][row, : int(sets["n_points"][row])].copy(), float(sets["radius"][row])
        body = Body(check.robot.links[int(sets["owner"][row])], points, radius, decides=False)
        if len(points) and np.isfinite(points).all() and _near(body):
            yield _set("link", number, body, "")


def _set(kind: str, number: int, body: Body, model: str) -> Entity:
    colour = _colour(BODY_COLOURS["decides" if body.decides else kind], _CLEAR)
    facts = {"set": shown(body.name), "radius": f"{body.radius:.6f} m"}
    if body.person:
        facts["person"] = shown(body.person)
    if model:
        facts["model"] = model
    if body.decides:
        facts["decides"] = "one of the pair that decided"
    name = shown(f"{body.person} {body.name}".strip())
    return Entity(f"{kind} set {number} {name}", colour, sets=[pieces(body.points, body.radius)], facts=facts)


def _pair(pair: Witness) -> Entity:
    """Return the nearest points of the pair that decided, and the way between them."""
    colour = _colour(BODY_COLOURS["decides"], 1.0)
    other = pair.other or f"{pair.person} {pair.part}"
    gap = f": gap {pair.gap_m:+.3f} m" if math.isfinite(pair.gap_m) else ""
    model = f" ({pair.model})" if pair.model else ""
    text = f"{shown(pair.link)} and {shown(other)}{model}{gap}"
    ends = np.array(pair.points)
    if not (np.isfinite(ends).all() and np.abs(ends).max() <= FARTHEST_M):
        return Entity("pair", colour, facts={"pair": text})
    return Entity(
        "pair",
        colour,
        dots=ends,
        dot_m=_POINT_M,
        lines=ends[None],
        text=text,
        at=ends.mean(axis=0) + np.array([0.0, 0.0, 0.1]),
        facts={"pair": text, "criterion": pair.criterion},
    )


def _fixtures(check: CycleCheck) -> Iterator[Body]:
    for criterion in check.robot_criteria:
        if isinstance(criterion, WorkspaceCriterion):
            for fixture in criterion.workspace.fixtures:
                for piece in fixture.pieces:
                    if len(piece.points):
                        yield Body(fixture.name, piece.points, piece.radius, decides=False)


def _near(body: Body) -> bool:
    return bool(np.abs(body.points).max() <= FARTHEST_M) and body.radius <= FARTHEST_M


def _colour(text: str, opacity: float) -> Colour:
    red, green, blue = (int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue, opacity
