// Factors of the graph, whitened residuals and Jacobians at once: the equations of trackfg.factors, factor by factor.
#include <algorithm>
#include <cmath>
#include <vector>

#include "arrays.h"
#include "factors.h"
#include "rotations.h"
#include "states.h"

namespace {

constexpr int GYRO_RATE = 9;  // where W begins in IMU, row by row
constexpr int MOST_SLOTS = 4, MOST_DATA = 8;

// What a factor is computed from: the values that it touches, slot by slot, and its measurements. Values of NAV are its
// attitude; position and velocity follow in arrays of their own.
struct Given {
    const double *value[MOST_SLOTS], *p[MOST_SLOTS], *v[MOST_SLOTS], *data[MOST_DATA];

    Matrix R(int slot) const { return matrix(value[slot]); }
    Vector position(int slot) const { return vector(p[slot]); }
    Vector own_velocity(int slot) const { return transposed(R(slot)) * vector(v[slot]); }
};

// Rows [A b] of one factor: `columns` of them, or b alone where there is 1. Entries that are not set stay 0.
struct Rows {
    double *out;
    std::ptrdiff_t columns;

    bool with_jacobian() const { return columns > 1; }
    void residual(int row, double value) const { out[(row + 1) * columns - 1] = -value; }
    double &at(int row, int column) const { return out[row * columns + column]; }
    void block(int row, int column, const Matrix &from) const {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) at(row + i, column + j) = from[i][j];
    }
    void row(int row, int column, const Vector &from) const {
        for (int j = 0; j < 3; ++j) at(row, column + j) = from[j];
    }
    void add(int row, int column, const Vector &from) const {
        for (int j = 0; j < 3; ++j) at(row, column + j) += from[j];
    }
};

Vector minus(const Vector &a) { return {{-a[0], -a[1], -a[2]}}; }
Matrix operator-(const Matrix &a, const Matrix &b) { return a + (-1.0) * b; }

void distance_chain(const Given &given, const Rows &rows) {
    const double *first = given.value[0], *second = given.value[1];
    rows.residual(0, second[DISTANCE] - first[DISTANCE] - second[STEP]);
    rows.residual(1, second[SCALE] - first[SCALE]);
    if (!rows.with_jacobian()) return;
    rows.at(0, DISTANCE) = rows.at(1, SCALE) = rows.at(0, ODO + STEP) = -1.0;
    rows.at(0, ODO + DISTANCE) = rows.at(1, ODO + SCALE) = 1.0;
}

void tach_distance(const Given &given, const Rows &rows) {
    const double *first = given.value[0], *second = given.value[1], *wheel = given.value[2], *response = given.data[0];
    const double turned = second[COUNT] - first[COUNT];
    double explained = 0.0;
    for (int i = 0; i < WHEEL; ++i) explained += response[i] * wheel[i];
    rows.residual(0, first[SCALE] * turned - second[STEP] - explained);
    if (!rows.with_jacobian()) return;
    rows.at(0, SCALE) = turned, rows.at(0, COUNT) = -first[SCALE];
    rows.at(0, ODO + COUNT) = first[SCALE], rows.at(0, ODO + STEP) = -1.0;
    for (int i = 0; i < WHEEL; ++i) rows.at(0, 2 * ODO + i) = -response[i];
}

void tach_reading(const Given &given, const Rows &rows) {
    const double *odo = given.value[0], *clock = given.value[1];
    const double count = *given.data[0], rate = *given.data[1], since = *given.data[2];
    rows.residual(0, odo[COUNT] - (count - rate * (clock[0] + clock[1] * since)));
    if (!rows.with_jacobian()) return;
    rows.at(0, COUNT) = 1.0, rows.at(0, ODO) = rate, rows.at(0, ODO + 1) = rate * since;
}

void absolute_fix(const Given &given, const Rows &rows) {
    rows.residual(0, given.value[0][DISTANCE] - *given.data[0]);
    if (rows.with_jacobian()) rows.at(0, DISTANCE) = 1.0;
}

// phi / sin(phi) and its derivative by cos(phi), by series near zero.
void angle_over_sine(double cosine, double &value, double &slope) {
    const double x = 1.0 - std::min(cosine, 1.0);
    if (x < 1e-4) {
        value = 1.0 + x / 3.0 + 2.0 * x * x / 15.0, slope = -(1.0 / 3.0 + 4.0 * x / 15.0);
        return;
    }
    const double phi = std::acos(std::min(cosine, 1.0)), sine = std::sin(phi);
    value = phi / sine, slope = -(sine - phi * std::cos(phi)) / (sine * sine * sine);
}

