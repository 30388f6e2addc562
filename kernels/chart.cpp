// Steps from states to states, all variables at once: trackfg.factors.states and the chart of marginal_prior.
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
                          const NavState to = moved(values.nav(k), step, in_chart != 0);
                          std::copy(&to.R.x[0][0], &to.R.x[0][0] + 9, out.value[OF_NAV] + 9 * k);
                          std::copy(to.p.x, to.p.x + 3, out.p + 3 * k);
                          std::copy(to.v.x, to.v.x + 3, out.v + 3 * k);
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
                          const InChart tangent(values.nav(k), origin.nav(k));
                          for (const Vector &part : {tangent.turn, tangent.shift, tangent.faster})
                              step = std::copy(part.x, part.x + 3, step);
                          return;
                      }
                      const std::ptrdiff_t at = k * DIMENSION[kind];
                      for (int i = 0; i < DIMENSION[kind]; ++i)
                          step[i] = values.value[kind][at + i] - origin.value[kind][at + i];
                  });
    Py_RETURN_NONE;
}
