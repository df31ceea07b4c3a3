"""A commented cell file to start from; what only the user can know is left as a visible blank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from robots.identity import stated_hash

BLANK = "____"
"""Stands where the user must write something; a cell with a blank left in it is refused."""

_TEMPLATE = """\
# stopproof cell file. Every key carries its unit; docs/cell.md explains each one.
# Replace every {blank}. A key behind '# ' shows its default, or '(no default)' and an example.

# cycle_s = 0.01                       # a new short-term plan is judged every cycle

[robot]
{robot}
# urdf = "arm.urdf"                    # (no default) in place of name
tool = "{blank}"                         # tool file (TOML); or delete this line and state bare_flange = true
# bare_flange = false{contains}
# joints = ["joint_1", "joint_2"]      # (no default) joints that are commanded; unset: those of the model
accept_assumed = []                    # accept "limits" and/or "enclosure" that nobody has published
# max_sample_gap_s = 0.1               # joint samples further apart leave the motion between them unknown
{package_dirs}
# knot_spacing_s = 0.05                # (no default) of the spline through the samples

[robot.mount]                          # pose of the robot base in the world
xyz_m = [0.0, 0.0, 0.0]
rpy_deg = [0.0, 0.0, 0.0]

{tracking}
# [robot.silence]                      # (no default) it stops by itself when no command comes (A4)
# hold_s = 0.01                        # goes on for at most this long
# goes_on_with = "velocity"            # or "acceleration"
# deceleration_rad_s2 = 5.0            # then brakes with at least this, or a list: of each joint
# deceleration_source = "brake test"   # (no default) how it was found: needed above acceleration limits

# [robot.enclosure.forearm_link]       # (no default) capsule around a link for which a URDF has no geometry
# a_m = [0.0, 0.0, 0.0]
# b_m = [0.0, 0.0, 0.4]
# radius_m = 0.07

{limits}
[stop]
# model = "path_consistent"            # or "measured": the robot's own, from a model of its stops
# measured = "stops.toml"              # (no default) that model, by `stopproof stops --model`
# allow_joint_space = true             # leave the path where no path-consistent stop keeps the limits
# slice_s = 0.01

[recording]                            # needed only where several topics or arms could be meant
{joints_topic}       # (no default) where the arm's joints are
{people_topic}             # (no default) where the people are
{joint_prefix}               # (no default) stands before the arm's joint names; is taken off
# time_offset_s = 0.0                  # (no default) added to stamps of people; its error is clock_error_s
# joints_time_offset_s = 0.0           # (no default) added to stamps of joints
# base_frame = "base_link"             # (no default) frame of /tf_static that is the base of the arm's model
# ros4hri_error_m = 0.5                # (no default) largest error of people's frames of ROS4HRI

# [recording.floor]                    # (no default) the source has positions of people on the floor
# error_m = 0.3                        # (no default) largest horizontal distance of the pelvis from them
# floor_z_m = 0.0                      # height of the floor in their frame, whose z points up

# [recording.switch]                    # (no default) the source is a switch that watches the regions
# free_when = false                    # (no default) its value while nobody is in any of them
# age_s = 0.1                          # (no default) how much older than its message a state may be
# regions = ["cell", "scanner", "camera"]  # (no default) all of people.monitored

[people]
# models = ["iso13855"]
# profile = "iso"
# approach_speed_m_s = 2.0             # 1.6 or 2.0
latency_s = {blank}                       # from seeing to arriving here (the default would be 0.05)
{clock_error}
# stamp_error_s = 0.0
# position_error_m = 0.01              # (no default) where a report states no error
# repeated_points = "refused"          # or "measured": coordinates that do not change at all (simulations)
# left_right = "may_be_exchanged"      # or "trusted": the source never calls a left hand right
# held_object_m = 0.0                  # how far an object in the hand reaches beyond it
# max_report_gap_s = 0.5               # (no default) a longer silence contradicts the cell
# empty_report_valid_s = 0.1           # a complete report that lists nobody counts for this long
# ignored_parts = []                   # listed as a waiver with every result

{frames}
# [people.monitored.cell]              # (no default) convex region of which complete reports list everybody
# kind = "box"                         # (no default) people whom nobody lists may come in from outside
# detection_time_s = 0.1               # (no default) whoever was inside for this long is listed
# boundary_error_m = 0.0
# min_m = [-4.0, -4.0, -5.0]
# max_m = [4.0, 4.0, 5.0]

