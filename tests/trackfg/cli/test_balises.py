"""``trackfg balises`` surveys results of the command line, and says in one line what it cannot use."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.results.columns import BALISE_COLUMNS

Run = Callable[..., tuple[int, str, str]]
PLACES = np.linspace(80.0, 380.0, 13)
WRONG, UNKNOWN = 6, 9


@pytest.fixture
def run(trackfg: Callable[..., Any]) -> Run:
    def run(*arguments: object) -> tuple[int, str, str]:
        done = trackfg(*arguments)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two recordings of one line, whose balises have numbers, and a table of planned places beside them."""
    folder, rng = tmp_path_factory.mktemp("balises"), np.random.default_rng(3)
    planned = PLACES + 0.2 * rng.normal(size=len(PLACES)) + 9.0 * (np.arange(len(PLACES)) == WRONG)
    table = pd.DataFrame({"id": np.arange(len(PLACES)), "chainage_m": planned, "sd_m": 0.2})
    table.loc[UNKNOWN, ["chainage_m", "sd_m"]] = np.nan
    table.to_csv(folder / "register.csv", index=False)
    for number in range(2):
        simulated = simulate("mainline", seed=3, run=number, duration_s=80.0)
        place = folder / f"rec{number}"
        simulated.write(place)
        chainage, t = simulated.truth["chainage_m"].to_numpy(), simulated.truth["t_s"].to_numpy()
        assert chainage[-1] > PLACES[-1]
        passed = np.interp(PLACES + 0.1 * rng.normal(size=len(PLACES)), chainage, t)
        pd.DataFrame({"t": passed, "id": table["id"]}).to_csv(place / "balises.csv", index=False)
        with (place / "recording.toml").open("a", encoding="utf-8") as toml:
            toml.write('\n[balises]\nfile = "balises.csv"\n')
        table.to_csv(place / "register.csv", index=False)
    return [folder / "rec0", folder / "rec1"]


def _with_places(recording: Path) -> None:
    toml = recording / "recording.toml"
    toml.write_text(toml.read_text() + 'places = "register.csv"\n')


def test_balises_of_two_runs_are_surveyed_and_reported(run: Run, recordings: list[Path], tmp_path: Path) -> None:
    outs = [tmp_path / f"out{number}" for number in range(2)]
    _with_places(recordings[0])  # the second run knows no place, and helps all the same
    for recording, out in zip(recordings, outs, strict=True):
        status, _, error = run("smooth", recording, "-o", out)
        assert status == 0, error
    register = recordings[0].parent / "register.csv"
    status, shown, error = run("balises", *outs, "--planned", register, "-o", tmp_path / "survey.csv")
    assert (status, error) == (0, "")
    assert "wrong" in shown
    assert f"survey: {tmp_path / 'survey.csv'}" in shown
    assert run("balises", *outs, "--planned", register, "-o", tmp_path / "quiet.csv", "--quiet") == (0, "", "")
    assert (tmp_path / "quiet.csv").read_bytes() == (tmp_path / "survey.csv").read_bytes()
    assert "wrong" in run("balises", *outs, "--planned", register, "--quiet")[1]
    table = pd.read_csv(tmp_path / "survey.csv")
    assert tuple(table.columns) == BALISE_COLUMNS
    by_id = table.set_index("id")
    assert by_id.index[by_id["verdict"] == "wrong"].tolist() == [WRONG]
    assert by_id.loc[UNKNOWN, "verdict"] == "surveyed"
    assert (by_id["passes"] == 2).all()
    assert (np.abs(by_id["place_m"].sort_index() - PLACES) < 4.0 * by_id["place_m_sd"].sort_index()).all()
    status, shown, _ = run("balises", *outs, "--planned", register, "--json")
    assert status == 0
    assert [row["id"] for row in json.loads(shown)["balises"] if row["verdict"] == "wrong"] == [str(WRONG)]
    status, _, error = run("report", outs[0], "-o", tmp_path / "page.html")
    assert status == 0, error
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "13 balises: " in page
    status, _, error = run("export", outs[0], "--to", "csv", "--table", "balises", "-o", tmp_path / "table.csv")
    assert status == 0, error
    exported, own = (pd.read_csv(path) for path in (tmp_path / "table.csv", outs[0] / "balises.csv"))
    pd.testing.assert_frame_equal(exported, own)

    for arguments, said in (
        ((outs[0], outs[0]), "is the same run as"),
        ((outs[0], "--planned", tmp_path / "none.csv"), "none.csv: no such file"),
        ((tmp_path,), "expected a trackfg result"),
    ):
        status, _, error = run("balises", *arguments)
        assert status == 2
        assert error.count("\n") == 1
        assert said in error
    (outs[0] / "passages.parquet").unlink()
    status, _, error = run("balises", outs[0])
    assert status == 2
    assert "no passages of balises" in error