// From keyframe to keyframe, the way of the point that follows the track.
Vector chord(const Given &given, const Vector &from_track) {
    return (given.position(1) - given.R(1) * from_track) - (given.position(0) - given.R(0) * from_track);
}

void arc_length(const Given &given, const Rows &rows) {
    const Mounting mount(given.value[3]);
    const Vector from_track = vector(given.data[0]) - mount.point, f = mount.forward(), way = chord(given, from_track);
    const Vector t[2] = {given.R(0) * f, given.R(1) * f}, mean = 0.5 * (t[0] + t[1]);
    const double along = dot(way, mean);
    double ratio, by_cosine;
    angle_over_sine(dot(t[0], t[1]), ratio, by_cosine);
    rows.residual(0, ratio * along - given.value[2][STEP]);
    if (!rows.with_jacobian()) return;
    const int at_mount = 2 * NAV + ODO;
    rows.at(0, 2 * NAV + STEP) = -1.0;
    for (int end = 0; end < 2; ++end) {
        const Matrix back = transposed(given.R(end));
        const Vector toward = ((end == 0 ? -1.0 : 1.0) * ratio) * (back * mean);
        const Vector direction = back * ((0.5 * ratio) * way + (along * by_cosine) * t[1 - end]);
        rows.row(0, NAV * end, cross(toward, from_track) + cross(f, direction));
        rows.row(0, NAV * end + 3, toward);
        for (int angle = 0; angle < 2; ++angle)
            rows.at(0, at_mount + angle) += dot(column(mount.by[angle], 0), direction);
        for (int i = 0; i < 3; ++i) rows.at(0, at_mount + 2 + i) += toward[i];
    }
}

void path(const Given &given, const Rows &rows) {
    const Mounting mount(given.value[2]);
    const Matrix first = given.R(0), turn = matrix(given.data[0]), mean = matrix(given.data[1]),
                 mean_by_time = matrix(given.data[2]);
    const Vector ahead = vector(given.data[3]), felt = matrix(given.value[3] + GYRO_RATE) * ahead;
    const Vector from_track = vector(given.data[4]) - mount.point, f = mount.forward();
    const Matrix relative = transposed(first) * given.R(1);
    const Vector u = transposed(first) * chord(given, from_track), e = logarithm(transposed(turn) * relative);
    const Matrix c_by_e = -1.0 * (mean_by_time * skew(f)), c_by_w = mean * skew(f);
    const Vector c = mean * f + c_by_e * e + c_by_w * felt;
    const double slope[2] = {c[1] / c[0], c[2] / c[0]}, share = u[0] / c[0];
    for (int i = 0; i < 2; ++i) rows.residual(i, u[1 + i] - slope[i] * u[0]);
    if (!rows.with_jacobian()) return;
    // Rows 2 and 3 of a derivative less `slope` times row 1.
    const auto add_across = [&](int column, const Matrix &derivative, double factor, int count = 3) {
        for (int i = 0; i < 2; ++i)
            for (int j = 0; j < count; ++j)
                rows.at(i, column + j) += factor * (derivative[1 + i][j] - slope[i] * derivative[0][j]);
    };
    const Matrix by_e = c_by_e * Rotation(e).inverse_jacobian(), arm = skew(from_track);
    add_across(0, skew(u) - arm, 1.0);
    add_across(0, by_e * transposed(relative), share);
    add_across(3, IDENTITY, -1.0);
    add_across(NAV, relative * arm, 1.0);
    add_across(NAV, by_e, -share);
    add_across(NAV + 3, relative, 1.0);
    const Matrix by_f = mean + mean_by_time * skew(e) - mean * skew(felt);
    Matrix by_angles = 0.0 * IDENTITY;
    for (int angle = 0; angle < 2; ++angle) {
        const Vector derivative = by_f * column(mount.by[angle], 0);
        for (int i = 0; i < 3; ++i) by_angles[i][angle] = derivative[i];
    }
    add_across(2 * NAV, by_angles, -share, 2);
    add_across(2 * NAV + 2, relative - IDENTITY, 1.0);
    for (int axis = 0; axis < 3; ++axis) {
        Matrix by_rate = 0.0 * IDENTITY;  // of row `axis` of W
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) by_rate[i][j] = c_by_w[i][axis] * ahead[j];
        add_across(2 * NAV + MOUNT + GYRO_RATE + 3 * axis, by_rate, -share);
    }
}

