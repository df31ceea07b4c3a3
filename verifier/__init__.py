"""What is allowed: verdicts, criteria, the cell, replay of recordings.

The names of ``__all__`` are imported when they are first asked for: the command line must be able to say in
one line why the compiled parts cannot be loaded.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False
if TYPE_CHECKING:
    from verifier.cell import Cell
    from verifier.cell_reading import CellError
    from verifier.replay import verify
    from verifier.reports.verification import VerifyReport
    from verifier.supervisor import Supervisor
    from verifier.verdict import Reason, Status, Verdict, Witness

__all__ = [
    "Cell", "CellError", "Reason", "Status", "Supervisor", "Verdict", "VerifyReport", "Witness", "verify",
]  # fmt: skip

_HOME = {
    "Cell": "verifier.cell",
    "CellError": "verifier.cell_reading",
    "Reason": "verifier.verdict",
    "Status": "verifier.verdict",
    "Supervisor": "verifier.supervisor",
    "Verdict": "verifier.verdict",
    "VerifyReport": "verifier.reports.verification",
    "Witness": "verifier.verdict",
    "verify": "verifier.replay",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value
