"""A recording with its verdicts and scenes in it, for a viewer: what ``verify --out`` writes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from verifier.outcome_colours import OUTCOME_COLOURS
from verifier.recordings.copying import Additions, copy_with_verdicts
from verifier.recordings.spool import Added, AddedTopic, Spool
from verifier.recordings.topic import SHOWN_VERDICT_TOPIC
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import VerifyReport
from verifier.verdict import Reason, Status

RECORD: Final = "stopproof.verify"
"""Name of the metadata record that says what was judged."""
SHOWN_VERDICT: Final[dict[str, Any]] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "stopproof.ShownVerdict",
    "description": "What was found for the cycle at the time of the message.",
    "type": "object",
    "properties": {
        "t": {"type": "number", "description": "s; since cycle 0, as per_cycle.t of the JSON result"},
        "status": {"type": "integer", "description": "as per_cycle.status of the JSON result"},
        "outcome": {"type": "string", "description": "the name of the status"},
        "reason": {"type": "string", "description": "the name of the reason"},
        "text": {"type": "string", "description": "the reason in words"},
        "margin_m": {"type": "number", "description": "m; what a gap must exceed"},
        "gap_m": {"type": "number", "description": "m; of the pair that decided; absent: there is none"},
        "stop_time_s": {"type": "number", "description": "s; until standstill; absent: there is no stop"},
        "colour": {"type": "string", "description": "#rrggbb; of the outcome, as in the HTML report"},
    },
    "required": ["t", "status", "outcome", "reason", "text", "margin_m", "colour"],
    "additionalProperties": False,
}
"""No type of it is a list of types: viewers that read schemas take one type each."""

_TOPIC: Final = AddedTopic(
    SHOWN_VERDICT_TOPIC,
    str(SHOWN_VERDICT["title"]),
    "jsonschema",
    json.dumps(SHOWN_VERDICT).encode(),
    "json",
)


def write_judged(
    recording: str | Path,
    out: str | Path,
    report: VerifyReport,
    spool: Spool,
    margin_m: float,
    *,
    force: bool,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Copy a recording as it is, and add verdicts and scenes (docs/recordings.md).

    Parameters
    ----------
    recording, out:
        The original, and the new file.
    report, spool:
        What the run has found, and the scenes that it has drawn.
    margin_m:
        What a gap had to exceed [m].
    force:
        Overwrite ``out`` if it is there.
    progress:
        Told the share that is copied.

    Raises
    ------
    OutputExistsError, RecordingError
        ``out`` is there or cannot be written, or the recording is damaged.
    """
    found = _merged(shown_verdicts(report, margin_m), spool.messages())
    additions = Additions(found, {RECORD: _record(report)})
    copy_with_verdicts(recording, out, report.verdicts(), additions, force=force, progress=progress)


def shown_verdicts(report: VerifyReport, margin_m: float) -> Iterator[tuple[int, Added]]:
    """Yield time [ns, the recording's clock] and verdict of every cycle, for ``/stopproof/verdict``."""
    rows = report.per_cycle
    for k in range(report.cycles):
        t, status, reason = float(rows.t[k]), Status(int(rows.status[k])), Reason(int(rows.reason[k]))
        content: dict[str, Any] = {
            "t": round(t, 9),
            "status": int(status),
            "outcome": status.name.lower(),
            "reason": reason.name.lower(),
            "text": reason.text,
            "margin_m": margin_m,
            "colour": OUTCOME_COLOURS[status],
        }
        for key, values in (("gap_m", rows.gap_m), ("stop_time_s", rows.stop_time_s)):
            _add_finite(content, key, values, k)
        data = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        yield report.start_ns + round(t * 1e9), Added(_TOPIC, data)


def _add_finite(content: dict[str, Any], key: str, values: NDArray[np.float32], k: int) -> None:
    value = float(values[k])
    if math.isfinite(value):
        content[key] = value


def _merged(*streams: Iterator[tuple[int, Added]]) -> Iterator[tuple[int, Added]]:
    return merge(*streams, key=itemgetter(0))


def _record(report: VerifyReport) -> dict[str, str]:
    """What must stay with the file: it is passed on alone."""
    legend = ", ".join(f"{colour} {status.name.lower()}" for status, colour in OUTCOME_COLOURS.items())
    return {
        "disclaimer": DISCLAIMER,
        "version": report.version,
        "robot": report.robot,
        "profile": report.profile,
        "stop_model": report.stop_model,
        "cell_hash": report.cell_hash,
        "waived": "; ".join(report.waived) or "nothing",
        "colours": legend,
    }
