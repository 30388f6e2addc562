"""What runs over one line say together: joining them into a map, finding a run on it, seeing what changed.

=================  ===================================================================================================
module             content
=================  ===================================================================================================
``recognition``    where a run's profile lies on a map's
``warp``           from one chainage to another, and tables with it
``marks``          what one run says of the map's variables, all else eliminated
``joint``          the estimate of these variables from all runs
``merging``        profiles of many runs on one grid
``reference_line`` the centre line in east, north, up
``landmarks``      the curves' points, the same ones in every version
``build``          :func:`build_map`, :func:`add_run`
``changes``        what a run shows otherwise than the map
=================  ===================================================================================================
"""
