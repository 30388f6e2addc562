"""Where the platform has no fcntl, no open folders and no flags of POSIX, what was written elsewhere can be read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from trackfg.files.owned_folder import FolderKind

PROGRAM = """
import os, sys

sys.modules["fcntl"] = None
for name in ("O_DIRECTORY", "O_NONBLOCK", "O_CLOEXEC", "O_NOFOLLOW", "geteuid"):
    delattr(os, name)
os.supports_dir_fd = set()

from pathlib import Path
from trackfg.errors import BadInputError
from trackfg.files.owned_folder import FolderKind
import trackfg.io.reader, trackfg.maps.store, trackfg.results.result

kind = FolderKind("result", "head.json", "x/", ("head.json", "rows.csv"), ("more.csv",))
print(sorted(kind.read(Path("there")).items()))
for folder in ("absent", "part"):
    try:
        kind.read(Path(folder))
    except BadInputError as error:
        print(error)
"""


def test_folders_are_read_without_what_posix_has(tmp_path: Path) -> None:
    for folder, names in (("there", ("head.json", "rows.csv", "more.csv")), ("part", ("head.json",))):
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).write_text(name)
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=tmp_path, capture_output=True, text=True, check=True)
    content = {name: name.encode() for name in ("head.json", "more.csv", "rows.csv")}
    assert FolderKind("result", "head.json", "x/", ("head.json", "rows.csv"), ("more.csv",)).read(
        tmp_path / "there"
    ) == {name: content[name] for name in content}
    assert done.stdout.splitlines() == [
        str(sorted(content.items())),
        "absent: expected a folder with a trackfg result: No such file or directory",
        f"part: {Path('part') / 'rows.csv'} is missing; expected a trackfg result",
    ]