void non_holonomic(const Given &given, const Rows &rows) {
    const Mounting mount(given.value[1]);
    const Vector rate = vector(given.data[0]), body = given.own_velocity(0);
    const Vector on_track = body - cross(rate, vector(given.data[1]) - mount.point);
    const double ahead = dot(column(mount.R, 0), on_track), sign = (ahead > 0.0) - (ahead < 0.0);
    for (int i = 0; i < 2; ++i) {
        const double sideways = dot(column(mount.R, 1 + i), on_track), growth = given.data[3][i];
        const double scale = 1.0 / (1.0 + growth * (std::abs(ahead) - *given.data[2]));
        rows.residual(i, scale * sideways);
        if (!rows.with_jacobian()) continue;
        // By the sideways velocity, and by that ahead.
        const double by[2] = {scale, -scale * scale * growth * sign * sideways};
        const int axes[2] = {1 + i, 0};
        const Vector side = by[0] * column(mount.R, axes[0]) + by[1] * column(mount.R, axes[1]);
        rows.row(i, 0, cross(side, body));  // side' [body]x
        rows.row(i, 6, side);
        for (int angle = 0; angle < 2; ++angle) {
            const Matrix &turned = mount.by[angle];
            rows.at(i, NAV + angle) = dot(by[0] * column(turned, axes[0]) + by[1] * column(turned, axes[1]), on_track);
        }
        rows.row(i, NAV + 2, cross(side, rate));
    }
}

void bias_walk(const Given &given, const Rows &rows) {
    const double *first = given.value[0], *second = given.value[1], *calibration = given.value[2];
    for (int i = 0; i < BIAS; ++i) {
        const double *change = given.data[0] + IMU * i;
        double explained = 0.0;
        for (int j = 0; j < IMU; ++j) explained += change[j] * calibration[j];
        rows.residual(i, second[i] - first[i] - explained);
        if (!rows.with_jacobian()) continue;
        rows.at(i, i) = -1.0, rows.at(i, BIAS + i) = 1.0;
        for (int j = 0; j < IMU; ++j) rows.at(i, 2 * BIAS + j) = -change[j];
    }
}

void at_rest(const Given &given, const Rows &rows) {
    for (int i = 0; i < 3; ++i) rows.residual(i, given.v[0][i]);
    if (rows.with_jacobian()) rows.block(0, 6, given.R(0));
}

void standstill(const Given &given, const Rows &rows) {
    const Matrix back = transposed(given.R(0)), relative = back * given.R(1);
    const Vector turn = logarithm(relative), shift = back * (given.position(1) - given.position(0));
    for (int i = 0; i < 3; ++i) rows.residual(i, turn[i]), rows.residual(3 + i, shift[i]);
    if (!rows.with_jacobian()) return;
    const Matrix inverse = Rotation(turn).inverse_jacobian();
    rows.block(0, 0, -1.0 * (inverse * transposed(relative)));
    rows.block(3, 0, skew(shift));
    rows.block(3, 3, -1.0 * IDENTITY);
    rows.block(0, NAV, inverse);
    rows.block(3, NAV + 3, relative);
}

