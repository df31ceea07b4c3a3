"""Named arms and arms of the user: model file + URDF + setup -> RobotModel."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from robots.assumption import Assumption, Certainty
from robots.card import ModelCard, model_card
from robots.enclosure import NO_CORNERS, EnclosedPart, default_cache_dir, enclose, pack
from robots.errors import SetupError, ToolError
from robots.files import is_file, printed, read_bytes, read_toml
from robots.geometry import locked_range
from robots.identity import urdf_identity
from robots.inertia import MassModel, Payload, read_masses
from robots.limits import (
    JointLimits,
    Limit,
    assemble,
    declared_limits,
    file_limits,
    override,
    urdf_limits,
)
from robots.model import LockedJoint, Mount, RobotModel, Tree, read_tree
from robots.rounding import require_rounding_to_nearest
from robots.tool import (
    Tool,
    check_keys,
    frame_placement,
    numbered,
    placed,
    read_capsule,
    read_rows,
    read_tool,
    tool_parts,
)
from robots.urdf import parse_urdf

_MODELS = Path(__file__).parent / "models"


@dataclass(frozen=True, eq=False)
class RobotSetup:
    """How an arm is installed: what the model file or URDF cannot know.

    Attributes
    ----------
    tool, bare_flange:
        The tool, or the statement that there is none. Neither: nobody said anything, and the model says so.
    mount:
        Pose of the base in the world.
    limits:
        Joint -> key -> number, for gaps and to override, e.g. ``{"elbow": {"jerk_rad_s3": 300.0}}``.
    enclosure:
        Tables ``{"link", "a_m", "b_m", "radius_m"}`` in link frames, for links without geometry.
    commanded:
        Joints that the plan commands, in any order (the model has them parents first); None: those of the
        model file, or all of the URDF that mimic no other.
    package_dirs:
        Where ``package://`` mesh names are looked for, besides the folders above the URDF.
    cache_dir:
        Where enclosures are kept; None: :func:`robots.enclosure.default_cache_dir`.
    source:
        Where all this is stated, for messages: ``{source}.limits.elbow: …``.
    """

    tool: Tool | None = None
    bare_flange: bool = False
    mount: Mount = field(default_factory=Mount)
    limits: Mapping[str, Mapping[str, object]] | None = None
    enclosure: Sequence[Mapping[str, object]] = ()
    commanded: tuple[str, ...] | None = None
    package_dirs: tuple[Path, ...] = ()
    cache_dir: Path | None = None
    source: str = "setup"

    def __post_init__(self) -> None:
        if self.bare_flange and self.tool is not None:
            raise SetupError(f"tool {self.tool.name} and bare_flange contradict each other: give one of them")


@dataclass(frozen=True, eq=False)
class Description:
    """An arm before it becomes arrays: what is known, with sources."""

    name: str
    text: str
    tree: Tree
    limits: JointLimits
    rows: tuple[Limit, ...]
    parts: tuple[EnclosedPart, ...]


def robot_names() -> tuple[str, ...]:
    """Names of the arms that come with a model file."""
    return tuple(sorted(file.stem for file in _MODELS.glob("*.toml")))


def built_in_tool(name: str) -> str | None:
    """Return what an arm of the catalogue has beyond its flange; None: nothing."""
    model_file, _urdf = _locate(name)
    tool = model_file.get("contains")
    return None if tool is None else str(tool)


def load_robot(name_or_urdf: str | Path, *, setup: RobotSetup) -> RobotModel:
    """Load an arm of the catalogue by name, or any arm by the path of its URDF.

    Raises
    ------
    SetupError
        In one line: unknown name, unreadable file, missing mesh, missing limits (:class:`MissingLimits`),
        moving base, too many joints or capsules, a setup that does not fit the arm.
    """
    require_rounding_to_nearest()
    return _model(describe(name_or_urdf, setup), setup)


def fitted_parts(name_or_urdf: str | Path, package_dirs: Sequence[Path] = ()) -> tuple[EnclosedPart, ...]:
    """Enclose the geometry of an arm as :func:`load_robot` does; needs no limits.

    Raises
    ------
    SetupError
        Unknown name, a URDF or a mesh that cannot be read, or geometry that cannot be enclosed.
    """
    model_file, urdf_path = _locate(name_or_urdf)
    urdf = parse_urdf(read_bytes(urdf_path), urdf_path, package_dirs)
    return enclose(read_tree(urdf, model_file.get("joints")), default_cache_dir())


def joint_names(name_or_urdf: str | Path, package_dirs: Sequence[Path] = ()) -> tuple[str, tuple[str, ...]]:
    """Return what a recording of an arm states, and its commanded joints; needs no limits and no geometry.

    That is its name in the catalogue, or :func:`robots.identity.urdf_identity`.

    Raises
    ------
    SetupError
        Unknown name, or a URDF that cannot be read.
    """
    model_file, urdf_path = _locate(name_or_urdf)
    urdf = parse_urdf(read_bytes(urdf_path), urdf_path, package_dirs)
    stated = model_file.get("name") or urdf_identity(urdf.name, urdf.content)
    return stated, read_tree(urdf, model_file.get("joints")).joints


def load_masses(
    name_or_urdf: str | Path,
    payload: Payload | None,
    *,
    setup: RobotSetup | None = None,
    rated_kg: float | None = None,
) -> MassModel:
    """Read the masses of an arm and add what it carries; its kinematics are those of :func:`load_robot`.

    ``rated_kg``: the largest payload, by default that of the model file; None where that has none: then no
    payload is refused.

    Raises
    ------
    SetupError
        In one line: unknown name, unreadable file, a mass that nobody knows, a payload beyond the rated one.
    """
    setup = setup or RobotSetup()
    model_file, urdf_path = _locate(name_or_urdf)
    urdf = parse_urdf(read_bytes(urdf_path), urdf_path, setup.package_dirs)
    commanded = model_file.get("joints") if setup.commanded is None else setup.commanded
    tree = read_tree(urdf, commanded)
    rated = model_file.get("rated_payload", {}).get("kg") if rated_kg is None else rated_kg
    return read_masses(model_file.get("name", urdf.name), tree, payload, model_file.get("flange"), rated)


def load_tool(path: str | Path) -> Tool:
    """Read a tool file (TOML): ``name``, ``frame``, ``[[capsule]]``, ``[[mesh]]``, ``[[payload]]``.

    Raises
    ------
    ToolError
        If the file cannot be read or says something wrong.
    """
    try:
        return read_tool(read_toml(Path(path)), Path(path).resolve().parent, str(path))
    except SetupError as error:
        raise ToolError(str(error)) from None


def describe(name_or_urdf: str | Path, setup: RobotSetup) -> Description:
    """Gather what is known about an arm; raises as :func:`load_robot` does."""
    model_file, urdf_path = _locate(name_or_urdf)
    urdf = parse_urdf(read_bytes(urdf_path), urdf_path, setup.package_dirs)
    commanded = model_file.get("joints") if setup.commanded is None else setup.commanded
    tree = read_tree(urdf, commanded, None if setup.commanded is None else f"{setup.source}.joints")
    name = model_file.get("name", urdf.name)
    known = urdf_limits([urdf.joints[joint] for joint in tree.joints], urdf_path.name)
    known = override(
        known, file_limits(model_file.get("limits", {}), model_file.get("joints", ()), tree.prismatic)
    )
    where = f"{setup.source}.limits"
    stated = declared_limits(setup.limits or {}, tree.prismatic, "declared in the setup", where)
    label = name if model_file else str(urdf_path)
    limits, rows = assemble(label, tree.prismatic, override(known, stated), where)
    cache_dir = setup.cache_dir or default_cache_dir()
    parts = [*enclose(tree, cache_dir), *_declared_parts(tree, model_file, setup)]
    if setup.tool is not None:
        parts += tool_parts(tree, setup.tool, model_file.get("flange"), cache_dir)
    parts.sort(key=lambda part: part.joint)
    _check_every_joint_enclosed(tree, parts)
    return Description(name, model_file.get("description", urdf.name), tree, limits, rows, tuple(parts))


def describe_card(name_or_urdf: str | Path, setup: RobotSetup | None = None) -> ModelCard:
    """Make the model card of an arm; raises as :func:`load_robot` does."""
    setup = setup or RobotSetup()
    description = describe(name_or_urdf, setup)
    return model_card(_model(description, setup), description.text, description.rows, description.parts)


def _model(description: Description, setup: RobotSetup) -> RobotModel:
    kinematics = description.tree.kinematics(setup.mount)
    limits, rows, parts, tree = description.limits, description.rows, description.parts, description.tree
    assumed = (row.quantity for row in rows if row.certainty is Certainty.ASSUMED)
    return RobotModel(
        name=description.name,
        joints=description.tree.joints,
        limits=limits,
        kinematics=kinematics,
        enclosure=pack(parts, kinematics, limits.position_lower, limits.position_upper),
        links=tuple(part.name for part in parts),
        fixed_links=description.tree.fixed_links,
        assumptions=_assumptions(description, setup),
        assumed_enclosure=any(part.certainty is Certainty.ASSUMED for part in parts),
        assumed_limits=tuple(dict.fromkeys(assumed)),
        tool=setup.tool.name if setup.tool is not None else "bare flange" if setup.bare_flange else None,
        locked=tuple(
            LockedJoint(name, *locked_range(tree, name), tree.urdf.joints[name].prismatic)
            for name in tree.locked
        ),
    )


def _locate(name_or_urdf: str | Path) -> tuple[dict[str, Any], Path]:
    if str(name_or_urdf) in robot_names():
        model_file = read_toml(_MODELS / f"{name_or_urdf}.toml")
        if "distribution" not in model_file:
            return model_file, _MODELS / model_file["urdf"]
        return model_file, _installed_file(model_file["distribution"], model_file["urdf"])
    path = Path(name_or_urdf)
    if not is_file(path):
        raise SetupError(
            f"{printed(path)}: neither a file nor a robot of the catalogue ({', '.join(robot_names())})"
        )
    return {}, path


def _installed_file(distribution: str, ending: str) -> Path:
    try:
        package = metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        raise SetupError(f"the package {distribution} is not installed, which has {ending}") from None
    # of a thousand files, only the one that is asked for is made a path: that takes longer than all the rest
    listed = (line for line in (package.read_text("RECORD") or "").splitlines() if ending in line)
    for name, *_ in csv.reader(listed):
        if name.endswith("/" + ending):
            return Path(str(package.locate_file(name)))
    for file in package.files or ():
        if str(file).endswith("/" + ending):
            return Path(str(file.locate()))
    raise SetupError(f"the package {distribution} has no file {ending}")


def _declared_parts(tree: Tree, model_file: Mapping[str, Any], setup: RobotSetup) -> list[EnclosedPart]:
    """Capsules that a model file or a user states for a link, in the link's frame."""
    rows = [
        (row, f"model file: enclosure[{i}]", str(row["source"]), Certainty(str(row["certainty"])))
        for i, row in enumerate(read_rows(model_file, "enclosure", "model file"))
    ]
    rows += [
        (row, f"{setup.source}.enclosure.{row.get('link', i)}", "declared in the setup", Certainty.DECLARED)
        for i, row in enumerate(setup.enclosure)
    ]
    parts = []
    for row, where, source, certainty in rows:
        keys = ("link", "a_m", "b_m", "radius_m")
        check_keys(row, keys, (*keys, "source", "certainty"), where)
        joint, placement = frame_placement(tree, str(row["link"]), where)
        capsule = placed(read_capsule({key: row[key] for key in keys[1:]}, where), placement)
        parts.append(EnclosedPart(str(row["link"]), joint, capsule, NO_CORNERS, certainty, source))
    return numbered(parts)


