"""A simulated arm that is guided, then hit: what the contact mode makes of it.

No supervisor is in between; `modes/contact/scenario.py` has one. Needs the extra `twin`:

    python examples/contact.py
"""

from __future__ import annotations

import numpy as np

from modes.contact.admittance import CyclicTask
from modes.contact.course import Loop
from modes.contact.detection import Residual
from modes.contact.machine import ContactMachine, ContactSettings
from modes.contact.touches import Blow, Hand, Spot
from modes.contact.twin import Body, Twin
from modes.contact.wrench import SensorLimits, ToolLoad
from modes.tool_frame import ToolFrame
from robots.catalog import RobotSetup, load_robot

BEGIN = np.deg2rad([0.0, 20.0, -10.0, 0.0, 60.0, 0.0])
GRIP = Spot("tool", (0.0, 0.0, -0.1))


def main() -> None:
    """Simulate fifteen seconds, and print every state that is entered."""
    body = Body()
    robot = load_robot("kr5_sixx", setup=RobotSetup(bare_flange=True))
    here = ToolFrame(robot, np.array(body.flange_m)).pose(BEGIN)[1]
    settings = ContactSettings(
        Residual(body.gains_Nm_A),
        load=ToolLoad(body.tool_kg, np.array([0.0, 0.0, -0.5 * body.tool_m]), body.bias),
        sensor=SensorLimits(range_N=body.range_N, range_Nm=body.range_Nm),
        sensor_m=body.flange_m,
    )
    task = CyclicTask(here + np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]), leg_s=3.0)
    loop = Loop(Twin(robot, BEGIN, body), ContactMachine(robot, task, settings))
    touches = (
        Hand(GRIP, 2.0, 6.0, away_m=(0.0, 0.0, 0.08)),
        Blow(GRIP, 12.0, peak_N=60.0),
    )
    course = loop.run(15.0, touches)
    for change in course.changes():
        print(f"{change.t:6.2f} s  {change.state.value:14} {change.reason.value}")
    held = [d.place for t, d in zip(course.t, course.decisions, strict=True) if 5.0 <= t < 5.5]
    print(f"led upwards by {1e3 * (np.mean(held, axis=0) - here)[2]:.0f} mm")


if __name__ == "__main__":
    main()
