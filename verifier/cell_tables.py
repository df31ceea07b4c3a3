"""The tables of a cell: their keys, and the rules within each. Where they come together: verifier/cell.py."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from occupancy.body import PART_NAMES, POINT_NAMES, profile_names
from occupancy.contact_limits import contact_limits_names
from occupancy.humans.catalog import MODEL_NAMES
from occupancy.sets import MAX_MODELS
from occupancy.workspace import FLOOR

Positive = Annotated[float, Field(gt=0.0)]
Seconds = Annotated[float, Field(ge=0.0, le=10.0)]
Metres = Annotated[float, Field(ge=0.0, le=10.0)]
Limit = Annotated[float, Field(gt=0.0, le=1e6)]
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
NearCoordinate = Annotated[float, Field(ge=-100.0, le=100.0)]
Near = tuple[NearCoordinate, NearCoordinate, NearCoordinate]
Angle = Annotated[float, Field(gt=0.0, lt=180.0)]
Offset = Annotated[float, Field(ge=-4e9, le=4e9)]

ISO_APPROACH_SPEEDS = (1.6, 2.0)
"""Approach speeds of ISO 13855:2010 [m/s]."""


class Table(BaseModel):
    """Frozen, with no other keys than its own."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class Tracking(Table):
    """How well the robot follows the command (assumption A2)."""

    position_error_rad: Annotated[float, Field(ge=0.0, le=10.0)] | Literal["measured"] = "measured"
    """Bound on the joint error (rad; m for prismatic joints); ``"measured"``: the largest residual of the fit
    to the recording."""
    velocity_error_rad_s: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    delay_min_s: Seconds = 0.0
    delay_max_s: Seconds = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Tracking:
        if self.delay_max_s < self.delay_min_s:
            raise ValueError(
                f"delay_max_s = {self.delay_max_s} must be at least delay_min_s = {self.delay_min_s}"
            )
        return self


class SilenceTable(Table):
    """``[robot.silence]``: what the robot does by itself when no command comes (assumption A4)."""

    hold_s: Annotated[float, Field(ge=0.0, le=1.0)]
    goes_on_with: Literal["velocity", "acceleration"] = "velocity"
    deceleration_rad_s2: Limit | Annotated[tuple[Limit, ...], Field(min_length=1)]
    """At least this, of all joints or of each (rad/s²; m/s² for prismatic joints)."""
    deceleration_source: str | None = None
    """How it was found; required for more than the acceleration limit of a joint."""

    @model_validator(mode="after")
    def _said(self) -> SilenceTable:
        if self.deceleration_source is not None and not self.deceleration_source.strip():
            raise ValueError("deceleration_source must say how the deceleration was found")
        return self


class Pose(Table):
    """A rigid transform: translation in metres, roll, pitch, yaw in degrees about fixed x, y, z."""

    xyz_m: Vector = (0.0, 0.0, 0.0)
    rpy_deg: Vector = (0.0, 0.0, 0.0)


class Frame(Pose):
    """Where a sensor frame stands in the world, with its calibration error (assumption A6)."""

    pose: Literal["stated", "recorded"] = "stated"
    """Whether the cell states it, or ``/tf_static`` of the recording does."""
    translation_error_m: Metres = 0.0
    rotation_error_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = 0.0

    @model_validator(mode="after")
    def _recorded(self) -> Frame:
        if self.pose == "stated":
            return self
        if {"xyz_m", "rpy_deg"} & self.model_fields_set:
            raise ValueError('pose = "recorded" takes xyz_m and rpy_deg from the recording: leave them away')
        if not {"translation_error_m", "rotation_error_deg"} <= self.model_fields_set:
            raise ValueError(
                'pose = "recorded": a recording does not say how well its transforms are known; state '
                "translation_error_m and rotation_error_deg"
            )
        return self


class JointLimitTable(Table):
    """Limits of one joint that the model or URDF does not give, or that the cell overrides."""

    position_lower_rad: Coordinate | None = None
    position_upper_rad: Coordinate | None = None
    velocity_rad_s: Limit | None = None
    acceleration_rad_s2: Limit | None = None
    jerk_rad_s3: Limit | None = None
    torque_Nm: Limit | None = None
    position_lower_m: Coordinate | None = None
    position_upper_m: Coordinate | None = None
    velocity_m_s: Limit | None = None
    acceleration_m_s2: Limit | None = None
    jerk_m_s3: Limit | None = None
    force_N: Limit | None = None


class LinkCapsule(Table):
    """A capsule around a link for which the URDF has no geometry, in the frame of that link."""

    a_m: Near
    b_m: Near
    radius_m: Annotated[float, Field(gt=0.0, le=100.0)]


