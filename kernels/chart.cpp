// Steps from states to states, all variables at once: trackfg.factors.states and the chart of marginal_prior; and the states
// of marginalised keyframes, by their conditionals: trackfg.streaming.window.window.
#include <vector>

#include "states.h"

namespace {

NavState moved(const NavState &from, const double *step, bool in_chart) {
    const Vector turn = vector(step), shift = vector(step + 3), faster = vector(step + 6);
    const Vector p = from.p + from.R * shift;
    if (!in_chart) return {from.R * Rotation(turn).exponential(), p, from.v + from.R * faster};
    const Angles angles(from.R);
    const Vector rates = angles.euler_rates() * turn, before = from.own_velocity();
    const Matrix R = Angles(angles.roll + rates[0], angles.pitch + rates[1], angles.yaw + rates[2]).rotation();
    return {R, p, R * (before + faster + cross(before, turn))};
}

// Where a tangent of keyframe k, or of the shared variables, has the kinds of variables.
template <typename Each>
void each_variable(std::ptrdiff_t keyframes, double *of_keyframes, double *of_shared, Each each) {
    for (std::ptrdiff_t k = 0; k < keyframes; ++k) {
        double *at = of_keyframes + k * KEYFRAME;
        for (const Variable kind : ORDER)
            if (kind < OF_MOUNT) each(kind, k, at), at += DIMENSION[kind];
    }
    double *at = of_shared;
    for (const Variable kind : ORDER)
        if (kind >= OF_MOUNT) each(kind, 0, at), at += DIMENSION[kind];
}

// Write the tangent from `origin` to `to` in the chart of marginal_prior; return where the next one begins.
double *write_tangent(const NavState &to, const NavState &origin, double *out) {
    const InChart tangent(to, origin);
    for (const Vector &part : {tangent.turn, tangent.shift, tangent.faster}) out = std::copy(part.x, part.x + 3, out);
    return out;
}

// Write a navigation state as number k of `values`.
void write_nav(const NavState &nav, const Values &values, std::ptrdiff_t k) {
    std::copy(&nav.R.x[0][0], &nav.R.x[0][0] + 9, values.value[OF_NAV] + 9 * k);
    std::copy(nav.p.x, nav.p.x + 3, values.p + 3 * k);
    std::copy(nav.v.x, nav.v.x + 3, values.v + 3 * k);
}

bool fit(const Values &one, const Values &other, const Doubles &keyframes, const Doubles &shared) {
    const std::ptrdiff_t n = one.count[OF_NAV];
    return one.ok && other.ok && one.of_one_run() && other.of_one_run() && other.count[OF_NAV] == n &&
           keyframes.size(0) == n && keyframes.size(1) == KEYFRAME && shared.size(0) >= SHARED;
}

}  // namespace

// retract(values, keyframes (n, K), shared (s), in_chart, moved): `values` moved by a step, into `moved`; in the chart of
// marginal_prior or in that of the graph. Both are as States.arrays has them, s may have further sensors at its end.
PyObject *retract(PyObject *, PyObject *arguments) {
    PyObject *py[4];
    int in_chart;
    if (!PyArg_ParseTuple(arguments, "OOOpO", &py[0], &py[1], &py[2], &in_chart, &py[3])) return nullptr;
    const Arrays arrays(py[0]);
    if (!arrays.ok()) return nullptr;
    const Doubles keyframes(py[1], 2), shared(py[2], 1);
    if (!keyframes.ok() || !shared.ok()) return nullptr;
    const Arrays out_arrays(py[3], true);
    if (!out_arrays.ok()) return nullptr;
    const Values values(arrays), out(out_arrays);
    if (!fit(values, out, keyframes, shared)) return refused("states and a step");
    each_variable(keyframes.size(0), keyframes.data(), shared.data(),
                  [&](Variable kind, std::ptrdiff_t k, const double *step) {
                      if (kind == OF_NAV) {
                          write_nav(moved(values.nav(k), step, in_chart != 0), out, k);
                          return;
                      }
                      const std::ptrdiff_t at = k * DIMENSION[kind];
                      for (int i = 0; i < DIMENSION[kind]; ++i)
                          out.value[kind][at + i] = values.value[kind][at + i] + step[i];
                  });
    Py_RETURN_NONE;
}

