"""docs/robot-sources.md: its command is run, and what it lists is what there is."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from verifier.commands import cli
from verifier.recordings.robot_logs import KINDS, STATES
from verifier.recordings.robot_sources import ADAPTERS

DOC = (Path(__file__).resolve().parents[2] / "docs/robot-sources.md").read_text(encoding="utf-8")


def test_every_source_is_listed():
    for schema in ADAPTERS:
        package, _msg, name = schema.split("/")
        assert f"`{package}/{name}`" in DOC
    for kind in KINDS[:2]:
        for pattern in (kind.q, kind.command_q):
            assert f"`{pattern.format(0)}` …" in DOC
    for name in ("speed_scaling", "safety_mode", "safety_status"):
        assert name in STATES and f"`{name}`" in DOC


def test_links_within_the_page_lead_somewhere():
    anchors = {
        re.sub(r"[^a-z0-9 _-]", "", title.lower()).replace(" ", "-")
        for title in re.findall(r"^#+ (.*)$", DOC, re.MULTILINE)
    }
    assert set(re.findall(r"\(#([^)]+)\)", DOC)) <= anchors


@pytest.mark.real_data
def test_what_is_shown_is_what_is_printed(real_data):
    (command,) = re.findall(r"^stopproof (inspect \$DATA.*)$", DOC, re.MULTILINE)
    arguments = command.replace("$DATA", str(real_data)).split()
    printed = CliRunner().invoke(cli, arguments, standalone_mode=False).output.splitlines()
    (shown,) = re.findall(r"```text\n(tracking error.*?)```", DOC, re.DOTALL)
    for line in shown.strip().splitlines():
        assert line in printed
