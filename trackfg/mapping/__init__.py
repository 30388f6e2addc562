"""Maps from repeated runs over one line: a run is recognised on a map, joined to it, and compared with it.

===============  =====================================================================================================
package          content
===============  =====================================================================================================
``recognition``  where a run's profile lies on a map's: a hidden Markov model over places, then least squares
``joining``      a run's information on the map's variables, their joint estimate, the averaged profile, landmarks
``changes``      what changed of the track, and what moved from one version of a map to another
``runs``         runs laid over each other: shifts by sections, and how well they repeat
``trends``       how fast the track changes over many runs, where it jumped, and when a limit is reached
===============  =====================================================================================================

``recognition`` needs no map, only two profiles; ``joining`` and ``changes`` both start from it, ``trends`` from
changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trackfg.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from trackfg.mapping.changes.difference import Difference, difference
    from trackfg.mapping.changes.find import find_changes
    from trackfg.mapping.joining.build import build_map, with_runs
    from trackfg.mapping.recognition.recognition import Recognition, recognise

__all__ = ["Difference", "Recognition", "build_map", "difference", "find_changes", "recognise", "with_runs"]

# Imported late, because the smoother needs recognition and no database.
__getattr__ = lazy_imports(
    __name__,
    {
        "Recognition": "recognition.recognition",
        "build_map": "joining.build",
        "Difference": "changes.difference",
        "difference": "changes.difference",
        "find_changes": "changes.find",
        "recognise": "recognition.recognition",
        "with_runs": "joining.build",
    },
)
