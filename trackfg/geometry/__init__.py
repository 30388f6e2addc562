"""Track geometry: operators along the chainage, each with its exact wavelength response, and judging with them.

A *profile* is an array (..., n) of values at ``n`` places ``step_m`` apart along the chainage; every leading row (a
channel, a posterior sample) is treated alike in one call. Values are in SI, or in any unit where the operator is
linear. An operator gives back the shape it got, NaN where it reaches beyond an end or into a hole (NaN) of the profile.

A *response* is the ratio of output to input for ``exp(i W x)``, ``W = 2 pi / wavelength``: complex in general, real for
an operator that is symmetrical about its place. Functions ``..._response`` take any array of wavelengths in m.

docs/geometry.md has the signs, all looking towards greater chainage, and every operator with its response.
"""