// Two units see one point of a rail: one at slot `first`, one between slots `start` and `start` + 1.
void same_rail(const Given &given, const Rows &rows, int first, int start) {
    const double h = *given.data[2], T = *given.data[3], h2 = h * h, h3 = h2 * h;
    const double share[2] = {1 - 3 * h2 + 2 * h3, 3 * h2 - 2 * h3}, slope[2] = {T * (h - 2 * h2 + h3), T * (h3 - h2)};
    const Vector lead = vector(given.data[1]), trail = vector(given.data[7]);
    const Matrix ends[2] = {given.R(start), given.R(start + 1)}, relative = transposed(ends[0]) * ends[1];
    const Vector e = logarithm(transposed(matrix(given.data[5])) * relative);
    const Rotation late(h * e);
    const Matrix until = matrix(given.data[4]) * late.exponential(), trailing = ends[0] * until, leading = given.R(first);
    Vector behind = vector(given.data[6]) + trailing * trail;
    for (int end = 0; end < 2; ++end)
        behind = behind + (share[end] * given.position(start + end) + slope[end] * vector(given.v[start + end]));
    const Vector apart = transposed(leading) * (given.position(first) + leading * lead - behind);
    const Vector across[2] = {vector(given.data[0]), vector(given.data[0] + 3)};
    for (int i = 0; i < 2; ++i) rows.residual(i, dot(across[i], apart));
    if (!rows.with_jacobian()) return;
    const Matrix by_end = h * (late.jacobian() * Rotation(e).inverse_jacobian());
    const Matrix by_turn[2] = {transposed(until) - by_end * transposed(relative), by_end};
    for (int i = 0; i < 2; ++i) {
        rows.add(i, NAV * first, cross(across[i], apart - lead));
        rows.add(i, NAV * first + 3, across[i]);
        const Vector in_n = leading * across[i], about = cross(transposed(trailing) * in_n, trail);
        for (int end = 0; end < 2; ++end) {
            const int at = NAV * (start + end);
            const Vector own = transposed(ends[end]) * in_n;
            rows.add(i, at, transposed(by_turn[end]) * about);
            rows.add(i, at + 3, -share[end] * own);
            rows.add(i, at + 6, -slope[end] * own);
        }
    }
}

void rail_within(const Given &given, const Rows &rows) { same_rail(given, rows, 0, 0); }
void rail_apart(const Given &given, const Rows &rows) { same_rail(given, rows, 0, 1); }

constexpr Variable NONE = VARIABLES;

}  // namespace

struct FactorType {
    const char *name;
    void (*compute)(const Given &, const Rows &);
    int rows;
    Variable slots[MOST_SLOTS];
    int data[MOST_DATA];  // numbers per factor of each measurement, 0 where there is none

    std::ptrdiff_t columns() const {
        std::ptrdiff_t sum = 1;
        for (const Variable slot : slots) sum += slot == NONE ? 0 : DIMENSION[slot];
        return sum;
    }
};

namespace {

const FactorType TYPES[] = {
    {"distance_chain", distance_chain, 2, {OF_ODO, OF_ODO, NONE, NONE}, {}},
    {"tach_distance", tach_distance, 1, {OF_ODO, OF_ODO, OF_WHEEL, NONE}, {WHEEL}},
    {"tach_reading", tach_reading, 1, {OF_ODO, OF_CLOCK, NONE, NONE}, {1, 1, 1}},
    {"absolute_fix", absolute_fix, 1, {OF_ODO, NONE, NONE, NONE}, {1}},
    {"arc_length", arc_length, 1, {OF_NAV, OF_NAV, OF_ODO, OF_MOUNT}, {3}},
    {"path", path, 2, {OF_NAV, OF_NAV, OF_MOUNT, OF_IMU}, {9, 9, 9, 3, 3}},
    {"non_holonomic", non_holonomic, 2, {OF_NAV, OF_MOUNT, NONE, NONE}, {3, 3, 1, 2}},
    {"bias_walk", bias_walk, 6, {OF_BIAS, OF_BIAS, OF_IMU, NONE}, {BIAS * IMU}},
    {"at_rest", at_rest, 3, {OF_NAV, NONE, NONE, NONE}, {}},
    {"standstill", standstill, 6, {OF_NAV, OF_NAV, NONE, NONE}, {}},
    {"rail_within", rail_within, 2, {OF_NAV, OF_NAV, NONE, NONE}, {6, 3, 1, 1, 9, 9, 3, 3}},
    {"rail_apart", rail_apart, 2, {OF_NAV, OF_NAV, OF_NAV, NONE}, {6, 3, 1, 1, 9, 9, 3, 3}},
};

}  // namespace

Factors::Factors(const char *type, PyObject *indices, PyObject *data, PyObject *sigma, double width)
    : type_(std::find_if(std::begin(TYPES), std::end(TYPES),
                         [&](const FactorType &one) { return std::strcmp(one.name, type) == 0; })),
      data_(data), sigma_(sigma, 2), width_(width) {
    if (!data_.ok() || !sigma_.ok()) return;
    if (type_ == std::end(TYPES)) {
        refused("a type of factors that has no kernel");
        return;
    }
    if (!PyTuple_Check(indices) || PyTuple_Size(indices) != slots()) {
        refused("slots");
        return;
    }
    for (int slot = 0; slot < slots(); ++slot) {
        indices_.emplace_back(PyTuple_GetItem(indices, slot), 1);
        if (!indices_.back().ok()) return;
    }
    ok_ = true;
}

