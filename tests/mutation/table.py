"""Which tests belong to which file of the trusted core, and of what judges recordings by it."""

from __future__ import annotations

from typing import Final

_RECORDED: Final = ("verifier/test_cycle.py", "verifier/test_replay.py", "verifier/test_report.py")
_PEOPLE: Final = (
    "occupancy/test_iso13855.py",
    "occupancy/test_inclusion.py",
    "occupancy/test_inclusion_kernels.py",
)
_MODELS: Final = "occupancy/test_people_models.py"
_ARTICULATED: Final = ("occupancy/test_articulated.py", "occupancy/test_belied.py", *_PEOPLE)
_ARM_REACH: Final = (
    "occupancy/test_arm_bounds.py", "occupancy/test_belied.py", "occupancy/test_arm_reach_laws.py",
    "occupancy/test_reach_sets.py", "occupancy/test_arm_reach.py",
)  # fmt: skip
_GATE: Final = (
    "occupancy/test_measurement.py", "occupancy/test_hypotheses.py", "occupancy/test_gate_kernels.py",
    "occupancy/test_exchanged_sides.py", "occupancy/test_repeats.py", "occupancy/test_leaving.py",
    "soundness/test_gate_faults.py",
)  # fmt: skip
_MONITORED: Final = (
    "occupancy/test_region.py", "occupancy/test_leaving.py", "occupancy/test_unobserved.py",
    "verifier/test_monitored.py",
)  # fmt: skip
_SEPARATION: Final = (
    "occupancy/test_separation.py", "occupancy/test_distances.py", "occupancy/test_undecided.py",
    "occupancy/test_engines.py",
)  # fmt: skip
_FIXTURES: Final = (
    "occupancy/test_workspace_kernels.py", "occupancy/test_workspace.py", "occupancy/test_self_collision.py",
    "verifier/test_robot_criteria.py",
)  # fmt: skip
_TOUCH: Final = (
    "occupancy/test_contact_kernels.py", "occupancy/test_contact.py", "verifier/test_contact_criterion.py",
)  # fmt: skip
_CONFORMANCE: Final = (
    "occupancy/test_containment.py", "occupancy/test_conformance.py", "occupancy/test_identification.py",
)  # fmt: skip
_CORRIDOR: Final = (
    "occupancy/test_corridor_kernels.py", "occupancy/test_corridor.py", "verifier/test_batch.py",
)  # fmt: skip
_PLANS: Final = (
    "failsafe/test_trajectory.py", "failsafe/test_scaling.py", "failsafe/test_manoeuvre.py",
    "failsafe/test_short_term_plan.py", "failsafe/test_follow.py", "failsafe/test_running_plan.py",
    "failsafe/test_preparation.py",
)  # fmt: skip
_ENCLOSURE: Final = (
    "robots/test_capsule.py", "robots/test_shapes.py", "robots/test_enclosure.py",
)  # fmt: skip
_MODEL: Final = (
    "robots/test_limits.py", "robots/test_urdf_rules.py", "robots/test_urdf.py", "robots/test_model.py",
    "robots/test_catalog.py",
)  # fmt: skip
_LOOP: Final = (
    "verifier/test_tracking.py", "verifier/test_supervisor.py", "verifier/test_supervisor_stateful.py",
    "verifier/test_loop.py", "docs/test_supervisor_doc.py",
)  # fmt: skip
_HINDSIGHT: Final = (
    "verifier/test_borders_of_stretches.py", "verifier/test_delay_in_hindsight.py", "verifier/test_replay.py",
    "verifier/test_hindsight.py",
)  # fmt: skip
_BATCH: Final = ("verifier/test_batch.py", "verifier/test_sizes.py", "occupancy/test_corridor.py")
_PROPOSED: Final = ("verifier/test_joint_velocity_and_way_back.py", "verifier/test_connector.py")

JUDGES_RECORDINGS: Final = tuple(
    f"verifier/{name}.py" for name in ("arrivals", "batch", "hindsight", "judge", "quick_proof", "section")
)
"""Outside of the trusted core, but what verify answers rests on them."""

