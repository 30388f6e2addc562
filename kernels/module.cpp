// The module trackfg.numerics.compiled: what its functions do is said above each, their types in compiled.pyi.
#include "arrays.h"

static PyMethodDef methods[] = {
    {"eliminate", eliminate, METH_VARARGS, "Eliminate some keyframes of a chain by QR."},
    {"eliminate_pair", eliminate_pair, METH_VARARGS, "Eliminate two keyframes by QR."},
    {"triangle", triangle, METH_VARARGS, "Factorise some rows by QR."},
    {"back_substitute", back_substitute, METH_VARARGS, "Solve for all keyframes of a chain, from its conditionals."},
    {"forward_substitute", forward_substitute, METH_VARARGS, "Solve the transposed system of a chain."},
    {"covariances", covariances, METH_VARARGS, "Compute the covariances of all keyframes of a chain."},
    {"preintegrate", preintegrate, METH_VARARGS, "Preintegrate the increments of an interval."},
    {"inertial_factors", inertial_factors, METH_VARARGS, "Linearise inertial factors, or compute their residuals."},
    {"predict", predict, METH_VARARGS, "Predict the state after an interval."},
    {"predict_interval", predict_interval, METH_VARARGS, "Predict the next interval of a stream."},
    {"noise_floor", noise_floor, METH_VARARGS, "Look for the white noise of inertial samples."},
    {"noise_seen", noise_seen, METH_VARARGS, "Look for white noise and add it up."},
    {"white_noise", white_noise, METH_VARARGS, "Add up the white noise between times."},
    {"interpolate_columns", interpolate_columns, METH_VARARGS, "Interpolate the columns of a table."},
    {"compress", compress, METH_VARARGS, "Compress inertial samples to increments."},
    {"turning", turning, METH_VARARGS, "Follow the attitude along intervals."},
    {"ahead_of_a_steady_turn", ahead_of_a_steady_turn, METH_VARARGS, "Compare turns with steady ones."},
    {"means_around", means_around, METH_VARARGS, "Average samples around times."},
    {"tach_interval", tach_interval, METH_VARARGS, "Compute what a wheel rolls over an interval."},
    {"pair_rows", pair_rows, METH_VARARGS, "Linearise and stack the factors of two keyframes."},
    {"linear_rows", linear_rows, METH_VARARGS, "Linearise factors of a type."},
    {"marginal_prior", marginal_prior, METH_VARARGS, "Linearise a marginal prior."},
    {"retract", retract, METH_VARARGS, "Move states by a step."},
    {"step_from", step_from, METH_VARARGS, "Compute the step from states to others."},
    {"marginalised_states", marginalised_states, METH_VARARGS, "Compute states of marginalised keyframes."},
    {"quantities", quantities, METH_VARARGS, "Differentiate what a trajectory tells."},
    {"quantity_variances", quantity_variances, METH_VARARGS, "Compute the variances of what a trajectory tells."},
    {"trajectory_rows", trajectory_rows, METH_VARARGS, "Compute rows of a trajectory with their sigmas."},
    {"spread", spread, METH_VARARGS, "Compute the variances of predicted residuals."},
    {"dense_motion", dense_motion, METH_VARARGS, "Follow the motion between keyframes."},
    {"hermite_at", hermite_at, METH_VARARGS, "Evaluate cubics."},
    {"resample", resample, METH_VARARGS, "Bring samples to a uniform step."},
    {"add_weighted_rows", add_weighted_rows, METH_VARARGS, "Add weighted sums of rows."},
    {"add_up_rows", add_up_rows, METH_VARARGS, "Make running sums of rows."},
    {"switch_chain", switch_chain, METH_VARARGS, "Find the states of a chain of switches."},
    {"median_step", median_step, METH_VARARGS, "Find the median step of numbers."},
    {"cauchy_fit", cauchy_fit, METH_VARARGS, "Fit coefficients by robust least squares."},
    {"spill", spill, METH_VARARGS, "Lay large arrays beyond a budget into a file."},
    {"unspill", unspill, METH_VARARGS, "Leave arrays to another handler of memory again."},
    {nullptr, nullptr, 0, nullptr},
};

static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "compiled", "Kernels of trackfg in C++.", -1, methods, nullptr, nullptr, nullptr, nullptr,
};

PyMODINIT_FUNC PyInit_compiled() {
    PyObject *module = PyModule_Create(&definition);
    // Raised by one whenever a function's arguments change, so that a build of older sources is not called.
    if (module != nullptr && (PyModule_AddIntConstant(module, "REVISION", 34) != 0 ||
                              PyModule_AddIntConstant(module, "DELTA_SIZE", DELTA_SIZE) != 0)) {
        Py_DECREF(module);
        return nullptr;
    }
    return module;
}
