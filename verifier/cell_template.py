"""A commented cell file to start from; what only the user can know is left as a visible blank."""

from __future__ import annotations

BLANK = "____"
"""Stands where the user must write something; a cell with a blank left in it is refused."""

_TEMPLATE = """\
# stopproof cell file. Every key carries its unit; docs/cell.md explains each one.
# Replace every {blank}; lines that start with '# ' show a key with its default.

# cycle_s = 0.01                       # a new short-term plan is judged every cycle

[robot]
name = "{robot}"
tool = "{blank}"                         # tool file (TOML); or delete this line and state bare_flange = true
# bare_flange = true
accept_assumed = []                    # accept "limits" and/or "enclosure" that nobody has published
# max_sample_gap_s = 0.1               # joint samples further apart leave the motion between them unknown

[robot.mount]                          # pose of the robot base in the world
xyz_m = [0.0, 0.0, 0.0]
rpy_deg = [0.0, 0.0, 0.0]

[robot.tracking]                       # how well the robot follows the command (A2)
# position_error_rad = "measured"      # or a number: largest joint error
# velocity_error_rad_s = 0.0
# delay_min_s = 0.0                    # from command to motion
# delay_max_s = 0.0

[stop]
# model = "path_consistent"
# allow_joint_space = true             # leave the path where no path-consistent stop keeps the limits
# slice_s = 0.01

[people]
# models = ["iso13855"]
# profile = "iso"
# approach_speed_m_s = 2.0             # 1.6 or 2.0
latency_s = {blank}                       # from seeing to arriving here (the default would be 0.05)
# clock_error_s = 0.0                  # sensor clock against robot clock
# stamp_error_s = 0.0
# position_error_m = 0.01              # replaces what the recording states
# held_object_m = 0.0                  # how far an object in the hand reaches beyond it
# max_report_gap_s = 0.5               # a longer silence contradicts the cell; unset: not checked
# empty_report_valid_s = 0.1
# ignored_parts = []                   # listed as a waiver with every result

# [people.frames.camera]               # a sensor frame that reports may name
# xyz_m = [0.0, 0.0, 0.0]
# rpy_deg = [0.0, 0.0, 0.0]
# translation_error_m = 0.0
# rotation_error_deg = 0.0

# [people.point_names]                 # names of the recording -> names of docs/recordings.md
# "RightHand" = "r_hand"

[check]
# margin_m = 0.0001
# standstill_speed_m_s = 0.001         # a link nowhere faster counts as at rest
# engine = "coal"                      # or "fcl"
# cross_check = false                  # ask both engines about every near pair
"""


def template(robot: str | None) -> str:
    """Return the text of a commented cell file for a robot; ``None`` leaves its name blank."""
    return _TEMPLATE.format(robot=BLANK if robot is None else robot, blank=BLANK)
