"""Whatever the order of arrival, rows come out in the order of time; and no row is lost without a word."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event
from trackfg.streaming.events import LossReport
from trackfg.streaming.intake.imu_clock import ClockLimits
from trackfg.streaming.intake.reorder_buffer import ReorderBuffer

Tables = dict[str, Array]
RATES = {"imu": 100.0, "tach": 20.0, "fixes": 0.5, "laser/a": 50.0}


def table(t: Array, offset: float = 0.0) -> Array:
    """Times, and a second column that distinguishes the rows."""
    return np.column_stack([t, offset + np.arange(t.size)])


def rows_of(duration_s: float, start_s: float = 0.0, slower: float = 1.0) -> Tables:
    """``slower``: how many times less often the rows come."""
    return {name: table(start_s + np.arange(0.0, duration_s, slower / rate)) for name, rate in RATES.items()}


def batches(arrivals: list[tuple[str, Array]], size: int) -> list[Tables]:
    """Single rows in the order of arrival, ``size`` to a batch."""
    out = []
    for i in range(0, len(arrivals), size):
        tables: dict[str, list[Array]] = {}
        for name, row in arrivals[i : i + size]:
            tables.setdefault(name, []).append(row)
        out.append({name: np.array(rows) for name, rows in tables.items()})
    return out


def in_order(tables: Tables, delays: dict[str, Array] | None = None) -> list[tuple[str, Array]]:
    """Single rows as they arrive, each so much later than its time."""
    keyed = []
    for name, rows in tables.items():
        late = np.zeros(rows.shape[0]) if delays is None else delays[name]
        keyed += [(float(row[0] + d), name, row) for row, d in zip(rows, late, strict=True)]
    return [(name, row) for _, name, row in sorted(keyed, key=lambda entry: entry[:2])]


def set_back(pushed: list[Tables], by_s: float, only: str = "") -> list[Tables]:
    """The clocks of all tables, or of one, at 10 s."""
    for batch in pushed:
        for name, rows in batch.items():
            if only in ("", name):
                rows[rows[:, 0] >= 10, 0] -= by_s
    return pushed


def through(arrival: ReorderBuffer, pushed: list[Tables]) -> tuple[Tables, list[Event]]:
    """Everything that comes out, by table."""
    report, events = LossReport(), []
    out: dict[str, list[Array]] = {name: [] for name in RATES}
    for batch in pushed:
        for name, rows in arrival.push(batch, report).items():
            out[name].append(rows)
        events += report.end_of_push()
    for name, rows in arrival.finish(report).items():
        out[name].append(rows)
    events += report.end_of_stream()
    return {name: np.concatenate(rows) if rows else np.empty((0, 2)) for name, rows in out.items()}, events


def stream(tables: Tables, size: int = 13, **limits: float) -> tuple[Tables, list[Event]]:
    return through(ReorderBuffer.of(RATES, ClockLimits(**limits)), batches(in_order(tables), size))


def lost(events: list[Event]) -> Counter[tuple[str, str]]:
    count: Counter[tuple[str, str]] = Counter()
    for event in events:
        count[event.kind, event.table] += event.rows
    return +count


@given(seed=st.integers(0, 10_000), size=st.integers(1, 500), hold=st.sampled_from([0.05, 0.2, 1.0]))
@example(seed=265, size=1, hold=1.0)  # at the beginning: two late rows, then one more than a second ahead
@example(seed=1989, size=1, hold=0.2)  # at the beginning: seven rows with holes, whose interval seems to be longer
@settings(max_examples=60, deadline=None)
def test_disorder_within_the_hold_is_sorted_out(seed: int, size: int, hold: float) -> None:
    rng = np.random.default_rng(seed)
    tables = rows_of(6.0, start_s=rng.uniform(-1e3, 1e6), slower=2.0)
    gap = rng.integers(75, 200)
    tables["imu"] = np.delete(tables["imu"], slice(gap, gap + rng.integers(1, 75)), axis=0)
    delays = {name: rng.uniform(0.0, hold, rows.shape[0]) for name, rows in tables.items()}
    out, events = through(ReorderBuffer.of(RATES, ClockLimits(hold_s=hold)), batches(in_order(tables, delays), size))
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name], rows)
    assert not lost(events)


FAULTS = ("nan", "inf", "huge", "glitch", "back", "repeat", "jump", "shuffle", "constant")


def spoilt(tables: Tables, faults: list[str], rng: np.random.Generator) -> list[tuple[str, Array]]:
    arrivals = in_order(tables)
    for fault in faults:
        i = int(rng.integers(0, len(arrivals)))
        j = min(len(arrivals), i + int(rng.integers(1, 300)))
        part = [(name, row.copy()) for name, row in arrivals[i:j]]
        if fault == "repeat":
            arrivals[j:j] = part
            continue
        if fault == "jump":
            part, j = [(name, row.copy()) for name, row in arrivals[i:]], len(arrivals)
        by = rng.choice([-1e9, -100.0, -3.0, -0.3, 0.3, 3.0, 100.0, 1e9])
        for k, (_, row) in enumerate(part):
            if fault in ("nan", "inf", "huge"):
                row[rng.integers(0, 2)] = {"nan": np.nan, "inf": -np.inf, "huge": 1e300}[fault]
            elif fault == "glitch":
                row[0] += by if k == 0 else 0.0
            elif fault == "back":
                row[0] -= rng.exponential(1.0)
            elif fault == "jump":
                row[0] += by
            elif fault == "constant":
                row[0] = part[0][1][0]
        if fault == "shuffle":
            part = [part[k] for k in rng.permutation(len(part))]
        arrivals[i:j] = part
    return arrivals


@given(
    seed=st.integers(0, 100_000),
    faults=st.lists(st.sampled_from(FAULTS), min_size=1, max_size=4),
    size=st.integers(5, 200),
)
@example(seed=501, faults=["back", "nan", "nan", "shuffle"], size=45)  # ends in doubt, with rows that are too late
@settings(max_examples=80, deadline=None)
def test_every_row_comes_out_or_is_reported(seed: int, faults: list[str], size: int) -> None:
    arrivals = spoilt(rows_of(14.0, slower=2.0), faults, np.random.default_rng(seed))
    out, events = through(ReorderBuffer.of(RATES), batches(arrivals, size))
    came = Counter(name for name, _ in arrivals)
    gone = Counter({name: rows.shape[0] for name, rows in out.items()})
    for (_, name), count in lost(events).items():
        gone[name] += count
    assert came == gone
    for rows in out.values():
        assert (np.diff(rows[:, 0]) > 0.0).all()


@given(
    seed=st.integers(0, 100_000),
    faults=st.lists(st.sampled_from(FAULTS), max_size=3),
    size=st.integers(20, 200),
    cut=st.floats(0.0, 1.0),
)
@settings(max_examples=60, deadline=None)
def test_a_saved_state_goes_on_as_if_nothing_had_been(
    saved_and_restored: Callable[..., Any], seed: int, faults: list[str], size: int, cut: float
) -> None:
    pushed = batches(spoilt(rows_of(10.0, slower=2.0), faults, np.random.default_rng(seed)), size)
    whole, report = ReorderBuffer.of(RATES), LossReport()
    k = round(cut * len(pushed))
    for batch in pushed[:k]:
        whole.push(batch, report)
        report.end_of_push()
    again, report_again = saved_and_restored(whole), saved_and_restored(report)
    for batch in pushed[k:]:
        a, b = whole.push(batch, report), again.push(batch, report_again)
        assert a.keys() == b.keys()
        for name, rows in a.items():
            np.testing.assert_array_equal(rows, b[name])
        assert report.end_of_push() == report_again.end_of_push()
    rest, rest_again = whole.finish(report), again.finish(report_again)
    assert rest.keys() == rest_again.keys()
    for name, rows in rest.items():
        np.testing.assert_array_equal(rows, rest_again[name])
    assert report.end_of_stream() == report_again.end_of_stream()


def test_a_quiet_table_holds_nothing_up() -> None:
    tables = rows_of(10.0)
    arrival, report = ReorderBuffer.of(RATES), LossReport()
    for batch in batches(in_order({"imu": tables["imu"], "tach": tables["tach"][:3]}), 10):
        arrival.push(batch, report)
    assert arrival.watermark_s == pytest.approx(9.99 - 0.2)


def test_what_the_hold_allows_is_a_setting() -> None:
    tables = rows_of(10.0)
    delays = {name: np.full(rows.shape[0], 0.0 if name == "imu" else 0.7) for name, rows in tables.items()}
    pushed = batches(in_order(tables, delays), 10)
    _, events = through(ReorderBuffer.of(RATES, ClockLimits(hold_s=0.2)), pushed)
    assert lost(events)["late", "tach"] > 150
    assert events[0].detail.endswith(": up to 0.7 s behind the IMU's")
    out, events = through(ReorderBuffer.of(RATES, ClockLimits(hold_s=0.8)), pushed)
    assert not events
    np.testing.assert_array_equal(out["tach"], tables["tach"])


def test_rows_twice_are_dropped_and_counted() -> None:
    tables = rows_of(5.0)
    arrivals = in_order(tables)
    out, events = through(ReorderBuffer.of(RATES), batches([entry for entry in arrivals for _ in range(2)], 11))
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name], rows)
    assert lost(events) == {("duplicate", name): rows.shape[0] for name, rows in tables.items()}


@pytest.mark.parametrize("jump", [-1e9, -50.003, -0.503, 0.303, 5.003, 500.0, 1e9])
@pytest.mark.parametrize("name", ["imu", "tach"])
@pytest.mark.parametrize("at", [0, 57])
def test_one_wrong_stamp_costs_one_row(name: str, jump: float, at: int) -> None:
    tables = rows_of(8.0)
    tables[name][at, 0] += jump
    pushed = batches(in_order({k: np.delete(v, at, axis=0) if k == name else v for k, v in tables.items()}), 10)
    first = pushed[next(i for i, batch in enumerate(pushed) if name in batch and batch[name][-1, 1] >= at)]
    first[name] = np.concatenate([tables[name][at : at + 1], first[name]])
    out, events = through(ReorderBuffer.of(RATES), pushed)
    kept = out[name][out[name][:, 1] != at]
    np.testing.assert_array_equal(kept, np.delete(tables[name], at, axis=0))
    assert out[name].shape[0] + sum(lost(events).values()) == tables[name].shape[0]


@pytest.mark.parametrize("gap_s", [3.0, 90.0, 590.0])
def test_a_clock_that_went_forward_for_good_is_a_gap(gap_s: float) -> None:
    tables = {name: rows[(rows[:, 0] < 10) | (rows[:, 0] >= 10)] for name, rows in rows_of(17.0).items()}
    for rows in tables.values():
        rows[rows[:, 0] >= 10, 0] += gap_s
    out, events = stream(tables)
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name], rows)
    (gap,) = events
    assert (gap.kind, gap.table, gap.rows) == ("gap", "imu", 0)
    assert gap.t_s == pytest.approx(9.99)
    assert gap.until_s == pytest.approx(10.0 + gap_s)


@pytest.mark.parametrize("back_s", [0.403, 0.503, 1.003, 3.0, 4.7, 7.0, 30.0, 3600.0, 1e9, -700.0, -3600.0, -1e9])
def test_a_clock_set_for_good_goes_on_shifted(back_s: float) -> None:
    """All tables have one clock: no row is lost, times go on growing, all by the same shift."""
    tables = rows_of(17.0)
    pushed = set_back(batches(in_order(tables), 13), back_s)
    out, events = through(ReorderBuffer.of(RATES), pushed)
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name][:, 1], rows[:, 1])
        np.testing.assert_allclose(out[name][:, 0], rows[:, 0], atol=1e-6)
    assert {(event.kind, event.table, event.rows) for event in events} == {("clock-restart", name, 0) for name in RATES}


@pytest.mark.parametrize("size", [1, 13, 170])
@pytest.mark.parametrize("back_s", [0.052, 0.073, 0.103, 0.154, 0.197, 0.203, 0.304])
def test_a_clock_set_back_by_less_than_rows_may_be_late_is_no_disorder(back_s: float, size: int) -> None:
    """As above; but of a table that has no row in the time that comes again, one may be off by so much."""
    tables = rows_of(17.0)
    tables["fixes"] = table(np.arange(0.1, 17.0, 2.0))
    pushed = set_back(batches(in_order(tables), size), back_s)
    out, events = through(ReorderBuffer.of(RATES), pushed)
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name][:, 1], rows[:, 1])
        off = np.abs(out[name][:, 0] - rows[:, 0])
        assert off.max() <= back_s + 1e-6
        assert np.count_nonzero(off > 1e-6) <= (0 if RATES[name] > 2.0 / back_s else 1)
    assert {(event.kind, event.table, event.rows) for event in events} == {("clock-restart", name, 0) for name in RATES}


def test_tables_with_clocks_of_their_own_stay_as_they_are() -> None:
    """In disorder later on, too."""
    tables = {name: rows for name, rows in rows_of(20.0).items() if name != "fixes"}
    late = {name: np.where(rows[:, 1] % 97 == 96, 0.08, 0.0) for name, rows in tables.items()}
    pushed = batches(in_order(tables, late), 13)
    out, events = through(ReorderBuffer.of(RATES), set_back(pushed, 0.154, only="imu"))
    for name in ("imu", "tach", "laser/a"):
        np.testing.assert_allclose(out[name], tables[name], atol=1e-6)
    assert [(event.kind, event.table) for event in events] == [("clock-restart", "imu")]


@pytest.mark.parametrize("seed", range(5))
def test_rows_in_disorder_with_uneven_stamps_are_no_clock_set_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tables = rows_of(12.0)
    for name, rows in tables.items():
        rows[:, 0] += rng.uniform(0.0, 0.4, len(rows)) / RATES[name]
    delays = {name: rng.choice([0.0, 0.1], len(rows), p=[0.8, 0.2]) for name, rows in tables.items()}
    out, events = through(ReorderBuffer.of(RATES), batches(in_order(tables, delays), 13))
    assert not events
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name], rows)


@pytest.mark.parametrize("jump_s", [-3600.0, 3600.0])
def test_wrong_stamps_among_the_first_of_a_new_clock_cost_themselves_only(jump_s: float) -> None:
    tables = rows_of(22.0)
    pushed = batches(in_order(tables), 13)
    wrong = 0
    for k, batch in enumerate(pushed):
        for name, rows in batch.items():
            rows[rows[:, 0] >= 10, 0] += jump_s
            if name == "imu" and rows[0, 1] >= 1000 and k % 7 == 0:
                rows[0, 0] += 1e6 + k
                wrong += 1
    out, events = through(ReorderBuffer.of(RATES), pushed)
    assert lost(events) == {("clock-jump", "imu"): wrong}
    assert wrong > 15
    assert out["imu"].shape[0] == 2200 - wrong


@pytest.mark.parametrize("block", [(930, 990), (600, 970), (800, 1000)])
def test_rows_sent_again_in_one_piece_are_no_clock_set_back(block: tuple[int, int]) -> None:
    tables = rows_of(15.0)
    pushed = batches(in_order(tables), 13)
    place = next(i for i, batch in enumerate(pushed) if "imu" in batch and batch["imu"][-1, 1] >= 1000)
    pushed.insert(place, {"imu": tables["imu"][slice(*block)]})
    out, events = through(ReorderBuffer.of(RATES), pushed)
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name], rows)
    assert sum(lost(events).values()) == block[1] - block[0]
    assert {event.kind for event in events} <= {"late", "clock-jump", "duplicate"}


@pytest.mark.parametrize("hole", [(900, 970), (700, 970), (500, 700)])
def test_rows_that_fill_a_hole_too_late_are_no_clock_set_back(hole: tuple[int, int]) -> None:
    tables = rows_of(15.0)
    missed, tables["imu"] = tables["imu"][slice(*hole)], np.delete(tables["imu"], slice(*hole), axis=0)
    pushed = batches(in_order(tables), 13)
    place = next(i for i, batch in enumerate(pushed) if "imu" in batch and batch["imu"][-1, 1] >= 1020)
    pushed.insert(place, {"imu": missed})
    out, events = through(ReorderBuffer.of(RATES), pushed)
    np.testing.assert_array_equal(out["imu"], tables["imu"])
    assert sum(lost(events).values()) == hole[1] - hole[0]


def test_a_table_whose_clock_alone_is_wrong_is_refused_until_it_is_right_again() -> None:
    tables = rows_of(60.0)
    pushed = batches(in_order(tables), 13)
    for batch in pushed:
        if "tach" in batch:
            rows = batch["tach"]
            rows[(rows[:, 0] >= 20) & (rows[:, 0] < 40), 0] += 7200.0
    out, events = through(ReorderBuffer.of(RATES), pushed)
    good = (tables["tach"][:, 0] < 20) | (tables["tach"][:, 0] >= 40)
    np.testing.assert_array_equal(out["tach"], tables["tach"][good])
    assert lost(events) == {("clock-jump", "tach"): 400}
    assert min(event.t_s for event in events if event.t_s is not None) == pytest.approx(7220.0)


@pytest.mark.parametrize(
    ("off_s", "expected"),
    [(18.0, "18.0 s or more ahead of the IMU's"), (-604800.0, "up to 604800.0 s behind the IMU's")],
)
def test_times_off_the_imus_say_by_how_much(off_s: float, expected: str) -> None:
    tables = rows_of(15.0)
    pushed = batches(in_order(tables), 1)
    for batch in pushed:
        if "fixes" in batch:
            batch["fixes"][:, 0] += off_s
    _, events = through(ReorderBuffer.of(RATES), pushed)
    assert {event.table for event in events} == {"fixes"}
    assert events[-1].detail.endswith(expected)


def test_without_the_imu_rows_wait_for_it() -> None:
    """The wheel goes on counting while the IMU is silent: what it says of the gap is not lost."""
    tables = rows_of(120.0)
    keep = (tables["imu"][:, 0] < 20) | (tables["imu"][:, 0] >= 110)
    tables["imu"] = tables["imu"][keep]
    out, events = stream(tables)
    for name, rows in tables.items():
        np.testing.assert_array_equal(out[name], rows)
    assert [(event.kind, event.rows) for event in events] == [("gap", 0)]


def test_what_cannot_be_used_is_counted_by_kind() -> None:
    tables = rows_of(5.0)
    tables["imu"][100:110, 1] = np.nan
    tables["tach"][7, 0] = np.inf
    tables["tach"][8, 1] = -1e13
    _, events = stream({name: rows for name, rows in tables.items() if name != "tach"})
    (event,) = events
    assert event == Event("not-finite", "imu", 1.0, 1.09, 10, event.detail)
    _, events = through(ReorderBuffer.of(RATES), [tables])
    assert lost(events) == {("not-finite", "imu"): 10, ("not-finite", "tach"): 2}


def test_a_burst_is_one_event() -> None:
    tables = rows_of(10.0)
    tables["imu"][300:500, 1] = np.nan
    _, events = stream(tables)
    gap, event = events
    assert (gap.kind, gap.t_s, gap.until_s) == ("gap", 2.99, 5.0)
    assert (event.rows, event.t_s, event.until_s) == (200, 3.0, pytest.approx(4.99))
    assert str(event) == "imu: not-finite from t = 3.000 to 4.990 s, 200 rows: NaN, infinite or above 1e12"
