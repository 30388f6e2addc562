"""A coach on two bogies: masses on springs and dampers, driven by the track under its four wheelsets.

Three systems that do not act on one another, each of the form

    M q'' + C q' + K q = C_u u' + K_u u + F f(t)

with the wheelsets' heights, lateral places or rolls as ``u``, counted from the front:

* vertical: height and slope of the body, of the front and of the rear bogie frame;
* lateral: the same to the left and in heading; wheelsets are where the track is;
* roll: of the body and of the two frames, on the vertical springs.

Masses, vertical values and the secondary lateral ones are a published set for a 40 t coach (body bounce 0.67 Hz, frame
4.3 Hz); the body's gyration radius in pitch is that of the Manchester benchmark (Iwnicki, Vehicle System Dynamics 30,
1998); the other radii, the base of the springs and the stiff lateral guidance of the frames are assumed. Roll in curves
is not derived from centres of gravity and an anti-roll bar that no source gives: in a steady state the body leans by
``roll_coefficient`` times the angle of cant deficiency, outwards.

For ``u`` and ``f`` linear between samples the response is exact: in the modes ``q = Re(V eta)`` of the undriven system,
each ``eta' = lambda eta + p`` is a recursion of first order over the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its signal, which takes 0.5 s, when it is first used

from trackfg.numerics.arrays import Array


@dataclass(frozen=True)
class LinearSystem:
    """``q`` has n columns, ``u`` has m: masses (n,), damping and stiffness (n, n), and those to the inputs (n, m)."""

    mass: Array
    damping: Array
    stiffness: Array
    input_damping: Array
    input_stiffness: Array

    def response(self, inputs: Array, signals: Array, force: Array, dt_s: float, rows: list[int]) -> Array:
        """Return the columns ``rows`` of ``q`` at samples ``dt_s`` apart, from equilibrium and rest at the first.

        ``inputs`` (k, m) and the forces ``signals @ force.T``, (k, p) and (n, p), are linear in between. (k, rows).
        """
        n = len(self.mass)
        below = -np.concatenate([self.stiffness, self.damping], axis=1) / self.mass[:, None]
        rates, modes = np.linalg.eig(np.concatenate([np.eye(n, 2 * n, n), below]))
        into = np.linalg.inv(modes)[:, n:] / self.mass
        drive = np.concatenate([inputs, signals], axis=1)
        by_value = into @ np.concatenate([self.input_stiffness, force], axis=1)
        by_rate = into @ np.concatenate([self.input_damping, np.zeros_like(force)], axis=1)
        start = np.linalg.solve(self.stiffness, self.input_stiffness @ inputs[0] + force @ signals[0])
        eta_0 = np.linalg.solve(modes, np.concatenate([start, np.zeros(n)]))

        q = np.zeros((len(drive), len(rows)))
        q[0] = start[rows]
        # Modes that swing come in conjugate pairs, of which one stands for both.
        for i in np.flatnonzero(rates.imag >= 0.0):
            constant = np.expm1(rates[i] * dt_s) / rates[i]
            ramp = (constant - dt_s) / (rates[i] * dt_s)
            by_end = ramp * by_value[i] + constant / dt_s * by_rate[i]
            by_start = (constant - ramp) * by_value[i] - constant / dt_s * by_rate[i]
            decay = np.exp(rates[i] * dt_s)
            eta, _ = scipy.signal.lfilter(
                [1.0], [1.0, -decay], _times(drive[1:], by_end) + _times(drive[:-1], by_start), zi=[decay * eta_0[i]]
            )
            pair = 2.0 if rates[i].imag > 0.0 else 1.0
            for column, row in enumerate(rows):
                q[1:, column] += pair * (eta * modes[row, i]).real
        return q

    def gain(self, frequency_hz: Array, u: Array) -> Array:
        """Return complex amplitudes of ``q`` per unit of inputs that swing as ``u`` (m,). Shape (f,) to (f, n)."""
        w = 2.0 * np.pi * np.asarray(frequency_hz)[:, None, None]
        dynamic_stiffness = self.stiffness + 1j * w * self.damping - w * w * np.diag(self.mass)
        right = (self.input_stiffness + 1j * w * self.input_damping) @ u
        return np.asarray(np.linalg.solve(dynamic_stiffness, right[..., None])[..., 0])


@dataclass(frozen=True)
class Suspension:
    """Springs and dampers, N/m and N s/m, each for all of one wheelset (primary) or one bogie (secondary).

    ``*_gyration_m`` are radii of gyration in roll, pitch and yaw; vertical springs act ``spring_base_m`` / 2 from the
    middle. Bogies are ``half_pivot_m`` from the middle of the car, wheelsets ``half_wheelbase_m`` from that of a bogie.
    """

    body_mass_kg: float = 40_000.0
    bogie_mass_kg: float = 2280.0
    body_gyration_m: tuple[float, float, float] = (1.3, 7.8, 7.8)
    bogie_gyration_m: tuple[float, float, float] = (0.8, 0.75, 1.1)
    half_pivot_m: float = 9.0
    half_wheelbase_m: float = 1.25
    primary_vertical: tuple[float, float] = (6.65e5, 1.5e4)
    secondary_vertical: tuple[float, float] = (3.5e5, 8.0e4)
    primary_lateral: tuple[float, float] = (6.0e6, 3.0e4)
    secondary_lateral: tuple[float, float] = (2.08e5, 2.0e4)
    spring_base_m: float = 2.0
    roll_coefficient: float = 0.3

    @property
    def axles_m(self) -> tuple[float, float, float, float]:
        """Return offsets of the wheelsets from the middle of the car, from the front."""
        pivot, axle = self.half_pivot_m, self.half_wheelbase_m
        return (pivot + axle, pivot - axle, -pivot + axle, -pivot - axle)

    @property
    def vertical(self) -> LinearSystem:
        """Return heights and slopes: body, front frame, rear frame, (6,)."""
        return self._plane(1, self.primary_vertical, self.secondary_vertical)

    @property
    def lateral(self) -> LinearSystem:
        """Return places to the left and headings: body, front frame, rear frame, (6,)."""
        return self._plane(2, self.primary_lateral, self.secondary_lateral)

    @property
    def roll(self) -> LinearSystem:
        """Return rolls of the body, the front and the rear frame, (3,)."""
        inertia = np.array([self.body_mass_kg, self.bogie_mass_kg, self.bogie_mass_kg])
        inertia *= np.array([self.body_gyration_m[0], self.bogie_gyration_m[0], self.bogie_gyration_m[0]]) ** 2
        extension = np.array([[1, -1, 0], [1, 0, -1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]], dtype=float)
        lever = (0.5 * self.spring_base_m) ** 2
        primary, secondary = ((lever * k, lever * c) for k, c in (self.primary_vertical, self.secondary_vertical))
        return _on_springs(inertia, extension, primary, secondary)

    @property
    def lean_moment(self) -> float:
        """Return the moment on the body, N m, per rad of cant deficiency, that makes it lean by the roll
        coefficient.
        """
        return float(self.roll_coefficient / np.linalg.inv(self.roll.stiffness)[0, 0])

    def _plane(self, axis: int, primary: tuple[float, float], secondary: tuple[float, float]) -> LinearSystem:
        body, bogie = self.body_mass_kg, self.bogie_mass_kg
        turning = bogie * self.bogie_gyration_m[axis] ** 2
        mass = np.array([body, body * self.body_gyration_m[axis] ** 2, bogie, turning, bogie, turning])
        pivot, axle = self.half_pivot_m, self.half_wheelbase_m
        extension = np.array(
            [
                [1, pivot, -1, 0, 0, 0],
                [1, -pivot, 0, 0, -1, 0],
                [0, 0, 1, axle, 0, 0],
                [0, 0, 1, -axle, 0, 0],
                [0, 0, 0, 0, 1, axle],
                [0, 0, 0, 0, 1, -axle],
            ]
        )
        return _on_springs(mass, extension, primary, secondary)


def _on_springs(
    mass: Array, extension: Array, primary: tuple[float, float], secondary: tuple[float, float]
) -> LinearSystem:
    """Return the system of the extensions ``extension @ q`` less ``u`` of two secondary and four primary springs.

    ``extension`` is (6, n).
    """
    track = np.concatenate([np.zeros((2, 4)), np.eye(4)])
    k, c = (np.array([[second]] * 2 + [[first]] * 4) for first, second in zip(primary, secondary, strict=True))
    return LinearSystem(
        mass,
        extension.T @ (c * extension),
        extension.T @ (k * extension),
        extension.T @ (c * track),
        extension.T @ (k * track),
    )


def _times(real: Array, complex_weights: Array) -> Array:
    """Return ``real @ complex_weights``, (k, m) and (m,), without making the large factor complex."""
    return np.ascontiguousarray(real @ np.column_stack([complex_weights.real, complex_weights.imag])).view(complex)[
        :, 0
    ]
