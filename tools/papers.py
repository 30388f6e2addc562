"""What do the five papers say of their methods, what do these do here, and what does the smoother do instead?

Per paper one table: each line has the paper's figure, the baseline's and the smoother's on the scenario that stands for
the paper's measurements, as mean over seeds +- half its 95 % interval [least .. greatest of a seed], the smoother's
mean over the baseline's, the target, and whether it is met.

    python tools/papers.py [--seeds 20] [--first-seed 0] [--jobs 2] [--paper 000 001 002 003 004] [--out FILE]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import pandas as pd
from papers_attitude import PAPERS as ATTITUDE
from papers_friction import PAPERS as FRICTION
from papers_positioning import PAPERS as POSITIONING
from papers_table import Paper, printed, table_of
from papers_versines import PAPERS as VERSINES
from side_by_side import add_seed_arguments, seeds_of, side_by_side

PAPERS = {paper.number: paper for paper in (*ATTITUDE, *FRICTION, *VERSINES, *POSITIONING)}


def measured(papers: list[Paper], seeds: range, jobs: int) -> dict[str, pd.DataFrame]:
    """One row per seed of every paper's measurements, with a progress bar on a terminal.

    A measurement that fails ends it at once.
    """
    calls = {(paper.number, seed): (paper.measure, (seed,)) for paper in papers for seed in seeds}
    rows = side_by_side(calls, jobs)
    return {paper.number: pd.DataFrame([rows[paper.number, seed] for seed in seeds], index=seeds) for paper in papers}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_seed_arguments(parser)
    parser.add_argument("--paper", nargs="+", choices=sorted(PAPERS), default=sorted(PAPERS), metavar="NUMBER")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write every line of every table to a CSV file")
    arguments = parser.parse_args()
    seeds = seeds_of(parser, arguments)
    start = time.perf_counter()
    papers = [PAPERS[number] for number in dict.fromkeys(arguments.paper)]
    by_paper = measured(papers, seeds, arguments.jobs)
    tables = []
    for paper in papers:
        table = table_of(paper, paper.figures(by_paper[paper.number]))
        print(f"\n{paper.number}  {paper.title}; {arguments.seeds} seeds\n\n{printed(table)}")
        if paper.notes:
            print(f"\n{paper.notes}")
        tables.append(table)
    print(f"\n{time.perf_counter() - start:.0f} s in all", file=sys.stderr)
    if arguments.out is not None:
        pd.concat(tables, ignore_index=True).to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