int Factors::slots() const {
    return static_cast<int>(std::find(type_->slots, type_->slots + MOST_SLOTS, NONE) - type_->slots);
}

Variable Factors::kind(int slot) const { return type_->slots[slot]; }

std::ptrdiff_t Factors::columns() const { return type_->columns(); }

bool Factors::fit(const Values &values) const {
    if (!ok_) return false;
    const auto refuse = [](const char *what) { return refused(what) != nullptr; };
    const std::ptrdiff_t factors = count();
    if (rows() != type_->rows) return refuse("rows");
    int measurements = 0;
    for (; measurements < MOST_DATA && type_->data[measurements] > 0; ++measurements)
        if (measurements >= data_.count() || !data_.has(measurements, factors, type_->data[measurements]))
            return refuse("measurements");
    if (data_.count() != measurements) return refuse("measurements");
    for (int slot = 0; slot < slots(); ++slot) {
        if (indices_[slot].size(0) != factors) return refuse("slots");
        for (std::ptrdiff_t k = 0; k < factors; ++k)
            if (index(slot, k) < 0 || index(slot, k) >= values.count[kind(slot)]) return refuse("slots");
    }
    return true;
}

double Factors::linearise(const Values &values, std::ptrdiff_t k, double *out, std::ptrdiff_t columns) const {
    Given given{};
    for (int slot = 0; slot < slots(); ++slot) {
        const std::int64_t at = index(slot, k);
        given.value[slot] = values.value[kind(slot)] + at * DIMENSION[kind(slot)];
        if (kind(slot) == OF_NAV) given.p[slot] = values.p + 3 * at, given.v[slot] = values.v + 3 * at;
    }
    for (std::ptrdiff_t i = 0; i < data_.count(); ++i) given.data[i] = data_.data(i) + k * type_->data[i];
    const Rows rows{out, columns};
    type_->compute(given, rows);
    double bound = 0.0, square = 0.0;
    for (int i = 0; i < type_->rows; ++i) {
        const double scale = 1.0 / sigma_.data()[k * type_->rows + i];
        for (std::ptrdiff_t j = 0; j < columns; ++j) {
            double &entry = rows.out[i * columns + j];
            bound += entry * entry;
            entry *= scale;
        }
        const double b = rows.out[(i + 1) * columns - 1];
        square += b * b;
    }
    const double norm = std::sqrt(square), share = norm / width_;
    const double weight = width_ > 0.0   ? std::min(1.0, width_ / std::max(norm, 1e-12))
                          : width_ < 0.0 ? 1.0 / (1.0 + share * share)
                                         : 1.0;
    if (weight != 1.0)
        for (std::ptrdiff_t i = 0; i < type_->rows * columns; ++i) rows.out[i] *= std::sqrt(weight);
    return bound;
}

// linear_rows(type, values, indices, data, sigma (m, d), width, rows (m, d, c)): factors of a type on `values` (as
// States.arrays has them), of which slot j of a factor touches number indices[j]. Rows [A b], or b alone where c is 1, are
// whitened and, where `width` is above 0, weighted by Huber's loss, where it is below 0 by Cauchy's of width -`width`.
// Returns whether all numbers are finite and none is beyond all bounds: so is the sum of their squares.
PyObject *linear_rows(PyObject *, PyObject *arguments) {
    const char *name;
    PyObject *py[5];
    double width;
    if (!PyArg_ParseTuple(arguments, "sOOOOdO", &name, &py[0], &py[1], &py[2], &py[3], &width, &py[4])) return nullptr;
    const Arrays arrays(py[0]);
    if (!arrays.ok()) return nullptr;
    const Values values(arrays);
    if (!values.ok) return refused("values");
    const Factors factors(name, py[1], py[2], py[3], width);
    if (!factors.fit(values)) return nullptr;
    const Doubles out(py[4], 3, true);
    if (!out.ok()) return nullptr;
    const std::ptrdiff_t columns = out.size(2);
    if (out.size(0) != factors.count() || out.size(1) != factors.rows() || (columns != 1 && columns != factors.columns()))
        return refused("rows");
    double bound = 0.0;
    std::fill_n(out.data(), out.total(), 0.0);
    Py_BEGIN_ALLOW_THREADS;
    for (std::ptrdiff_t k = 0; k < factors.count(); ++k)
        bound += factors.linearise(values, k, out.data() + k * factors.rows() * columns, columns);
    Py_END_ALLOW_THREADS;
    return PyBool_FromLong(std::isfinite(bound));
}

