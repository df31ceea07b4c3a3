"""No forecast reaches what is verified: not by imports, and not by what a mode is handed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable

import numpy as np

from modes.planning.motion import motion_along
from modes.planning.scenario import CELL
from modes.planning.trials import PICK, PLACE
from modes.twin.camera import Camera, CameraSettings
from modes.twin.people import Walking
from tests.source_files import PACKAGES, ROOT, Source, imported, sources
from verifier.cell import Cell
from verifier.command import Cause
from verifier.proposal import NewTrajectory, SceneView
from verifier.supervisor import Supervisor

FORECASTS = ("modes.forecasting", "modes.planning.foresight")


def reached(begin: Iterable[str], known: dict[str, Source]) -> set[str]:
    """Modules that are imported from ``begin``, directly or by way of others, within functions too."""
    waiting, found = list(begin), set[str]()
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        source = known.get(name)
        if source is not None:
            waiting += [each for each, _line in imported(source.tree)]
    return found


def test_nothing_that_verifies_imports_a_forecast_by_any_way() -> None:
    known = {each.name.removesuffix(".py").replace("/", "."): each for each in sources(*PACKAGES)}
    verifying = [
        name for name in known if name.split(".")[0] in {"robots", "occupancy", "failsafe", "verifier"}
    ]
    assert len(verifying) > 100
    assert not {each for each in reached(verifying, known) if each.startswith("modes")}
    assert any(each.startswith(FORECASTS) for each in reached(["modes.planning.scenario"], known)), (
        "it can fail"
    )


def test_a_supervisor_runs_without_any_forecast_being_loaded() -> None:
    code = (
        "import sys, numpy as np\n"
        "from verifier import Cell, Supervisor\n"
        "q = np.array([0.0, -1.5, 1.5, 0.0, 0.0, 0.0])\n"
        "s = Supervisor.from_cell(Cell.from_toml('data/simulate.toml'), q)\n"
        "s.step(0.0, [])\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('modes', 'onnxruntime', 'torch')])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300, check=True
    )
    assert done.stdout.strip() == "[]"


def vandalised(view: SceneView) -> None:
    """Write forecasts over everything that a mode is handed: people are elsewhere, seen just now, exactly."""
    for person in view.people:
        person.xyz[:] = 50.0
        person.t[:] = view.t
        person.error_m[:] = 0.0
    view.q[:] = view.dq[:] = view.dq_ds[:] = 0.0


def verdicts(*, vandal: bool) -> list[tuple[object, ...]]:
    """What was verified, cycle by cycle, beside somebody who walks past."""
    camera = Camera([Walking((1.0, -2.0), (1.0, 2.0), floor_z_m=-0.8)], CameraSettings())
    supervisor = Supervisor.from_cell(Cell.from_table(CELL), np.array(PICK))
    way = motion_along(np.array([PICK, PLACE]), supervisor.check.robot.limits)
    assert supervisor.propose(NewTrajectory(way)) is None
    found = []
    for k in range(300):
        command = supervisor.step(0.01 * k, camera.arrived(0.01 * k))
        held = command.cause is Cause.NOT_VERIFIED
        assert supervisor.view().not_verified == (command.verdict.reason.name if held else "")
        if vandal:
            vandalised(supervisor.view())
        verdict = command.verdict
        found.append((command.outcome, command.cause, verdict.reason, verdict.gap_m, *command.q))
    return found


def test_what_a_mode_does_to_its_view_changes_no_verdict() -> None:
    without, beside = verdicts(vandal=False), verdicts(vandal=True)
    reasons = {each[2] for each in without}
    assert len(reasons) >= 3, "somebody is in the way, and gone again"
    np.testing.assert_equal(beside, without)
