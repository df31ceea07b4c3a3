"""docs/cell.md and the template of `stopproof init` list exactly the keys that a cell has."""

import datetime
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

import pytest
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from verifier.cell import Cell, CellError
from verifier.cell_reading import NOT_TAKEN
from verifier.cell_template import BLANK, template

ROOT = Path(__file__).resolve().parents[2]
DOC = (ROOT / "docs/cell.md").read_text(encoding="utf-8")

UNIT_OF_ENDING = {
    "_rad_s3": "rad/s³", "_rad_s2": "rad/s²", "_rad_s": "rad/s", "_m_s3": "m/s³", "_m_s2": "m/s²",
    "_m_s": "m/s", "_rad": "rad", "_deg": "deg", "_kg": "kg", "_Nm": "N m", "_N": "N", "_m": "m", "_s": "s",
}  # fmt: skip
"""Longest ending first: what the name of a key says about its unit."""

NAMED = ("robot.limits", "robot.enclosure", "people.frames", "people.monitored", "workspace.fixtures")
"""Tables of tables that the user names."""

Keys = dict[tuple[str, str], Any]
"""(table, key) -> default; ``...`` where there is none. Tables that the user names are called ``<…>``."""


def table_of(annotation: Any) -> type[BaseModel] | None:
    """The model of a table, also of one that the user names."""
    for each in (annotation, *get_args(annotation)):
        if isinstance(each, type) and issubclass(each, BaseModel):
            return each
    return None


def keys_of(model: type[BaseModel] = Cell, table: str = "") -> Iterator[tuple[tuple[str, str], Any]]:
    """Every key of the cell with its default."""
    for name, field in model.model_fields.items():
        inner = table_of(field.annotation)
        if inner is not None:
            by_name = get_origin(field.annotation) in (dict, tuple)
            named = ".<>" if by_name else ""
            yield from keys_of(inner, f"{table}.{name}{named}".lstrip("."))
        elif field.annotation == dict[str, str]:
            yield (f"{table}.{name}", "<>"), ...
        else:
            none = field.default is None or field.default is PydanticUndefined
            yield (table, name), ... if none else field.default


CELL: Keys = dict(keys_of())


def documented() -> Iterator[tuple[tuple[str, str], tuple[str, str, str]]]:
    """(table, key) -> unit, default and meaning in docs/cell.md."""
    for section in re.split(r"^##+ ", DOC, flags=re.MULTILINE)[1:]:
        title = section.splitlines()[0]
        found = re.match(r"`\[+([^\]]+)\]+`", title)
        if title.startswith("Tool"):
            continue
        table = re.sub(r"<\w+>", "<>", found[1]) if found else ""
        table += ".<>" if title.startswith("`[[") else ""
        for line in section.splitlines():
            row = [cell.strip() for cell in line.strip("|").split("|")]
            if line.startswith("| `") and len(row) == 4:
                (key,) = re.findall(r"`([^`]+)`", row[0])
                yield (table, key), (row[1], row[2], row[3])
        if table == "people.point_names":
            yield (table, "<>"), ("", "", section)


DOCUMENTED = dict(documented())


def plain(value: Any) -> Any:
    """Tuples as TOML has them."""
    return [plain(each) for each in value] if isinstance(value, tuple | list) else value


def test_the_cell_has_keys():
    assert len(CELL) > 40
    assert ("people.frames.<>", "rotation_error_deg") in CELL
    assert ("robot.limits.<>", "jerk_rad_s3") in CELL


def test_the_document_lists_exactly_the_keys():
    assert len(list(documented())) == len(DOCUMENTED), "a key stands there twice"
    assert set(DOCUMENTED) == set(CELL)


@pytest.mark.parametrize("place", CELL, ids=".".join)
def test_the_document_states_default_and_unit(place):
    unit, default, meaning = DOCUMENTED[place]
    shown = re.fullmatch(r"`(.+)`", default)
    if CELL[place] is ...:
        assert shown is None, f"{place} has no fixed default, but the document shows {default}"
    else:
        assert shown is not None, f"{place}: the document shows no default, it is {CELL[place]!r}"
        assert tomllib.loads(f"x = {shown[1]}")["x"] == plain(CELL[place])
    by_name = next((u for ending, u in UNIT_OF_ENDING.items() if place[1].endswith(ending)), "")
    assert unit.split(" (")[0] == by_name
    assert meaning or place[0] == "robot.limits.<>"


def uncommented() -> dict[str, Any]:
    """The template with every key switched on."""
    lines = template("ur5").replace(f'"{BLANK}"', '"tool.toml"').replace(BLANK, "0.05").splitlines()
    key = re.compile(r'# (["\w]+ = |\[)')
    return tomllib.loads("\n".join(line[2:] if key.match(line) else line for line in lines))


