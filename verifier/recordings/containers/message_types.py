"""Decoding messages by the definitions that stand in the file itself (rosbags' type system).

The library turns a definition into Python code of its own and runs that. So names, sizes and lengths are
checked first: nothing but identifiers and whole numbers of a definition ever reaches it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from verifier.recordings import json_text
from verifier.recordings.containers.container import Channel

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

MAX_DEFINITION = 1 << 18
"""Characters of a definition; the largest of common packages have about 20 000."""
MAX_SEQUENCE = 1 << 16
"""Elements of a list in a message; a joint state has tens, a marker array hundreds."""
MAX_ARRAY = 4096
"""Elements of a list of fixed length: the library writes code for each of them."""
TYPE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*){1,3}")
FIELD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
IDL_HEAD = "=" * 80 + "\nIDL: "
UNREADABLE = (
    SerdeError,
    TypesysError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    ArithmeticError,
    SyntaxError,
    RecursionError,
    MemoryError,
)
"""What the library raises on definitions and messages that it cannot make sense of."""


class MessageError(ValueError):
    """A message that cannot be decoded; ``str()`` says why."""


class MessageTypes:
    """Decodes the messages of a container; each channel has its own definition."""

    def __init__(self) -> None:
        self._stores: dict[Channel, Typestore] = {}

    def decode(self, channel: Channel, data: bytes) -> Any:
        """Return a message: attributes as the definition has them, a ``dict`` for JSON.

        Raises
        ------
        MessageError
            The definition is missing, not readable or too large; or the message does not follow it.
        """
        if channel.encoding == "json":
            return _json(data)
        if channel.encoding not in ("cdr", "ros1"):
            raise MessageError(f"encoding {channel.encoding[:40]!r} is not read")
        if channel not in self._stores:
            self._stores[channel] = _store(channel)
        store = self._stores[channel]
        try:
            if channel.encoding == "cdr":
                return store.deserialize_cdr(data, channel.schema)
            return store.deserialize_ros1(data, channel.schema)
        except UNREADABLE as error:
            raise MessageError(f"does not follow its definition ({_reason(error)})") from error


def without_definition(channel: Channel) -> bool:
    """Whether the file does not say how the messages of a channel are laid out."""
    return channel.encoding in ("cdr", "ros1") and not channel.definition.strip()


def is_laid_out_as(channel: Channel, definition: str) -> bool:
    """Whether the messages of a channel are laid out as ``definition`` (``ros2msg``) of the same type says.

    A file that does not say how they are laid out contradicts nothing. One whose definition cannot be read
    does: nobody knows.
    """
    if without_definition(channel):
        return True
    standard = get_types_from_msg(definition, channel.schema)
    try:
        _store(channel)
        found = dict(_definitions(channel))
    except MessageError:
        return False
    return all(found[name][1] == fields for name, (_, fields) in standard.items() if name in found)


def _json(data: bytes) -> dict[str, Any]:
    try:
        value = json_text.loads(data)
    except (json_text.JsonError, RecursionError) as error:
        raise MessageError(str(error) or "nested too deeply") from error
    if not isinstance(value, dict):
        raise MessageError("not a JSON object")
    return value


def _store(channel: Channel) -> Typestore:
    """A type store with the type of a channel, and what that needs."""
    if not TYPE_NAME.fullmatch(channel.schema):
        raise MessageError(f"{channel.schema[:80]!r} is no name of a message type")
    if without_definition(channel):
        return _known(channel.schema)
    if len(channel.definition) > MAX_DEFINITION:
        raise MessageError(f"its definition has more than {MAX_DEFINITION} characters")
    try:
        types = dict(_definitions(channel))
        _check(types)
        store = get_typestore(Stores.EMPTY)
        store.max_sequence_length = MAX_SEQUENCE
        store.register({name: entry for name, entry in types.items() if name not in store.types})
        store.get_msgdef(channel.schema)
    except MessageError:
        raise
    except UNREADABLE as error:
        raise MessageError(f"its definition in the file cannot be read ({_reason(error)})") from error
    return store


def _known(schema: str) -> Typestore:
    """Definitions of Humble, for bags of ROS 2 before Iron (2023), which hold none; the caller says so."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    if schema not in store.types:
        raise MessageError(
            f"the file does not say how {schema} is laid out; record it with ROS 2 Iron or later, or convert "
            "the bag to MCAP on the machine that has its package"
        )
    store.max_sequence_length = MAX_SEQUENCE
    return store


def _definitions(channel: Channel) -> Iterator[tuple[str, Any]]:
    text = channel.definition.replace("\r\n", "\n")
    if channel.definition_encoding != "ros2idl":
        yield from get_types_from_msg(text, channel.schema).items()
        return
    parts = (
        text.split("=" * 80 + "\n")[1:] if text.startswith(IDL_HEAD) else [f"IDL: {channel.schema}\n{text}"]
    )
    for part in parts:
        yield from get_types_from_idl(part.partition("\n")[2]).items()


def _check(types: Typesdict) -> None:
    """Refuse what the library would turn into code that is endless, or no code of its own."""
    for name, (constants, fields) in types.items():
        if not TYPE_NAME.fullmatch(name):
            raise MessageError(f"{name[:80]!r} is no name of a message type")
        for field in [*(constant[0] for constant in constants), *(field[0] for field in fields)]:
            if not FIELD_NAME.fullmatch(field):
                raise MessageError(f"{field[:80]!r} is no name of a field")
        for field, description in fields:
            if description[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                (kind, element), length = description[1]
                if description[0] == Nodetype.ARRAY and not 0 <= length <= MAX_ARRAY:
                    raise MessageError(f"{name}.{field} has {length} elements, more than {MAX_ARRAY}")
                if kind == Nodetype.NAME and not _takes_room(str(element), types, frozenset()):
                    raise MessageError(f"{name}.{field} is a list of {element}, which holds nothing")


def _takes_room(name: str, types: Typesdict, above: frozenset[str]) -> bool:
    """Whether a message of a type has at least a byte: of others any number would fit into none."""
    if name in above:
        raise MessageError(f"{name} contains itself")
    if name not in types:
        return True
    return any(
        kind in (Nodetype.BASE, Nodetype.SEQUENCE)
        or (kind == Nodetype.NAME and _takes_room(str(rest), types, above | {name}))
        or (kind == Nodetype.ARRAY and _array_takes_room(rest, types, above | {name}))
        for _field, (kind, rest) in types[name][1]
    )


def _array_takes_room(rest: Any, types: Typesdict, above: frozenset[str]) -> bool:
    (kind, element), length = rest
    return length > 0 and (kind == Nodetype.BASE or _takes_room(str(element), types, above))


def _reason(error: BaseException) -> str:
    text = " ".join(str(error).split())[:200]
    return text or type(error).__name__
