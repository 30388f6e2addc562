// The variables of the graph as trackfg.factors.states has them, and the chart of trackfg.factors.marginal_prior.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>

#include "arrays.h"
#include "rotations.h"

constexpr int NAV = 9, BIAS = 6, ODO = 4, MOUNT = 5, CLOCK = 3, IMU = 29, WHEEL = 5, SENSOR = 2;
constexpr int DISTANCE = 0, SCALE = 1, COUNT = 2, STEP = 3;  // of ODO

// The kinds of variables in the order in which Python passes their values, those of NAV as three arrays.
enum Variable { OF_NAV, OF_BIAS, OF_ODO, OF_MOUNT, OF_CLOCK, OF_IMU, OF_WHEEL, VARIABLES };
constexpr int DIMENSION[VARIABLES] = {NAV, BIAS, ODO, MOUNT, CLOCK, IMU, WHEEL};
// The order in which a tangent has them: first those of a keyframe, then the shared ones.
constexpr Variable ORDER[] = {OF_ODO, OF_BIAS, OF_NAV, OF_MOUNT, OF_CLOCK, OF_IMU, OF_WHEEL};
constexpr int KEYFRAME = ODO + BIAS + NAV, SHARED = MOUNT + CLOCK + IMU + WHEEL;

// Attitude, position and velocity of a keyframe.
struct NavState {
    Matrix R;
    Vector p, v;

    Vector own_velocity() const { return transposed(R) * v; }
};

// The mounting: travel axes to body axes, its derivatives by pitch and yaw, and the point that follows the track.
struct Mounting {
    Matrix R, by[2];
    Vector point;

    explicit Mounting(const double *mount) : point(vector(mount + 2)) {
        const double cp = std::cos(mount[0]), sp = std::sin(mount[0]), cy = std::cos(mount[1]), sy = std::sin(mount[1]);
        R = {{{cy * cp, -sy, cy * sp}, {sy * cp, cy, sy * sp}, {-sp, 0, cp}}};
        by[0] = {{{-cy * sp, 0, cy * cp}, {-sy * sp, 0, sy * cp}, {-cp, 0, -sp}}};
        by[1] = {{{-sy * cp, -cy, -sy * sp}, {cy * cp, -sy, cy * sp}, {0, 0, 0}}};
    }
    Vector forward() const { return column(R, 0); }
};

// Buffers of a tuple of arrays of doubles of any shape in C order: of each, how many rows and numbers it has.
class Arrays {
  public:
    explicit Arrays(PyObject *tuple, bool writable = false) {
        const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
        if (!PyTuple_Check(tuple)) {
            PyErr_SetString(PyExc_TypeError, "expected a tuple of arrays");
            return;
        }
        count_ = PyTuple_Size(tuple);
        if (count_ > MOST) {
            refused("too many");
            return;
        }
        for (; held_ < count_; ++held_)
            if (PyObject_GetBuffer(PyTuple_GetItem(tuple, held_), &views_[held_], flags) != 0) return;
        for (Py_ssize_t i = 0; i < count_; ++i) {
            const char *format = views_[i].format == nullptr ? "B" : in_own_order(views_[i].format);
            if (std::strcmp(format, "d") != 0 || views_[i].ndim < 1) {
                PyErr_SetString(PyExc_TypeError, "expected arrays of doubles");
                return;
            }
            if (!is_aligned(views_[i], alignof(double))) return;
        }
        ok_ = true;
    }
    ~Arrays() {
        for (Py_ssize_t i = 0; i < held_; ++i) PyBuffer_Release(&views_[i]);
    }
    Arrays(const Arrays &) = delete;
    Arrays &operator=(const Arrays &) = delete;

    bool ok() const { return ok_; }
    std::ptrdiff_t count() const { return count_; }
    double *data(std::ptrdiff_t i) const { return static_cast<double *>(views_[i].buf); }
    std::ptrdiff_t rows(std::ptrdiff_t i) const { return views_[i].shape[0]; }
    std::ptrdiff_t total(std::ptrdiff_t i) const { return views_[i].len / static_cast<Py_ssize_t>(sizeof(double)); }
    bool has(std::ptrdiff_t i, std::ptrdiff_t rows, std::ptrdiff_t numbers) const {
        return this->rows(i) == rows && total(i) == rows * numbers;
    }

