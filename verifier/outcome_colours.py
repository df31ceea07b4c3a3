"""Colours of outcomes and bodies, as in the HTML report (``reports/html/page.css``, on white)."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from verifier.verdict import Status

OUTCOME_COLOURS: Final = MappingProxyType(
    {
        Status.VERIFIED: "#2e7d32",
        Status.NOT_VERIFIED: "#c75300",
        Status.CONTRADICTED: "#7b1fa2",
        Status.NOT_CHECKED: "#8a8f98",
    }
)
BODY_COLOURS: Final = MappingProxyType(
    {
        "link": "#546e7a",
        "person": "#e8a33d",
        "person-edge": "#9a5b00",
        "decides": "#c62828",
        "fixture": "#90a4ae",
    }
)
