"""JSON schema of the messages on ``/people``; it is written into every recording."""

from __future__ import annotations

import json

SCHEMA_NAME = "stopproof.People"
SCHEMA_ENCODING = "jsonschema"
SCHEMA = json.dumps(
    {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": SCHEMA_NAME,
        "type": "object",
        "required": ["stamp", "frame", "people"],
        "properties": {
            "stamp": {"type": "number", "description": "when it was seen [s]"},
            "frame": {"type": "string"},
            "complete": {"type": "boolean", "description": "nobody else is in the monitored region"},
            "people": {
                "type": "array",
                "items": {
                    "type": "object",
                    "required": ["id", "points"],
                    "properties": {
                        "id": {"type": "string"},
                        "position_error_m": {"type": "number", "minimum": 0},
                        "points": {
                            "type": "object",
                            "additionalProperties": {
                                "type": "object",
                                "required": ["xyz", "state"],
                                "properties": {
                                    "xyz": {
                                        "type": "array",
                                        "items": {"type": ["number", "null"]},
                                        "minItems": 3,
                                        "maxItems": 3,
                                    },
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
