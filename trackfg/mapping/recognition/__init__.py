"""Recognition of a run on a reference by its profile: where on a map, or on another run, it was.

A run has measured features of the track (curvature, cross-level, versine of level) over its own chainage. The reference
has the same features over the chainage that is wanted. The run's chainage errs by an offset, which may be as large as
the line is long, by a scale, by creep and by slips of the wheel. The run is cut into sections of 100 m. Sought are, for
each section k, the place ``p_k`` where it lies on the reference, the sigma of that, and the probability that it is
true. The search goes from coarse to fine:

1. **Profiles** (``profiles``). Both tables become rows on one grid, then cells of 1 m with two signals: *short waves*,
   the features without what is longer than some 25 m, and *curves*, the mean curvature over 20 m.

2. **Likelihood of a place** (``likelihood``, which adds ``short_wave_likelihood`` and ``curve_likelihood``). For each
   section and each place of the reference, 2 m apart, the log likelihood ratio

       l_k(p) = log P(section k | it lies at p) - log P(section k | it lies on any other track).

   It is the sum of the ratios of short waves and of curves, whose noises are estimated apart.

3. **Forward-backward over the places** (``place_hmm``). A hidden Markov model with the hidden state (place, scale of
   the run's chainage, track unchanged or changed) or "nowhere on the reference", and transitions for creep, slips,
   maintenance and leaving the reference. Forward filtering and backward smoothing give ``P(p_k | all sections)``.

4. **Fine match** (``fine_match``). From the most probable place on, least squares on the rows themselves,

       run_k(x) = reference(p_k + (1 + e_k) x) + constant + noise,

   give the place to some millimetres, with a covariance that knows that the noise is coloured.

5. **Decision** (``recognition``). A section's place is used if the probability that the section's middle lies within
   three sigmas and 3 m of its fine match exceeds 0.99, and its sigma is below 5 m. What is ambiguous stays unused.

``tracker`` is step 3 as a filter, for a run that goes on: it keeps the probability of each place after the last
section. ``warp`` turns the used sections into a function from the run's chainage to the reference's, ``conventions``
recognises a smoothed run on a map and checks that both mean the same.
"""
