"""Named arms and arms of the user: model file + URDF + setup -> RobotModel."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from robots.assumption import Assumption, Certainty
from robots.enclosure import NO_CORNERS, EnclosedPart, default_cache_dir, enclose, enclose_mesh, pack
from robots.errors import SetupError
from robots.limits import JointLimits, Limit, assemble, declared_limits, unit_of
from robots.model import Mount, RobotModel, Tree, read_tree
from robots.tool import Tool, check_keys, frame_placement, placed, read_capsule, read_rows, read_tool
from robots.urdf import parse_urdf

_MODELS = Path(__file__).parent / "models"
_TO_SI = {
    "rad": 1.0, "deg": np.pi / 180.0, "rad/s": 1.0, "deg/s": np.pi / 180.0, "rad/s²": 1.0, "rad/s³": 1.0,
    "N m": 1.0, "m": 1.0, "m/s": 1.0, "m/s²": 1.0, "m/s³": 1.0, "N": 1.0,
}  # fmt: skip


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
        Joints that the plan commands; None: those of the model file, or all of the URDF that mimic no other.
    package_dirs:
        Where ``package://`` mesh names are looked for, besides the folders above the URDF.
    cache_dir:
        Where enclosures are kept; None: :func:`robots.enclosure.default_cache_dir`.
    """

    tool: Tool | None = None
    bare_flange: bool = False
    mount: Mount = field(default_factory=Mount)
    limits: Mapping[str, Mapping[str, object]] | None = None
    enclosure: Sequence[Mapping[str, object]] = ()
    commanded: tuple[str, ...] | None = None
    package_dirs: tuple[Path, ...] = ()
    cache_dir: Path | None = None

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
    fixed_links: tuple[str, ...]


def robot_names() -> tuple[str, ...]:
    """Names of the arms that come with a model file."""
    return tuple(sorted(file.stem for file in _MODELS.glob("*.toml")))


def load_robot(name_or_urdf: str | Path, *, setup: RobotSetup) -> RobotModel:
    """Load an arm of the catalogue by name, or any arm by the path of its URDF.

    Raises
    ------
    SetupError
        In one line: unknown name, unreadable file, missing mesh, missing limits (:class:`MissingLimits`),
        moving base, too many joints or capsules, a setup that does not fit the arm.
    """
    description = describe(name_or_urdf, setup)
    kinematics = description.tree.kinematics(setup.mount)
    limits, parts = description.limits, description.parts
    return RobotModel(
        name=description.name,
        joints=description.tree.joints,
        limits=limits,
        kinematics=kinematics,
        enclosure=pack(parts, kinematics, limits.position_lower, limits.position_upper),
        links=tuple(part.name for part in parts),
        fixed_links=description.fixed_links,
        assumptions=_assumptions(description, setup),
        assumed_enclosure=any(part.certainty is Certainty.ASSUMED for part in parts),
        assumed_limits=_assumed_quantities(description.rows),
        tool=setup.tool.name if setup.tool is not None else "bare flange" if setup.bare_flange else None,
    )


def load_tool(path: str | Path) -> Tool:
    """Read a tool file (TOML): ``name``, ``frame``, ``[[capsule]]``, ``[[mesh]]``, ``[[payload]]``.

    Raises
    ------
    SetupError
        If the file cannot be read or says something wrong.
    """
    return read_tool(_read_toml(Path(path)), Path(path).resolve().parent, str(path))


def describe(name_or_urdf: str | Path, setup: RobotSetup) -> Description:
    """Gather what is known about an arm; raises as :func:`load_robot` does."""
    model_file, urdf_path = _locate(name_or_urdf)
    urdf = parse_urdf(_read_bytes(urdf_path), urdf_path, (*setup.package_dirs, *_package_dirs(model_file)))
    tree = read_tree(urdf, setup.commanded or model_file.get("joints"))
    name = model_file.get("name", urdf.name)
    limits, rows = assemble(name, tree.prismatic, _known_limits(tree, model_file, setup))
    parts = [
        *enclose(tree, setup.cache_dir or default_cache_dir()),
        *_declared_parts(tree, model_file, setup),
    ]
    parts += _tool_parts(tree, model_file, setup)
    parts.sort(key=lambda part: part.joint)
    _check_every_joint_enclosed(tree, parts)
    return Description(
        name, model_file.get("description", urdf.name), tree, limits, rows, tuple(parts), tree.fixed_links
    )


