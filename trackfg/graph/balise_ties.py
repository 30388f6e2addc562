"""A balise that is passed again ties its passages together: the vehicle is where it was, wherever that may be.

The place L of a balise is a variable that the run shares. Passed n times, with a planned place of sigma p and readings
of sigma r, it has the information of a landmark: of the mean of the passages ``1 / (p^2 + r^2 / n)``, of their
differences ``1 / r^2``. Fixes of variance ``n p^2 + r^2`` each (:mod:`trackfg.smoothing.fixes.balise_fixes`), which are
held against the others by hypotheses and leave-one-out residuals, have the first and a part ``1 / (n p^2 + r^2)`` of
the second. So the passages of a free L get the rest of it, the variance

    r^2 (1 + r^2 / (n p^2)),

and both together are the landmark. Of a place that is not known, p is infinite and there are no fixes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.config import PositionConfig
from trackfg.factors.landmark import balise_passage
from trackfg.factors.loss import Cauchy
from trackfg.factors.states import Kind
from trackfg.graph.build import Problem
from trackfg.numerics.spans import nearest
from trackfg.recording.model import Recording

_MOST = 40
"""Balises whose places are variables of the graph: each adds 1 to 2 % to the rows and the columns of every keyframe's
covariance. Of more, those are taken that are spread evenly over the order of their first passages."""


def with_balise_ties(problem: Problem, recording: Recording, config: PositionConfig) -> Problem:
    """Return the problem with the balises that are passed more than once as shared variables, at its initial values."""
    part, passages = recording.description.balises, recording.balises
    if passages is None or part is None:
        return problem
    passages = passages[passages["t_s"].between(problem.t[0], problem.t[-1])]
    passages = passages.assign(n=passages.groupby("id")["id"].transform("size"))
    again = passages[passages["n"] > 1]
    ids = again["id"].unique()
    if not len(ids):
        return problem
    ids = ids[np.unique(np.linspace(0, len(ids) - 1, min(len(ids), _MOST)).astype(np.int64))]
    again = again[again["id"].isin(ids)]
    t, balise = again["t_s"].to_numpy(), pd.Categorical(again["id"], categories=ids).codes.astype(np.int64)
    read, planned = part.reading_sd_m, again["chainage_sd_m"].fillna(np.inf).to_numpy()
    sigma = read * np.sqrt(1.0 + read**2 / (again["n"].to_numpy() * planned**2))
    if len(ids) % Kind.SENSOR.dim:  # the other half of the last variable is where the run begins
        t, balise, sigma = np.append(t, problem.t[0]), np.append(balise, len(ids)), np.append(sigma, read)
    keyframe = nearest(problem.t, t)
    distance = np.interp(t, problem.t, problem.initial.odo.distance)
    carried = distance - problem.initial.odo.distance[keyframe]
    places = (np.bincount(balise, distance) / np.bincount(balise)).reshape(-1, Kind.SENSOR.dim)
    loss = Cauchy(config.fix_width) if config.robust else None
    sensor = problem.initial.sensor
    family = balise_passage(keyframe, carried, balise, len(sensor), sigma[:, None], loss)
    initial = replace(problem.initial, sensor=np.concatenate([sensor, places]))
    return replace(problem, initial=initial).with_family(family)