def in_template(table: dict[str, Any], name: str = "") -> Iterator[tuple[tuple[str, str], Any]]:
    """Every key that a parsed template has."""
    for key, value in table.items():
        inner = f"{name}.{key}".lstrip(".")
        if name in NAMED:
            inner = f"{name}.<>"
        if isinstance(value, dict):
            yield from in_template(value, inner)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for each in value:
                yield from in_template(each, f"{inner}.<>")
        else:
            yield (name, "<>" if name == "people.point_names" else key), value


def test_the_template_lists_exactly_the_keys():
    assert set(dict(in_template(uncommented()))) == set(CELL)


def test_what_the_template_shows_as_a_default_is_one():
    examples = set()
    table = ""
    for line in template("ur5").splitlines():
        head = re.match(r"(?:# )?\[{1,2}([\w.]+)\]", line)
        if head:
            table = re.sub(rf"^({'|'.join(map(re.escape, NAMED))})\.\w+", r"\1.<>", head[1])
            table += ".<>" if "[[" in line else ""
            example_table = "(no default)" in line
        shown = re.match(r"# (\w+) = ([^#]+)", line)
        if not shown:
            continue
        default = CELL[table, shown[1]]
        if default is ... or "(no default)" in line:
            examples.add((table, shown[1]))
            assert default is ..., f"{line}: the default is {default!r}"
            assert "(no default)" in line or example_table, line
        else:
            assert tomllib.loads(f"x = {shown[2]}")["x"] == plain(default), line
    without = {place for place in CELL if CELL[place] is ...}
    assert examples == {place for place in without if place[1] not in ("name", "tool", "<>")}


def test_the_template_is_a_cell_once_it_is_filled_in(tmp_path):
    text = template("ur5").replace(f'"{BLANK}"', '"tool.toml"').replace(BLANK, "0.05")
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    cell = Cell.from_toml(tmp_path / "cell.toml")
    assert cell.robot.name == "ur5"
    assert cell.people.latency_s == 0.05
    everything = uncommented()
    del everything["robot"]["urdf"], everything["stop"]["measured"]
    assert Cell.from_table(everything).people.point_names == {"RightHand": "r_hand"}


def test_every_key_of_a_tool_file_is_named():
    section = DOC.split("## Tool files")[1]
    for key in ("name", "frame", "[[capsule]]", "[[mesh]]", "[[payload]]", "a_m", "b_m", "radius_m", "file"):
        assert f"`{key}`" in section


def test_the_tool_file_of_the_document_is_one(tmp_path):
    from robots.catalog import load_tool

    (text,) = re.findall(r"```toml\n(.*?)```", DOC, re.DOTALL)
    (tmp_path / "fingers.stl").write_text("solid none\nendsolid none\n")
    (tmp_path / "tool.toml").write_text(text, encoding="utf-8")
    tool = load_tool(tmp_path / "tool.toml")
    assert len(tool.capsules) == 1
    assert len(tool.meshes) == 1
    assert len(tool.payload) == 1


JUNK = (
    3.0, -1e9, 1e9, math.nan, math.inf, 10**400, True, "x", "", [], [1], ["x", 2, None], [[1]], [1] * 40, {},
    {"a": 1}, {"a": {"a": {}}}, datetime.date(2020, 1, 1),
)  # fmt: skip
FOREIGN = re.compile(
    r"\b(?:[Ii]nput|[Ff]ield|[Tt]uple|dictionary|instance|valid|boolean|string|validation|items)\b"
)
"""Words of the library that validates, and of Python, which mean nothing to who writes a cell."""


@pytest.mark.parametrize("path", sorted({(table, key) for table, key in CELL}))
def test_whatever_a_key_is_set_to_is_refused_in_plain_words(path):
    table, key = path
    places = [place for place in table.replace("<>", "x").split(".") if place]
    for junk in JUNK:
        for value, into in ((junk, [*places, key]), (junk, places or [key])):
            whole: dict[str, Any] = {}
            inner = whole
            for place in into[:-1]:
                inner = inner.setdefault(place, {})
            inner["y" if into[-1] == "<>" else into[-1]] = value
            try:
                Cell.from_table(whole)
            except CellError as error:
                told = str(error)
                quoted = re.sub(r"'[^']*'|\[.*\]", "", told)
                assert not FOREIGN.search(quoted), told
                assert (
                    told.startswith(f"cell: {into[0] or into[1]}") and NOT_TAKEN.split("{")[0] not in told
                ), told
