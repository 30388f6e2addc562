"""``python -m speed.stages REC OUT`` does what ``trackfg smooth`` does, and prints each stage's CPU time as JSON."""

from __future__ import annotations

import importlib
import json
import sys
import time
from pathlib import Path


def main(recording: Path, out: Path) -> dict[str, float]:
    """Smooth a recording and return CPU seconds by stage, in the order in which each first began."""
    from trackfg.cli.freed_memory import keep_freed_memory
    from trackfg.cli.smoothing.options import SmoothOptions
    from trackfg.io.reader import read_recording
    from trackfg.numerics.bounded_memory import bounded_memory
    from trackfg.smoothing.smoother import smooth

    importlib.import_module("trackfg.cli.tables")  # as the command does
    seconds = {"start and imports": time.process_time()}
    starts: dict[str, float] = {}

    def progress(stage: str, done: float) -> None:
        if done == 0.0:
            starts[stage] = time.process_time()
        elif done == 1.0 and stage in starts:
            seconds[stage] = seconds.get(stage, 0.0) + time.process_time() - starts.pop(stage)

    keep_freed_memory()
    with bounded_memory(round(SmoothOptions.memory * 1e9), out.parent):
        start = time.process_time()
        read = read_recording(recording)
        seconds["reading"] = time.process_time() - start
        result = smooth(read, progress=progress)
        start = time.process_time()
        result.write(out)
        seconds["writing"] = time.process_time() - start
    seconds["checks before, tables after"] = time.process_time() - sum(seconds.values())
    return seconds


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), Path(sys.argv[2]))))