// step_from(origin, values, keyframes (n, K), shared (s)): the step that leads from `origin` to `values` in the chart of
// marginal_prior, written into `keyframes` and `shared`.
PyObject *step_from(PyObject *, PyObject *arguments) {
    PyObject *py[4];
    if (!PyArg_ParseTuple(arguments, "OOOO", &py[0], &py[1], &py[2], &py[3])) return nullptr;
    const Arrays origin_arrays(py[0]);
    if (!origin_arrays.ok()) return nullptr;
    const Arrays arrays(py[1]);
    if (!arrays.ok()) return nullptr;
    const Doubles keyframes(py[2], 2, true), shared(py[3], 1, true);
    if (!keyframes.ok() || !shared.ok()) return nullptr;
    const Values origin(origin_arrays), values(arrays);
    if (!fit(origin, values, keyframes, shared)) return refused("states and a step");
    each_variable(keyframes.size(0), keyframes.data(), shared.data(),
                  [&](Variable kind, std::ptrdiff_t k, double *step) {
                      if (kind == OF_NAV) {
                          write_tangent(values.nav(k), origin.nav(k), step);
                          return;
                      }
                      const std::ptrdiff_t at = k * DIMENSION[kind];
                      for (int i = 0; i < DIMENSION[kind]; ++i)
                          step[i] = values.value[kind][at + i] - origin.value[kind][at + i];
                  });
    Py_RETURN_NONE;
}

// marginalised_states(R (n, K, K), S (n, K, K + s), d (n, K), point, next, sensors, out): the states of n keyframes in a row
// by their conditionals ``R x_k + S (x_{k+1}, s) = d``, x from the linearisation point, that of n + 1 keyframes, in the chart
// of marginal_prior; given the first keyframe of `next` and its shared variables. `sensors`: by how much those of further
// sensors, at the end of s, differ from the point. `point`, `next` and `out` are as States.arrays has them; `out` takes n
// keyframes and the shared variables of `next`. Returns whether no conditional is singular.
PyObject *marginalised_states(PyObject *, PyObject *arguments) {
    PyObject *py[7];
    if (!PyArg_ParseTuple(arguments, "OOOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5], &py[6])) return nullptr;
    const Doubles R(py[0], 3), S(py[1], 3), d(py[2], 2), sensors(py[5], 1);
    if (!R.ok() || !S.ok() || !d.ok() || !sensors.ok()) return nullptr;
    const Arrays point_arrays(py[3]), next_arrays(py[4]), out_arrays(py[6], true);
    if (!point_arrays.ok() || !next_arrays.ok() || !out_arrays.ok()) return nullptr;
    const Values point(point_arrays), next(next_arrays), out(out_arrays);
    const std::ptrdiff_t n = R.size(0), shared = SHARED + sensors.size(0), columns = KEYFRAME + shared;
    if (n < 1 || R.size(1) != KEYFRAME || R.size(2) != KEYFRAME || S.size(0) != n || S.size(1) != KEYFRAME ||
        S.size(2) != columns || d.size(0) != n || d.size(1) != KEYFRAME)
        return refused("conditionals");
    for (const Values *values : {&point, &next, &out})
        if (!values->ok || !values->of_one_run()) return refused("states");
    if (point.count[OF_NAV] != n + 1 || next.count[OF_NAV] < 1 || out.count[OF_NAV] != n) return refused("states");

    std::vector<double> y(columns);  // (x_{k+1}, s)
    double x[KEYFRAME], *into = y.data();
    for (const Variable kind : ORDER) {
        const std::ptrdiff_t at = kind < OF_MOUNT ? n * DIMENSION[kind] : 0;
        if (kind == OF_NAV) {
            into = write_tangent(next.nav(0), point.nav(n), into);
            continue;
        }
        for (int i = 0; i < DIMENSION[kind]; ++i) *into++ = next.value[kind][i] - point.value[kind][at + i];
        if (kind >= OF_MOUNT) std::copy_n(next.value[kind], DIMENSION[kind], out.value[kind]);
    }
    std::copy_n(sensors.data(), sensors.size(0), into);
    for (std::ptrdiff_t k = n - 1; k >= 0; --k) {
        const double *R_k = R.data() + k * KEYFRAME * KEYFRAME, *S_k = S.data() + k * KEYFRAME * columns;
        for (int i = KEYFRAME - 1; i >= 0; --i) {
            double left = d.data()[k * KEYFRAME + i];
            for (std::ptrdiff_t c = 0; c < columns; ++c) left -= S_k[i * columns + c] * y[c];
            for (int j = i + 1; j < KEYFRAME; ++j) left -= R_k[i * KEYFRAME + j] * x[j];
            if (R_k[i * KEYFRAME + i] == 0.0) Py_RETURN_FALSE;
            x[i] = left / R_k[i * KEYFRAME + i];
        }
        std::copy_n(x, KEYFRAME, y.data());
        const double *step = x;
        for (const Variable kind : ORDER) {
            if (kind >= OF_MOUNT) break;
            if (kind == OF_NAV) {
                write_nav(moved(point.nav(k), step, true), out, k);
            } else {
                const std::ptrdiff_t at = k * DIMENSION[kind];
                for (int i = 0; i < DIMENSION[kind]; ++i) out.value[kind][at + i] = point.value[kind][at + i] + step[i];
            }
            step += DIMENSION[kind];
        }
    }
    Py_RETURN_TRUE;
}
