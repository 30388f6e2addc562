// Cubics between places with given velocities: trackfg.numerics.hermite.
#include <algorithm>

#include "arrays.h"

// hermite_at(t (m), times (n), places (r, n), velocities (r, n), out (r, m)): r rows of cubics at times t; `times` ascend.
PyObject *hermite_at(PyObject *, PyObject *arguments) {
    PyObject *py[5];
    if (!PyArg_ParseTuple(arguments, "OOOOO", &py[0], &py[1], &py[2], &py[3], &py[4])) return nullptr;
    const Doubles at(py[0], 1), times(py[1], 1), places(py[2], 2), velocities(py[3], 2), out(py[4], 2, true);
    if (!at.ok() || !times.ok() || !places.ok() || !velocities.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t m = at.size(0), n = times.size(0), rows = places.size(0);
    if (n < 2 || places.size(1) != n || velocities.size(0) != rows || velocities.size(1) != n) return refused("places");
    if (out.size(0) != rows || out.size(1) != m) return refused("results");
    const double *knots = times.data();
    Py_BEGIN_ALLOW_THREADS;
    std::ptrdiff_t k = 0;
    for (std::ptrdiff_t i = 0; i < m; ++i) {
        const double t = at.data()[i];
        if (!(knots[k] <= t && (k == n - 2 || t < knots[k + 1])))  // as a rule t ascends, and is in the same interval
            k = std::clamp<std::ptrdiff_t>(std::upper_bound(knots, knots + n, t) - knots - 1, 0, n - 2);
        const double T = knots[k + 1] - knots[k], f = (t - knots[k]) / T, f2 = f * f, f3 = f2 * f;
        const double w1 = 3.0 * f2 - 2.0 * f3, u0 = T * (f - 2.0 * f2 + f3), u1 = T * (f3 - f2);
        for (std::ptrdiff_t row = 0; row < rows; ++row) {
            const double *place = places.data() + row * n + k, *velocity = velocities.data() + row * n + k;
            out.data()[row * m + i] = place[0] * (1.0 - w1) + place[1] * w1 + velocity[0] * u0 + velocity[1] * u1;
        }
    }
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}
