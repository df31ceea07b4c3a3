"""The text of the file of a stop model; read by :mod:`verifier.stop_model`."""

from __future__ import annotations

from verifier.stops.fit import Fit
from verifier.stops.recorded import AllStops


def model_text(found: AllStops, fitted: Fit) -> str:
    """Return the file of a model."""
    model, joints = fitted.model, found.recordings[0].motion.joints
    return "\n".join(
        [
            "# How one arm stopped in some recordings, with a margin: no bound for other loads or poses.",
            f"robot = {_text('' if found.robot is None else found.robot.name)}",
            f"joints = [{', '.join(map(_text, joints))}]",
            f"delay_s = {model.delay_s!r}",
            f"braking_time_s = {model.braking_time_s!r}",
            f"deceleration_rad_s2 = {model.deceleration.tolist()!r}",
            f"fastest_rad_s = {model.fastest.tolist()!r}",
            f"margin = {float(fitted.margin)!r}",
            f"source = {_text(_source(found, fitted))}",
            "",
        ]
    )


def _source(found: AllStops, fitted: Fit) -> str:
    names = ", ".join(each.motion.path.name for each in found.recordings)
    out = sum(not held.within for held in fitted.held)
    held = f"{out} of {len(fitted.held)} stops that were held out exceed the model of the others"
    drift = f"; {len(fitted.drift)} joints drift" if fitted.drift else ""
    rise = max(fitted.faster)
    faster = (
        f"; some got up to {rise:.2g} faster after they were told" if rise > found.settings.standstill else ""
    )
    return f"worst of {fitted.stops} stops in {names} ({', '.join(fitted.causes)}); {held}{drift}{faster}"


def _text(value: str) -> str:
    """Return a TOML string; what does not print, and quotes, escaped."""
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