class RobotTable(Table):
    """``[robot]``: which arm, what it carries, where it stands."""

    name: str | None = None
    urdf: str | None = None
    tool: str | None = None
    bare_flange: bool = False
    joints: tuple[str, ...] | None = None
    accept_assumed: tuple[Literal["limits", "enclosure"], ...] = ()
    max_sample_gap_s: Annotated[float, Field(gt=0.0, le=2.0)] = 0.1
    knot_spacing_s: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    mount: Pose = Pose()
    tracking: Tracking = Tracking()
    silence: SilenceTable | None = None
    limits: dict[str, JointLimitTable] = Field(default_factory=dict)
    enclosure: dict[str, LinkCapsule] = Field(default_factory=dict)
    package_dirs: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _one_of(self) -> RobotTable:
        if self.name is not None and self.urdf is not None:
            raise ValueError("give either name or urdf, not both")
        if self.tool is not None and self.bare_flange:
            raise ValueError("bare_flange = true contradicts tool = ...: give one of them")
        for path in (self.urdf, self.tool, *self.package_dirs):
            if path is not None and "\0" in path:
                raise ValueError(f"{path!r} names no file: a path has no null character")
        return self


class StopTable(Table):
    """``[stop]``: whose stop, and how finely it is looked at."""

    model: Literal["path_consistent", "measured"] = "path_consistent"
    measured: str | None = None
    """File of a stop model, as ``stopproof stops --model`` writes it; used where ``model`` says so."""
    allow_joint_space: bool = True
    """Stop every joint on its own, leaving the path, where no path-consistent stop keeps the limits."""
    slice_s: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.01

    @property
    def measured_file(self) -> str | None:
        """File of the stop model that is used; ``None``: the stop is this software's."""
        return self.measured if self.model == "measured" else None

    @model_validator(mode="after")
    def _file_of_model(self) -> StopTable:
        if self.model == "measured" and self.measured is None:
            raise ValueError(
                'model = "measured" needs measured, the file that `stopproof stops --model` writes'
            )
        if self.measured is not None and "\0" in self.measured:
            raise ValueError(f"{self.measured!r} names no file: a path has no null character")
        return self


_KEYS_OF_KIND = {
    "box": {"min_m", "max_m"},
    "prism": {"polygon_m", "z_m"},
    "frustum": {"origin_m", "rpy_deg", "horizontal_fov_deg", "vertical_fov_deg", "near_m", "far_m"},
}


class MonitoredTable(Table):
    """``[people.monitored.<name>]``: a convex region of which complete reports list everybody (A5)."""

    kind: Literal["box", "prism", "frustum"]
    detection_time_s: Seconds
    boundary_error_m: Metres = 0.0
    min_m: Vector | None = None
    max_m: Vector | None = None
    polygon_m: tuple[tuple[float, float], ...] | None = None
    z_m: tuple[float, float] | None = None
    origin_m: Vector | None = None
    rpy_deg: Vector | None = None
    horizontal_fov_deg: Angle | None = None
    vertical_fov_deg: Angle | None = None
    near_m: Annotated[float, Field(ge=0.0, le=1e3)] | None = None
    far_m: Positive | None = None

    @model_validator(mode="after")
    def _keys_of_kind(self) -> MonitoredTable:
        wanted = _KEYS_OF_KIND[self.kind]
        given = {key for keys in _KEYS_OF_KIND.values() for key in keys if getattr(self, key) is not None}
        if given != wanted:
            names = ", ".join(sorted(wanted))
            raise ValueError(f"a {self.kind} needs the keys {names} and no others")
        return self