  private:
    static constexpr Py_ssize_t MOST = 13;
    Py_buffer views_[MOST];
    Py_ssize_t count_ = 0, held_ = 0;
    bool ok_ = false;
};

// Values of all variables, as States.arrays has them: R, p and v of NAV, then the others, one row for each variable.
struct Values {
    std::ptrdiff_t count[VARIABLES] = {};
    double *value[VARIABLES], *p, *v;
    bool ok = false;

    explicit Values(const Arrays &arrays) {
        if (arrays.count() != VARIABLES + 2) return;
        const std::ptrdiff_t keyframes = arrays.rows(0);
        if (!arrays.has(0, keyframes, 9) || !arrays.has(1, keyframes, 3) || !arrays.has(2, keyframes, 3)) return;
        value[OF_NAV] = arrays.data(0), p = arrays.data(1), v = arrays.data(2), count[OF_NAV] = keyframes;
        for (int kind = OF_BIAS; kind < VARIABLES; ++kind) {
            count[kind] = arrays.rows(kind + 2), value[kind] = arrays.data(kind + 2);
            if (!arrays.has(kind + 2, count[kind], DIMENSION[kind])) return;
        }
        ok = true;
    }

    // Whether there is one of each shared variable, and of the others one per keyframe.
    bool of_one_run() const {
        for (int kind = OF_BIAS; kind < VARIABLES; ++kind)
            if (count[kind] != (kind >= OF_MOUNT ? 1 : count[OF_NAV])) return false;
        return true;
    }
    NavState nav(std::ptrdiff_t k) const {
        return {matrix(value[OF_NAV] + 9 * k), vector(p + 3 * k), vector(v + 3 * k)};
    }
};

struct Angles {
    double roll, pitch, yaw;

    explicit Angles(const Matrix &R)
        : roll(std::atan2(R[2][1], R[2][2])), pitch(std::asin(std::clamp(-R[2][0], -1.0, 1.0))),
          yaw(std::atan2(R[1][0], R[0][0])) {}

    Angles(double roll, double pitch, double yaw) : roll(roll), pitch(pitch), yaw(yaw) {}

    Matrix rotation() const {
        const double sr = std::sin(roll), cr = std::cos(roll), sp = std::sin(pitch), cp = std::cos(pitch);
        const double sy = std::sin(yaw), cy = std::cos(yaw);
        return {{{cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr},
                 {sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr},
                 {-sp, cp * sr, cp * cr}}};
    }
    Matrix euler_rates() const {
        const double sr = std::sin(roll), cr = std::cos(roll), cp = std::cos(pitch), tp = std::tan(pitch);
        return {{{1, sr * tp, cr * tp}, {0, cr, -sr}, {0, sr / cp, cr / cp}}};
    }
    Matrix body_rates() const {
        const double sr = std::sin(roll), cr = std::cos(roll), sp = std::sin(pitch), cp = std::cos(pitch);
        return {{{1, 0, -sp}, {0, cr, sr * cp}, {0, -sr, cr * cp}}};
    }
};

// The tangent of a navigation state from its linearisation point in the chart.
struct InChart {
    Vector turn, shift, faster;

    InChart(const NavState &state, const NavState &origin) {
        const Angles angles(state.R), from(origin.R);
        double yaw = angles.yaw - from.yaw;
        yaw -= 2.0 * M_PI * std::nearbyint(yaw / (2.0 * M_PI));
        turn = from.body_rates() * Vector{{angles.roll - from.roll, angles.pitch - from.pitch, yaw}};
        shift = transposed(origin.R) * (state.p - origin.p);
        const Vector before = origin.own_velocity();
        faster = state.own_velocity() - before - cross(before, turn);
    }
};
