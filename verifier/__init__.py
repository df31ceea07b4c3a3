"""What is allowed: verdicts, criteria, the cell, replay of recordings."""

from verifier.cell import Cell, CellError
from verifier.replay import verify
from verifier.reports.verification import VerifyReport
from verifier.verdict import Reason, Status, Verdict, Witness

__all__ = ["Cell", "CellError", "Reason", "Status", "Verdict", "VerifyReport", "Witness", "verify"]
