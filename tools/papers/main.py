"""What do the five papers say of their methods, what do these do here, and what does the smoother do instead?

Per paper one table: each line has the paper's figure, the baseline's and the smoother's on the scenario that stands for
the paper's measurements, as mean over seeds +- half its 95 % interval [least .. greatest of a seed], the smoother's
mean over the baseline's, the target, and whether it is met.

    python tools/papers.py [--seeds 20] [--first-seed 0] [--jobs 2] [--paper 000 001 002 003 004] [--out FILE]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import pandas as pd
from benchmark import Part, add_seed_arguments, finish, seeds_of, show, side_by_side

from papers.attitude import PAPERS as ATTITUDE
from papers.friction import PAPERS as FRICTION
from papers.positioning import PAPERS as POSITIONING
from papers.table import printed, table_of
from papers.versines import PAPERS as VERSINES

PAPERS = {paper.name: paper for paper in (*ATTITUDE, *FRICTION, *VERSINES, *POSITIONING)}


def measured(papers: list[Part], seeds: range, jobs: int) -> dict[str, pd.DataFrame]:
    """One row per seed of every paper's measurements, with a progress bar on a terminal.

    A measurement that fails ends it at once.
    """
    calls = {(paper.name, seed): (paper.measure, (seed,)) for paper in papers for seed in seeds}
    rows = side_by_side(calls, jobs)
    return {paper.name: pd.DataFrame([rows[paper.name, seed] for seed in seeds], index=seeds) for paper in papers}


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
        table = table_of(paper, paper.figures(by_paper[paper.name]))
        show(paper, printed(table), arguments.seeds)
        tables.append(table)
    finish(tables, arguments.out, start)