class PeopleTable(Table):
    """``[people]``: what is believed about people and how they are seen."""

    models: tuple[str, ...] = ("iso13855",)
    profile: str = "iso"
    """Name of a bundled profile, or the path of a profile file."""
    approach_speed_m_s: Positive = 2.0
    """Of profile iso; the others have speeds of their own."""
    latency_s: Seconds = 0.05
    clock_error_s: Seconds = 0.0
    stamp_error_s: Seconds = 0.0
    position_error_m: Metres | None = None
    """For points whose report states no error; ``None``: 0.01 m, shown as default."""
    repeated_points: Literal["refused", "measured"] = "refused"
    """Points whose coordinates do not change at all: passed on again, or measured anew."""
    left_right: Literal["may_be_exchanged", "trusted"] = "may_be_exchanged"
    """Whether the source may call a left point right and the other way round."""
    held_object_m: Metres = 0.0
    max_report_gap_s: Annotated[float, Field(gt=0.0, le=3600.0)] | None = None
    empty_report_valid_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.1
    ignored_parts: tuple[str, ...] = ()
    frames: dict[str, Frame] = Field(default_factory=dict)
    point_names: dict[str, str] = Field(default_factory=dict)
    monitored: dict[str, MonitoredTable] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _known_names(self) -> PeopleTable:
        for part in self.ignored_parts:
            if part not in PART_NAMES:
                known = ", ".join(PART_NAMES)
                raise ValueError(f"ignored_parts: {part!r} is not a body part; known: {known}")
        if set(self.ignored_parts) == set(PART_NAMES):
            raise ValueError(
                "ignored_parts: these are all there are, so that nobody would be looked at; leave in those "
                "that the robot must not touch"
            )
        for name, point in self.point_names.items():
            if point not in POINT_NAMES:
                known = ", ".join(POINT_NAMES)
                raise ValueError(f"point_names.{name}: {point!r} is not a point; known: {known}")
        if self.profile != "iso" and "approach_speed_m_s" in self.model_fields_set:
            raise ValueError(f"approach_speed_m_s belongs to profile iso, not to {self.profile}")
        if self.approach_speed_m_s not in ISO_APPROACH_SPEEDS:
            raise ValueError(
                f"approach_speed_m_s = {self.approach_speed_m_s}: profile iso knows "
                f"{' and '.join(map(str, ISO_APPROACH_SPEEDS))} m/s (ISO 13855)"
            )
        if "world" in self.frames:
            raise ValueError(
                "frames.world: world is the frame in which all others are placed; give a sensor frame "
                "another name, and place the robot by [robot.mount]"
            )
        unknown = [name for name in self.models if name not in MODEL_NAMES]
        if unknown or not self.models:
            known = ", ".join(MODEL_NAMES)
            raise ValueError(f"models: {', '.join(unknown) or 'none is named'}; known: {known}")
        if not self.profile.endswith(".toml") and self.profile not in profile_names():
            known = ", ".join(profile_names())
            raise ValueError(f"profile {self.profile!r} is not known; there are {known}, or a file NAME.toml")
        if len(self.models) + len(self.monitored) > MAX_MODELS:
            raise ValueError(f"monitored: models and regions together must be at most {MAX_MODELS}")
        return self


_KEYS_OF_FIXTURE: dict[str, tuple[set[str], set[str]]] = {
    "box": ({"xyz_m", "size_m"}, {"rpy_deg"}),
    "capsule": ({"a_m", "b_m", "radius_m"}, set()),
    "plane": ({"point_m", "normal"}, set()),
    "mesh": ({"file"}, {"xyz_m", "rpy_deg", "scale", "pieces"}),
}
"""Kind of fixture -> the keys that it needs, and those that it may have."""


class FixtureTable(Table):
    """``[workspace.fixtures.<name>]``: something that stands in the cell; no link may come near it."""

    kind: Literal["box", "capsule", "plane", "mesh"]
    position_error_m: Metres = 0.0
    may_touch: tuple[str, ...] = ()
    """Links that are not held against it, because they touch it by construction."""
    xyz_m: Vector | None = None
    rpy_deg: Vector | None = None
    size_m: tuple[Positive, Positive, Positive] | None = None
    a_m: Vector | None = None
    b_m: Vector | None = None
    radius_m: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    point_m: Vector | None = None
    normal: Vector | None = None
    file: str | None = None
    scale: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    pieces: Literal["hull", "connected"] | None = None

    @model_validator(mode="after")
    def _keys_of_kind(self) -> FixtureTable:
        needed, possible = _KEYS_OF_FIXTURE[self.kind]
        every = {key for keys in _KEYS_OF_FIXTURE.values() for group in keys for key in group}
        given = {key for key in every if getattr(self, key) is not None}
        if not needed <= given <= needed | possible:
            more = f", may have {', '.join(sorted(possible))}," if possible else ""
            raise ValueError(f"a {self.kind} needs the keys {', '.join(sorted(needed))}{more} and no others")
        if self.file is not None and "\0" in self.file:
            raise ValueError(f"{self.file!r} names no file: a path has no null character")
        return self


class WorkspaceTable(Table):
    """``[workspace]``: floor and fixtures."""

    floor_z_m: Coordinate | None = None
    """Height of the floor in the world; unset: no floor is checked."""
    floor_error_m: Metres = 0.0
    floor_may_touch: tuple[str, ...] = ()
    fixtures: dict[str, FixtureTable] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _floor(self) -> WorkspaceTable:
        if FLOOR in self.fixtures:
            raise ValueError(f"fixtures.{FLOOR}: the floor is stated as floor_z_m; take another name")
        if self.floor_z_m is None and {"floor_error_m", "floor_may_touch"} & self.model_fields_set:
            raise ValueError("floor_error_m and floor_may_touch belong to a floor: give floor_z_m")
        return self


