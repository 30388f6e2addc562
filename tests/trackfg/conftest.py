"""A browser without a window, the command line, and made-up input and output: results, a run on a curved line, its
recording as files.
"""

from __future__ import annotations

import copy
import functools
import json
import os
import select
import shutil
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pandas as pd
import pyarrow.csv
import pytest
import tomli_w

from trackfg.cli import main
from trackfg.config import GeometryConfig, SmoothConfig
from trackfg.datasets.scenarios import Scenario, Simulation, scenario, simulate
from trackfg.datasets.sensors.imu_errors import ImuResponse
from trackfg.datasets.vehicle.vehicle import Rigid
from trackfg.factors.gtsam_bridge import chain_ordering, custom_factors, with_frozen_chain
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding
from trackfg.results.columns import EVENT_COLUMNS, GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.result import Result
from trackfg.results.summary import Estimate, Solver, Summary, VectorEstimate
from trackfg.smoothing.smoother import SmoothedStates, smooth_states

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One for all tests of a process: playwright does not run twice in it."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)}")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def until() -> Callable[..., None]:
    """Waits from outside a page: its content security policy forbids conditions that playwright evaluates inside."""

    def wait(true: Callable[[], bool], within_s: float = 30.0) -> None:
        end = time.monotonic() + within_s
        while not true():
            assert time.monotonic() < end
            time.sleep(0.05)

    return wait


