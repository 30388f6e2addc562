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
   section and each place of the reference, 2 m apart, the log likelihood ratio

       l_k(p) = log P(section k | it lies at p) - log P(section k | it lies on any other track).

   It is the sum of two ratios, of short waves and of curves. They are kept apart, because maintained track keeps its
   curves but not its short waves.

3. **Forward-backward over the places** (``place_hmm``). A hidden Markov model whose state is one of

   * *on* the reference: (place, scale error of the run's chainage, track unchanged or changed);
   * *alike* p: foreign, resembling p, another line whose curves happen to be those at p. It competes with *on* for the
     evidence of the curves, so only short waves or further curves decide;
   * *off*: foreign, and like no place of the reference,

   with transitions for creep, slips, maintenance and leaving the reference. Forward filtering and backward smoothing
   give ``P(p_k | all sections)``.

4. **Fine match** (``fine_match``, by ``section_fit``). From the most probable place on, least squares on the rows
   themselves, with x from the section's middle,

       run_k(x) = reference(m_k + (1 + e_k) x) + constant + noise,

   give the position ``m_k`` of the middle to some millimetres, with a covariance for coloured noise.

5. **Decision** (``recognition``). A section's place is used if the probability that the section's middle lies within
   three sigmas and 3 m of its fine match exceeds 0.99, and its sigma is below 5 m. What is ambiguous stays unused.

Creep has three models, one for each length at which it matters: from section to section a place moves by one, with a
probability (step 3); within a section the scale error has a prior sigma for it (step 4); and the wheel's random walk
over three sections gives the sigma between a section's mean shift and the shift at its middle (step 4).

``tracker`` is step 3 as a filter, for a run that goes on: it keeps the probability of each place after the last
section. ``warp`` turns the used sections into a function from the run's chainage to the reference's, ``conventions``
recognises a smoothed run on a map and checks that both mean the same.
"""