def _locate(name_or_urdf: str | Path) -> tuple[dict[str, Any], Path]:
    if str(name_or_urdf) in robot_names():
        model_file = _read_toml(_MODELS / f"{name_or_urdf}.toml")
        if "distribution" not in model_file:
            return model_file, _MODELS / model_file["urdf"]
        return model_file, _installed_file(model_file["distribution"], model_file["urdf"])
    path = Path(name_or_urdf)
    if not path.is_file():
        raise SetupError(
            f"{name_or_urdf}: neither a file nor a robot of the catalogue ({', '.join(robot_names())})"
        )
    return {}, path


def _installed_file(distribution: str, ending: str) -> Path:
    try:
        files = metadata.files(distribution) or []
    except metadata.PackageNotFoundError:
        raise SetupError(f"the package {distribution} is not installed, which has {ending}") from None
    for file in files:
        if str(file).endswith("/" + ending):
            return Path(str(file.locate()))
    raise SetupError(f"the package {distribution} has no file {ending}")


def _package_dirs(model_file: Mapping[str, Any]) -> tuple[Path, ...]:
    return () if "distribution" in model_file else (_MODELS,)


def _known_limits(
    tree: Tree, model_file: Mapping[str, Any], setup: RobotSetup
) -> dict[tuple[str, str], Limit]:
    """URDF, overridden by the model file, overridden by the setup."""
    known: dict[tuple[str, str], Limit] = {}
    for joint in tree.joints:
        for quantity, value in _urdf_limits(tree, joint).items():
            unit = unit_of(quantity, tree.prismatic[joint])
            known[joint, quantity] = Limit(
                joint, quantity, value, unit, tree.urdf.path.name, Certainty.SOURCED, urdf_value=value
            )
    overrides = _file_limits(tree, model_file)
    if setup.limits is not None:
        overrides |= declared_limits(setup.limits, tree.prismatic, "declared in the setup")
    for key, limit in overrides.items():
        urdf_value = known[key].urdf_value if key in known else None
        known[key] = Limit(
            limit.joint, limit.quantity, limit.value, limit.unit, limit.source, limit.certainty, urdf_value
        )
    return known


def _urdf_limits(tree: Tree, name: str) -> dict[str, float]:
    """Limits that the URDF states in earnest: a velocity or effort of 0, or an empty range, is a gap."""
    joint = tree.urdf.joints[name]
    found: dict[str, float] = {}
    if joint.kind == "continuous":
        found |= {"position_lower": -np.inf, "position_upper": np.inf}
    elif joint.lower is not None and joint.upper is not None and joint.lower < joint.upper:
        found |= {"position_lower": joint.lower, "position_upper": joint.upper}
    if joint.velocity is not None and 0.0 < joint.velocity < np.inf:
        found["velocity"] = joint.velocity
    if joint.effort is not None and joint.effort > 0.0:
        found["torque"] = joint.effort
    return found


def _file_limits(tree: Tree, model_file: Mapping[str, Any]) -> dict[tuple[str, str], Limit]:
    limits = {}
    for quantity, entry in model_file.get("limits", {}).items():
        factor, certainty = _TO_SI[entry["unit"]], Certainty(entry["certainty"])
        for joint, value in zip(model_file["joints"], entry["values"], strict=True):
            if joint in tree.joints:
                unit = unit_of(quantity, tree.prismatic[joint])
                limits[joint, quantity] = Limit(
                    joint, quantity, value * factor, unit, entry["source"], certainty
                )
    return limits


