"""A snapshot is what an object holds, as JSON values and bytes: by its type annotations, and to the last bit.

What goes on from a snapshot must round as it would have without. So arrays come back with their strides, because sums
over numbers that lie differently in memory add up in another order; and what two places share they share again, or
one of them would go on alone. Serialisation libraries do neither, and would rather make a value fit than refuse it.

A class is dataclass or named tuple, written field by field; no list of fields stands anywhere else. Fields that are
:data:`DERIVED` are left out and get their default. Nothing is looked up by a name from a snapshot but fields,
members of enumerations and the functions of :mod:`trackfg.factors`.

==============================  ======================================================================================
annotation                      as JSON
==============================  ======================================================================================
``bool``, ``int``, ``str``      itself
``float``                       a number, ``Infinity`` or ``NaN``; all digits
a NumPy scalar under these      ``{"float64": ...}``: its class makes a difference where it is divided by zero
``X | None``                    ``null`` or ``[X]``
tuple, list                     a list
mapping                         a list of pairs
enumeration                     the member's name
``Callable``                    module and name of a function of :mod:`trackfg.factors`
array                           number of the object: type, shape, strides, where in the bytes it begins
dataclass, named tuple          number of the object: ``{field: value}``
abstract class                  name of one of its subclasses, and that one's form
a class that is *given*         ``null``: whoever takes up the snapshot has the same one
==============================  ======================================================================================
"""

from __future__ import annotations

import collections.abc
import dataclasses
import importlib
import inspect
import pkgutil
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from functools import cache
from typing import Any, NamedTuple, Protocol, get_args, get_origin

import numpy as np

import trackfg.factors
from trackfg.errors import BadInputError, first_line

DERIVED: Mapping[str, bool] = types.MappingProxyType({"made again": True})
"""Metadata of a dataclass's field that is derived from the others whenever it is needed."""

_ARRAYS = ("<f8", "<f4", "<i8", "<i4", "|b1")
_SCALARS = {kind.name: kind.type for kind in map(np.dtype, _ARRAYS)}
_LARGEST_BYTES = 2**32
"""The largest array with what lies between its numbers, bytes."""


_MISFITS = (KeyError, TypeError, ValueError, AttributeError, NameError, OverflowError, MemoryError, RecursionError)
"""What making an object from something else raises; ``NameError`` where its class is known only with what is given."""


class Snapshot(NamedTuple):
    """``tree``: JSON values, ``data``: the arrays' numbers."""

    tree: dict[str, Any]
    data: bytes


def dump(thing: object, given: Iterable[object] = ()) -> Snapshot:
    """Return the attributes of a thing, each of which its class annotates. What is ``given`` is left out, by its class.

    Raises ``TypeError`` for an attribute that is not annotated, or is not what its annotation says.
    """
    writer = _Writer({type(instance): instance for instance in given})
    attributes, hints = vars(thing), _hints(type(thing), writer.given)
    if attributes.keys() != hints.keys():
        raise TypeError(f"{type(thing).__name__}: {set(attributes) ^ set(hints)} of attributes and annotations differ")
    tree = {name: _form(hints[name]).write(value, writer) for name, value in attributes.items()}
    return Snapshot({"attributes": tree, "objects": writer.objects}, b"".join(writer.data))


def load_attributes(kind: type, snapshot: Snapshot, given: Iterable[object] = ()) -> dict[str, Any]:
    """Return the attributes that a thing of class ``kind`` had.

    Raises :class:`~trackfg.errors.BadInputError` for a snapshot that does not fit the classes as they are.
    """
    by_class = {type(instance): instance for instance in given}
    hints = _hints(kind, by_class)
    try:
        reader = _Reader(snapshot.tree["objects"], snapshot.data, by_class)
        return reader.fields(snapshot.tree["attributes"], {name: _form(hint) for name, hint in hints.items()})
    except _MISFITS as error:
        raise BadInputError(f"the state is not one of {kind.__name__} ({first_line(error)})") from error


class _Writer:
    def __init__(self, given: Mapping[type, object]) -> None:
        self.given = given
        self.objects: list[Any] = []
        self.data: list[bytes] = []
        self._size = 0
        self._places: dict[int, int] = {}

    def place(self, value: object, node: Callable[[], Any]) -> int:
        """Return the number of an object, which is written when it is met for the first time."""
        if id(value) not in self._places:
            content = node()
            self._places[id(value)] = len(self.objects)
            self.objects.append(content)
        return self._places[id(value)]

    def stored(self, array: np.ndarray) -> int:
        """Store an array; return where its numbers begin."""
        at = self._size
        self.data.append(array.tobytes())
        self._size += array.nbytes
        return at