TESTS: Final[dict[str, tuple[str, ...]]] = {
    "robots/assumption.py": ("robots/test_limits.py", "robots/test_catalog.py"),
    "robots/capsule.py": _ENCLOSURE,
    "robots/card.py": ("robots/test_catalog.py", "verifier/test_command_line.py", "docs/test_schemas.py"),
    "robots/catalog.py": (
        "robots/test_catalog.py", "robots/test_enclosure.py", "verifier/test_which_robot.py",
    ),
    "robots/enclosure.py": (*_ENCLOSURE, "occupancy/test_swept.py"),
    "robots/collada.py": ("robots/test_collada.py",),
    "robots/errors.py": _MODEL,
    "robots/files.py": ("robots/test_files.py", *_MODEL),
    "robots/geometry.py": (*_ENCLOSURE, "robots/test_urdf_rules.py", "robots/test_mesh_rules.py"),
    "robots/identity.py": (*_MODEL, "verifier/test_which_robot.py"),
    "robots/inertia.py": ("robots/test_inertia.py", "failsafe/test_dynamics.py"),
    "robots/kernels.py": ("robots/test_kernels.py", "robots/test_reach.py", "occupancy/test_swept.py"),
    "robots/limits.py": _MODEL,
    "robots/mesh_rules.py": ("robots/test_mesh_rules.py", "robots/test_collada.py"),
    "robots/model.py": (*_MODEL, "robots/test_kernels.py", "robots/test_enclosure.py"),
    "robots/motion.py": (*_PLANS, "occupancy/test_swept.py"),
    "robots/reach.py": ("robots/test_reach.py", "occupancy/test_swept.py"),
    "robots/rounding.py": ("robots/test_rounding.py", "robots/test_reach.py", *_ENCLOSURE),
    "robots/shapes.py": _ENCLOSURE,
    "robots/tool.py": ("robots/test_enclosure.py", "verifier/test_cell_file.py", "docs/test_cell_doc.py"),
    "robots/urdf.py": (*_MODEL, *_ENCLOSURE),
    "robots/urdf_rules.py": _MODEL,
    "occupancy/body.py": (
        "occupancy/test_body.py", "occupancy/test_iso13855.py", "occupancy/test_measurement.py",
    ),
    "occupancy/conformance.py": _CONFORMANCE,
    "occupancy/conformance_kernels.py": _CONFORMANCE,
    "occupancy/contact.py": _TOUCH,
    "occupancy/contact_kernels.py": _TOUCH,
    "occupancy/contact_limits.py": _TOUCH,
    "occupancy/containment.py": (*_CONFORMANCE, "verifier/test_snapshot.py"),
    "occupancy/corridor.py": _CORRIDOR,
    "occupancy/corridor_kernels.py": _CORRIDOR,
    "occupancy/engines.py": ("occupancy/test_engines.py", "occupancy/test_distances.py"),
    "occupancy/gate_kernels.py": _GATE,
    "occupancy/hypotheses.py": (*_GATE, "verifier/test_hindsight.py"),
    "occupancy/identification.py": _CONFORMANCE,
    "occupancy/kernels.py": (
        *_SEPARATION, "occupancy/test_reach_sets.py", "occupancy/test_swept.py",
        "soundness/test_not_a_number.py",
    ),
    "occupancy/ledger_kernels.py": (
        "occupancy/test_ledger_kernels.py", "occupancy/test_prove_apart.py", "occupancy/test_separation.py",
    ),
    "occupancy/measurement.py": (*_GATE, "occupancy/test_unobserved.py"),
    "occupancy/number_table.py": ("occupancy/test_body.py", "occupancy/test_contact.py"),
    "occupancy/recorded.py": _CONFORMANCE,
    "occupancy/pace.py": ("occupancy/test_pace.py", "verifier/test_known.py"),
    "occupancy/pace_kernels.py": ("occupancy/test_pace.py",),
    "occupancy/region.py": _MONITORED,
    "occupancy/repeats.py": ("occupancy/test_repeats.py", "soundness/test_gate_faults.py"),
    "occupancy/report.py": _GATE,
    "occupancy/roll_call.py": (*_MONITORED, *_GATE),
    "occupancy/self_collision.py": (
        "occupancy/test_self_collision.py", "occupancy/test_workspace_kernels.py",
        "verifier/test_robot_criteria.py",
    ),
    "occupancy/separation.py": _SEPARATION,
    "occupancy/sets.py": ("occupancy/test_sets.py", "occupancy/test_swept.py", "occupancy/test_iso13855.py"),
    "occupancy/swept.py": ("occupancy/test_swept.py", "soundness/test_not_a_number.py"),
    "occupancy/volume.py": ("occupancy/test_volume.py",),
    "occupancy/workspace.py": _FIXTURES,
    "occupancy/workspace_kernels.py": _FIXTURES,
    "occupancy/humans/arm_joint_kernels.py": _ARM_REACH,
    "occupancy/humans/arm_kernels.py": _ARM_REACH,
    "occupancy/humans/arm_reach.py": (_MODELS, *_ARM_REACH),
    "occupancy/humans/articulated.py": (_MODELS, *_ARTICULATED),
    "occupancy/humans/catalog.py": (_MODELS, "verifier/test_comparison.py", "verifier/test_snapshot.py"),
    "occupancy/humans/iso13855.py": (_MODELS, *_PEOPLE),
    "occupancy/humans/kernels.py": (
        "occupancy/test_people_kernels.py", *_ARTICULATED, *_GATE, "occupancy/test_pedestrian.py",
        "occupancy/test_unobserved.py",
    ),
    "occupancy/humans/model.py": (_MODELS, *_ARTICULATED),
    "occupancy/humans/options.py": (
        _MODELS, "occupancy/test_people_kernels.py", *_ARM_REACH, *_ARTICULATED,
        "verifier/test_comparison.py",
    ),
    "occupancy/humans/pedestrian.py": (
        _MODELS, "occupancy/test_pedestrian.py", "occupancy/test_inclusion.py",
    ),
    "occupancy/humans/unobserved.py": (_MODELS, *_MONITORED, "occupancy/test_inclusion.py"),
    "failsafe/axis_kernels.py": ("failsafe/test_axis_kernels.py", "failsafe/test_manoeuvre.py", *_PLANS),
    "failsafe/braking.py": ("failsafe/test_braking.py", "verifier/stops/test_measured_in_verify.py"),
    "failsafe/braking_kernels.py": ("failsafe/test_braking.py",),
    "failsafe/axis_stop.py": ("failsafe/test_axis_stop.py", "failsafe/test_stopping.py"),
    "failsafe/box_search.py": ("failsafe/test_box_search.py", "failsafe/test_stopping.py"),
    "failsafe/bracket.py": ("failsafe/test_stopping.py", "failsafe/test_box_search.py"),
    "failsafe/brake_stop.py": ("failsafe/test_brake_stop.py",),
    "failsafe/dynamics.py": ("failsafe/test_dynamics.py", "failsafe/test_brake_stop.py"),
    "failsafe/dynamics_kernels.py": ("failsafe/test_dynamics.py", "failsafe/test_brake_stop.py"),
    "failsafe/joint_velocity.py": (
        "failsafe/test_joint_velocity.py", "verifier/test_joint_velocity_and_way_back.py",
    ),
    "failsafe/limit_kernels.py": ("failsafe/test_limit_kernels.py", "failsafe/test_scaling.py", *_PLANS),
    "failsafe/manoeuvre.py": ("failsafe/test_manoeuvre.py", *_PLANS),
    "failsafe/path_cells.py": ("occupancy/test_corridor.py", "verifier/test_batch.py"),
    "failsafe/path_kernels.py": ("failsafe/test_path_kernels.py", "failsafe/test_manoeuvre.py", *_PLANS),
    "failsafe/preparation.py": ("failsafe/test_preparation.py", *_LOOP),
    "failsafe/running_plan.py": ("failsafe/test_running_plan.py", *_LOOP),
    "failsafe/scaling.py": ("failsafe/test_scaling.py", *_PLANS),
    "failsafe/search_kernels.py": ("failsafe/test_stop_kernels.py", "failsafe/test_scaling.py", *_PLANS),
    "failsafe/plan.py": ("failsafe/test_short_term_plan.py",),
    "failsafe/short_term_plan.py": (
        "failsafe/test_short_term_plan.py", "failsafe/test_follow.py", *_PLANS, "verifier/test_silence.py",
        "failsafe/test_braking.py", "verifier/stops/test_measured_in_verify.py",
    ),
    "failsafe/silence.py": ("failsafe/test_silence.py", "verifier/test_silence.py"),
    "failsafe/silence_kernels.py": ("failsafe/test_silence.py",),
    "failsafe/slice_kernels.py": (
        "failsafe/test_slice_kernels.py", "failsafe/test_short_term_plan.py", *_PLANS,
        "occupancy/test_corridor.py",
    ),
    "failsafe/stop_kernels.py": ("failsafe/test_stop_kernels.py", *_PLANS, "verifier/test_batch.py"),
    "failsafe/stop_grid.py": ("failsafe/test_stopping.py", "failsafe/test_brake_stop.py"),
    "failsafe/stopping.py": ("failsafe/test_stopping.py",),
    "failsafe/box_kernels.py": ("failsafe/test_stopping_kernels.py", "failsafe/test_box_search.py"),
    "failsafe/stopping_kernels.py": ("failsafe/test_stopping_kernels.py", "failsafe/test_box_search.py"),
    "failsafe/trajectory.py": (*_PLANS, "failsafe/test_waypoints.py"),
    "failsafe/trajectory_kernels.py": ("failsafe/test_scaling.py", *_PLANS),
    "failsafe/waypoints.py": ("failsafe/test_waypoints.py",),
    "verifier/verdict.py": (
        "verifier/test_verdict.py", *_RECORDED, *_FIXTURES, *_LOOP, "docs/test_method_doc.py",
    ),
    "verifier/criteria.py": (
        "verifier/test_separation_criterion.py", "verifier/test_robot_criteria.py",
        "verifier/test_contact_criterion.py",
    ),
    "verifier/command.py": _LOOP,
    "verifier/grid.py": ("verifier/test_grid.py", *_LOOP, "verifier/test_faults.py"),
    "verifier/number.py": ("verifier/test_number.py",),
    "verifier/outlook.py": ("verifier/test_safety_state.py",),
    "verifier/proposal.py": _LOOP,
    "verifier/proposed.py": (*_PROPOSED, *_LOOP),
    "verifier/required_distance.py": ("verifier/test_required_distance.py",),
    "verifier/setting_out.py": ("verifier/test_setting_out.py", "verifier/test_safety_state.py"),
    "verifier/supervisor.py": (
        *_LOOP, *_PROPOSED, "verifier/test_faults.py", "verifier/test_safety_state.py",
        "verifier/test_held_plan.py", "verifier/test_supervised_replay.py", "verifier/test_silence.py",
    ),
    "verifier/cycle.py": (
        *_RECORDED, "verifier/test_monitored.py", "verifier/test_contact_criterion.py", *_LOOP,
        "verifier/test_setting_out.py", "soundness/test_not_a_number.py",
    ),
    "verifier/known.py": (
        "verifier/test_known.py", *_RECORDED, "verifier/test_arrivals.py", *_LOOP,
        "verifier/test_hindsight.py",
    ),
    "verifier/tracking.py": ("verifier/test_tracking.py", *_LOOP),
    "verifier/arrivals.py": ("verifier/test_arrivals.py", *_HINDSIGHT),
    "verifier/batch.py": _BATCH,
    "verifier/hindsight.py": ("verifier/test_hindsight.py", *_HINDSIGHT),
    "verifier/judge.py": (
        *_HINDSIGHT, *_RECORDED, "verifier/test_monitored.py", "verifier/test_sizes.py",
        "verifier/test_html_report.py", "verifier/test_silence.py", "verifier/test_locked_motion.py",
    ),
    "verifier/quick_proof.py": _BATCH,
    "verifier/section.py": (
        "verifier/test_section.py", "verifier/test_endless_joint.py", *_HINDSIGHT, "verifier/test_silence.py",
    ),
}  # fmt: skip
"""File -> its test files under tests/, those that look closest first."""


def belonging_to(file: str) -> tuple[str, ...]:
    """Return the test files of a file, from the root of the tree, each once."""
    return tuple(dict.fromkeys(f"tests/{each}" for each in TESTS[file]))
