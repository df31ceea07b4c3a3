"""From a cell and a recording to the objects that judge cycles."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from failsafe.braking import Braking
from failsafe.plan import PlanSettings
from failsafe.silence import Silence
from occupancy.body import ALL_PARTS, PART_NAMES, Part, Profile, load_profile
from occupancy.contact import Contact, ContactRule
from occupancy.contact_limits import ContactLimits, load_contact_limits
from occupancy.engines import CoalEngine, FclEngine
from occupancy.humans.catalog import build_models
from occupancy.humans.unobserved import UnobservedSpace
from occupancy.measurement import Gate, GateSettings, SensorFrame
from occupancy.pace import Pace
from occupancy.region import Monitored, Region, RegionError
from occupancy.self_collision import SelfCollision
from occupancy.separation import Separation
from occupancy.workspace import FLOOR, Fixture, Workspace, box, capsule, connected_hulls, half_space, hull
from robots.assumption import Assumption, Certainty
from robots.catalog import RobotSetup, load_robot, load_tool, robot_names
from robots.errors import SetupError
from robots.files import printed, read_bytes
from robots.geometry import read_triangles
from robots.identity import stated_hash, urdf_hash
from robots.model import Mount, RobotModel
from verifier.cell import Cell
from verifier.cell_tables import FixtureTable, Frame, MonitoredTable, RobotTable
from verifier.criteria import (
    ContactCriterion,
    RobotCriterion,
    SelfCollisionCriterion,
    SeparationCriterion,
    Standstill,
    WorkspaceCriterion,
)
from verifier.cycle import CycleCheck, CycleSettings
from verifier.known import PeopleWatch
from verifier.shown import LONGEST_VALUE, shown
from verifier.stop_model import braking_of

Array = NDArray[np.float64]

DEFAULT_POSITION_ERROR_M = 0.01
"""Used, and shown as *default*, where neither recording nor cell states a position error."""


def require_cell(cell: object) -> None:
    """Refuse what is no cell, in words that say how one is made.

    Raises
    ------
    SetupError
        It is the path of a cell file, a table, or something else.
    """
    if isinstance(cell, Cell):
        return
    if isinstance(cell, str | Path):
        how = f"read the file first, with Cell.from_toml({shown(repr(str(cell)), LONGEST_VALUE)})"
    elif isinstance(cell, Mapping):
        how = "make one of this table with Cell.from_table(table)"
    else:
        how = "read a file with Cell.from_toml(path), or Cell() has every default"
    given = "None" if cell is None else f"what is of type {type(cell).__name__}"
    raise SetupError(f"a Cell is needed here, not {given}: {how}")


def build_robot(cell: Cell, recorded: str | None = None, cache_dir: Path | None = None) -> RobotModel:
    """Load the arm that the cell names, or else the one of the catalogue that the recording names.

    Raises
    ------
    SetupError
        Neither names an arm, or they name different ones; or the arm cannot be set up.
    """
    require_cell(cell)
    table = cell.robot
    chosen = _chosen_robot(table, recorded)
    limits: Mapping[str, Mapping[str, object]] = {
        joint: row.model_dump(exclude_none=True) for joint, row in table.limits.items()
    }
    setup = RobotSetup(
        tool=load_tool(table.tool) if table.tool is not None else None,
        bare_flange=table.bare_flange,
        mount=Mount.from_xyz_rpy(table.mount.xyz_m, table.mount.rpy_deg),
        limits=limits,
        enclosure=[{"link": link, **row.model_dump()} for link, row in table.enclosure.items()],
        commanded=table.joints,
        package_dirs=tuple(Path(entry) for entry in table.package_dirs),
        cache_dir=cache_dir,
        source=f"{cell.where}: robot",
    )
    robot = load_robot(chosen, setup=setup)
    known_arms = robot_names()
    if recorded != robot.name and recorded in known_arms and robot.name in known_arms:
        raise SetupError(
            f"the recording is of {recorded}, but {table.urdf} describes {robot.name}: they must agree"
        )
    return robot


def _chosen_robot(table: RobotTable, recorded: str | None) -> str | Path:
    """Name or URDF of the arm to load; what a recording states is compared, and never opened as a file."""
    known = ", ".join(robot_names())
    is_of = f"the recording is of {printed(recorded or '')}"
    if table.name is not None:
        if recorded is not None and recorded != table.name:
            raise SetupError(f"{is_of}, but the cell or --robot says {printed(table.name)}: they must agree")
        if table.name not in robot_names():
            raise SetupError(
                f"robot {printed(table.name)} is not in the catalogue ({known}); name a URDF as [robot] "
                "urdf, or as --robot with a path that has a / or ends in .urdf"
            )
        return table.name
    stated = stated_hash(recorded)
    if table.urdf is not None:
        if stated is not None and stated != (found := urdf_hash(read_bytes(Path(table.urdf)))):
            raise SetupError(
                f"{is_of}, but {printed(table.urdf)} has the hash {found}: they must agree; name the URDF "
                "that was imported, as it was"
            )
        return Path(table.urdf)
    if recorded is None:
        raise SetupError(f"no robot is named: give [robot] name in the cell (or --robot); known: {known}")
    if stated is not None:
        raise SetupError(f"{is_of}, the arm of a URDF: name that file with --robot FILE.urdf or [robot] urdf")
    if recorded not in robot_names():
        raise SetupError(
            f"{is_of}, which is not in the catalogue ({known}): name its URDF with --robot FILE.urdf"
        )
    return recorded


def build_profile(cell: Cell) -> Profile:
    """Load the profile of the cell with the approach speed that the cell selects."""
    require_cell(cell)
    name = cell.people.profile
    profile = load_profile(Path(name) if name.endswith(".toml") else name)
    speed = cell.people.approach_speed_m_s
    if name != "iso" or float(profile.speed.max()) == speed:
        return profile
    return profile.with_speed(speed)


def build_monitored(cell: Cell) -> tuple[Monitored, ...]:
    """Return the regions that complete reports cover.

    Raises
    ------
    SetupError
        A region is empty, too far away or not convex.
    """
    regions = []
    for name, table in cell.people.monitored.items():
        try:
            region = _region(table)
        except RegionError as error:
            raise SetupError(f"{cell.where}: people.monitored.{name}: {error}") from error
        regions.append(Monitored(name, region, table.detection_time_s, table.boundary_error_m))
    return tuple(regions)


def _region(table: MonitoredTable) -> Region:
    if table.min_m is not None and table.max_m is not None:
        return Region.box(table.min_m, table.max_m)
    if table.polygon_m is not None and table.z_m is not None:
        return Region.prism(table.polygon_m, *table.z_m)
    keys = ("origin_m", "rpy_deg", "horizontal_fov_deg", "vertical_fov_deg", "near_m", "far_m")
    origin, rpy, horizontal, vertical, near, far = (getattr(table, key) for key in keys)
    pose = Mount.from_xyz_rpy(origin, rpy)
    return Region.frustum(
        pose.translation,
        pose.rotation,
        horizontal=float(np.deg2rad(horizontal)),
        vertical=float(np.deg2rad(vertical)),
        near=near,
        far=far,
    )


def build_gate(cell: Cell, profile: Profile) -> Gate:
    """Make the gate that admits reports about people in this cell."""
    require_cell(cell)
    people = cell.people
    stated = people.position_error_m
    return Gate(
        profile,
        GateSettings(
            clock_error_s=people.clock_error_s,
            stamp_error_s=people.stamp_error_s,
            position_error_m=DEFAULT_POSITION_ERROR_M if stated is None else stated,
            frames={name: _sensor_frame(name, frame) for name, frame in people.frames.items()},
            monitored=build_monitored(cell),
            believe_repeats=people.repeated_points == "measured",
            trust_sides=people.left_right == "trusted",
        ),
    )


def _sensor_frame(name: str, frame: Frame) -> SensorFrame:
    if frame.pose == "recorded":
        raise SetupError(
            f'people.frames.{shown(name)}: pose = "recorded" needs a recording with /tf_static; '
            "verifier.opened.open_placed(path, cell) takes it from there"
        )
    pose = Mount.from_xyz_rpy(frame.xyz_m, frame.rpy_deg)
    return SensorFrame(
        pose.rotation,
        pose.translation,
        frame.translation_error_m,
        float(np.deg2rad(frame.rotation_error_deg)),
    )


def build_check(
    cell: Cell, robot: RobotModel, profile: Profile, *, assume_nobody: bool, gjk_limit: int | None = None
) -> CycleCheck:
    """Make the check of one cycle: models of people, criteria, obligations."""
    require_cell(cell)
    ignored = sum(1 << PART_NAMES.index(part) for part in set(cell.people.ignored_parts))
    engines = (CoalEngine, FclEngine) if cell.check.engine == "coal" else (FclEngine, CoalEngine)
    separation = Separation(
        cell.check.margin_m,
        engines[0](),
        gjk_limit=gjk_limit,
        boxes_first=gjk_limit is not None,
        cross_check=engines[1]() if cell.check.cross_check else None,
    )
    held = cell.people.held_object_m if "held_object_m" in cell.people.model_fields_set else None
    settings = CycleSettings(
        parts=ALL_PARTS & ~ignored,
        standstill=Standstill(cell.check.standstill_speed_m_s, cell.check.standstill_error_m),
        empty_report_valid_s=cell.people.empty_report_valid_s,
        assume_nobody=assume_nobody,
    )
    criterion = SeparationCriterion(separation, cell.check.margin_m)
    if cell.people.monitored and "unobserved" not in profile.models:
        raise SetupError(f"people.monitored: profile {profile.name} says nothing about unobserved space")
    models = list(build_models(profile, cell.people.models, held))
    for monitored in build_monitored(cell):
        models.append(UnobservedSpace(monitored, profile, index=len(models)))
    contact = build_contact(cell, robot, profile) if cell.criteria.contact else None
    return CycleCheck(robot, models, [criterion], settings, build_robot_criteria(cell, robot), contact)


def build_fixtures(cell: Cell) -> tuple[Fixture, ...]:
    """Return the floor and the fixtures of the cell, meshes read.

    Raises
    ------
    SetupError
        A fixture cannot be used, or a file cannot be read.
    """
    stated = cell.workspace
    found = [_fixture(name, table) for name, table in stated.fixtures.items()]
    if stated.floor_z_m is not None:
        point = (0.0, 0.0, stated.floor_z_m)
        found.insert(0, half_space(FLOOR, point, (0.0, 0.0, 1.0), stated.floor_error_m))
    return tuple(found)


def _fixture(name: str, table: FixtureTable) -> Fixture:
    error, zero = table.position_error_m, (0.0, 0.0, 0.0)
    pose = Mount.from_xyz_rpy(table.xyz_m or zero, table.rpy_deg or zero)
    if table.size_m is not None:
        return box(name, table.size_m, pose, error)
    if table.a_m is not None and table.b_m is not None and table.radius_m is not None:
        return capsule(name, table.a_m, table.b_m, table.radius_m, error)
    if table.point_m is not None and table.normal is not None:
        return half_space(name, table.point_m, table.normal, error)
    assert table.file is not None, "the cell has looked at the keys of each kind"
    vertices, triangles = read_triangles(Path(table.file))
    vertices = vertices * (1.0 if table.scale is None else table.scale)
    if table.pieces == "connected":
        return connected_hulls(name, vertices, triangles, pose, error)
    return hull(name, vertices, pose, error)


def build_robot_criteria(cell: Cell, robot: RobotModel) -> tuple[RobotCriterion, ...]:
    """Make the criteria that need no people: workspace where something stands there, self-collision."""
    margin, stated, criteria = cell.check.margin_m, cell.workspace, cell.criteria
    found: list[RobotCriterion] = []
    fixtures = build_fixtures(cell)
    if fixtures:
        may_touch = {name: table.may_touch for name, table in stated.fixtures.items()}
        if stated.floor_z_m is not None:
            may_touch[FLOOR] = stated.floor_may_touch
        found.append(WorkspaceCriterion(Workspace(fixtures, robot.links, may_touch, margin), margin))
    if criteria.self_collision:
        pairs = SelfCollision(robot, criteria.links_may_touch, margin)
        found.append(SelfCollisionCriterion(pairs, margin))
    return tuple(found)


def build_contact(cell: Cell, robot: RobotModel, profile: Profile) -> ContactCriterion:
    """Make the criterion of power and force limiting with everything that it rests on.

    Raises
    ------
    SetupError
        The limits cannot be read, or a rule names a link that is not there or a part that is never touched.
    """
    stated = cell.criteria
    limits = contact_limits(cell)
    fastest = float(profile.speed.max())
    rules, found, declared = [], [], Certainty.DECLARED
    for number, table in enumerate(stated.contact):
        place, parts = f"contact.{number}", tuple(Part(PART_NAMES.index(name)) for name in table.parts)
        never = [part.name.lower() for part in parts if not limits.speed(part) > 0.0]
        if never:
            raise SetupError(f"criteria.{place}: parts: {', '.join(never)} must not be touched by what moves")
        mass = math.inf
        if table.moving_mass_kg is not None and table.payload_kg is not None:
            mass = 0.5 * table.moving_mass_kg + table.payload_kg
        person = fastest if table.person_speed == "added" else 0.0
        rules.append(ContactRule(table.links, parts, person, mass))
        source = "M/2 + m_L, understates what arrives" if mass < math.inf else "it keeps its position"
        found.append(Assumption(f"{place}.robot_mass_kg", mass, "kg", source, declared))
        source = "largest of the profile" if person else "the part's own speed is neglected"
        found.append(Assumption(f"{place}.person_speed_m_s", person, "m/s", source, declared))
        source = f"F_T / √(k μ), least of its regions, {limits.name}"
        found += [
            Assumption(
                f"{place}.limit.{p.name.lower()}", limits.speed(p, mass), "m/s", source, Certainty.COMPUTED
            )
            for p in parts
        ]
    found += limits.used({part for rule in rules for part in rule.parts})
    found += [
        Assumption(f"contact.gap_by_design.{a}", b, "", "declared: nothing can be clamped", declared)
        for a, b in stated.gaps_by_design
    ]
    found.append(Assumption("contact.pressure", "not checked", "", "edges and areas", Certainty.ASSUMED))
    contact = Contact(robot, build_fixtures(cell), rules, limits, stated.gaps_by_design)
    return ContactCriterion(contact, found)


def contact_limits(cell: Cell) -> ContactLimits:
    """Read the limits of contact that the cell names."""
    name = cell.criteria.contact_limits
    return load_contact_limits(Path(name) if name.endswith(".toml") else name)


def build_silence(cell: Cell, robot: RobotModel) -> Silence | None:
    """Return what the robot does by itself when no command comes; ``None``: it holds the plan.

    Raises
    ------
    SetupError
        There is not one deceleration per joint, or one is above the acceleration limit of its joint and
        nothing says how it was found.
    """
    table = cell.robot.silence
    if table is None:
        return None
    n, stated = len(robot.joints), table.deceleration_rad_s2
    if isinstance(stated, tuple) and len(stated) != n:
        raise SetupError(
            f"{cell.where}: robot.silence.deceleration_rad_s2 has {len(stated)} values, should be one "
            f"number, or {n}: one for each of {', '.join(robot.joints)}"
        )
    deceleration = np.array(stated) if isinstance(stated, tuple) else np.full(n, stated)
    harder = beyond_limits(robot, deceleration)
    if harder and table.deceleration_source is None:
        i, unit = harder[0]
        raise SetupError(
            f"{cell.where}: robot.silence.deceleration_rad_s2 of {robot.joints[i]} is {deceleration[i]:g} "
            f"{unit}, above its acceleration limit of {robot.limits.acceleration[i]:g} {unit}: state at most "
            "that, or, where the brakes were found to be harder, how, as robot.silence.deceleration_source"
        )
    return Silence(table.hold_s, table.goes_on_with == "acceleration", deceleration)


def build_braking(cell: Cell, robot: RobotModel) -> Braking | None:
    """Return how the arm stops by itself, where the cell has a stop that was measured.

    Raises
    ------
    SetupError
        The file of the model cannot be used, or is of another arm.
    """
    if cell.stop.measured_file is None:
        return None
    return braking_of(Path(cell.stop.measured_file), robot)[1]


def beyond_limits(robot: RobotModel, deceleration: Array) -> list[tuple[int, str]]:
    """Return each joint that is said to brake with more than its acceleration limit, and the unit of both."""
    sliding, limits = robot.kinematics["prismatic"][0], robot.limits.acceleration
    return [
        (i, "m/s²" if sliding[i] else "rad/s²")
        for i in range(len(robot.joints))
        if not deceleration[i] <= limits[i]
    ]


def content_hash(check: CycleCheck, cell: Cell) -> str:
    """Hash of what fixtures, limits of contact and a stop model are, wherever their files lie."""
    parts = [
        criterion.workspace.content_hash
        for criterion in check.robot_criteria
        if isinstance(criterion, WorkspaceCriterion)
    ]
    if check.contact is not None:
        parts.append(repr([(item.name, item.value) for item in check.contact.assumptions()]))
    if cell.stop.measured_file is not None:
        parts.append(hashlib.sha256(read_bytes(Path(cell.stop.measured_file))).hexdigest())
    return hashlib.sha256(repr(parts).encode()).hexdigest()


GJK_CALLS = 8
"""Calls of the distance engine in one step of a supervisor; what they do not decide is not verified."""
GJK_CALLS_OF_A_PLAN = GJK_CALLS // 2
"""A step judges two plans at most: the next one and, before the robot sets out, a longer one."""


@dataclass(frozen=True, slots=True)
class Supervised:
    """What a supervisor is made of."""

    check: CycleCheck
    watch: PeopleWatch
    plans: PlanSettings


def build_supervised(cell: Cell, robot: RobotModel | None = None) -> Supervised:
    """Make what a supervisor of this cell needs.

    Raises
    ------
    SetupError
        The cell cannot be used, or leaves open how well the robot follows its commands.
    """
    require_cell(cell)
    if cell.stop.measured_file is not None:
        raise SetupError(
            f'{cell.where}: stop.model = "measured" is a stop that the robot drives by itself; a supervisor '
            'drives its own: stop.model = "path_consistent"'
        )
    robot = build_robot(cell) if robot is None else robot
    tracking = cell.robot.tracking
    if isinstance(tracking.position_error_rad, str):
        raise SetupError(
            f'{cell.where}: robot.tracking.position_error_rad = "measured" needs a recording; a supervisor '
            "needs a number: the largest joint error (rad) that the robot makes when it follows commands"
        )
    profile = build_profile(cell)
    n = len(robot.joints)
    plans = PlanSettings(
        cycle_s=cell.cycle_s,
        delay=(tracking.delay_min_s, tracking.delay_max_s),
        q_error=np.full(n, tracking.position_error_rad),
        dq_error=np.full(n, tracking.velocity_error_rad_s),
        slice_s=cell.stop.slice_s,
        allow_joint_space=cell.stop.allow_joint_space and "allow_joint_space" in cell.stop.model_fields_set,
        silence=build_silence(cell, robot),
    )
    check = build_check(cell, robot, profile, assume_nobody=False, gjk_limit=GJK_CALLS_OF_A_PLAN)
    return Supervised(check, build_live_watch(cell), plans)


def build_watch(cell: Cell) -> PeopleWatch:
    """Make what takes in the reports of a recording, whose later samples are held against it anyway."""
    require_cell(cell)
    doubt = cell.people.stamp_error_s + cell.people.clock_error_s
    return PeopleWatch(build_gate(cell, build_profile(cell)), doubt)


def build_live_watch(cell: Cell) -> PeopleWatch:
    """Make what takes in the reports for one supervisor: it counts time from that one's begin."""
    require_cell(cell)
    doubt, profile = cell.people.stamp_error_s + cell.people.clock_error_s, build_profile(cell)
    return PeopleWatch(build_gate(cell, profile), doubt, Pace(profile))
