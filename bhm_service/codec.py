"""Messages and what apps remember, as JSON and back: floats to the last bit, arrays, enumerations, nested records."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Callable
from enum import Enum
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from bhm_service import messages

Kind = TypeVar("Kind")


class NotThisKindError(ValueError):
    """What was read is not what was written under that name."""


def packed(value: Any, bulk: bool = True) -> Any:
    """``value`` as what JSON can hold; without ``bulk`` the fields that are declared ``repr=False`` are left out."""
    if value is None or isinstance(value, str | bool | int | float):
        return float(value) if isinstance(value, np.floating) else value
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [packed(item, bulk) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(packed(item, bulk) for item in value)
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: packed(item, bulk) for key, item in value.items()}
    if isinstance(value, dict):
        return [[packed(key, bulk), packed(item, bulk)] for key, item in value.items()]
    if isinstance(value, type):
        return value.__name__
    if dataclasses.is_dataclass(value):
        of: Any = type(value)
        return {name: packed(getattr(value, name), bulk) for name, small in _fields(of) if bulk or small}
    raise TypeError(f"{type(value).__name__} cannot be written")


def unpacked(kind: type[Kind], data: Any) -> Kind:
    """The ``kind`` that was packed. Raises NotThisKindError for anything else."""
    try:
        of: Any = kind
        value: Kind = _reader(of)(data)
    except (TypeError, ValueError, KeyError, AttributeError, IndexError) as why:
        raise NotThisKindError(f"no {getattr(kind, '__name__', kind)}: {why}") from None
    return value


@cache
def _fields(kind: type) -> tuple[tuple[str, bool], ...]:
    return tuple((field.name, field.repr) for field in dataclasses.fields(kind))


@cache
def _reader(kind: Any) -> Callable[[Any], Any]:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _either(arguments)
    if origin is np.ndarray:
        return lambda data: np.array(data, dtype=float)
    if origin is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            item = _reader(arguments[0])
            return lambda data: tuple(item(part) for part in data)
        items = [_reader(argument) for argument in arguments]
        return lambda data: tuple(read(part) for read, part in zip(items, data, strict=True))
    if origin in (list, set):
        item = _reader(arguments[0])
        return lambda data: origin(item(part) for part in data)
    if origin is dict:
        key, item = map(_reader, arguments)
        return lambda data: {key(k): item(v) for k, v in (data.items() if isinstance(data, dict) else data)}
    if kind is type or origin is type:
        return _message_type
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return _record(kind)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind
    if kind is Any:
        return lambda data: data
    if kind is float:
        return _number
    return lambda data: _exactly(kind, data)


def _either(arguments: tuple[Any, ...]) -> Callable[[Any], Any]:
    others = [argument for argument in arguments if argument is not types.NoneType]
    if len(others) != 1:
        raise TypeError(f"more than one kind of thing under one name: {arguments}")
    read = _reader(others[0])
    return lambda data: None if data is None else read(data)


def _record(kind: type) -> Callable[[Any], Any]:
    hints = get_type_hints(kind)
    readers = {name: _reader(hints[name]) for name, _ in _fields(kind)}

    def read(data: Any) -> Any:
        return kind(**{name: readers[name](value) for name, value in data.items() if name in readers})

    return read


def _number(data: Any) -> float:
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise TypeError(f"{data!r} is not a number")
    return float(data)


def _exactly(kind: type, data: Any) -> Any:
    if type(data) is not kind:
        raise TypeError(f"{data!r} is not a {kind.__name__}")
    return data


def _message_type(name: Any) -> Any:
    return getattr(messages, _exactly(str, name))
