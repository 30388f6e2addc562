// Arguments of the kernels are arrays that Python made: buffers of doubles or 64-bit integers, contiguous in C order, at
// addresses that a processor reads at once.
#pragma once

#define Py_LIMITED_API 0x030B0000  // Py_buffer is part of it since Python 3.11: one build serves every later version
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

// Compile a function for the vector units that processors differ in; the loader chooses (GNU C library on x86-64).
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
#define WITH_VECTOR_UNITS __attribute__((target_clones("arch=skylake-avx512", "arch=haswell", "default")))
#else
#define WITH_VECTOR_UNITS
#endif

// One argument: its buffer is held until the kernel returns. Check `ok()` before use; an exception is set where not.
template <typename Number>
class Array {
  public:
    Array(PyObject *object, int dimensions, bool writable = false) {
        const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
        if (PyObject_GetBuffer(object, &view_, flags) != 0) return;
        held_ = true;
        const char *format = view_.format == nullptr ? "B" : view_.format;
        const bool integer = std::strcmp(format, "l") == 0 || std::strcmp(format, "q") == 0;
        const bool right_type = std::is_integral_v<Number> ? integer : std::strcmp(format, "d") == 0;
        if (!right_type || view_.itemsize != sizeof(Number) || view_.ndim != dimensions) {
            PyErr_Format(PyExc_TypeError, "expected an array of %d dimensions of %s, and not of %d of format '%s'",
                         dimensions, std::is_integral_v<Number> ? "64-bit integers" : "doubles", view_.ndim, format);
            return;
        }
        if (view_.len > 0 && reinterpret_cast<std::uintptr_t>(view_.buf) % alignof(Number) != 0) {
            PyErr_Format(PyExc_ValueError, "expected an array at an address that is a multiple of %d bytes",
                         static_cast<int>(alignof(Number)));
            return;
        }
        ok_ = true;
    }
    ~Array() {
        if (held_) PyBuffer_Release(&view_);
    }
    Array(const Array &) = delete;
    Array &operator=(const Array &) = delete;

    bool ok() const { return ok_; }
    Number *data() const { return static_cast<Number *>(view_.buf); }
    std::ptrdiff_t size(int axis) const { return view_.shape[axis]; }
    std::ptrdiff_t total() const { return view_.len / static_cast<std::ptrdiff_t>(sizeof(Number)); }

  private:
    Py_buffer view_{};
    bool held_ = false, ok_ = false;
};

using Doubles = Array<double>;
using Integers = Array<std::int64_t>;

// Refuse arguments that do not belong together; a kernel would write beyond them.
inline PyObject *refused(const char *what) {
    PyErr_Format(PyExc_ValueError, "arrays of sizes that do not belong together: %s", what);
    return nullptr;
}

PyObject *eliminate(PyObject *, PyObject *arguments);
PyObject *preintegrate(PyObject *, PyObject *arguments);
PyObject *inertial_factors(PyObject *, PyObject *arguments);
PyObject *predict(PyObject *, PyObject *arguments);
PyObject *spill(PyObject *, PyObject *arguments);
PyObject *unspill(PyObject *, PyObject *arguments);

extern const std::ptrdiff_t DELTA_SIZE;  // numbers that preintegrate() writes of an interval
