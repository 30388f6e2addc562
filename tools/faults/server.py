"""A PostgreSQL server of one's own, for maps in a database: it listens on a unix socket and is removed in the end."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Server:
    """A PostgreSQL server on a unix socket in ``folder``; ``postgis`` says whether the extension is installed there."""

    folder: Path
    programs: Path
    postgis: bool

    def sql(self, database: str, statement: str) -> str:
        """Return what psql prints, one line per row."""
        command = [self.programs / "psql", "-h", self.folder, "-U", "trackfg", "-d", database, "-XAtq", "-c", statement]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    def url(self, database: str, schema: str) -> str:
        return f"postgresql://trackfg@/{database}?host={self.folder}&schema={schema}"


def programs() -> Path | None:
    """Return the folder of the newest server that is installed, None without any."""
    paths = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[4]))
    return paths[-1].parent if paths else None


@contextmanager
def running_server() -> Iterator[Server]:
    """Run a server with the databases ``plain`` and, where it can be, ``spatial`` (with PostGIS).

    PostgreSQL refuses to run as root, so root lends it to the unprivileged user of the Debian package or ``nobody``.
    """
    installed = programs()
    assert installed is not None, "no PostgreSQL server installed"
    # in the temporary folder itself: the socket's path has at most 107 bytes, and its user must be able to get there
    folder = Path(tempfile.mkdtemp(prefix="pg"))
    user = _unprivileged_user()
    if user is not None:
        shutil.chown(folder, user)

    def run(program: str, *arguments: object) -> None:
        command = [str(installed / program), *map(str, arguments)]
        environment = {**os.environ, "LC_ALL": "C", "HOME": str(folder)}
        with (folder / "said").open("ab") as log:  # not a pipe: the server would keep it open
            done = subprocess.run(command, user=user, cwd=folder, env=environment, stdout=log, stderr=log, check=False)
        assert done.returncode == 0, (folder / "said").read_text()

    data, log = folder / "data", folder / "log"
    options = f"-k {folder} -c listen_addresses='' -c fsync=off"
    try:
        run("initdb", "-D", data, "-U", "trackfg", "-A", "trust", "-E", "UTF8", "--no-sync")
        run("pg_ctl", "-D", data, "-l", log, "-o", options, "-w", "start")
        try:
            bare = Server(folder, installed, postgis=False)
            postgis = bare.sql("postgres", "SELECT count(*) FROM pg_available_extensions WHERE name = 'postgis'") == "1"
            bare.sql("postgres", "CREATE DATABASE plain")
            if postgis:
                bare.sql("postgres", "CREATE DATABASE spatial")
                bare.sql("spatial", "CREATE EXTENSION postgis")
            yield Server(folder, installed, postgis)
        finally:
            run("pg_ctl", "-D", data, "-m", "fast", "-w", "stop")
    finally:
        shutil.rmtree(folder)


def _unprivileged_user() -> str | None:
    if os.geteuid() != 0:
        return None
    names = {entry.pw_name for entry in pwd.getpwall()}
    return "postgres" if "postgres" in names else "nobody"
