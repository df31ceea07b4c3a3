"""JSON schema of the messages on ``/people``; it is written into every recording."""

from __future__ import annotations

import json

SCHEMA_NAME = "stopproof.People"
SCHEMA_ENCODING = "jsonschema"
POINT = {"type": "array", "items": {"type": ["number", "null"]}, "minItems": 3, "maxItems": 3}
SCHEMA = json.dumps(
    {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_NAME,
        "type": "object",
        "required": ["stamp", "frame", "people"],
        "properties": {
            "stamp": {"type": "number", "description": "when it was seen [s]"},
            "frame": {"type": "string"},
            "complete": {
                "anyOf": [{"type": "boolean"}, {"type": "array", "items": {"type": "string"}}],
                "description": "nobody else is in the monitored regions, or in those that are listed",
            },
            "unknown_points": {
                "type": "array",
                "items": {"type": "string"},
                "description": "names of points that the source has and the writer did not know",
            },
            "people": {
                "type": "array",
                "items": {
                    "type": "object",
                    "required": ["id"],
                    "anyOf": [{"required": ["points"]}, {"required": ["floor"]}],
                    "properties": {
                        "id": {"type": "string"},
                        "position_error_m": {"type": "number", "minimum": 0},
                        "floor": {
                            "type": "object",
                            "required": ["xyz", "error_m"],
                            "description": "where somebody stands of whom no more is known",
                            "properties": {
                                "xyz": POINT,
                                "error_m": {
                                    "type": "number",
                                    "minimum": 0,
                                    "description": "m; largest horizontal distance of the pelvis from it",
                                },
                                "up": POINT | {"description": "1; unit vector away from the floor"},
                            },
                        },
                        "points": {
                            "type": "object",
                            "additionalProperties": {
                                "type": "object",
                                "required": ["xyz", "state"],
                                "properties": {
                                    "xyz": POINT,
                                    "state": {"enum": ["measured", "inferred"]},
                                    "error_m": {"type": "number", "minimum": 0},
                                },
                            },
                        },
                    },
                },
            },
        },
    },
    separators=(",", ":"),
).encode()
