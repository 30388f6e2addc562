"""Wheels and tachometers do what their effects say."""

import numpy as np
import pytest

from trackfg.datasets.effects.wheel import (
    CREEP_S,
    CoarsePulses,
    CurveRolling,
    LateTach,
    MiscountedPulses,
    NoisySpeed,
    ScaleJump,
    WeakCreep,
    WholeKmh,
    WrongWheel,
)
from trackfg.numerics.units import KMH
from trackfg.recording.canonical import pulse_m


def distance(simulation):
    return simulation.recording.tach["distance_m"].to_numpy()


def speeds(simulation):
    """The speeds that a table was integrated from: its rows alternate about the trapezoids' means."""
    t = simulation.recording.tach["t_s"].to_numpy()
    means = np.diff(distance(simulation)) / np.diff(t)
    signs = (-1.0) ** np.arange(len(means))
    shown = np.concatenate([[0.0], 2.0 * signs * np.cumsum(signs * means)])
    return t, np.round(shown, 9)


def test_a_coarse_wheel_counts_revolutions(run):
    recording = run(CoarsePulses(1.0)).recording
    steps = np.diff(recording.tach["distance_m"].to_numpy()) / (np.pi * 0.86)
    assert pulse_m(recording.description.tach) == pytest.approx(np.pi * 0.86)
    assert set(np.round(steps, 6)) == {0.0, 1.0}


@pytest.mark.parametrize(("cut_off", "whole"), [(False, np.rint), (True, np.floor)])
def test_whole_kmh_are_whole(run, cut_off, whole):
    simulation = run(WholeKmh(5.0, cut_off=cut_off))
    t, shown = speeds(simulation)
    assert np.diff(t) == pytest.approx(np.full(len(t) - 1, 0.2))
    true = np.interp(t - 0.1, simulation.truth["t_s"], simulation.truth["speed_mps"]) / KMH / simulation.wheel_scale
    assert np.mean(np.abs(shown / KMH - whole(true)) < 1e-6) > 0.9
    assert simulation.recording.description.tach.kind == "speed"


def test_the_oracle_has_half_a_kmh_added_to_what_was_cut_off(run):
    oracle = speeds(run(WholeKmh(5.0, cut_off=True, for_oracle=True)))[1] / KMH
    cut = speeds(run(WholeKmh(5.0, cut_off=True)))[1] / KMH
    assert oracle[cut > 0.5] == pytest.approx(cut[cut > 0.5] + 0.5)
    assert np.all(oracle[cut < 0.5] == 0.0)


def test_a_noisy_speed_is_noisy_at_rest(run):
    simulation = run(NoisySpeed(0.1))
    still = simulation.recording.tach["t_s"].to_numpy() < 25.0
    # The trapezoid's mean of two speeds.
    means = np.diff(distance(simulation)[still]) / 0.1
    assert means.std() == pytest.approx(0.1 / np.sqrt(2.0), rel=0.1)


def test_late_rows_are_stamped_late(run):
    late, clean = run(LateTach(0.7)), run()
    assert late.recording.tach["t_s"].to_numpy() == pytest.approx(clean.recording.tach["t_s"].to_numpy() + 0.7)
    assert late.tach_time_offset_s == pytest.approx(-0.7)


def test_pulses_are_missed_and_doubled_at_the_same_rate(run):
    simulation = run(MiscountedPulses(0.02))
    quantum = pulse_m(simulation.recording.description.tach)
    pulses = distance(run()) / quantum
    counted = distance(simulation) / quantum
    assert np.rint(counted) == pytest.approx(counted, abs=1e-6)
    lost = np.diff(counted - pulses)
    assert np.sum(lost**2) / pulses[-1] == pytest.approx(0.04, rel=0.1)
    assert abs(counted[-1] - pulses[-1]) < 4.0 * np.sqrt(0.04 * pulses[-1])


def test_a_weak_creep_adds_its_share_for_a_minute(run):
    clean, creeping = run(duration_s=150.0), run(WeakCreep(0.02), duration_s=150.0)
    t = clean.recording.tach["t_s"].to_numpy()
    quantum = pulse_m(clean.recording.description.tach)
    added = quantum * np.rint((distance(creeping) - distance(clean)) / quantum)
    speed = np.abs(clean.ride.motion.speed(t))
    slipping = t[1:][np.diff(added) != 0.0]
    begins, ends = slipping[0], slipping[-1]
    assert ends - begins == pytest.approx(CREEP_S, abs=2.0)
    inside = (t > begins) & (t < ends)
    assert added[-1] == pytest.approx(0.02 * np.trapezoid(speed[inside], t[inside]), rel=0.1)
    assert speed[inside].mean() > 0.5 * speed.max()


def test_a_scale_jumps_half_way(run):
    clean, jumped = distance(run()), distance(run(ScaleJump(0.01)))
    half = 0.5 * clean[-1]
    quantum = pulse_m(run().recording.description.tach)
    assert jumped[clean < half] == pytest.approx(clean[clean < half])
    assert jumped[-1] - half == pytest.approx(0.99 * (clean[-1] - half), abs=quantum)


@pytest.mark.parametrize("factor", [1.3, 3.6, -1.0])
def test_a_wrong_wheel_multiplies(run, factor):
    assert distance(run(WrongWheel(factor))) == pytest.approx(factor * distance(run()))


def test_a_wheelset_rolls_further_outside(run):
    clean, wide = run(duration_s=150.0), run(CurveRolling(0.5), duration_s=150.0)
    curvature = clean.track.line.curvature(clean.ride.motion.distance(clean.recording.tach["t_s"].to_numpy()))
    t = clean.recording.tach["t_s"].to_numpy()
    bent = np.trapezoid(np.abs(curvature * clean.ride.motion.speed(t)), t)
    assert bent > 0.2
    added = distance(wide)[-1] - distance(clean)[-1]
    assert added == pytest.approx(0.5 * bent / clean.wheel_scale, abs=0.04)


@pytest.mark.parametrize("effect", [LateTach(0.7), MiscountedPulses(0.02), WeakCreep(0.02), ScaleJump(0.01)])
def test_the_oracle_has_a_good_wheel(run, effect):
    oracle = run(type(effect)(effect.magnitude, for_oracle=True)).recording
    assert oracle.tach.equals(run().recording.tach)