namespace {

// The derivative of a navigation state's tangent from its linearisation point, in the chart, by the tangent of the state.
void chart_by_state(const NavState &state, const NavState &origin, double (&out)[NAV][NAV]) {
    const Matrix by_turn = Angles(origin.R).body_rates() * Angles(state.R).euler_rates();
    const Matrix by_shift = transposed(origin.R) * state.R;
    const Matrix faster_by_turn = skew(state.own_velocity()) - skew(origin.own_velocity()) * by_turn;
    for (int i = 0; i < 3; ++i) {
        out[6 + i][6 + i] = 1.0;
        for (int j = 0; j < 3; ++j) {
            out[i][j] = by_turn[i][j], out[3 + i][3 + j] = by_shift[i][j];
            out[6 + i][j] = faster_by_turn[i][j];
        }
    }
}

}  // namespace

Prior::Prior(PyObject *sensor, Py_ssize_t keyframe, PyObject *origins, PyObject *sensor_origins, PyObject *A, PyObject *b,
             PyObject *sigma)
    : sensor_(sensor, 2), keyframe_(keyframe), origins_(origins), sensor_origins_(sensor_origins, 2), A_(A, 2), b_(b, 1),
      sigma_(sigma, 1) {}

bool Prior::fit(const Values &values) const {
    if (!sensor_.ok() || !origins_.ok() || !sensor_origins_.ok() || !A_.ok() || !b_.ok() || !sigma_.ok()) return false;
    const auto refuse = [](const char *what) { return refused(what) != nullptr; };
    const Values origins(origins_);
    if (!values.ok || !origins.ok || keyframe_ < 0 || keyframe_ >= values.count[OF_NAV]) return refuse("values");
    if (!values.of_one_run() || !origins.of_one_run() || origins.count[OF_NAV] != 1) return refuse("values");
    if (sensor_.size(1) != SENSOR || sensor_origins_.size(1) != SENSOR || sensor_origins_.size(0) != sensor_.size(0))
        return refuse("sensors");
    if (A_.size(1) != KEYFRAME + SHARED + sensor_.total() || b_.size(0) != rows() || sigma_.size(0) != rows())
        return refuse("rows");
    return true;
}

double Prior::linearise(const Values &values, double *out, std::ptrdiff_t columns) const {
    const std::ptrdiff_t n = A_.size(1);
    const Values origins(origins_);
    std::vector<double> x;
    x.reserve(n);
    std::ptrdiff_t at_nav = 0;
    double by_state[NAV][NAV] = {};
    for (const Variable kind : ORDER) {
        const std::ptrdiff_t own = kind >= OF_MOUNT ? 0 : keyframe_;
        if (kind == OF_NAV) {
            const NavState state = values.nav(keyframe_), origin = origins.nav(0);
            const InChart tangent(state, origin);
            if (columns > 1) chart_by_state(state, origin, by_state);
            at_nav = static_cast<std::ptrdiff_t>(x.size());
            for (const Vector &part : {tangent.turn, tangent.shift, tangent.faster})
                x.insert(x.end(), part.x, part.x + 3);
        } else
            for (int i = 0; i < DIMENSION[kind]; ++i)
                x.push_back(values.value[kind][own * DIMENSION[kind] + i] - origins.value[kind][i]);
    }
    for (std::ptrdiff_t i = 0; i < sensor_.total(); ++i) x.push_back(sensor_.data()[i] - sensor_origins_.data()[i]);

    double bound = 0.0;
    for (std::ptrdiff_t i = 0; i < rows(); ++i) {
        const double *from = A_.data() + i * n, scale = 1.0 / sigma_.data()[i];
        double *row = out + i * columns, sum = b_.data()[i];
        for (std::ptrdiff_t j = 0; j < n; ++j) sum -= from[j] * x[j];
        row[columns - 1] = sum;
        if (columns > 1) {
            std::copy(from, from + n, row);
            for (int j = 0; j < NAV; ++j) {
                double by = 0.0;
                for (int k = 0; k < NAV; ++k) by += from[at_nav + k] * by_state[k][j];
                row[at_nav + j] = by;
            }
        }
        for (std::ptrdiff_t j = 0; j < columns; ++j) bound += row[j] * row[j], row[j] *= scale;
    }
    return bound;
}