class ContactTable(Table):
    """``[[criteria.contact]]``: links that may touch body parts, slowly and where they cannot clamp them."""

    links: Annotated[tuple[str, ...], Field(min_length=1)]
    parts: Annotated[tuple[str, ...], Field(min_length=1)]
    person_speed: Literal["added", "neglected"] = "added"
    """Whether the part may come towards the link at the profile's speed, or counts as standing still."""
    moving_mass_kg: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    """With ``payload_kg``: the robot arrives with M/2 + m_L; unset: it counts as infinitely heavy."""
    payload_kg: Annotated[float, Field(ge=0.0, le=1e6)] | None = None

    @model_validator(mode="after")
    def _usable(self) -> ContactTable:
        for part in self.parts:
            if part not in PART_NAMES:
                raise ValueError(f"parts: {part!r} is not a body part; known: {', '.join(PART_NAMES)}")
        if (self.moving_mass_kg is None) != (self.payload_kg is None):
            raise ValueError("moving_mass_kg and payload_kg belong together: give both, or none")
        return self


class CriteriaTable(Table):
    """``[criteria]``: rules besides separation."""

    self_collision: bool = False
    """Hold moving links against each other."""
    links_may_touch: tuple[tuple[str, str], ...] = ()
    """Pairs of links that are not held against each other."""
    contact_limits: str = "ts15066"
    """Name of bundled limits of contact, or the path of a file of the same form."""
    accept_unverified: bool = False
    """Accept limits of contact that nobody has compared with their source."""
    gaps_by_design: tuple[tuple[str, str], ...] = ()
    """Pairs of links in whose gap nothing can be clamped."""
    contact: tuple[ContactTable, ...] = ()

    @model_validator(mode="after")
    def _belong_together(self) -> CriteriaTable:
        if self.links_may_touch and not self.self_collision:
            raise ValueError("links_may_touch belongs to self_collision = true")
        belong = {"contact_limits", "accept_unverified", "gaps_by_design"} & self.model_fields_set
        if belong and not self.contact:
            raise ValueError(f"{', '.join(sorted(belong))}: belongs to [[criteria.contact]]")
        known = contact_limits_names()
        if not self.contact_limits.endswith(".toml") and self.contact_limits not in known:
            raise ValueError(
                f"contact_limits {self.contact_limits!r} is not known; there are {', '.join(known)}, "
                "or a file NAME.toml"
            )
        return self


class FloorTable(Table):
    """``[recording.floor]``: what a source that has positions on the floor says about a person."""

    error_m: Metres
    """Largest horizontal distance of the middle of the pelvis from the position that is reported."""
    floor_z_m: Coordinate = 0.0
    """Height of the floor in the frame of the positions."""


class SwitchTable(Table):
    """``[recording.switch]``: what a switch that watches the monitored regions says."""

    free_when: bool
    """Its value while nobody is in any of the regions."""
    age_s: Seconds
    """How much older than its message time a state may be."""
    regions: Annotated[tuple[str, ...], Field(min_length=1)]
    """The regions that it speaks for: all that the cell has."""


class RecordingTable(Table):
    """``[recording]``: which topics and joints of a recording are meant; its clocks and frames."""

    joints_topic: str | None = None
    people_topic: str | None = None
    joint_prefix: str | None = None
    """Stands before the joint names of the arm in the recording."""
    time_offset_s: Offset | None = None
    """Added to the stamps of people; ``people.clock_error_s`` is its error."""
    joints_time_offset_s: Offset | None = None
    """Added to the stamps of joints, likewise."""
    base_frame: str | None = None
    """Frame of the transforms in the recording that is the base of the arm's model."""
    ros4hri_error_m: Metres | None = None
    """Largest error of frames of ROS4HRI."""
    floor: FloorTable | None = None
    switch: SwitchTable | None = None


class CheckTable(Table):
    """``[check]``: how the comparison is made."""

    margin_m: Annotated[float, Field(ge=1e-5, le=10.0)] = 1e-4
    standstill_speed_m_s: Annotated[float, Field(ge=0.0, le=0.05)] = 0.001
    standstill_error_m: Annotated[float, Field(ge=0.0, le=0.02)] = 0.002
    engine: Literal["coal", "fcl"] = "coal"
    cross_check: bool = False
