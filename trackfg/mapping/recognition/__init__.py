"""Recognition of a run on a reference by its profile: where on a map, or on another run, it was.

A run has measured features of the track (curvature, cross-level, versine of level) over its own chainage. The reference
has the same features over the chainage that is wanted. The run's chainage errs by an offset, which may be as large as
the line is long, by a scale, by creep and by slips of the wheel. The run is cut into sections of 100 m. Sought are, for
each section k, where it lies on the reference, the sigma of that, and the probability that it is true.

A *place* is an index: the number p of a pair of cells, ``2 p`` m to ``2 p + 2`` m of the reference. A position in
metres has the suffix ``_m``. A section *begins* at its end of lower chainage, whichever way the run went, and the place
``p_k`` of steps 2 and 3 is where it begins; step 4 works on the position of its middle. The search goes from coarse to
fine:

1. **Profiles** (``profiles``). Both tables become rows on one grid, then cells of 1 m with two signals: *short waves*,
   the features without what is longer than some 25 m, and *curves*, the mean curvature over 20 m.

2. **Likelihood of a place** (``likelihood``, which adds ``short_wave_likelihood`` and ``curve_likelihood``). For each
   section and each place of the reference, 2 m apart, the log likelihood ratio against any other track, by short waves
   and by curves.

3. **Forward-backward over the places** (``place_hmm``). A hidden Markov model, whose state is on the reference, on a
   foreign line alike it, or off both, gives ``P(p_k | all sections)``.

4. **Fine match** (``fine_match``, by ``section_fit``). From the most probable place on, least squares on the rows
   themselves give the position ``m_k`` of the section's middle to some millimetres, with a covariance for coloured
   noise.

5. **Decision** (``recognition``). A section's place is used if the probability that the section's middle lies within
   three sigmas and 3 m of its fine match exceeds 0.99, and its sigma is below 5 m. What is ambiguous stays unused.

Creep has three models, one for each length at which it matters: from section to section a place moves by one, with a
probability (step 3); within a section the scale error has a prior sigma for it (step 4); and the wheel's random walk
over three sections gives the sigma between a section's mean shift and the shift at its middle (step 4).

``tracker`` is step 3 as a filter, for a run that goes on: it keeps the probability of each place after the last
section. ``warp`` turns the used sections into a function from the run's chainage to the reference's, ``conventions``
recognises a smoothed run on a map and checks that both mean the same.
"""
