"""What runs over one line say together: joining them into a map, finding a run on it, seeing what changed.

==================  ==================================================================================================
module              content
==================  ==================================================================================================
``recognition``     where a run's profile lies on a map's, by ``likelihood``, ``place_chain`` and ``local_match`` of
                    ``profiles``
``following``       the same as the run goes on, section by section
``warp``            from one chainage to another, and tables with it
``marks``           what one run says of the map's variables, all else eliminated
``joint``           the estimate of these variables from all runs
``merging``         profiles of many runs on one grid
``survey``          a map in the making; ``joining`` adds a run, ``finishing`` moves it to the joint estimate
``reference_line``  the centre line in east, north, up
``design``          the designed cant, from the curves
``landmarks``       the curves' points, the same ones in every version
``build``           :func:`build_map`, :func:`with_runs`
``map_difference``  what moved from one map to another, and by how many sigmas
``placing``         a run laid over a map, for whatever is to be done with it then
``finding``         :func:`find_changes`: by ``changes``, with ``overlay``, ``remaining_shift`` and ``change_noise``
==================  ==================================================================================================
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

# Late, because the smoother needs recognition and no database.
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
