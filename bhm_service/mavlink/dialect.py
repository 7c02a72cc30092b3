"""pymavlink's dialect, as tables: layouts, checksums, packing."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads it at import

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ENUM = mavlink


@dataclass(frozen=True, slots=True)
class Layout:
    """How the payload of one message is laid out on the wire."""

    name: str
    unpacker: struct.Struct
    fields: tuple[str, ...]  # in wire order
    lengths: tuple[int, ...]  # how many numbers each field takes; 0 and 1 for one
    extra: bytes  # CRC_EXTRA


@cache
def layout(message_id: int) -> Layout | None:
    """Layout of a message, None for one that the dialect does not know."""
    kind: Any = mavlink.mavlink_map.get(message_id)
    if kind is None:
        return None
    lengths = tuple(
        1 if kind.fieldtypes[kind.fieldnames.index(name)] == "char" else kind.array_lengths[index]
        for index, name in enumerate(kind.ordered_fieldnames)
    )
    return Layout(kind.msgname, kind.unpacker, tuple(kind.ordered_fieldnames), lengths, bytes([kind.crc_extra]))


def unpack(message_id: int, payload: bytes) -> dict[str, Any]:
    """Fields of a payload by name; trailing zeros that MAVLink 2 cut off are put back.

    Raises KeyError for a message that the dialect does not know.
    """
    shape = layout(message_id)
    if shape is None:
        raise KeyError(message_id)
    size = shape.unpacker.size
    numbers = shape.unpacker.unpack(payload[:size].ljust(size, b"\0"))
    values: dict[str, Any] = {}
    at = 0
    for name, length in zip(shape.fields, shape.lengths, strict=True):
        if length > 1:
            values[name] = numbers[at : at + length]
            at += length
        else:
            values[name] = numbers[at]
            at += 1
    return values
