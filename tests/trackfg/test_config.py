"""The configuration file: what is refused and how; every setting documented."""

from __future__ import annotations

import inspect
import pickle
import re
from pathlib import Path

import pytest
import tomli_w
from pydantic import BaseModel

from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError

SECTIONS = SmoothConfig.model_fields


def write(folder: Path, text: str) -> Path:
    path = folder / "smooth.toml"
    path.write_text(text)
    return path


def test_empty_file_is_the_default(tmp_path: Path) -> None:
    assert SmoothConfig.from_toml(write(tmp_path, "")) == SmoothConfig()


def test_one_setting_leaves_the_others_alone(tmp_path: Path) -> None:
    config = SmoothConfig.from_toml(write(tmp_path, "[tach]\nrobust_width = 6\n"))
    assert config.tach.robust_width == 6.0
    default = SmoothConfig()
    assert config == default.model_copy(update={"tach": default.tach.model_copy(update={"robust_width": 6.0})})


def test_defaults_survive_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, tomli_w.dumps(SmoothConfig().model_dump()))
    assert SmoothConfig.from_toml(path) == SmoothConfig()


@pytest.mark.parametrize(
    ("text", "key", "expectation"),
    [
        ("[tach]\nrobust_with = 4", "tach.robust_with", "unknown key; expected one of"),
        ("[taxi]\nx = 1", "taxi", "unknown key; expected one of"),
        ("[tach]\nrobust_width = 0", "tach.robust_width", "greater than 2.5"),
        ("[keyframes]\ninterval_s = -1.0", "keyframes.interval_s", "greater than 0"),
        ("[keyframes]\ndistance_m = nan", "keyframes.distance_m", "finite|greater than 0"),
        ("[keyframes]\ndistance_m = inf", "keyframes.distance_m", "finite"),
        ('[output]\nrate_hz = "fast"', "output.rate_hz", "is 'fast'; expected a valid number"),
        ("[solver]\nmax_iterations = 2.5", "solver.max_iterations", "valid integer"),
        ("[solver]\nmax_iterations = 0", "solver.max_iterations", "greater than 0"),
        ('[position]\nrobust = "perhaps"', "position.robust", "valid boolean"),
        ("tach = 3", "tach", "is 3; expected a section with keys"),
        ("[geometry]\nstep_m = 1e-300", "geometry.step_m", "0.001"),
        ("[output]\nrate_hz = 1e300", "output.rate_hz", "10000"),
        ("[keyframes]\ninterval_s = 5e-324", "keyframes.interval_s", "expected at least 0.001"),
        ("[keyframes]\ninterval_s = true", "keyframes.interval_s", "valid number"),
    ],
)
def test_refusal_names_file_key_and_expectation(tmp_path: Path, text: str, key: str, expectation: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(BadInputError) as caught:
        SmoothConfig.from_toml(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert f"{key}: " in message
    assert re.search(expectation, message)


def test_all_mistakes_are_named_at_once(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"keyframes\.interval_s.*; .*motion\.sd_per_sped"):
        SmoothConfig.from_toml(write(tmp_path, "[keyframes]\ninterval_s = 0\n[motion]\nsd_per_sped = 1"))


def test_of_many_mistakes_the_first_are_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"tach\.a4: [^;]*; [^;]*; 3 more$"):
        SmoothConfig.from_toml(write(tmp_path, "[tach]\n" + "\n".join(f"a{i} = 1" for i in range(8))))


def test_settings_made_in_python_name_what_is_wrong() -> None:
    message = "^SmoothConfig: geometry.step_m: is -1; expected greater than or equal to 0.001; solvr: unknown key; "
    with pytest.raises(BadInputError, match=message) as refused:
        SmoothConfig.model_validate({"geometry": {"step_m": -1}, "solvr": {}})
    assert "did you mean 'solver'?" in str(refused.value)
    again = pickle.loads(pickle.dumps(refused.value))
    assert (str(again), again.details) == (str(refused.value), refused.value.details)


def test_broken_toml_names_the_line(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"smooth\.toml: not valid TOML.*line 2"):
        SmoothConfig.from_toml(write(tmp_path, "[tach]\nx = = 1\n"))


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"absent\.toml: cannot be read"):
        SmoothConfig.from_toml(tmp_path / "absent.toml")
    (tmp_path / "latin.toml").write_bytes(b"# \xe9\n")
    with pytest.raises(BadInputError, match=r"latin\.toml: not valid TOML in UTF-8"):
        SmoothConfig.from_toml(tmp_path / "latin.toml")
    with pytest.raises(BadInputError, match="cannot be read"):
        SmoothConfig.from_toml(tmp_path)


def test_settings_cannot_change_afterwards() -> None:
    with pytest.raises(ValueError, match="frozen"):
        SmoothConfig().tach.robust_width = 3.0  # type: ignore[misc]


@pytest.mark.parametrize("section", SECTIONS)
def test_every_section_is_documented_and_its_default_is_valid(section: str) -> None:
    model = SECTIONS[section].annotation
    assert isinstance(model, type)
    assert issubclass(model, BaseModel)
    assert inspect.getdoc(model)
    assert model.__doc__ != BaseModel.__doc__
    defaults = model().model_dump()
    assert model.model_validate(defaults) == model()
    assert SECTIONS[section].default == model()
