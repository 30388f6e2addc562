"""The benchmark of the papers: ``python tools/papers.py``."""
