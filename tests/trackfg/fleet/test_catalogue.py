from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.fleet.catalogue import Run, read_catalogue
from trackfg.fleet.store import Store
from trackfg.results.result import Result


def write(folder: Path, text: str) -> str:
    (folder / "runs.csv").write_text(text)
    return str(folder / "runs.csv")


def test_a_table_names_runs_with_paths_relative_to_it(tmp_path: Path) -> None:
    text = "recording,line,map,settings,tags,run\nrecs/a,7,line.gpkg,fast.toml,winter,first\n/recs/b,,,,,\n"
    first, second = read_catalogue([write(tmp_path, text)])
    assert first == Run(
        name="first",
        recording=str(tmp_path / "recs/a"),
        line="7",
        map=str(tmp_path / "line.gpkg"),
        settings=str(tmp_path / "fast.toml"),
        tags="winter",
    )
    assert (second.recording, second.line, second.map, second.settings) == ("/recs/b", "unknown", None, None)
    assert second.name.startswith("b-")


def test_what_a_row_leaves_out_comes_from_the_defaults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    place = write(tmp_path, "recording,settings\na,own.toml\nb,\n")
    own, given = read_catalogue([place], {"settings": "all.toml", "line": "7"})
    assert own.settings == str(tmp_path / "own.toml")
    assert given.settings == str(tmp_path / "elsewhere" / "all.toml")
    assert own.line == given.line == "7"


def test_commas_at_the_ends_of_rows_shift_nothing(tmp_path: Path) -> None:
    plain = read_catalogue([write(tmp_path, "recording,line\na,007\nb,8\n")])
    assert plain == read_catalogue([write(tmp_path, "recording,line\r\na,007,,\r\nb,8,,\r\n")])
    assert plain == read_catalogue([write(tmp_path, "recording,line,\na,007,\nb,8,\n")])


def test_a_parquet_table_is_read_as_its_csv(tmp_path: Path) -> None:
    rows = pd.DataFrame({"recording": ["a", "b"], "line": [7, 8], "tags": [None, "winter"]})
    rows.to_parquet(tmp_path / "runs.parquet")
    rows.to_csv(tmp_path / "runs.csv", index=False)
    assert read_catalogue([str(tmp_path / "runs.parquet")]) == read_catalogue([str(tmp_path / "runs.csv")])


def test_a_database_and_a_url_stay_as_they_are(tmp_path: Path) -> None:
    text = "recording,map\ns3://bucket/a.zip,postgresql://me@host/maps\n"
    (run,) = read_catalogue([write(tmp_path, text)])
    assert (run.recording, run.map) == ("s3://bucket/a.zip", "postgresql://me@host/maps")


