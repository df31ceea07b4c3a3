"""Loads and brakes of a stop report: what was stated, and what stands in for what nobody has stated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from failsafe.brake_stop import Brakes
from failsafe.dynamics import ArmDynamics
from robots.assumption import Assumption, Certainty
from robots.catalog import RobotSetup, load_masses, robot_names
from robots.errors import SetupError
from robots.files import read_toml
from robots.inertia import Payload
from robots.model import Mount, RobotModel
from verifier.cell import Cell
from verifier.stop_report.report import Missing
from verifier.stop_report.settings import StopReportSettings

GUESSED_DELAY_S = 0.1
"""Of brakes that nobody has declared; no source."""
_BRAKES = "--payload KG, --brake-torque N_M,…, --brake-delay S"


@dataclass(frozen=True, eq=False)
class Loads:
    """The dynamics of the arm at shares of its payload, and its brakes.

    Attributes
    ----------
    at:
        Share of the payload -> dynamics.
    payload_kg:
        The payload at 100 % [kg].
    brakes, guessed:
        The brakes, and whether nobody has declared them.
    assumptions:
        Masses, payload and brakes.
    """

    at: Callable[[float], ArmDynamics]
    payload_kg: float
    brakes: Brakes | None
    guessed: bool
    assumptions: tuple[Assumption, ...]
    missing: tuple[Missing, ...]


def loads_of(cell: Cell, robot: RobotModel, settings: StopReportSettings) -> Loads | Missing:
    """Return what is known of masses and brakes, or what is missing for all that depends on masses.

    Raises
    ------
    SetupError
        What was stated cannot be used: a payload beyond the rated one, an arm of unknown masses, another
        number of brakes than joints.
    """
    of_urdf = cell.robot.urdf is not None
    rated = None if of_urdf else rated_payload(robot.name)
    mass = settings.payload_kg if settings.payload_kg is not None else None if rated is None else rated.value
    if mass is None:
        why = "nobody has stated a payload, and no rated one is known"
        return Missing("loads, category 0", why, _BRAKES)
    if of_urdf and float(mass) > 0.0 and settings.payload_frame is None:
        raise SetupError("--payload: the flange of a URDF is not known; give --payload-frame LINK too")
    payload = Payload(
        float(mass), np.array(settings.payload_at_m or (0.0, 0.0, 0.0)), frame=settings.payload_frame
    )
    known: dict[float, ArmDynamics] = {}

    def at(share: float) -> ArmDynamics:
        if share not in known:
            masses = load_masses(_arm(cell, robot), payload.scaled(share), setup=_setup(cell))
            known[share] = ArmDynamics(robot, masses)
        return known[share]

    try:
        full = at(1.0)
    except SetupError as error:
        if settings.payload_kg is not None:
            raise
        return Missing("loads, category 0", str(error), "a URDF with masses, then --payload KG")
    brakes, stated, missing = _brakes(robot, settings)
    masses = [*full.masses.assumptions[:-1], _payload(robot.name, float(mass), settings, rated)]
    if settings.payload_at_m is None:
        source = "in the origin of the frame that it hangs on; nobody has stated it"
        masses.append(
            Assumption(f"robot.{robot.name}.payload.centre", "0 0 0", "m m m", source, Certainty.DEFAULT)
        )
    guessed = settings.brake_torque is None
    return Loads(at, float(mass), brakes, guessed, (*masses, *stated), missing)


def rated_payload(name: str) -> Assumption | None:
    """Return the rated payload of an arm of the catalogue [kg], ``None`` where its model file has none."""
    if name not in robot_names():
        return None
    table = read_toml(Path(str(files("robots").joinpath(f"models/{name}.toml")))).get("rated_payload")
    if table is None:
        return None
    return Assumption(
        f"robot.{name}.rated_payload",
        float(table["kg"]),
        "kg",
        table["source"],
        Certainty(table["certainty"]),
    )


def _payload(name: str, mass: float, settings: StopReportSettings, rated: Assumption | None) -> Assumption:
    stated = Assumption(f"robot.{name}.mass.payload", mass, "kg", "stated by the user", Certainty.DECLARED)
    if settings.payload_kg is not None or rated is None:
        return stated
    source = f"nobody has stated one: the rated payload ({rated.source}; {rated.certainty})"
    return replace(stated, source=source, certainty=Certainty.DEFAULT)


def _arm(cell: Cell, robot: RobotModel) -> str | Path:
    return Path(cell.robot.urdf) if cell.robot.urdf is not None else robot.name


def _setup(cell: Cell) -> RobotSetup:
    table = cell.robot
    return RobotSetup(
        mount=Mount.from_xyz_rpy(table.mount.xyz_m, table.mount.rpy_deg),
        commanded=table.joints,
        package_dirs=tuple(Path(entry) for entry in table.package_dirs),
    )


def _brakes(
    robot: RobotModel, settings: StopReportSettings
) -> tuple[Brakes | None, tuple[Assumption, ...], tuple[Missing, ...]]:
    """Return the brakes that were declared, or guesses from the torque limits, and what they rest on."""
    n, unstated = len(robot.joints), "nobody has stated them: guessed"
    torque, delay = settings.brake_torque, settings.brake_delay_s
    certainty, source = Certainty.DECLARED, "stated by the user"
    missing: tuple[Missing, ...] = ()
    if torque is None or delay is None:
        missing = (Missing("brake torques and delay", "nobody has stated them", _BRAKES),)
        if not np.isfinite(robot.limits.torque).all():
            return None, (), missing
        torque, delay = tuple(robot.limits.torque.tolist()), GUESSED_DELAY_S
        certainty, source = Certainty.ASSUMED, f"{unstated} as the torque limit of the joint"
    if len(torque) == 1:
        torque = torque * n
    if len(torque) != n:
        raise SetupError(
            f"--brake-torque: {len(torque)} torques, but there are {n} joints: {', '.join(robot.joints)}; "
            "give one for each, in this order, or one for all"
        )
    sliding = robot.kinematics[0]["prismatic"]
    stated = [
        Assumption(f"brake.torque.{joint}", value, "N" if sliding[j] else "N m", source, certainty)
        for j, (joint, value) in enumerate(zip(robot.joints, torque, strict=True))
    ]
    if not math.isfinite(delay):
        raise SetupError(f"--brake-delay {delay:g}: should be finite")
    waits = "stated by the user" if certainty is Certainty.DECLARED else f"{unstated}, without a source"
    stated.append(Assumption("brake.delay", delay, "s", waits, certainty))
    return Brakes(np.array(torque), delay), tuple(stated), missing