# [people.monitored.scanner]           # (no default) the same for the field of a scanner, in the world
# kind = "prism"                       # (no default)
# detection_time_s = 0.08              # (no default)
# polygon_m = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]]
# z_m = [-5.0, 5.0]

# [people.monitored.camera]            # (no default) the same for a camera that looks along its x
# kind = "frustum"                     # (no default)
# detection_time_s = 0.1               # (no default)
# origin_m = [-3.0, 0.0, 3.0]
# rpy_deg = [0.0, 30.0, 0.0]
# horizontal_fov_deg = 70.0
# vertical_fov_deg = 50.0
# near_m = 0.5
# far_m = 6.0

# [people.point_names]                 # names of the recording = names of docs/recordings.md
# "RightHand" = "r_hand"

[workspace]                            # without floor and fixtures none are checked
# floor_z_m = 0.0                      # (no default) everything below is solid
# floor_error_m = 0.0
# floor_may_touch = []                 # links that are not held against it; a waiver

# [workspace.fixtures.table]           # (no default) something that stands in the cell
# kind = "box"                         # (no default)
# position_error_m = 0.0
# may_touch = []                       # links that touch it by construction; a waiver
# xyz_m = [0.6, 0.0, -0.1]             # (no default) its middle
# size_m = [0.8, 1.2, 0.05]            # (no default)
# rpy_deg = [0.0, 0.0, 0.0]            # (no default)

# [workspace.fixtures.post]            # (no default) the same for a round one
# kind = "capsule"                     # (no default)
# a_m = [-0.8, 0.5, -0.8]              # (no default)
# b_m = [-0.8, 0.5, 1.5]               # (no default)
# radius_m = 0.05                      # (no default)

# [workspace.fixtures.wall]            # (no default) the same for a plane: solid away from its normal
# kind = "plane"                       # (no default)
# point_m = [-1.0, 0.0, 0.0]           # (no default)
# normal = [1.0, 0.0, 0.0]             # (no default)

# [workspace.fixtures.machine]         # (no default) the same for a mesh
# kind = "mesh"                        # (no default)
# file = "machine.stl"                 # (no default)
# scale = 0.001                        # (no default) for a file in mm
# pieces = "connected"                 # (no default) or "hull"

[criteria]
# self_collision = false               # hold moving links against each other
# links_may_touch = []                 # pairs that are not; a waiver
# contact_limits = "ts15066"           # of [[criteria.contact]], or a file "ours.toml"
# accept_unverified = false            # nobody has compared the bundled ones with the standard
# gaps_by_design = []                  # pairs of links between which nothing can be clamped; a waiver

# [[criteria.contact]]                 # (no default) links that may touch body parts, slowly
# links = ["wrist_3_link"]             # (no default)
# parts = ["l_hand", "r_hand"]         # (no default) all others stay apart
# person_speed = "added"               # or "neglected": the part stands still
# moving_mass_kg = 15.0                # (no default) unset: the robot counts as infinitely heavy
# payload_kg = 1.0                     # (no default) both or none

[check]
# margin_m = 0.0001
# standstill_speed_m_s = 0.001         # a link that is nowhere faster
# standstill_error_m = 0.002           # and errs by no more counts as at rest
# engine = "coal"                      # or "fcl"
# cross_check = false                  # compare both engines on every near pair; slow
"""


_TRACKING = """\
[robot.tracking]                       # how well the robot follows the command (A2)
# position_error_rad = "measured"      # or a number: largest joint error; a supervisor needs one
# velocity_error_rad_s = 0.0
# delay_min_s = 0.0                    # from command to motion
# delay_max_s = 0.0
"""

_LIMITS = """\
# [robot.limits.elbow_joint]           # (no default) limits that the model does not give
# position_lower_rad = -3.1
# position_upper_rad = 3.1
# velocity_rad_s = 3.1
# acceleration_rad_s2 = 10.0
# jerk_rad_s3 = 400.0
# torque_Nm = 150.0