def _declared_parts(tree: Tree, model_file: Mapping[str, Any], setup: RobotSetup) -> list[EnclosedPart]:
    """Capsules that a model file or a user states for a link, in the link's frame."""
    file_rows = read_rows(model_file, "enclosure", "model file")
    stated = [(row, str(row["source"]), Certainty(str(row["certainty"]))) for row in file_rows]
    stated += [(row, "declared in the setup", Certainty.DECLARED) for row in setup.enclosure]
    names = [str(row.get("link")) for row, _, _ in stated]
    parts = []
    for i, (row, source, certainty) in enumerate(stated):
        where, link = f"enclosure[{i}]", str(row.get("link"))
        check_keys(row, ("link",), ("link", "a_m", "b_m", "radius_m", "source", "certainty"), where)
        joint, placement = frame_placement(tree, link)
        capsule = read_capsule({key: row[key] for key in ("a_m", "b_m", "radius_m") if key in row}, where)
        name = link if names.count(link) == 1 else f"{link}:{names[: i + 1].count(link)}"
        parts.append(EnclosedPart(name, joint, placed(capsule, placement), NO_CORNERS, certainty, source))
    return parts


def _tool_parts(tree: Tree, model_file: Mapping[str, Any], setup: RobotSetup) -> list[EnclosedPart]:
    tool = setup.tool
    if tool is None:
        return []
    frame = tool.frame or model_file.get("flange")
    if frame is None:
        raise SetupError(
            f"tool {tool.name}: {tree.urdf.path.name} names no flange; give frame = a link's name"
        )
    joint, placement = frame_placement(tree, frame)
    parts = []
    for kind, capsules in (("tool", tool.capsules), ("payload", tool.payload)):
        name = f"{kind}:{tool.name}"
        for capsule in capsules:
            moved = placed(capsule, placement)
            parts.append(EnclosedPart(name, joint, moved, NO_CORNERS, tool.certainty, tool.source))
    cache_dir = setup.cache_dir or default_cache_dir()
    for mesh in tool.meshes:
        parts += enclose_mesh(f"tool:{tool.name}", mesh.file, joint, placement @ mesh.placement, cache_dir)
    return _numbered(parts)


def _numbered(parts: Sequence[EnclosedPart]) -> list[EnclosedPart]:
    names = [part.name for part in parts]
    numbered = []
    for i, part in enumerate(parts):
        name = part.name if names.count(part.name) == 1 else f"{part.name}:{names[: i + 1].count(part.name)}"
        numbered.append(
            EnclosedPart(name, part.joint, part.capsule, part.corners, part.certainty, part.source)
        )
    return numbered


def _check_every_joint_enclosed(tree: Tree, parts: Sequence[EnclosedPart]) -> None:
    enclosed = {part.joint for part in parts}
    bare = [tree.urdf.joints[joint].child for i, joint in enumerate(tree.joints) if i not in enclosed]
    if bare:
        raise SetupError(
            f"{tree.urdf.path}: moving link without geometry: {', '.join(bare)}; state a capsule for each: "
            "[[enclosure]] with link, a_m, b_m, radius_m"
        )


def _assumed_quantities(rows: Sequence[Limit]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(row.quantity for row in rows if row.certainty is Certainty.ASSUMED))


def _assumptions(description: Description, setup: RobotSetup) -> tuple[Assumption, ...]:
    prefix = f"robot.{description.name}"
    found = [
        Assumption(f"{prefix}.{row.quantity}.{row.joint}", row.value, row.unit, row.source, row.certainty)
        for row in description.rows
    ]
    found += [
        Assumption(
            f"{prefix}.enclosure.{part.name}.radius", part.capsule.radius, "m", part.source, part.certainty
        )
        for part in description.parts
    ]
    found.append(_mount_assumption(prefix, setup.mount))
    return tuple(found)


def _mount_assumption(prefix: str, mount: Mount) -> Assumption:
    if mount.is_identity:
        return Assumption(f"{prefix}.mount", "world = robot base", "", "nothing declared", Certainty.DEFAULT)
    numbers = ", ".join(f"{x:.6g}" for x in (*mount.translation, *mount.rotation.ravel()))
    return Assumption(
        f"{prefix}.mount", f"translation [m], rotation: {numbers}", "", "declared", Certainty.DECLARED
    )


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(_read_bytes(path).decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SetupError(f"{path}: not a TOML file ({error})") from None


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SetupError(f"{path}: cannot be read ({error.strerror})") from None
