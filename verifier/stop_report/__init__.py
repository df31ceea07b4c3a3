"""Worst-case stops of an arm as plain data: :func:`stop_report` makes a :class:`StopReport`."""

from verifier.stop_report.compute import stop_report
from verifier.stop_report.report import StopReport
from verifier.stop_report.settings import StopReportSettings

__all__ = ["StopReport", "StopReportSettings", "stop_report"]