def test_a_pattern_names_folders_and_leaves_other_files_out(tmp_path: Path) -> None:
    for name in ("b", "a", "other"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    (tmp_path / "runs" / "notes.txt").touch()
    runs = read_catalogue([str(tmp_path / "runs" / "[ab]"), str(tmp_path / "runs" / "other")], {"line": "7"})
    assert [Path(run.recording).name for run in runs] == ["a", "b", "other"]
    assert {run.line for run in runs} == {"7"}


def test_a_pattern_matches_recordings_only(tmp_path: Path) -> None:
    (tmp_path / "run1").mkdir()
    (tmp_path / "run1.mapping.toml").write_text('format = "trackfg-mapping/1"\n')
    (tmp_path / "run1.line.toml").write_text('format = "trackfg-line/1"\n')
    (tmp_path / "run1.settings.toml").write_text("rest_s = 1.0\n")
    (tmp_path / "run2.toml").write_text('format = "trackfg-recording/1"\n')
    (tmp_path / "run3.toml").write_text('format = "trackfg-recording/2"\n')
    (tmp_path / "run4.toml").write_text("format = \n")
    (tmp_path / "run5").mkdir()
    (tmp_path / "run5" / "recording.toml").write_text("id = 'no format'\n")
    for name, member in (("run6", "run6/recording.toml"), ("run6.log", "run6/gyro.csv")):
        with zipfile.ZipFile(tmp_path / f"{name}.zip", "w") as archive:
            archive.writestr(member, "")
    (tmp_path / "run7.zip").write_bytes(b"PK damaged")
    with zipfile.ZipFile(tmp_path / "run8.zip", "w") as archive:
        archive.writestr("\xe9", "")
    (tmp_path / "run8.zip").write_bytes((tmp_path / "run8.zip").read_bytes().replace(b"\xc3\xa9", b"\xff\xff"))
    (tmp_path / "run9.csv").touch()

    def matched(pattern: str) -> list[str]:
        return [
            Path(run.recording).relative_to(tmp_path).as_posix() for run in read_catalogue([str(tmp_path / pattern)])
        ]

    recordings = ["run1", "run2.toml", "run3.toml", "run4.toml", "run5", "run6.zip", "run7.zip", "run8.zip"]
    assert matched("run*") == recordings
    assert matched("run*/*.toml") == ["run5/recording.toml"]
    with pytest.raises(BadInputError, match="no recording is there"):
        matched("*.mapping.toml")


def test_a_pattern_passes_over_results_stores_and_folders_of_recordings(
    tmp_path: Path, make_result: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("day1", "more/day2", "empty"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("day1", "more/day2"):
        (tmp_path / name / "recording.toml").write_text('format = "trackfg-recording/1"\n')
    make_result(rows=20).write(tmp_path / "out1")
    Store(tmp_path / "store")
    monkeypatch.chdir(tmp_path)

    def matched(pattern: str) -> list[str]:
        return [Path(run.recording).relative_to(tmp_path).as_posix() for run in read_catalogue([pattern])]

    assert matched("*") == ["day1", "empty"]
    assert matched("**/day*/**") == ["day1", "more/day2"]
    with pytest.raises(BadInputError, match=r"^more: is no recording, but holds some; .* Hint: 'more/\*'"):
        matched("more")


def test_what_is_named_is_not_passed_over(tmp_path: Path) -> None:
    mapping = tmp_path / "run1.mapping.toml"
    mapping.write_text('format = "trackfg-mapping/1"\n')
    table = write(tmp_path, "recording\nrun1.mapping.toml\n")
    for place in (str(mapping), table):
        assert [run.recording for run in read_catalogue([place])] == [str(mapping)]


def test_names_depend_on_the_place_alone(tmp_path: Path) -> None:
    text = "recording\nmay/run1\njune/run1\nmay/run2/recording.toml\n"
    names = [run.name for run in read_catalogue([write(tmp_path, text)])]
    assert len(set(names)) == 3
    assert [name.rpartition("-")[0] for name in names] == ["run1", "run1", "run2"]
    (alone,) = read_catalogue([write(tmp_path, "recording\njune/run1\n")])
    assert alone.name == names[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("recording,setting\na,b\n", r"column 'setting': expected .* Hint: did you mean 'settings'"),
        ("line\n7\n", "no column 'recording'"),
        ("recording,line\na,7\n,7\n", "row 2: no recording"),
        ("recording,run\na,../b\n", r"row 1: run '\.\./b': expected letters"),
        ("recording\na\n./a\n", "is there 2 times: expected one row for each"),
        ("recording\na\na/recording.toml\n", "recording .* is there 2 times"),
        ("recording;line\na;7\n", "its columns are parted by semicolons; expected commas"),
        ("recording,line\na,7,b\n", "rows of 3 values; expected 2"),
        ("recording,run\na,x\nb,x\n", "run 'x' is there 2 times"),
        (f"recording\na\n{'x' * 40_000}\n", "row 2: recording has 40,000 characters; expected a path or a URL"),
        ("", "not a readable table of runs"),
    ],
)
def test_a_table_at_fault_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        read_catalogue([write(tmp_path, text)])


def test_a_table_in_another_encoding_is_named(tmp_path: Path) -> None:
    for encoding in ("latin-1", "utf-16"):
        (tmp_path / "runs.csv").write_bytes("recording,line\na,Zürich\n".encode(encoding))
        with pytest.raises(BadInputError, match=r"runs\.csv: not a readable table of runs: its text is not UTF-8"):
            read_catalogue([str(tmp_path / "runs.csv")])


def test_a_pattern_that_nothing_fits_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no recording is there"):
        read_catalogue([str(tmp_path / "*")])
