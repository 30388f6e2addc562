"""Track geometry: operators along the chainage, each with its exact wavelength response, and judging with them.

A *profile* is an array (..., n) of values at ``n`` places ``step_m`` apart along the chainage; every leading row (a
channel, a posterior sample) is treated alike in one call. Values are in SI, or in any unit where the operator is
linear. An operator gives back the shape it got, NaN where it reaches beyond an end or into a hole (NaN) of the profile.

A *response* is the ratio of output to input for ``exp(i W x)``, ``W = 2 pi / wavelength``: complex in general, real for
an operator that is symmetrical about its place. Functions ``..._response`` take any array of wavelengths in m.

Heights are positive up, lateral positions positive to the left, cross-level is positive where the left rail is higher
and curvature positive to the left, all looking towards greater chainage.

==================== =============================================================================
module               what it holds
==================== =============================================================================
versines             chord offsets for any chord; circle and versine
moving_average       baselines: moving average, cascades of them (24 m; 24-18 m)
bands                D0 to D3, zero phase
cross_level, twist   cross-level from roll, bases and signs; twist over any base
gradient, curvature  slopes and curvatures over a base
design_versine       what the designed curve contributes to a versine
statistics           sections of 200 m, sliding standard deviation, peaks
limits, exceedances  limit tables, and where a geometry exceeds them
resampling           samples at any places to a uniform step
==================== =============================================================================
"""
