"""The root of every exception that set-up raises."""

from __future__ import annotations


class SetupError(ValueError):
    """Input that cannot be used: one line that names value, joint or part, and the rule it breaks."""


class ToolError(SetupError):
    """A tool file that cannot be used."""
