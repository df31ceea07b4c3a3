"""A stop report as plain values for JSON; docs/stop-report.schema.json."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from failsafe.bracket import Bracket
from failsafe.stopping import POINT_SPEED, STOP_ANGLE, STOP_TIME, STOP_WAY
from verifier.protective_separation import SeparationHistory
from verifier.reports.assumptions import assumption_dicts
from verifier.reports.limits import instant_dict, required_dict
from verifier.reports.text import DISCLAIMER
from verifier.stop_report.report import (
    WORDS,
    Distance,
    Grid,
    Missing,
    Pose,
    PoseToMeasure,
    Profile,
    RecordedStops,
    StopCase,
    StopReport,
    TorqueCheck,
)

FORMAT = "stopproof stop-report 1"
KEYS = {STOP_TIME: "time", STOP_ANGLE: "angle", POINT_SPEED: "point_speed", STOP_WAY: "way"}

Json = dict[str, Any]


def report_dict(report: StopReport) -> Json:
    """Return all of a report but its pictures."""
    return {
        "format": FORMAT,
        "version": report.version,
        "disclaimer": DISCLAIMER,
        "robot": report.robot,
        "tool": report.tool,
        "joints": list(report.joints),
        "units": list(report.units),
        "recording": report.recording,
        "stop_model": report.answer.stop,
        "cell_hash": report.cell_hash,
        "interrupted": report.interrupted,
        "seconds": finite(report.seconds),
        "waived": list(report.waived),
        "speed": report.speed,
        "speeds": report.speeds.tolist(),
        "reaction": {"seconds": report.reaction.seconds, "parts": assumption_dicts(report.reaction.parts)},
        "answer": _answer(report),
        "worst_case": [
            {**_bracket(bracket), **_of_case(case), "t": None if instant is None else instant.t}
            for _number, case, bracket, instant in report.numbered()
        ],
        "grids": [_grid(each, report) for each in report.grids],
        "required_distances": [_distance(each) for each in report.distances],
        "recorded": None if report.recorded is None else _recorded(report.recorded),
        "protective_separation": None if report.separation is None else _separation(report.separation),
        "profile": _profile(report.profile, report.joints),
        "torques": [_torque(each) for each in report.torques],
        "worst_poses": [_pose(each) for each in report.poses],
        "to_measure": [_to_measure(each) for each in report.to_measure],
        "missing": [_missing(each) for each in report.missing],
        "assumptions": assumption_dicts(report.assumptions),
        "inputs": [
            {"what": each.what, "file": each.file, "bytes": each.bytes, "sha256": each.sha256}
            for each in report.inputs
        ],
    }


def finite(value: float) -> float | None:
    """Return a number, ``None`` where there is none."""
    return float(value) if math.isfinite(value) else None


def _answer(report: StopReport) -> Json:
    """The first page: the numbers of one stop, each the place of a bracket in ``worst_case``."""
    places = {id(bracket): number for number, _case, bracket, _instant in report.numbered()}
    case = report.answer

    def largest(quantity: str) -> int | None:
        found = case.largest(quantity)
        return None if found is None else places[id(found)]

    needed = [
        k for k, each in enumerate(report.distances) if (each.stop, each.over) == (case.stop, case.over)
    ]
    return {
        **_of_case(case),
        "description": WORDS[case.stop],
        "speeds": report.answer_speeds.tolist(),
        "total_s": report.total_s,
        "time": largest(STOP_TIME),
        "angles": [places[id(each)] for each in case.of(STOP_ANGLE)],
        "point_speed": largest(POINT_SPEED),
        "way": largest(STOP_WAY),
        "required_distances": needed,
    }


def _of_case(case: StopCase) -> Json:
    return {"stop": case.stop, "over": case.over, "guessed": case.guessed}


def _bracket(each: Bracket) -> Json:
    witness = each.witness
    return {
        "quantity": each.quantity,
        "part": each.part,
        "lower": each.lower,
        "upper": finite(each.upper),
        "unit": each.unit,
        "gap": each.gap,
        "configuration": None if witness is None else witness.q.tolist(),
        "speeds": None if witness is None else witness.dq.tolist(),
        "accelerations": None if witness is None else witness.ddq.tolist(),
        "method": each.method,
        "ended": str(each.ended),
        "reason": each.reason,
        "seconds": finite(each.seconds),
    }


def _grid(each: Grid, report: StopReport) -> Json:
    largest, reaction = each.grid.largest_extension, report.reaction.seconds
    return {
        "stop": each.stop,
        "categories": list(each.categories),
        "guessed": each.guessed,
        "load_matters": each.grid.load_matters,
        "load_kg": each.load_kg,
        "speeds": each.speed.tolist(),
        "complete": each.grid.complete,
        "largest_extension_m": {"lower": largest.lower, "upper": finite(largest.upper)},
        "cells": [
            {
                "extension": cell.extension,
                "speed": cell.speed,
                "load": cell.load,
                "extension_m": finite(cell.extension_m),
                "reaction_s": reaction,
                "reaction_angle": (reaction * cell.speed * each.speed).tolist(),
                "reaction_way_m": _reaction_way(cell.brackets, reaction),
                "braking": _braking(cell.brackets),
            }
            for cell in each.grid.cells
        ],
    }


def _reaction_way(brackets: Iterable[Bracket], reaction: float) -> float | None:
    """The fastest point goes on for the reaction time."""
    return next((finite(reaction * each.upper) for each in brackets if each.quantity == POINT_SPEED), None)


def _braking(brackets: tuple[Bracket, ...]) -> Json:
    def pairs(quantity: str) -> list[Bracket]:
        return [each for each in brackets if each.quantity == quantity]

    def worst(quantity: str) -> Json | None:
        found = max(pairs(quantity), key=lambda each: (each.upper, each.lower), default=None)
        return None if found is None else _pair(found)

    return {
        "time_s": worst(STOP_TIME),
        "times_s": [_pair(each) for each in pairs(STOP_TIME)],
        "angles": [_pair(each) for each in pairs(STOP_ANGLE)],
        "point_speed_m_s": worst(POINT_SPEED),
        "way_m": worst(STOP_WAY),
    }


def _pair(each: Bracket) -> Json:
    return {"part": each.part, "lower": each.lower, "upper": finite(each.upper), "reason": each.reason}


def _distance(each: Distance) -> Json:
    return {
        "stop": each.stop,
        "over": each.over,
        "symbol": "S",
        "edition": each.edition,
        "form": each.form,
        "known": assumption_dicts(each.known),
        "distance_m": None if each.required is None else each.required.distance_m,
        "required": None if each.required is None else required_dict(each.required),
        "missing": [_missing(item) for item in each.missing],
    }


def _missing(each: Missing) -> Json:
    return {"what": each.what, "why": each.why, "remedy": each.remedy}


def _recorded(each: RecordedStops) -> Json:
    return {
        "cycles": len(each.t),
        "looked_at": each.looked_at,
        "planned": each.planned,
        "without_stop": each.without_stop,
        "beyond_end": each.beyond_end,
        "off_path": each.off_path,
        "t": _series(each.t),
        "stop_time_s": _series(each.stop_time_s),
    }


def _series(values: np.ndarray) -> list[float | None]:
    return [round(value, 6) if math.isfinite(value) else None for value in values.tolist()]


def _separation(each: SeparationHistory) -> Json:
    return {
        "profile": each.profile,
        "compared": each.compared,
        "too_close": each.too_close,
        "t": _series(each.t),
        "separation_m": _series(each.separation_m),
        "required_m": _series(each.required_m),
        "worst": None if each.worst is None else {**instant_dict(each.worst), "room_m": each.worst.room_m},
    }


def _profile(each: Profile, joints: tuple[str, ...]) -> Json:
    return {
        "stop": each.stop,
        "over": each.over,
        "t": _series(each.t),
        "joints": [
            {"joint": joint, "way": _series(each.way[:, j]), "speed": _series(each.speed[:, j])}
            for j, joint in enumerate(joints)
        ],
    }


def _torque(each: TorqueCheck) -> Json:
    allowed = each.allowed
    return {
        "load_kg": each.load_kg,
        "share_guaranteed": allowed.guaranteed,
        "share_found": allowed.found,
        "joint": allowed.joint,
        "configuration": None if allowed.witness is None else allowed.witness.q.tolist(),
        "torques": [
            {"joint": item.part, "unit": item.unit, "lower": item.lower, "upper": finite(item.upper)}
            for item in each.brackets
        ],
    }


def _pose(each: Pose) -> Json:
    return {
        "title": each.title,
        "stop": each.stop,
        "configuration": each.q.tolist(),
        "speeds": each.dq.tolist(),
        "link": each.link,
        "point_m": each.fastest.tolist(),
        "point_speed_m_s": float(np.linalg.norm(each.velocity)),
    }


def _to_measure(each: PoseToMeasure) -> Json:
    return {
        "stop": each.stop,
        "guessed": each.guessed,
        "load_kg": each.load_kg,
        "t": None if each.instant is None else each.instant,
        **_bracket(each.bracket),
    }
