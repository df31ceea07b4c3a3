"""Rules of a URDF that its parsers do not enforce: what they would skip, guess or print about is refused."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

from robots.capsule import LARGEST
from robots.errors import SetupError
from robots.files import shown

Element = ElementTree.Element

MAX_DEPTH = 50
"""Elements inside one another; a URDF needs six."""
_LARGEST_SCALE = 1e6
_MEANT = {
    "robot": ("link", "joint"),
    "link": ("visual", "collision"),
    "visual": ("origin", "geometry"),
    "collision": ("origin", "geometry"),
    "joint": ("origin", "parent", "child", "axis", "limit", "mimic"),
}
"""What is read of each element. All else has no bearing on where the arm is, and is left out."""
_HOLDS = ("link", "joint", "visual", "collision", "geometry", "include", "collision_checking")
"""What must not be lost inside an element that is not read; the last one makes capsules of cylinders."""
_FOREIGN = ("gazebo", "transmission", "ros2_control", "self_filter")
"""Elements of simulators and controllers that name joints and shapes a second time; left out whole."""
_MAY_REPEAT = ("link", "joint", "visual", "collision")
_SIZES = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1}, "mesh": {}}
"""Shape -> attribute -> how many numbers [m]; a mesh has a file and a scale."""
_ATTRIBUTES = {
    **{shape: tuple(sizes) for shape, sizes in _SIZES.items()}, "mesh": ("filename", "scale"),
    "visual": ("name",), "collision": ("name",), "geometry": ("name",), "origin": ("xyz", "rpy"),
    "mimic": ("joint", "multiplier", "offset"),
}  # fmt: skip
"""What may be written in each element; parsers ignore all else, misspelt ones too."""


def read_xml(content: bytes, where: str) -> Element:
    """Return the root <robot>, without the elements that are not read.

    Raises
    ------
    SetupError
        If it is no XML, nested too deeply, no robot, a name is missing or does not print, it is xacro that
        was not expanded, there is a DOCTYPE, or an element that is not read holds links, joints or shapes.
    """
    builder = _Builder()
    try:
        root = ElementTree.fromstring(content, ElementTree.XMLParser(target=builder))
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise SetupError(f"{where}: not XML ({' '.join(str(error).split())})") from None
    if builder.has_doctype:
        raise SetupError(f"{where}: has a DOCTYPE; write it without, other files may belong to it")
    level, depth = [root], 0
    while level:
        level, depth = [child for element in level for child in element], depth + 1
        if depth > MAX_DEPTH:
            raise SetupError(
                f"{where}: its elements are nested more than {MAX_DEPTH} deep: no URDF needs that"
            )
    _require_expanded(root, where)
    if root.tag != "robot":
        raise SetupError(f"{where}: the root element is <{root.tag}>, a URDF has <robot>")
    if not root.get("name", "").isprintable():
        raise SetupError(f"{where}: robot name {root.get('name')!r} must be one line of text that prints")
    _keep_what_is_meant(root, where)
    seen: set[tuple[str, str]] = set()
    for element in root:
        name = element.get("name", "")
        if not name or not name.isprintable():
            raise SetupError(f"{where}: a {element.tag} has the name {name!r}; it must be text that prints")
        if (element.tag, name) in seen:
            raise SetupError(f"{where}: two {element.tag}s are called {name}; each needs a name of its own")
        seen.add((element.tag, name))
        _keep_what_is_meant(element, f"{where}: {element.tag} {name}")
    return root


def check_shapes(link: Element, where: str) -> dict[str, int]:
    """Check every shape of a link; return how many it has: ``visual``, ``collision`` -> number.

    Parsers leave out a shape they cannot read and go on: the link would be taken for smaller than it is.

    Raises
    ------
    SetupError
        For geometry that is missing, of an unknown type, or has a size or place that is no number.
    """
    for kind in ("visual", "collision"):
        for i, element in enumerate(link.findall(kind)):
            place = f"{where}: {kind}[{i}]"
            _keep_what_is_meant(element, place)
            check_origin(element, place)
            check_attributes(element, place)
            geometry = element.find("geometry")
            found = 0 if geometry is None else len(geometry)
            if geometry is None or found != 1:
                raise SetupError(f"{place} has {found} shapes; it must have one <geometry> with one shape")
            check_attributes(geometry, place)
            _check_shape(geometry[0], place)
    return {kind: len(link.findall(kind)) for kind in ("visual", "collision")}


def check_origin(element: Element, where: str) -> None:
    """Check the placement of a shape or joint: three numbers ``xyz`` [m], three numbers ``rpy`` [rad].

    Raises
    ------
    SetupError
        If they are something else, or there is another attribute (parsers ignore a misspelt one).
    """
    origin = element.find("origin")
    if origin is None:
        return
    check_attributes(origin, where)
    for key in tuple(origin.attrib):
        text, numbers = origin.get(key), _numbers(origin, key)
        if len(numbers) != 3 or not all(abs(number) <= LARGEST for number in numbers):
            raise SetupError(
                f"{where}: origin {key} = {text!r} must be three numbers from -{LARGEST:g} to {LARGEST:g}"
            )


def check_attributes(element: Element, where: str) -> None:
    """Refuse attributes of a shape, an origin or a mimic that are not read.

    Raises
    ------
    SetupError
        If there is one.
    """
    possible = _ATTRIBUTES[element.tag]
    for key in element.attrib:
        if key not in possible:
            raise SetupError(
                f"{where}: {element.tag} has the attribute {key}; possible are: {', '.join(possible)}"
            )


def check_tree(links: Sequence[str], joints: Iterable[tuple[str, str, str]], where: str) -> None:
    """Check that joints (name, parent link, child link) make one tree of all links.

    Raises
    ------
    SetupError
        Naming the links: one that two joints carry, a ring, several roots, no link at all.
    """
    carried: dict[str, tuple[str, str]] = {}
    for name, parent, child in joints:
        if child in carried:
            raise SetupError(
                f"{where}: link {child} is the child of two joints, {carried[child][0]} and {name}; "
                "a link hangs on one joint"
            )
        carried[child] = name, parent
    hanging: set[str] = set()
    for link in links:
        way: list[str] = []
        while link in carried and link not in hanging:
            hanging.add(link)
            way.append(link)
            link = carried[link][1]
        if link in way:
            ring = " - ".join([*way[way.index(link) :], link])
            raise SetupError(f"{where}: joints make a ring of the links {ring}; a URDF is a tree")
    roots = [link for link in links if link not in carried]
    if len(roots) != 1:
        found = f"links {', '.join(roots)} all hang on nothing" if roots else "there is no link"
        raise SetupError(f"{where}: {found}; a URDF has one root link, and joints carry all others")


def number(text: str) -> float:
    """Return the number that ``text`` is, NaN where it is none; as strict as other parsers are."""
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan


class _Builder(ElementTree.TreeBuilder):
    """Notes a DOCTYPE, which may name another file: the parser would go on without that."""

    has_doctype = False

    def doctype(self, *_: str | None) -> None:
        self.has_doctype = True


def _require_expanded(root: Element, where: str) -> None:
    """Refuse xacro: what it includes or calls would be missing."""
    for element in root.iter():
        namespace, _, name = element.tag.rpartition("}")
        if "xacro" in namespace.lower():
            raise SetupError(f"{where}: <xacro:{name}> is not expanded: run xacro first")
        if element.tag in ("link", "joint") and "${" in (text := element.get("name", "")):
            raise SetupError(f"{where}: the name {shown(text)} is not expanded: run xacro first")


def _keep_what_is_meant(element: Element, where: str) -> None:
    """Leave out children that are not read.

    Refused are one in other letters, a second of one kind, and one that holds links, joints or shapes,
    at any depth: they would be lost. Only what stands in ``_FOREIGN`` may hold such.
    """
    meant = _MEANT[element.tag]
    for child in element:
        name = _local(child)
        if name in meant and child.tag not in meant:
            raise SetupError(f"{where}: <{child.tag}> is not read; write <{name}> if that is meant")
        looked_at_later = child.tag in meant and child.tag in _MEANT
        if not looked_at_later and child.tag not in _FOREIGN:
            _require_nothing_lost(child, child.tag in meant, where)
        if "}" in child.tag:
            raise SetupError(f"{where}: <{child.tag}> is of another namespace; what it means would be lost")
    element[:] = [child for child in element if child.tag in meant]
    for tag in meant:
        if tag not in _MAY_REPEAT and len(element.findall(tag)) > 1:
            raise SetupError(f"{where}: <{tag}> stands there {len(element.findall(tag))} times; one is read")


def _require_nothing_lost(child: Element, itself_is_read: bool, where: str) -> None:
    for inner in child.iter():
        if _local(inner) in _HOLDS and not (inner is child and itself_is_read):
            place = "here" if inner is child else f"inside <{child.tag}>"
            raise SetupError(f"{where}: <{inner.tag}> {place} is not read, and would be lost")


def _local(element: Element) -> str:
    """Name of an element without its namespace, in small letters."""
    return element.tag.rsplit("}", 1)[-1].rsplit(":", 1)[-1].lower()


def _check_shape(shape: Element, where: str) -> None:
    if shape.tag not in _SIZES:
        raise SetupError(
            f"{where}: shape <{shape.tag}> is not supported; possible are: {', '.join(_SIZES)} "
            "(or state a capsule for the link in a cell file, and leave the shape out of the URDF)"
        )
    check_attributes(shape, where)
    if len(shape):
        raise SetupError(f"{where}: {shape.tag} holds a <{shape[0].tag}>, which is not read")
    for key, count in _SIZES[shape.tag].items():
        text, sizes = shape.get(key), _numbers(shape, key)
        if len(sizes) != count or not all(0.0 < size <= LARGEST for size in sizes):
            rule = "three numbers" if count == 3 else "a number"
            raise SetupError(
                f"{where}: {shape.tag} {key} = {text!r} must be {rule} above 0 and at most {LARGEST:g} [m]"
            )
    if shape.tag == "mesh" and "scale" in shape.attrib:
        text, scale = shape.get("scale"), _numbers(shape, "scale")
        if len(scale) != 3 or not all(0.0 < abs(factor) <= _LARGEST_SCALE for factor in scale):
            raise SetupError(
                f"{where}: mesh scale = {text!r} must be three numbers that are not zero, "
                f"at most {_LARGEST_SCALE:g}"
            )


def _numbers(element: Element, key: str) -> list[float]:
    """Read numbers, and write them back so that every parser reads the same ones."""
    numbers = [number(part) for part in element.get(key, "").split()]
    element.set(key, " ".join(map(repr, numbers)))
    return numbers