// marginal_prior(values, sensor (s, 2), keyframe, origins, sensor_origins (s, 2), A (r, n), b (r), sigma (r),
// rows (r, n + 1)): the factor on a keyframe and the shared variables, linearised at `values`, or b alone into rows (r, 1);
// `origins` are those of one keyframe. Both are as States.arrays has them. Returns as linear_rows().
PyObject *marginal_prior(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    Py_ssize_t keyframe;
    if (!PyArg_ParseTuple(arguments, "OOnOOOOOO", &py[0], &py[1], &keyframe, &py[2], &py[3], &py[4], &py[5], &py[6],
                          &py[7]))
        return nullptr;
    const Arrays arrays(py[0]);
    if (!arrays.ok()) return nullptr;
    const Values values(arrays);
    const Prior prior(py[1], keyframe, py[2], py[3], py[4], py[5], py[6]);
    if (!prior.fit(values)) return nullptr;
    const Doubles rows(py[7], 2, true);
    if (!rows.ok()) return nullptr;
    const std::ptrdiff_t columns = rows.size(1);
    if (rows.size(0) != prior.rows() || (columns != 1 && columns != prior.columns())) return refused("rows");
    return PyBool_FromLong(std::isfinite(prior.linearise(values, rows.data(), columns)));
}

// switch_chain(z (n), transition (2, 2), stay_cost, outlier, inlier_before, first (n)): the probability that each error
// belongs to the first state given all of them, forwards and backwards along the chain of trackfg.factors.switching
// (Rabiner, Proceedings of the IEEE 77 (1989)). Returns that of the last one by those up to it.
PyObject *switch_chain(PyObject *, PyObject *arguments) {
    PyObject *py[3];
    double stay_cost, outlier, inlier_before;
    if (!PyArg_ParseTuple(arguments, "OOdddO", &py[0], &py[1], &stay_cost, &outlier, &inlier_before, &py[2]))
        return nullptr;
    const Doubles z(py[0], 1), transition(py[1], 2), first(py[2], 1, true);
    if (!z.ok() || !transition.ok() || !first.ok()) return nullptr;
    const std::ptrdiff_t n = z.size(0);
    if (transition.size(0) != 2 || transition.size(1) != 2 || first.size(0) != n) return refused("a chain");
    const double *T = transition.data();
    // What an error says of the states, up to a factor.
    const auto likelihood = [&](std::ptrdiff_t k, double &in, double &out) {
        const double own = z.data()[k], costs[2] = {0.5 * own * own, stay_cost + 0.5 * own / outlier * (own / outlier)};
        const double least = std::min(costs[0], costs[1]);
        in = std::exp(least - costs[0]), out = std::exp(least - costs[1]);
    };
    double in = inlier_before, out = 1.0 - inlier_before, of_in, of_out;
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        likelihood(k, of_in, of_out);
        const double next_in = (in * T[0] + out * T[2]) * of_in, next_out = (in * T[1] + out * T[3]) * of_out;
        in = next_in / (next_in + next_out), out = next_out / (next_in + next_out);
        first.data()[k] = in;
    }
    double after_in = 1.0, after_out = 1.0;
    for (std::ptrdiff_t k = n - 1; k >= 0; --k) {
        double &own = first.data()[k];
        const double as_in = own * after_in, as_out = (1.0 - own) * after_out;
        own = as_in / (as_in + as_out);
        likelihood(k, of_in, of_out);
        const double before_in = T[0] * of_in * after_in + T[1] * of_out * after_out;
        const double before_out = T[2] * of_in * after_in + T[3] * of_out * after_out;
        const double largest = std::max(before_in, before_out);
        after_in = before_in / largest, after_out = before_out / largest;
    }
    return PyFloat_FromDouble(in);
}