@pytest.fixture
def trackfg(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return what runs the command line in this process, as from a pipe: an interpreter takes a second to start."""

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        words = ["trackfg", *map(str, arguments)]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as end:
            main.main()
        written = capsys.readouterr()
        return subprocess.CompletedProcess(words, int(end.value.code or 0), written.out, written.err)

    return run


FORKING = """
# Each line describes a program and where it runs: it does so in a fork of this process, which has imported trackfg. The
# first line that is answered is the fork's process id, the second one how it has ended.
import json, os, sys, traceback
import trackfg.cli.main, trackfg.datasets.scenarios, trackfg.maps, trackfg.results.result
import trackfg.smoothing.smoother, trackfg.streaming.run

for line in sys.stdin:
    asked = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(asked["folder"])
        os.environ.clear()
        os.environ.update(asked["environment"])
        for number, name in enumerate(asked["streams"]):
            kind = os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            os.dup2(os.open(name, kind | os.O_NOCTTY), number)
        sys.argv[1:], code = asked["arguments"], 1
        try:
            exec(compile(asked["program"], "<forked>", "exec"), {"__name__": "__main__"})
            code = 0
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@dataclass(frozen=True)
class Forks:
    """Runs Python programs, one at a time, in forks of an interpreter that imports trackfg once for all.

    What forks itself, is killed, or writes to a terminal cannot run in the process of the tests.
    """

    interpreter: subprocess.Popen[bytes]
    said: Path

    def __call__(self, program: str, *arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run a program with arguments in ``cwd``."""
        self.begin(program, *arguments, cwd=cwd)
        words = [program, *map(str, arguments)]
        return subprocess.CompletedProcess(
            words, self.end(), *((self.said / name).read_text() for name in ("out", "err"))
        )

    def begin(
        self,
        program: str,
        *arguments: object,
        cwd: Path | None = None,
        streams: tuple[Path | None, Path | None, Path | None] = (None, None, None),
        environment: Mapping[str, str] = os.environ,
    ) -> int:
        """Begin a program, whose standard streams are files; return the id of its process, which has to :meth:`end`."""
        usual = (Path(os.devnull), self.said / "out", self.said / "err")
        asked = {
            "folder": str(cwd or self.said),
            "program": textwrap.dedent(program),
            "arguments": [str(argument) for argument in arguments],
            "streams": [str(stream or other) for stream, other in zip(streams, usual, strict=True)],
            "environment": {**environment, "OPENBLAS_NUM_THREADS": "1"},
        }
        assert self.interpreter.stdin is not None
        self.interpreter.stdin.write(f"{json.dumps(asked)}\n".encode())
        return int(self._answer())

    def runs(self) -> bool:
        """Return whether the program that was begun has not ended."""
        return not select.select([self.interpreter.stdout], [], [], 0.0)[0]

    def end(self) -> int:
        """Wait for the end of the program that was begun; return its status."""
        return int(self._answer())

    def _answer(self) -> bytes:
        assert self.interpreter.stdout is not None
        return self.interpreter.stdout.readline()


@pytest.fixture(scope="session")
def forked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Forks]:
    """Return what runs Python programs in forks."""
    command, environment = [sys.executable, "-c", FORKING], {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, bufsize=0
    ) as interpreter:
        yield Forks(interpreter, tmp_path_factory.mktemp("forked"))
        assert interpreter.stdin is not None
        interpreter.stdin.close()


@pytest.fixture(scope="session")
def make_result() -> Callable[..., Result]:
    def make(rows: int = 50, rate_hz: float = 10.0, **summary: object) -> Result:
        t = np.arange(rows) / rate_hz
        values = {
            "t_s": t,
            "chainage_m": 15.0 * t,
            "east_m": 500.0 * np.sin(t / 40.0),
            "north_m": 500.0 * np.cos(t / 40.0),
            "up_m": 0.1 * t,
            "speed_mps": 15.0 + np.sin(t),
            "roll_rad": 0.01 * np.sin(t / 3.0),
            "pitch_rad": 0.01 * np.cos(t / 3.0),
            "yaw_rad": np.arctan2(-np.sin(t / 40.0), np.cos(t / 40.0)),
        }
        trajectory = pd.DataFrame({name: values.get(name, np.full(rows, 0.1)) for name in TRAJECTORY_COLUMNS})
        events = pd.DataFrame(
            [
                ("standstill", 0.0, 12.5, 0.0, 0.01, np.nan, np.nan, ""),
                ("slip", 20.0, 21.5, 88.25, 0.3, 1.5, 0.2, "wheel, driven axle"),
            ],
            columns=list(EVENT_COLUMNS),
        )
        page: dict[str, object] = {
            "recording_id": "made-up",
            "configuration": {"output": {"rate_hz": rate_hz}},
            "solver": Solver(
                converged=True, reason="step below tolerance", iterations=4, cost=101.5, degrees_of_freedom=200
            ),
            "timings_s": {"read": 0.5, "solve": 1.25},
            "duration_s": float(t[-1]),
            "distance_m": float(15.0 * t[-1]),
            "keyframes": rows // 5,
            "wheel_scale": Estimate(value=1.0021, sd=0.0003),
            "geometry": {"gauge_m": 1.067, "cross_level_base_m": 1.067, **GeometryConfig().model_dump()},
            "gyro_bias_radps": VectorEstimate(value=(1e-4, -2e-4, 3e-5), sd=(1e-6, 1e-6, 2e-6)),
            "accel_bias_mps2": VectorEstimate(value=(0.01, 0.02, -0.03), sd=(1e-3, 1e-3, 1e-3)),
            "findings": (Finding("warning", "gap", "a gap of 2 s", file="imu.csv", column="t", row=3, hint="none"),),
        }
        return Result(trajectory, _made_up_geometry(trajectory), events, Summary.model_validate({**page, **summary}))

    return make


@pytest.fixture(scope="session")
def result(make_result: Callable[..., Result]) -> Result:
    """1498 m, a curve to the left from about 250 to 1250 m. Nobody may change its tables."""
    return make_result(rows=1000)


def _made_up_geometry(trajectory: pd.DataFrame) -> pd.DataFrame:
    """A curve to the left with cant in the middle of the run, waves of 20 m, sigmas of 0.1 of each column's unit."""
    chainage = np.arange(0.0, trajectory["chainage_m"].iloc[-1], 0.25)
    middle = np.clip(4.0 - np.abs(chainage / chainage[-1] - 0.5) * 12.0, 0.0, 1.0)
    wave = np.sin(2.0 * np.pi * chainage / 20.0)
    values = {
        "chainage_m": chainage,
        "speed_mps": np.interp(chainage, trajectory["chainage_m"], trajectory["speed_mps"]),
        "curvature_1pm": middle / 500.0,
        "gradient_permille": 5.0 + wave,
        "cross_level_mm": -80.0 * middle + wave,
        "twist_mm": 2.0 * wave,
        "level_mm": 3.0 * wave,
        "alignment_mm": 2.0 * wave,
        "versine_level_mm": 3.0 * wave,
        "versine_alignment_mm": -25.0 * middle + 2.0 * wave,
    }
    scale = {"curvature_1pm": 1e-5}
    return pd.DataFrame(
        {
            name: values.get(name, np.full(chainage.size, scale.get(name.removesuffix("_sd"), 0.1)))
            for name in GEOMETRY_COLUMNS
        }
    )


G = 9.80665
LATITUDE, LONGITUDE = 35.2, 139.0


@dataclass(frozen=True)
class LineRun:
    """A run with two stops over curves with cant and gradients: tables with the contract's example columns.

    The kinematics are the textbook's, written without trackfg: w_z = v k, f_x = dv/dt - g sin(pitch),
    f_y = v^2 k + g sin(roll). The tach's stamps are ``tach_late_s`` behind the IMU's clock; the true distance is
    ``wheel_scale`` times the nominal one.
    """

    duration_s: float = 150.0
    rate_hz: float = 50.0
    tach_rate_hz: float = 10.0
    tach_late_s: float = 0.0
    wheel_scale: float = 1.0
    pulse_m: float = np.pi * 0.86 / 90
    gyro_white: float = 5e-5
    accel_white: float = 1e-3
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cant_deficiency: float = 0.5
    seed: int = 1

    def tables(self) -> dict[str, pd.DataFrame]:
        rng = np.random.default_rng(self.seed)
        t = np.arange(round(self.duration_s * self.rate_hz)) / self.rate_hz
        knots = np.array([0.0, 20.0, 40.0, 55.0, 62.0, 75.0, 95.0, 110.0, 125.0, 140.0, 1e9])
        speeds = np.array([0.0, 0.0, 14.0, 14.0, 9.0, 9.0, 0.0, 0.0, 12.0, 16.0, 16.0])

        def smooth(values: np.ndarray, seconds: float) -> np.ndarray:
            width = max(1, round(seconds * self.rate_hz))
            padded = np.pad(values, width, mode="edge")
            return np.convolve(padded, np.ones(width) / width, mode="same")[width:-width]

        v = smooth(np.interp(t, knots, speeds), 2.0)
        v = np.where(((t > 1) & (t < 17)) | ((t > 98) & (t < 107)), 0.0, v)
        d = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) / self.rate_hz)])
        curvature = (
            np.interp(d, [0, 100, 160, 300, 360, 450, 520, 700, 760, 1e6], [0, 0, 1, 1, 0, 0, -1, -1, 0, 0]) / 400.0
        )
        pitch = -np.interp(d, [0, 80, 140, 500, 560, 1e6], [0, 0, 0.01, 0.01, -0.005, -0.005])
        roll = -(1.0 - self.cant_deficiency) * 12.0**2 * curvature / G
        yaw = np.cumsum(v * curvature) / self.rate_hz
        gyro = np.column_stack([np.gradient(roll, t), np.gradient(pitch, t), v * curvature])
        forward, left = np.gradient(v, t) - G * np.sin(pitch), v**2 * curvature + G * np.sin(roll)
        accel = np.column_stack([forward, left, np.full(t.size, G)])
        gyro = gyro + self.gyro_bias + self.gyro_white * np.sqrt(self.rate_hz) * rng.standard_normal(gyro.shape)
        accel = accel + self.accel_bias + self.accel_white * np.sqrt(self.rate_hz) * rng.standard_normal(accel.shape)
        imu = pd.DataFrame(dict(zip(("t", "wx", "wy", "wz", "fx", "fy", "fz"), (t, *gyro.T, *accel.T), strict=True)))

        tach_t = np.arange(round(self.duration_s * self.tach_rate_hz)) / self.tach_rate_hz
        at = tach_t - self.tach_late_s
        travelled = np.interp(at, t, d) + v[-1] * np.maximum(at - t[-1], 0.0)
        count = np.floor(travelled / self.wheel_scale / self.pulse_m).astype(int)
        east, north = -np.cumsum(v * np.sin(yaw)) / self.rate_hz, np.cumsum(v * np.cos(yaw)) / self.rate_hz
        fix_at = np.flatnonzero(np.diff(np.floor(d / 150.0)) > 0)
        rows = np.arange(0, t.size, round(self.rate_hz))
        w2 = 1.0 - 6.69437999e-3 * np.sin(np.radians(LATITUDE)) ** 2
        across, along = 6378137.0 / np.sqrt(w2) + 50.0, 6378137.0 * (1.0 - 6.69437999e-3) / w2**1.5 + 50.0
        return {
            "imu": imu,
            "tach": pd.DataFrame({"t": tach_t, "count": count}),
            "fixes": pd.DataFrame({"t": t[fix_at], "chainage_m": 1000.0 + d[fix_at], "sd_m": 0.5}),
            "gnss": pd.DataFrame(
                {
                    "t": t[rows],
                    "lat_deg": LATITUDE + np.degrees(north[rows] / along),
                    "lon_deg": LONGITUDE + np.degrees(east[rows] / across / np.cos(np.radians(LATITUDE))),
                    "height_m": 50.0,
                    "sd_e": 1.0,
                    "sd_n": 1.0,
                    "sd_u": 2.0,
                }
            ),
            "laser": pd.DataFrame({"t": t, "a_lv": -420.0 + 2.0 * np.sin(d / 3.0) + 0.1 * rng.standard_normal(t.size)}),
        }


