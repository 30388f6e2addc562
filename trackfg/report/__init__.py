"""``trackfg report``: one self-contained page for a result or a comparison, opened without a network.

:mod:`.sources` says which kinds of folder there are and how each becomes a page; :mod:`.page` is what a page is made of
and how it is written; :mod:`.charts` and :mod:`.columns` are its charts and their data; ``template/`` is what the
browser gets.
"""

from trackfg.report.sources import write_report

__all__ = ["write_report"]
