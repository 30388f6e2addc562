"""A snapshot gives back what was taken, to the bit and to the stride, or says what it cannot take."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError
from trackfg.factors.marginal_prior import local_coordinates
from trackfg.numerics.arrays import Array
from trackfg.streaming.checkpoint.snapshot import DERIVED, Snapshot, dump, load_attributes


class Side(Enum):
    LEFT = (1.0,)
    RIGHT = (-1.0,)


class Pair(NamedTuple):
    a: Array
    b: np.ndarray


@dataclass(frozen=True)
class Inner:
    values: Array

    @cached_property
    def total(self) -> float:
        return float(self.values.sum())


@dataclass
class Outer:
    inner: Inner
    again: Inner
    config: SmoothConfig
    side: Side = Side.LEFT
    pairs: tuple[Pair, ...] = ()
    numbers: list[float] = field(default_factory=list)
    named: dict[str, Array] = field(default_factory=dict)
    counted: Mapping[int, tuple[str, bool]] = field(default_factory=dict)
    evaluate: Callable[..., Any] | None = None
    nothing: Inner | None = None
    follows: Inner | None = field(default=None, metadata=DERIVED)


class Thing:
    outer: Outer
    count: int
    until: float

    def __init__(self, outer: Outer, count: Any = 0, until: Any = -np.inf) -> None:
        self.outer, self.count, self.until = outer, count, until


CONFIG = SmoothConfig()


def outer(**parts: Any) -> Outer:
    inner = Inner(np.arange(3.0))
    return Outer(inner, inner, CONFIG, **parts)


def through_a_file(thing: Thing, given: tuple[object, ...] = (CONFIG,)) -> Thing:
    snapshot = dump(thing, given)
    text = json.dumps(snapshot.tree)
    back = object.__new__(Thing)
    vars(back).update(load_attributes(Thing, Snapshot(json.loads(text), snapshot.data), given))
    return back


def test_everything_comes_back() -> None:
    array = np.array([0.1 + 0.2, -0.0, np.nan, np.inf, 5e-324])
    before = outer(
        side=Side.RIGHT,
        pairs=(Pair(array, np.array([True, False])), Pair(np.zeros((0, 7)), np.array([2**62]))),
        numbers=[0.1, -np.inf, 3],
        named={"fixes": np.ones((2, 3))},
        counted={7: ("left", True)},
        evaluate=local_coordinates,
        follows=Inner(np.zeros(2)),
    )
    after = through_a_file(Thing(before, 2)).outer
    assert (after.side, after.numbers, after.counted) == (Side.RIGHT, [0.1, -np.inf, 3], {7: ("left", True)})
    assert after.evaluate is local_coordinates
    assert after.config is CONFIG
    assert after.nothing is after.follows is None
    for ours, theirs in zip(after.pairs, before.pairs, strict=True):
        for one, other in zip(ours, theirs, strict=True):
            assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())


def test_what_is_shared_is_shared_again() -> None:
    shared = np.zeros(2)
    after = through_a_file(Thing(outer(named={"a": shared, "b": shared}))).outer
    assert after.inner is after.again
    assert after.named["a"] is after.named["b"]
    assert after.inner.total == 3.0  # a cached value is no field: it is made again


@given(
    shape=st.lists(st.integers(0, 4), min_size=0, max_size=3),
    order=st.permutations([0, 1, 2]),
    step=st.sampled_from([1, 2, -1, -3]),
    kind=st.sampled_from(["float64", "int64", "bool"]),
)
@settings(max_examples=60, deadline=None)
def test_arrays_lie_in_memory_as_before(shape: list[int], order: list[int], step: int, kind: str) -> None:
    room = np.arange(int(np.prod([abs(step) * n for n in shape])), dtype=np.int64)
    whole = room.reshape([abs(step) * n for n in shape]).astype(kind)
    array = whole[(*(slice(None, None, step) for _ in shape), ...)].transpose(np.argsort(order[: len(shape)]))
    after = through_a_file(Thing(outer(named={"a": array}))).outer.named["a"]
    np.testing.assert_array_equal(after, array, strict=True)
    assert array.size == 0 or after.strides == array.strides


def test_numpys_scalars_stay_numpys() -> None:
    after = through_a_file(Thing(outer(), np.int64(3), np.float64(0.1)))
    assert type(after.count) is np.int64
    assert type(after.until) is np.float64
    assert (after.count, after.until) == (3, 0.1)


def closure(scale: float) -> Callable[..., Any]:
    return lambda x: scale * x


@pytest.mark.parametrize(
    ("thing", "said"),
    [
        (Thing(outer(), "3"), "str '3' where int is expected"),
        (Thing(outer(), True), "bool 'True' where int is expected"),
        (Thing(outer(), until="1"), "str '1' where float is expected"),
        (Thing(outer(evaluate=closure(2.0))), "expected a function of trackfg.factors"),
        (Thing(outer(evaluate=json.loads)), "expected a function of trackfg.factors"),
        (Thing(outer(named={"a": np.array(["text"])})), "an array of <U4"),
        (Thing(outer(named={"a": [1.0]})), "list '.1.0.' where ndarray is expected"),
        (Thing(outer(pairs=[])), "list .* where tuple is expected"),
    ],
)
def test_what_does_not_fit_its_annotation_is_not_taken(thing: Thing, said: str) -> None:
    with pytest.raises(TypeError, match=said):
        dump(thing, (CONFIG,))


def test_an_attribute_without_annotation_is_not_forgotten() -> None:
    thing = Thing(outer())
    vars(thing)["later"] = 1
    with pytest.raises(TypeError, match=r"Thing: \{'later'\} of attributes and annotations differ"):
        dump(thing, (CONFIG,))


def test_what_is_given_must_be_the_same() -> None:
    with pytest.raises(TypeError, match="another SmoothConfig than the given one"):
        dump(Thing(outer()), (SmoothConfig.model_validate({"output": {"rate_hz": 5.0}}),))


def nodes(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where there is something in a tree, the root excepted."""
    inside = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    found = [path] if path else []
    return found + [place for key, value in inside for place in nodes(value, (*path, key))]


ODD = ([], {}, [[]], {"float64": "x"}, {"object": 1}, [1, 2], "os.system", 10**30, -1, ["<f8", [9], [8], 0])
JSON = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3), st.sampled_from(ODD)
)  # fmt: skip


@given(data=st.data())
@settings(max_examples=300, deadline=None)
def test_a_tree_of_wrong_types_is_refused_or_read(data: st.DataObject) -> None:
    before = outer(
        pairs=(Pair(np.ones((2, 3)), np.array([1])),),
        numbers=[1.0],
        counted={7: ("a", True)},
        evaluate=local_coordinates,
    )
    snapshot = dump(Thing(before), (CONFIG,))
    tree = json.loads(json.dumps(snapshot.tree))
    *way, last = data.draw(st.sampled_from(nodes(tree)))
    parent = tree
    for key in way:
        parent = parent[key]
    if data.draw(st.booleans()):
        parent[last] = data.draw(JSON)
    else:
        del parent[last]
    length = data.draw(st.integers(0, len(snapshot.data)))
    with contextlib.suppress(BadInputError):
        load_attributes(Thing, Snapshot(tree, snapshot.data[:length]), (CONFIG,))
