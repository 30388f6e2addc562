"""How long the page of a long run takes: to build, and to open in headless Chromium.

A made-up result of ``--km`` kilometres, a row per 0.25 m with every column (``--rails``: of each rail too) and noise of
the size of its sigmas, is written, turned into a page and opened from the disk. Printed are seconds and sizes; those of
the browser are the least of ``--repeats``, with the time that its main thread computed beside the clock's::

    python tools/report_speed.py --km 100
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from page_audit import BROWSERS, chromium
from playwright.sync_api import Browser, sync_playwright

from trackfg.config import GeometryConfig
from trackfg.report import write_report
from trackfg.results.columns import EVENT_COLUMNS, GEOMETRY_COLUMNS, RAIL_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.result import Result
from trackfg.results.summary import GeometryConventions, Solver, Summary, VectorEstimate

SPEED_MPS, RATE_HZ, STEP_M = 25.0, 10.0, 0.25
SIGMAS = {"curvature_1pm": 2e-6, "gradient_permille": 0.1}
SIGMA_MM = 0.04
WAVES_M = (4.0, 7.0, 12.0, 23.0)
AMPLITUDE = 40.0
"""Of each wave, in sigmas."""


def made_up(km: float, *, rails: bool) -> Result:
    """Waves and noise along a line of ``km``, measured at 25 m/s."""
    rng = np.random.default_rng(0)
    chainage = STEP_M * np.arange(round(1000.0 * km / STEP_M) + 1)
    waves = sum(np.sin(2.0 * np.pi * chainage / wave + i) for i, wave in enumerate(WAVES_M))
    columns = {"chainage_m": chainage, "chainage_m_sd": np.full(chainage.size, 0.3), "speed_mps": SPEED_MPS}
    for name in (*GEOMETRY_COLUMNS[3:], *(RAIL_COLUMNS if rails else ())):
        size = SIGMAS.get(name.removesuffix("_sd"), SIGMA_MM)
        if name.endswith("_sd"):
            columns[name] = size * (1.0 + 0.1 * np.sin(chainage / 300.0))
        else:
            columns[name] = size * (AMPLITUDE * waves + rng.normal(size=chainage.size))
    t = np.arange(round(chainage[-1] / SPEED_MPS * RATE_HZ)) / RATE_HZ
    turn = 2.0 * np.pi * t / t[-1]
    motion = {
        "t_s": t,
        "chainage_m": SPEED_MPS * t,
        "east_m": 15e3 * np.sin(turn),
        "north_m": 15e3 * np.cos(turn),
        "speed_mps": SPEED_MPS + rng.normal(0.0, 0.01, t.size),
        "roll_rad": rng.normal(0.0, 1e-3, t.size),
        "pitch_rad": rng.normal(0.0, 1e-3, t.size),
        "yaw_rad": turn - np.pi,
    }
    zero = VectorEstimate(value=(0.0, 0.0, 0.0), sd=(1e-6, 1e-6, 1e-6))
    summary = Summary(
        recording_id=f"{km:g} km, made up",
        configuration={},
        solver=Solver(converged=True, reason="made up", iterations=1, cost=0.5, degrees_of_freedom=1),
        timings_s={"solve": 1.0},
        duration_s=float(t[-1]),
        distance_m=float(chainage[-1]),
        keyframes=len(t) // 10,
        noise_ratios={"gyro": 1.0},
        gyro_bias_radps=zero,
        accel_bias_mps2=zero,
        geometry=GeometryConventions(gauge_m=1.067, cross_level_base_m=1.067, **GeometryConfig().model_dump()),
    )
    trajectory = pd.DataFrame({name: motion.get(name, np.full(t.size, 1e-3)) for name in TRAJECTORY_COLUMNS})
    return Result(trajectory, pd.DataFrame(columns), pd.DataFrame(columns=list(EVENT_COLUMNS), dtype=float), summary)


def opened(browser: Browser, page: Path) -> dict[str, float]:
    """Seconds from the click: the first text, the chart of the geometry, all charts; and zooming into 200 m."""
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    session = tab.context.new_cdp_session(tab)
    session.send("Performance.enable")

    def computed() -> float:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return next(float(metric["value"]) for metric in metrics if metric["name"] == "ThreadTime")

    tab.goto(page.as_uri(), wait_until="commit")
    tab.wait_for_selector(".chart[data-drawn]", timeout=120_000)
    first = computed()
    tab.wait_for_selector("html[data-charts=drawn]", timeout=120_000)
    last = computed()
    marks = tab.evaluate("performance.getEntries().map((entry) => [entry.name, entry.startTime / 1000])")
    at = dict(marks)
    start = time.perf_counter()
    field = tab.locator(".tools input").nth(1)
    field.fill("0.2")
    field.press("Tab")
    tab.wait_for_selector(".chart[data-shown$=' 0.2']")
    zoomed = time.perf_counter() - start
    tab.close()
    return {
        "text": at["first-contentful-paint"],
        "chart of the geometry": at["chart 0"],
        "all charts": at["charts drawn"],
        "computing, until the chart of the geometry": first,
        "computing, until all charts": last,
        "zoom into 200 m": zoomed,
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--km", type=float, default=100.0)
    parser.add_argument("--rails", action="store_true")
    parser.add_argument("--repeats", type=int, default=3)
    asked = parser.parse_args()
    program = chromium()
    if program is None:
        parser.error(f"no browser: expected one of {', '.join(BROWSERS)}")
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result"
        made_up(asked.km, rails=asked.rails).write(result)
        start = time.perf_counter()
        page = write_report(result, Path(folder) / "report.html")
        print(f"{'building':45} {time.perf_counter() - start:8.2f} s")
        print(f"{'size':45} {page.stat().st_size / 1e6:8.2f} MB")
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=program)
            runs = pd.DataFrame([opened(browser, page) for _ in range(asked.repeats)])
            browser.close()
    for name, seconds in runs.min().items():
        print(f"{name:45} {seconds:8.2f} s")