class _Reader:
    def __init__(self, objects: list[Any], data: bytes, given: Mapping[type, object]) -> None:
        self.data, self.given = data, given
        self._objects = objects
        self._made: dict[int, Any] = {}

    def object(self, place: Any, kind: type, made: Callable[[Any], Any]) -> Any:
        """Return the object of that number, made from its node when it is met for the first time."""
        if type(place) is not int or not 0 <= place < len(self._objects):
            raise ValueError(f"{place!r} is no object")
        if place not in self._made:
            self._made[place] = made(self._objects[place])
        if type(self._made[place]) is not kind:
            raise ValueError(f"object {place} is no {kind.__name__}")
        return self._made[place]

    def fields(self, node: Any, forms: Mapping[str, _Form]) -> dict[str, Any]:
        if node.keys() != forms.keys():
            raise ValueError(f"{', '.join(node)} instead of {', '.join(forms)}")
        return {name: form.read(node[name], self) for name, form in forms.items()}


class _Form(Protocol):
    """The form in which values of one annotation are written and read."""

    def write(self, value: Any, to: _Writer) -> Any: ...

    def read(self, node: Any, source: _Reader) -> Any: ...


@cache
def _form(annotation: Any) -> _Form:
    origin, arguments = get_origin(annotation) or annotation, get_args(annotation)
    if origin in (bool, int, str, float):
        return _Plain(origin)
    if origin is np.ndarray:
        return _Arrays()
    if origin is collections.abc.Callable:
        return _Functions()
    if origin in (typing.Union, types.UnionType) and len(arguments) == 2 and type(None) in arguments:
        return _Optional(_form(next(argument for argument in arguments if argument is not type(None))))
    if origin is list or (origin is tuple and arguments[1:] == (...,)):
        return _Many(origin, _form(arguments[0]))
    if origin is tuple:
        return _Fixed(tuple(_form(argument) for argument in arguments))
    if origin in (dict, collections.abc.Mapping):
        return _Pairs(_Fixed(tuple(_form(argument) for argument in arguments)))
    if inspect.isclass(origin):
        if inspect.isabstract(origin):
            return _Variants(origin)
        return _Members(origin) if issubclass(origin, Enum) else _Structure(origin)
    raise TypeError(f"{annotation}: a snapshot has no form for it")


def _expect(value: object, *kinds: type) -> None:
    if type(value) not in kinds:
        raise TypeError(f"{type(value).__name__} {str(value)[:60]!r} where {kinds[0].__name__} is expected")


@dataclasses.dataclass(frozen=True)
class _Plain:
    kind: type

    def write(self, value: Any, to: _Writer) -> Any:
        if isinstance(value, np.generic) and value.dtype.name in _SCALARS:
            return {value.dtype.name: value.item()}
        return self.read(value, None)

    def read(self, node: Any, source: _Reader | None) -> Any:
        if type(node) is dict:
            ((name, value),) = node.items()
            return _SCALARS[name](value)
        _expect(node, self.kind, *((int,) if self.kind is float else ()))
        return node


@dataclasses.dataclass(frozen=True)
class _Optional:
    form: _Form

    def write(self, value: Any, to: _Writer) -> Any:
        return None if value is None else [self.form.write(value, to)]

    def read(self, node: Any, source: _Reader) -> Any:
        if node is None:
            return None
        (inner,) = node
        return self.form.read(inner, source)


@dataclasses.dataclass(frozen=True)
class _Many:
    kind: type
    form: _Form

    def write(self, value: Any, to: _Writer) -> Any:
        _expect(value, self.kind)
        return [self.form.write(item, to) for item in value]

    def read(self, node: Any, source: _Reader) -> Any:
        _expect(node, list)
        return self.kind(self.form.read(item, source) for item in node)


@dataclasses.dataclass(frozen=True)
class _Fixed:
    forms: tuple[_Form, ...]

    def write(self, value: Any, to: _Writer) -> Any:
        _expect(value, tuple)
        return [form.write(item, to) for form, item in zip(self.forms, value, strict=True)]

    def read(self, node: Any, source: _Reader) -> Any:
        _expect(node, list)
        return tuple(form.read(item, source) for form, item in zip(self.forms, node, strict=True))


@dataclasses.dataclass(frozen=True)
class _Pairs:
    pair: _Fixed

    def write(self, value: Any, to: _Writer) -> Any:
        _expect(value, dict)
        return [self.pair.write(pair, to) for pair in value.items()]

    def read(self, node: Any, source: _Reader) -> Any:
        _expect(node, list)
        return dict(self.pair.read(pair, source) for pair in node)


