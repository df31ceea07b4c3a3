"""Topics of recordings, and the names of ours (docs/recordings.md)."""

from __future__ import annotations

from dataclasses import dataclass

JOINT_TOPIC = "/joint_states"
PEOPLE_TOPIC = "/people"
VERDICT_TOPIC = "/verdict"
COMMAND_TOPIC = "/joint_commands"
"""Where the joints were commanded to be; read by ``stopproof stops``."""
SCENE_TOPIC = "/stopproof/scene"
FIXTURES_TOPIC = "/stopproof/fixtures"
FRAMES_TOPIC = "/stopproof/frames"
SHOWN_VERDICT_TOPIC = "/stopproof/verdict"
ADDED_TOPICS = frozenset({SCENE_TOPIC, FIXTURES_TOPIC, FRAMES_TOPIC, SHOWN_VERDICT_TOPIC})
"""What ``stopproof verify --out`` adds for viewers; never read."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic: name, schema and encoding of its messages, how many there are."""

    name: str
    schema: str
    encoding: str
    messages: int
