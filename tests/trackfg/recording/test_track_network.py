"""Networks of tracks worked out by hand: a main track with a siding, a crossing, relations, a loop."""

from __future__ import annotations

import numpy as np

from trackfg.recording.track_joints import Relation, joined


def line(*vertices: tuple[float, float]) -> np.ndarray:
    return np.array(vertices, dtype=np.float64)


MAIN, SIDING = line((0, 0), (1000, 0)), line((300, 0), (350, 4.5), (700, 4.5), (750, 0))


def test_a_track_is_cut_where_a_siding_touches_it() -> None:
    network = joined(("main", "siding"), (MAIN, SIDING), None)
    assert network.track == ("main", "main", "main", "siding")
    np.testing.assert_allclose(network.length_m[:3], [300.0, 450.0, 250.0])
    assert set(network.ways[0, 1]) == {(1, 0), (3, 0)}
    assert set(network.ways[2, 0]) == {(1, 1), (3, 1)}
    assert network.ways[3, 0] == ((0, 1),)  # not back along the main track


def test_tracks_that_cross_are_not_joined() -> None:
    network = joined(("a", "b"), (line((0, 0), (100, 0)), line((50, -50), (50, 50))), None)
    assert not network.ways
    square = joined(("a", "b"), (line((0, 0), (100, 0)), line((50, 0), (50, 50))), None)
    assert square.ways == {(0, 1): ((1, 0),), (1, 0): ((0, 1),)}  # a wall: nothing turns into it


def test_relations_are_the_ways() -> None:
    ids, lines = ("main", "siding"), (MAIN, SIDING)
    one_way = joined(ids, lines, [Relation("main", 0.3, "siding", 0.0, back=False)])
    assert one_way.track == ("main", "main", "siding")
    assert set(one_way.ways[0, 1]) == {(1, 0), (2, 0)}
    assert (2, 0) not in one_way.ways
    at_ends = joined(("a", "b"), (line((0, 0), (10, 0)), line((10, 0), (10, 30))), [Relation("a", 1.0, "b", 0.0)])
    assert at_ends.ways == {(0, 1): ((1, 0),), (1, 0): ((0, 1),)}  # a file may say what the angle does not
    assert not joined(ids, lines, []).ways


def test_what_a_vehicle_reaches() -> None:
    network = joined(("main", "siding"), (MAIN, SIDING), None)
    assert network.reached((0, 290.0, 1), 20.0) == {(1, 0): 10.0, (3, 0): 10.0}
    assert network.reached((0, 290.0, 1), 5.0) == {}
    assert network.reached((0, 10.0, -1), 1000.0) == {}
    far = network.reached((0, 290.0, 1), 600.0)
    assert far[2, 0] == 10.0 + 450.0  # by the shorter way
    assert network.reached((2, 5.0, -1), 20.0) == {(1, 1): 5.0, (3, 1): 5.0}


def test_feet() -> None:
    network = joined(("main", "siding"), (MAIN, SIDING), None)
    feet = network.feet(line((500, 1), (100, -2), (-3, 1), (500, 40)), np.full(4, 10.0))
    assert feet.point.tolist() == [0, 0, 1, 2]
    assert [network.track[piece] for piece in feet.piece] == ["main", "siding", "main", "main"]
    np.testing.assert_allclose(feet.across, [1.0, -3.5, -2.0, 1.0])
    np.testing.assert_allclose(feet.along[[0, 2]], [200.0, 100.0])
    np.testing.assert_allclose(feet.beyond, [0.0, 0.0, 0.0, 3.0])
    np.testing.assert_allclose(feet.place[0], [500.0, 0.0])
    np.testing.assert_allclose(feet.normal[0], [0.0, 1.0])


def test_a_foot_at_a_corner_is_as_far_as_the_corner() -> None:
    network = joined(("bend",), (line((0, 0), (100, 0), (100, 100)),), None)
    feet = network.feet(line((103, -4)), np.full(1, 10.0))
    np.testing.assert_allclose(feet.across, [-5.0])
    np.testing.assert_allclose(feet.place, [[100.0, 0.0]])


def test_feet_stay_on_their_pieces_far_beyond_an_end() -> None:
    """Solved again, a run may lie tens of metres further along: its points keep the pieces that they were found on."""
    network = joined(("first", "second"), (line((0, 0), (1000, 0)), line((1000, 0), (1200, 40))), None)
    earlier = network.feet(line((995, 1)), np.full(1, 3.0))
    for east in (1040, 1041, 1042):
        earlier = network.feet_on(earlier, line((east, 1)))
        assert [network.track[piece] for piece in earlier.piece] == ["first"]
        np.testing.assert_allclose(earlier.place, [[east, 0.0]])
        np.testing.assert_allclose(earlier.beyond, [east - 1000.0])


def test_feet_are_those_of_every_segment_looked_at() -> None:
    """Against the distance to every segment, for a winding line with long and short segments."""
    rng = np.random.default_rng(5)
    winding = np.cumsum(rng.uniform(0.5, 60.0, (40, 1)) * np.column_stack([np.ones(40), rng.normal(size=40)]), axis=0)
    points = winding[rng.integers(0, 39, 200)] + rng.normal(scale=15.0, size=(200, 2))
    step = np.diff(winding, axis=0)
    offset = points[:, None] - winding[:-1]
    share = np.clip(np.sum(offset * step, axis=2) / np.sum(step**2, axis=1), 0.0, 1.0)
    nearest = np.linalg.norm(offset - share[:, :, None] * step, axis=2).min(axis=1)
    feet = joined(("w",), (winding,), None).feet(points, np.full(200, 80.0))
    inner = feet.beyond == 0.0
    assert inner.sum() > 150
    np.testing.assert_allclose(np.abs(feet.across[inner]), nearest[feet.point[inner]], atol=1e-9)
