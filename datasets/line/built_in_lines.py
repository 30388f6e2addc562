"""Designs of line and conditions of track that the built-in scenarios are made of."""

from __future__ import annotations

from dataclasses import replace

from trackfg.datasets.line.irregularities import IrregularityModel
from trackfg.datasets.line.line_design import LineDesign
from trackfg.numerics.units import KMH

MAIN_LINE = LineDesign(
    gauge_m=1.067,
    cross_level_base_m=1.067,
    line_speed_mps=120 * KMH,
    radius_m=(300.0, 1200.0),
    straight_m=(150.0, 1200.0),
    circle_m=(80.0, 500.0),
    max_turn_rad=1.0,
    cant_max_m=0.105,
    deficiency_max_m=0.070,
    usual_deficiency_m=0.030,
    transition_min_m=30.0,
    max_gradient=0.025,
    station_gradient=0.005,
    gradient_length_m=(350.0, 1200.0),
    vertical_radius_m=(3000.0, 6000.0),
    station_spacing_m=4000.0,
)

HIGH_SPEED_LINE = replace(
    MAIN_LINE,
    gauge_m=1.435,
    cross_level_base_m=1.5,
    radius_m=(400.0, 1000.0),
    straight_m=(80.0, 250.0),
    circle_m=(100.0, 300.0),
    cant_max_m=0.180,
    deficiency_max_m=0.090,
    transition_min_m=50.0,
    max_gradient=0.015,
    vertical_radius_m=(10_000.0, 15_000.0),
)

GOOD_TRACK = IrregularityModel(
    level_d1_sd_m=1.0e-3, alignment_d1_sd_m=0.8e-3, cross_level_d1_sd_m=0.8e-3, gauge_d1_sd_m=0.5e-3
)

WORN_TRACK = IrregularityModel(
    shape="high", level_d1_sd_m=1.8e-3, alignment_d1_sd_m=1.4e-3, cross_level_d1_sd_m=1.4e-3, gauge_d1_sd_m=0.8e-3
)

YARD = replace(
    MAIN_LINE,
    line_speed_mps=25 * KMH,
    radius_m=(160.0, 400.0),
    straight_m=(40.0, 200.0),
    circle_m=(40.0, 120.0),
    cant_max_m=0.060,
    max_gradient=0.005,
)

NARROW_YARD = replace(
    YARD,
    radius_m=(30.0, 200.0),
    straight_m=(20.0, 150.0),
    circle_m=(20.0, 80.0),
    max_turn_rad=2.0,
    transition_min_m=10.0,
    cant_max_m=0.0,
    max_gradient=0.05,
)
"""Curves and grades of a tramway's depot, without cant. No scenario has it: low-cost sensors are tried on it."""
