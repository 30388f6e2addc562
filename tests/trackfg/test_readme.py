"""README's commands and its Python run as printed, in the order printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

USE_IT = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8").split("## Use it\n")[1].split("\n## ")[0]
BLOCK = re.compile(r"```python\n(?P<python>.*?)```|(?P<shell>(?:^ {4}[^\n]*\n)+)", re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_use_it_runs_as_printed(tmp_path: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    blocks = list(BLOCK.finditer(USE_IT))
    assert [block.lastgroup for block in blocks] == ["shell", "shell", "python"]
    for block in blocks:
        if block.lastgroup == "python":
            command = [sys.executable, "-c", block["python"]]
        else:
            command = ["bash", "-euo", "pipefail", "-c", re.sub("^ {4}", "", block["shell"], flags=re.MULTILINE)]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    made = {path.name for path in tmp_path.iterdir()}
    assert {
        "out1",
        "out1.png",
        "out1.html",
        "comparison1",
        "live1",
        "line.gpkg",
        "result3",
        "out2",
        "chart.html",
    } <= made