def _check_every_joint_enclosed(tree: Tree, parts: Sequence[EnclosedPart]) -> None:
    enclosed = {part.joint for part in parts}
    bare = [tree.urdf.joints[joint].child for i, joint in enumerate(tree.joints) if i not in enclosed]
    if bare:
        raise SetupError(
            f"{tree.urdf.path}: moving link without geometry: {', '.join(bare)}; state a capsule for each: "
            "[robot.enclosure.<link>] of a cell file, with a_m, b_m, radius_m"
        )


def _assumptions(description: Description, setup: RobotSetup) -> tuple[Assumption, ...]:
    """Everything that is believed about the arm, one entry for each number or statement."""
    prefix, tree = f"robot.{description.name}", description.tree
    found = [
        Assumption(f"{prefix}.{row.quantity}.{row.joint}", row.value, row.unit, row.source, row.certainty)
        for row in description.rows
    ]
    for part in description.parts:
        name, radius = f"{prefix}.enclosure.{part.name}.radius", part.capsule.radius
        found.append(Assumption(name, radius, "m", part.source, part.certainty))
    found += [
        Assumption(f"{prefix}.{name}", text, "", source, certainty)
        for name, text, source, certainty in _statements(tree, setup)
    ]
    return tuple(found)


def _statements(tree: Tree, setup: RobotSetup) -> Iterator[tuple[str, str, str, Certainty]]:
    """(name, text, source, certainty) of what is believed and is no number."""
    file = tree.urdf.path.name
    yield "kinematics", f"joint placements as in {file}", file, Certainty.SOURCED
    yield "mount", *_mount_statement(setup.mount)
    if setup.tool is None:
        certainty = Certainty.DECLARED if setup.bare_flange else Certainty.DEFAULT
        yield (
            "tool",
            "nothing on the flange beyond the model",
            "bare flange" if setup.bare_flange else "",
            certainty,
        )
    if tree.fixed_links:
        text = f"not checked against people, they do not move: {', '.join(tree.fixed_links)}"
        yield "fixed_links", text, file, Certainty.SOURCED
    frames = [
        link for link in tree.urdf.links if link not in tree.urdf.shaped and tree.carrier(link) is not None
    ]
    if tree.urdf.shaped and frames:
        yield (
            "frames",
            f"frames without a body: {', '.join(frames)}",
            f"no geometry in {file}",
            Certainty.SOURCED,
        )
    for joint in tree.locked:
        lower, upper = locked_range(tree, joint)
        yield f"locked.{joint}", f"anywhere from {lower:g} to {upper:g}, enclosed", file, Certainty.SOURCED


def _mount_statement(mount: Mount) -> tuple[str, str, Certainty]:
    if mount.is_identity:
        return "world = robot base", "nothing declared", Certainty.DEFAULT
    translation = ", ".join(f"{x:.6g}" for x in mount.translation)
    rotation = ", ".join(f"{x:.9g}" for x in mount.rotation.ravel())
    return f"base at {translation} m, rotation {rotation}", "declared", Certainty.DECLARED
