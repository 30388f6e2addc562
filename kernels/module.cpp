// The module trackfg.numerics.compiled: what its functions do is said above each, their types in compiled.pyi.
#include "arrays.h"

static PyMethodDef methods[] = {
    {"eliminate", eliminate, METH_VARARGS, "Eliminate some keyframes of a chain by QR."},
    {"preintegrate", preintegrate, METH_VARARGS, "Preintegrate the increments of an interval."},
    {"inertial_factors", inertial_factors, METH_VARARGS, "Linearise inertial factors, or compute their residuals."},
    {"predict", predict, METH_VARARGS, "Predict the state after an interval."},
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
    if (module != nullptr && (PyModule_AddIntConstant(module, "REVISION", 3) != 0 ||
                              PyModule_AddIntConstant(module, "DELTA_SIZE", DELTA_SIZE) != 0)) {
        Py_DECREF(module);
        return nullptr;
    }
    return module;
}
