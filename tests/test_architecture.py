"""Who may know whom, read from the imports and calls of every file."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator

import pytest

from tests.source_files import (
    CORE_PACKAGES,
    OTHER_FOLDERS,
    PACKAGES,
    ROOT,
    Source,
    called,
    dotted,
    imported,
    sources,
)

MAY_KNOW: dict[str, tuple[str, ...]] = {
    "robots": ("robots",),
    "occupancy": ("occupancy", "robots"),
    "failsafe": ("failsafe", "robots"),
    "verifier": ("verifier", "occupancy", "failsafe", "robots"),
    "modes": ("modes", "occupancy", "failsafe", "robots", "verifier.proposal"),
}
PROJECT = {*PACKAGES, "tests", "bench", "examples"}

TRUSTED_VERIFIER = tuple(
    f"verifier/{name}.py"
    for name in (
        "verdict",
        "criteria",
        "proposal",
        "proposed",
        "supervisor",
        "setting_out",
        "command",
        "grid",
        "outlook",
        "cycle",
        "known",
        "number",
        "tracking",
        "required_distance",
    )
)
SET_UP = {
    *(
        f"robots/{name}.py"
        for name in ("catalog", "model", "enclosure", "urdf", "tool", "geometry", "files", "mesh_rules")
    ),
    *(f"occupancy/{name}.py" for name in ("body", "conformance", "contact_limits")),
}
"""Files of the trusted core that read files before the first cycle; URDF, tool and mesh reading are parts of
the catalogue and the enclosure."""
OUTSIDE_WORLD = {
    "asyncio", "builtins", "click", "ctypes", "datetime", "fileinput", "io", "logging", "matplotlib",
    "multiprocessing", "os", "pathlib", "pickle", "plotly", "random", "rich", "select", "shutil", "signal",
    "socket", "subprocess", "sys", "tempfile", "threading", "time", "tkinter", "tomllib", "urllib",
    "warnings",
}  # fmt: skip
"""Modules that read files, clocks or the environment, draw, log, or run something beside the cycle."""
WORLD_CALLS = {"print", "open", "input", "exec", "eval", "compile", "breakpoint", "__import__"}
SET_UP_MODULES = {"io", "os", "pathlib", "tempfile", "tomllib", "urllib"}
PRINTS = {"print", "click.echo", "click.secho", "sys.stdout.write", "sys.stderr.write", "rich.print"}
MAY_PRINT = (
    "verifier/__main__.py", "verifier/commands.py", "verifier/output.py", "modes/forecasting/training.py",
)  # fmt: skip
"""The command line: the error line, the help, and everything else; and the training, a command of its own."""
COMMAND_LINE = tuple(
    f"verifier/{name}.py"
    for name in (
        "commands",
        "command_options",
        "diff_command",
        "judging_commands",
        "limits_command",
        "recording_commands",
        "robots_command",
        "scenario_command",
        "stop_commands",
        "stop_report_command",
    )
)
"""The commands and their options."""
PRINTING_MODULES = {"rich.console", "rich.print"}
READS_YAML = ("verifier/joint_limits_file.py", "verifier/recordings/containers/ros2_folder.py")
ONLY_IN: dict[str, Callable[[str], bool]] = {
    "ruckig": lambda name: name == "failsafe/manoeuvre.py",
    "mcap": lambda name: name.startswith("verifier/recordings/"),
    "rosbags": lambda name: name.startswith("verifier/recordings/"),
    "foxglove": lambda name: name == "verifier/recordings/foxglove_scene.py",
    "ruamel": lambda name: name in READS_YAML,
    "numba": lambda name: name.endswith(("/kernels.py", "_kernels.py")),  # a package may have several
    "pinocchio": lambda name: name.startswith("robots/") or name == "modes/contact/momentum.py",
    "click": lambda name: name in COMMAND_LINE,
}
"""Package -> the shipped files that may import it."""
MAY_CATCH_ALL = (
    "verifier/__main__.py", "verifier/supervisor.py", "verifier/loop.py", "verifier/mode_runner.py",
    "verifier/scenario.py",
)  # fmt: skip
EXTRAS = {
    "c3d", "cyclonedds", "dask", "foxglove", "matplotlib", "mediapipe", "mujoco", "ompl", "onnx",
    "onnxruntime", "plotly", "pymotion", "toppra", "torch", "viser",
}  # fmt: skip
"""Packages of the extras: imported within functions only."""

Breach = tuple[str, int, str]


def top(name: str) -> str:
    return name.split(".", 1)[0]


def unknown_neighbours(source: Source) -> Iterator[Breach]:
    """Imports of parts of the project that a package must not know."""
    allowed = MAY_KNOW[source.package]
    if source.package == "modes" and source.file == "scenario.py":
        allowed = (*allowed, "verifier")
    for name, line in imported(source.tree):
        if name == ".":
            yield source.name, line, "relative import"
        elif top(name) in PROJECT and not any(name == a or name.startswith(a + ".") for a in allowed):
            yield source.name, line, f"imports {name}"


def contact_with_the_world(source: Source) -> Iterator[Breach]:
    """Files, clocks, printing in the trusted core."""
    trusted = source.package in CORE_PACKAGES or source.name in TRUSTED_VERIFIER
    if not trusted:
        return
    granted = SET_UP_MODULES if source.name in SET_UP else set()
    for name, line in imported(source.tree):
        if top(name) in OUTSIDE_WORLD - granted:
            yield source.name, line, f"imports {name}"
    for name, line in called(source.tree):
        if name in WORLD_CALLS and not (name == "open" and granted):
            yield source.name, line, f"calls {name}()"


def printing(source: Source) -> Iterator[Breach]:
    """Output of any kind outside the command line."""
    if source.name in MAY_PRINT:
        return
    for name, line in called(source.tree):
        if name in PRINTS or name.startswith("print."):
            yield source.name, line, f"calls {name}()"
    for name, line in imported(source.tree):
        if any(name == module or name.startswith(module + ".") for module in PRINTING_MODULES):
            yield source.name, line, f"imports {name}"


def out_of_place(source: Source) -> Iterator[Breach]:
    """Packages that only one file or folder may import."""
    for name, line in imported(source.tree):
        rule = ONLY_IN.get(top(name))
        if rule is not None and not rule(source.name):
            yield source.name, line, f"imports {name}"


def eager_extras(source: Source) -> Iterator[Breach]:
    """Optional packages imported when the module is."""
    outside = [node for node in source.tree.body if not isinstance(node, ast.FunctionDef | ast.ClassDef)]
    outside += [
        node
        for each in source.tree.body
        if isinstance(each, ast.ClassDef)
        for node in each.body
        if not isinstance(node, ast.FunctionDef)
    ]
    for node in outside:
        if isinstance(node, ast.If) and dotted(node.test).endswith("TYPE_CHECKING"):
            continue
        for name, line in imported(node):
            if top(name) in EXTRAS:
                yield source.name, line, f"imports {name} at module level"


def loose_kernels(source: Source) -> Iterator[Breach]:
    """Compiled functions that are not cached, divide by raising, or may reorder arithmetic."""
    for node in ast.walk(source.tree):
        if not (isinstance(node, ast.Call) and dotted(node.func).rsplit(".", 1)[-1] in ("njit", "jit")):
            continue
        options = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
        if options != {"cache": "True", "error_model": "'numpy'"}:
            yield source.name, node.lineno, f"compiled with {options}"
    for node in ast.walk(source.tree):
        if isinstance(node, ast.FunctionDef):
            for decorator in node.decorator_list:
                if not isinstance(decorator, ast.Call) and dotted(decorator).rsplit(".", 1)[-1] == "njit":
                    yield source.name, node.lineno, "compiled without options"


def broad_excepts(source: Source) -> Iterator[Breach]:
    """Catch-alls outside the command line, the supervisor, and what runs code of others beside it."""
    if source.name in MAY_CATCH_ALL:
        return
    for node in ast.walk(source.tree):
        if isinstance(node, ast.ExceptHandler):
            kinds = [] if node.type is None else [dotted(t) for t in getattr(node.type, "elts", [node.type])]
            if node.type is None or {"Exception", "BaseException"} & set(kinds):
                yield source.name, node.lineno, "catches everything"


RULES = (
    unknown_neighbours,
    contact_with_the_world,
    printing,
    out_of_place,
    eager_extras,
    loose_kernels,
    broad_excepts,
)


def breaches(rule: Callable[[Source], Iterable[Breach]], files: Iterable[Source]) -> list[str]:
    return [f"{name}:{line}: {what}" for source in files for name, line, what in rule(source)]


@pytest.fixture(scope="module")
def shipped() -> list[Source]:
    return list(sources(*PACKAGES))


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_rule_holds_in_every_shipped_file(
    rule: Callable[[Source], Iterator[Breach]], shipped: list[Source]
) -> None:
    assert {source.package for source in shipped} >= {"robots", "occupancy", "failsafe", "verifier"}
    found = breaches(rule, shipped)
    assert not found, "\n" + "\n".join(found)


PLANTED = [
    (unknown_neighbours, "occupancy/sets.py", "from failsafe.trajectory import Fit"),
    (unknown_neighbours, "failsafe/scaling.py", "def f():\n    import occupancy.sets"),
    (unknown_neighbours, "robots/limits.py", "from occupancy import sets"),
    (unknown_neighbours, "verifier/cell.py", "import modes.speed"),
    (unknown_neighbours, "modes/speed/mode.py", "from verifier.cycle import CycleCheck"),
    (unknown_neighbours, "robots/limits.py", "from . import model"),
    (unknown_neighbours, "robots/limits.py", "from tests import conftest"),
    (contact_with_the_world, "robots/limits.py", "import pathlib"),
    (contact_with_the_world, "robots/limits.py", "from time import monotonic"),
    (contact_with_the_world, "occupancy/separation.py", "def f(): print('x')"),
    (contact_with_the_world, "verifier/cycle.py", "def f(): return open('x')"),
    (contact_with_the_world, "robots/catalog.py", "import time"),
    (contact_with_the_world, "robots/catalog.py", "def f(): print('x')"),
    (printing, "verifier/replay.py", "import click\nclick.echo('x')"),
    (printing, "verifier/replay.py", "from rich.console import Console"),
    (out_of_place, "failsafe/scaling.py", "import ruckig"),
    (out_of_place, "verifier/replay.py", "from mcap.reader import make_reader"),
    (out_of_place, "verifier/replay.py", "def f():\n    from rosbags.highlevel import AnyReader"),
    (out_of_place, "occupancy/sets.py", "from numba import njit"),
    (eager_extras, "verifier/reports/picture.py", "import matplotlib.pyplot"),
    (
        loose_kernels,
        "occupancy/kernels.py",
        "@njit(cache=True, error_model='numpy', fastmath=True)\ndef f(): ...",
    ),
    (loose_kernels, "occupancy/kernels.py", "@njit(cache=True)\ndef f(): ..."),
    (loose_kernels, "occupancy/kernels.py", "@njit\ndef f(): ..."),
    (broad_excepts, "verifier/replay.py", "try:\n    f()\nexcept (ValueError, Exception):\n    pass"),
]


@pytest.mark.parametrize(("rule", "name", "code"), PLANTED)
def test_rule_sees_a_planted_breach(rule: Callable[[Source], Iterator[Breach]], name: str, code: str) -> None:
    assert list(rule(Source(name, ast.parse(code))))


ALLOWED = [
    (unknown_neighbours, "modes/speed/scenario.py", "from verifier import verify"),
    (unknown_neighbours, "modes/speed/mode.py", "from verifier.proposal import Stop"),
    (unknown_neighbours, "verifier/replay.py", "from failsafe.trajectory import Fit"),
    (contact_with_the_world, "robots/catalog.py", "import tomllib"),
    (contact_with_the_world, "verifier/replay.py", "import time"),
    (printing, "verifier/commands.py", "import click\nclick.echo('x')"),
    (out_of_place, "failsafe/manoeuvre.py", "import ruckig"),
    (eager_extras, "verifier/reports/picture.py", "def f():\n    import matplotlib.pyplot"),
    (loose_kernels, "occupancy/kernels.py", "@njit(cache=True, error_model='numpy')\ndef f(): ..."),
]


@pytest.mark.parametrize(("rule", "name", "code"), ALLOWED)
def test_rule_lets_pass_what_is_meant(
    rule: Callable[[Source], Iterator[Breach]], name: str, code: str
) -> None:
    assert not list(rule(Source(name, ast.parse(code))))


def test_set_up_files_exist() -> None:
    missing = [name for name in sorted(SET_UP) if not (ROOT / name).is_file()]
    assert not missing, f"exceptions for files that are not there: {missing}"


def long_without_docstring(source: Source, longest: int = 80) -> list[str]:
    found = []
    for node in ast.walk(source.tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(node) is None:
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            if lines > longest:
                found.append(f"{source.name}:{node.lineno}: {node.name}, {lines} lines, has no docstring")
    return found


def test_long_functions_say_what_they_do(shipped: list[Source]) -> None:
    files = (*shipped, *sources(*OTHER_FOLDERS))
    found = [line for source in files for line in long_without_docstring(source)]
    assert not found, "\n" + "\n".join(found)
    body = "\n".join(["    x = 1"] * 90)
    assert long_without_docstring(Source("robots/x.py", ast.parse(f"def f():\n{body}")))


SILENCED = re.compile(r"#\s*(?:noqa|type:\s*ignore)(?P<rule>:?\s*[A-Z]+\d+|\[[a-z-]+\])?(?P<reason>.*)")


def silenced_without_reason(name: str, text: str) -> list[str]:
    """Checks that a line silences without naming the rule, or without a reason there or in the line above."""
    found, above = [], ""
    for number, line in enumerate(text.splitlines(), 1):
        silenced = SILENCED.search(line)
        if silenced is not None:
            reason = silenced["reason"].strip(" #-()")
            if silenced["rule"] is None or not (len(reason.split()) > 1 or above.startswith("#")):
                found.append(f"{name}:{number}: {line.strip()}")
        above = line.strip()
    return found


def test_every_silenced_check_has_its_reason() -> None:
    folders = (*PACKAGES, *OTHER_FOLDERS)
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    texts = [(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")) for path in files]
    this = "tests/test_architecture.py"
    found = [line for name, text in texts if name != this for line in silenced_without_reason(name, text)]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("f()  # noqa", 1),
        ("f()  # noqa: E501", 1),
        ("f()  # type: ignore", 1),
        ("f()  # type: ignore[arg-type]", 1),
        ("f()  # noqa: since it is so", 1),
        ("f()  # noqa: E501 - cannot be shorter", 0),
        ("# cannot be shorter\nf()  # type: ignore[arg-type]", 0),
    ],
)
def test_a_silenced_check_without_a_reason_is_seen(text: str, wrong: int) -> None:
    assert len(silenced_without_reason("x.py", text)) == wrong