def run_on_a_line(**settings: Any) -> dict[str, pd.DataFrame]:
    """The tables of a :class:`LineRun`."""
    return LineRun(**settings).tables()


@dataclass
class Draft:
    """A recording about to be written, with every part of the contract's example; tests spoil it in one way each."""

    toml: dict[str, Any]
    tables: dict[str, pd.DataFrame]
    texts: dict[str, str | bytes] = field(default_factory=dict)

    def __getitem__(self, table: str) -> pd.DataFrame:
        return self.tables[f"{table}.csv"]

    def write(self, folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in self.tables.items():
            if name.endswith(".parquet"):
                table.to_parquet(folder / name)
            elif all(kind.kind in "if" for kind in table.dtypes):
                pyarrow.csv.write_csv(pyarrow.Table.from_pandas(table, preserve_index=False), folder / name)
            else:
                table.to_csv(folder / name, index=False)
        (folder / "recording.toml").write_text(tomli_w.dumps(self.toml))
        for name, text in self.texts.items():
            (folder / name).write_bytes(text.encode() if isinstance(text, str) else text)
        return folder


EXAMPLE = {
    "format": "trackfg-recording/1",
    "id": "test-run",
    "track": {"gauge_m": 1.067, "cross_level_base_m": 1.067, "direction": 1, "latitude_deg": LATITUDE},
    "imu": {
        "file": "imu.csv",
        "time": "t",
        "gyro": ["wx", "wy", "wz"],
        "gyro_unit": "rad/s",
        "accel": ["fx", "fy", "fz"],
        "accel_unit": "m/s^2",
        "axes": "FLU",
        "rigid": True,
        "noise": {"gyro_white": 5e-5, "accel_white": 1e-3},
    },
    "tach": {
        "file": "tach.csv",
        "column": "count",
        "kind": "pulses",
        "unit": "1",
        "pulses_per_rev": 90,
        "wheel_diameter_m": 0.86,
    },
    "fixes": {"file": "fixes.csv"},
    "gnss": {
        "file": "gnss.csv",
        "position": ["lat_deg", "lon_deg", "height_m"],
        "sd": ["sd_e", "sd_n", "sd_u"],
        "lever_arm_m": [0.0, 0.0, 0.0],
    },
    "laser": [
        {
            "name": "A-left-vertical",
            "file": "laser.csv",
            "column": "a_lv",
            "unit": "mm",
            "position_m": [5.0, 0.5, 0.0],
            "axis": "z",
            "rail": "left",
            "sd_m": 1e-4,
        }
    ],
}


@pytest.fixture(scope="session")
def make_run() -> Callable[..., dict[str, pd.DataFrame]]:
    return run_on_a_line


@pytest.fixture(scope="session")
def example_tables() -> dict[str, pd.DataFrame]:
    return run_on_a_line()


@pytest.fixture
def draft(example_tables: dict[str, pd.DataFrame]) -> Draft:
    """A sound recording with every kind of table."""
    return Draft(copy.deepcopy(EXAMPLE), {f"{name}.csv": table.copy() for name, table in example_tables.items()})


@pytest.fixture
def make_draft(make_run: Callable[..., dict[str, pd.DataFrame]]) -> Callable[..., Draft]:
    """A sound recording of IMU and tach (and whatever else is named) of a run with the given properties."""

    def make(*, parts: tuple[str, ...] = ("imu", "tach"), **properties: Any) -> Draft:
        tables = {f"{name}.csv": table for name, table in make_run(**properties).items() if name in parts}
        keep = {"format", "id", "track", *parts}
        return Draft(copy.deepcopy({key: value for key, value in EXAMPLE.items() if key in keep}), tables)

    return make


def as_designed(plan: Scenario) -> Scenario:
    """The scenario with its track as designed, a vehicle that follows it exactly, an IMU with no errors but noise and
    bias, and recorders that keep time: what the smoother models exactly."""
    return replace(
        plan,
        irregularities=None,
        defects=(),
        vehicle=Rigid(),
        flange_knocks=False,
        imu=replace(plan.imu, response=ImuResponse()),
        recorders={},
    )


@pytest.fixture(scope="session")
def simulated() -> Callable[..., Simulation]:
    """``simulate`` in the world as designed, each run made once. Nobody may change its tables."""

    def run(name: str, **options: Any) -> Simulation:
        return simulate(as_designed(scenario(name)), **options)

    return functools.cache(run)


@pytest.fixture(scope="session")
def simulated_in_full() -> Callable[..., Simulation]:
    """``simulate`` with rough track, springs and every error of the sensors, each run made once."""
    return functools.cache(simulate)


@pytest.fixture(scope="session")
def smoothed(simulated: Callable[..., Simulation]) -> Callable[..., SmoothedStates]:
    """The smoothed states of a simulated run as designed, with the default configuration, each solved once."""
    return _smoothing(simulated)


@pytest.fixture(scope="session")
def smoothed_in_full(simulated_in_full: Callable[..., Simulation]) -> Callable[..., SmoothedStates]:
    """Likewise in the full world."""
    return _smoothing(simulated_in_full)


def _smoothing(simulated: Callable[..., Simulation]) -> Callable[..., SmoothedStates]:
    def run(name: str, **options: Any) -> SmoothedStates:
        return smooth_states(simulated(name, **options).recording, SmoothConfig())

    return functools.cache(run)


@pytest.fixture(scope="session")
def linearized() -> Callable[[Problem, States], tuple[Array, Array]]:
    """``A d = b`` of a problem's graph at given states, every factor on its own and linearised by GTSAM: A dense, its
    columns keyframe by keyframe, shared variables last. A chained loss, which GTSAM does not know, stands as its
    weights at these states.
    """

    def linearize(problem: Problem, states: States) -> tuple[Array, Array]:
        graph = gtsam.NonlinearFactorGraph(problem.native)
        for family in problem.families:
            for factor in custom_factors(with_frozen_chain(family, states)):
                graph.push_back(factor)
        A, b = graph.linearize(states.to_gtsam()).jacobian(chain_ordering(len(problem.t), len(states.sensor)))
        return A, b

    return linearize