@dataclasses.dataclass(frozen=True)
class _Members:
    kind: type[Enum]

    def write(self, value: Any, to: _Writer) -> Any:
        _expect(value, self.kind)
        return value.name

    def read(self, node: Any, source: _Reader) -> Any:
        return self.kind[node]


class _Functions:
    def write(self, value: Any, to: _Writer) -> Any:
        name = f"{value.__module__}.{value.__qualname__}"
        if _functions().get(name) is not value:
            raise TypeError(f"{name}: expected a function of trackfg.factors")
        return name

    def read(self, node: Any, source: _Reader) -> Any:
        return _functions()[node]


@cache
def _functions() -> dict[str, Callable[..., Any]]:
    """Return all functions of :mod:`trackfg.factors`, by module and name."""
    functions: dict[str, Callable[..., Any]] = {}
    for info in pkgutil.iter_modules(trackfg.factors.__path__, "trackfg.factors."):
        module = importlib.import_module(info.name)
        for function in vars(module).values():
            if inspect.isfunction(function) and function.__module__ == info.name:
                functions[f"{info.name}.{function.__qualname__}"] = function
    return functions


class _Arrays:
    def write(self, value: Any, to: _Writer) -> Any:
        _expect(value, np.ndarray)
        return to.place(value, lambda: self._node(value, to))

    def read(self, node: Any, source: _Reader) -> Any:
        return source.object(node, np.ndarray, lambda content: self._made(content, source))

    @staticmethod
    def _node(value: np.ndarray, to: _Writer) -> Any:
        if value.dtype.str not in _ARRAYS:
            raise TypeError(f"an array of {value.dtype}: expected one of {', '.join(_ARRAYS)}")
        return [value.dtype.str, value.shape, value.strides, to.stored(value)]

    @staticmethod
    def _made(node: Any, source: _Reader) -> np.ndarray:
        kind, shape, strides, at = node
        if kind not in _ARRAYS or at < 0 or min(shape, default=0) < 0:
            raise ValueError(f"no array: {node}")
        dtype, size = np.dtype(kind), int(np.prod(shape, dtype=object))
        values: np.ndarray = np.frombuffer(source.data, dtype, size, at).reshape(shape) if size else np.empty(shape)
        ends = [(n - 1) * stride for n, stride in zip(shape, strides, strict=True)] if size else []
        first, last = sum(min(end, 0) for end in ends), sum(max(end, 0) for end in ends)
        if last - first > _LARGEST_BYTES:
            raise ValueError(f"an array over {last - first} bytes")
        buffer = np.empty(last - first + dtype.itemsize, dtype=np.uint8)
        made: np.ndarray = np.ndarray(shape, dtype, buffer, -first, strides)
        made[...] = values
        return made


class _Structure:
    def __init__(self, kind: type) -> None:
        self.kind = kind

    def write(self, value: Any, to: _Writer) -> Any:
        if self.kind in to.given:
            if value is not to.given[self.kind]:
                raise TypeError(f"another {self.kind.__name__} than the given one")
            return None
        _expect(value, self.kind)
        forms = _fields(self.kind, tuple(to.given))
        return to.place(value, lambda: {name: form.write(getattr(value, name), to) for name, form in forms.items()})

    def read(self, node: Any, source: _Reader) -> Any:
        if self.kind in source.given:
            _expect(node, type(None))
            return source.given[self.kind]
        forms = _fields(self.kind, tuple(source.given))
        return source.object(node, self.kind, lambda fields: self.kind(**source.fields(fields, forms)))


class _Variants:
    """Values of one of the subclasses of an abstract class."""

    def __init__(self, kind: type) -> None:
        variants: list[type] = kind.__subclasses__()
        self.forms = {variant.__name__: _Structure(variant) for variant in variants}

    def write(self, value: Any, to: _Writer) -> Any:
        name = type(value).__name__
        return [name, self.forms[name].write(value, to)]

    def read(self, node: Any, source: _Reader) -> Any:
        name, inner = node
        return self.forms[name].read(inner, source)


@cache
def _fields(kind: type, given: tuple[type, ...]) -> dict[str, _Form]:
    if dataclasses.is_dataclass(kind):
        names = [field.name for field in dataclasses.fields(kind) if not field.metadata.keys() & DERIVED.keys()]
    elif issubclass(kind, tuple) and hasattr(kind, "_fields"):
        names = list(kind._fields)
    else:
        raise TypeError(f"{kind.__name__}: expected a dataclass or a named tuple")
    hints = _hints(kind, given)
    return {name: _form(hints[name]) for name in names}


def _hints(kind: type, given: Iterable[type]) -> dict[str, Any]:
    """Return annotations; what is given may be imported for type checkers alone where the class is."""
    return typing.get_type_hints(kind, localns={other.__name__: other for other in given})