# [robot.limits.slide]                 # (no default) the same for a prismatic joint
# position_lower_m = 0.0
# position_upper_m = 1.0
# velocity_m_s = 0.5
# acceleration_m_s2 = 2.0
# jerk_m_s3 = 20.0
# force_N = 200.0
"""

_FRAME = """\
# [people.frames.camera]               # (no default) a sensor frame that reports may name
# pose = "stated"                      # or "recorded": from /tf_static; then without xyz_m and rpy_deg
# xyz_m = [0.0, 0.0, 0.0]
# rpy_deg = [0.0, 0.0, 0.0]
# translation_error_m = 0.0
# rotation_error_deg = 0.0
"""

_SEEN_FRAME = """\
[people.frames.{frame}]  # the recording has reports in this frame: where it stands in the world
# pose = "recorded"  # in place of xyz_m and rpy_deg: /tf_static of the recording says it
xyz_m = [{blank}, {blank}, {blank}]
rpy_deg = [{blank}, {blank}, {blank}]
translation_error_m = {blank}
rotation_error_deg = {blank}
"""


_CONTAINS = "\n# the model contains {contains}; bare_flange = true says that nothing hangs beyond it"
_PACKAGE_DIRS = (
    "# package_dirs = []                    # folders in which package:// meshes of a URDF are looked for"
)
_CLOCK_ERROR = "# clock_error_s = 0.0                  # sensor clock against robot clock"

_TOPICS = {
    "joints_topic": '# joints_topic = "/joint_states"',
    "people_topic": '# people_topic = "/people"',
    "joint_prefix": '# joint_prefix = "left_"',
}


@dataclass(frozen=True, slots=True)
class Filled:
    """Parts of a cell file that are known, as TOML; ``None``: as it stands there for everybody.

    Attributes
    ----------
    arm:
        ``name = …`` or ``urdf = …`` of ``[robot]``.
    tracking, limits:
        The tables ``[robot.tracking]`` and ``[robot.limits]``.
    contains:
        What the arm of the catalogue has beyond its flange.
    package_dirs:
        ``package_dirs = …`` of ``[robot]``.
    clock_error:
        ``clock_error_s = …`` of ``[people]``.
    choices:
        Keys of ``[recording]`` that must be filled in, and what could be meant.
    """

    arm: str | None = None
    tracking: str | None = None
    limits: str | None = None
    contains: str | None = None
    package_dirs: str | None = None
    clock_error: str | None = None
    choices: Mapping[str, Sequence[str]] = field(default_factory=dict)


def template(robot: str | None, frames: Sequence[str] = (), filled: Filled | None = None) -> str:
    """Return the text of a commented cell file.

    Parameters
    ----------
    robot:
        Arm of the catalogue, or ``urdf:<name>:<hash>`` as a recording states it; ``None``: blank.
    frames:
        Frames of the reports about people other than the world: their poses become blanks.
    filled:
        What is known of the rest.
    """
    filled = filled or Filled()
    meant = filled.choices
    topics = {key: _choice(key, meant[key]) if key in meant else line for key, line in _TOPICS.items()}
    seen = [_SEEN_FRAME.format(frame=toml_string(frame), blank=BLANK) for frame in frames]
    return _TEMPLATE.format(
        robot=filled.arm or _arm(robot),
        blank=BLANK,
        tracking=filled.tracking or _TRACKING,
        limits=filled.limits or _LIMITS,
        contains="" if filled.contains is None else _CONTAINS.format(contains=filled.contains),
        package_dirs=filled.package_dirs or _PACKAGE_DIRS,
        clock_error=filled.clock_error or _CLOCK_ERROR,
        frames="\n".join(seen) or _FRAME,
        **topics,
    )


def _choice(key: str, meant: Sequence[str]) -> str:
    return f'{key} = "{BLANK}"  # one of {", ".join(map(toml_string, meant))}'


def _arm(robot: str | None) -> str:
    digest = stated_hash(robot)
    if digest is not None:
        return f'urdf = "{BLANK}"                          # the imported one, with the hash {digest}'
    return f"name = {toml_string(BLANK if robot is None else robot)}"


def toml_string(text: str) -> str:
    """Return a name of a recording as a TOML string, also as a key; it cannot end the string or its line.

    A lone half of a surrogate pair, for which TOML has no spelling, becomes a replacement character.
    """
    return f'"{"".join(map(_toml_character, text))}"'


def _toml_character(character: str) -> str:
    if character in '"\\':
        return f"\\{character}"
    if character.isprintable():
        return character
    code = ord(character)
    if 0xD800 <= code < 0xE000:
        return "\\uFFFD"
    return f"\\u{code:04X}" if code < 0x10000 else f"\\U{code:08X}"
