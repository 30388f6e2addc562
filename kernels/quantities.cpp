// What a trajectory tells of a vehicle, its sigmas, and its derivatives by the states: trackfg.output.trajectory.
#include <iterator>

#include "states.h"

namespace {

constexpr int QUANTITIES = 8, CHAINAGE = 0, PLACE = 1, SPEED = 4, ATTITUDE = 5;
constexpr int POINT = 2;  // where the place of the point that follows the track begins in MOUNT
constexpr int AT_NAV = ODO + BIAS;  // in a tangent

// The derivatives of the quantities of one keyframe by its tangent and those of the shared variables, as far as they are
// not 0: each quantity has a few, row by row in the order of the columns.
class Derivatives {
  public:
    Derivatives(const Matrix &R, const Vector &v, const Mounting &mount, const Matrix &by_lever) {
        const Matrix to_travel = transposed(mount.R), by_turn = R * by_lever;
        const Matrix rates = Angles(R * mount.R).euler_rates(), by_attitude = rates * to_travel;
        const Vector forward = mount.forward(), faster = cross(forward, transposed(R) * v);
        const double cy = mount.R[1][1], sy = -mount.R[0][1];
        const Vector by_pitch = rates * (to_travel * Vector{{-sy, cy, 0}}), by_yaw = rates * (to_travel * Vector{{0, 0, 1}});
        add(CHAINAGE, DISTANCE, 1.0);
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) add(PLACE + i, AT_NAV + j, by_turn[i][j]);
            for (int j = 0; j < 3; ++j) add(PLACE + i, AT_NAV + 3 + j, R[i][j]);
            for (int j = 0; j < 3; ++j) add(ATTITUDE + i, AT_NAV + j, by_attitude[i][j]);
            add(ATTITUDE + i, KEYFRAME, by_pitch[i]), add(ATTITUDE + i, KEYFRAME + 1, by_yaw[i]);
        }
        for (int i = 0; i < 3; ++i) add(SPEED, AT_NAV + i, faster[i]);
        for (int i = 0; i < 3; ++i) add(SPEED, AT_NAV + 6 + i, forward[i]);
    }

    // Call each(column, derivative) for those of a quantity.
    template <typename Each>
    void of(int quantity, const Each &each) const {
        for (int i = 0; i < count_[quantity]; ++i) each(column_[quantity][i], value_[quantity][i]);
    }

  private:
    void add(int quantity, int column, double value) {
        const int i = count_[quantity]++;
        column_[quantity][i] = column, value_[quantity][i] = value;
    }
    static constexpr int MOST = 6;
    int count_[QUANTITIES] = {}, column_[QUANTITIES][MOST];
    double value_[QUANTITIES][MOST];
};

}  // namespace

// quantities(R (n, 3, 3), v (n, 3), mount (5), lever_arm (3), J (n, 8, d)): the derivatives of the quantities by the tangents
// of a keyframe and of the shared variables, but for further sensors.
PyObject *quantities(PyObject *, PyObject *arguments) {
    PyObject *py[5];
    if (!PyArg_ParseTuple(arguments, "OOOOO", &py[0], &py[1], &py[2], &py[3], &py[4])) return nullptr;
    const Doubles attitude(py[0], 3), velocity(py[1], 2), mounting(py[2], 1), lever(py[3], 1), out(py[4], 3, true);
    if (!attitude.ok() || !velocity.ok() || !mounting.ok() || !lever.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t n = out.size(0), columns = KEYFRAME + SHARED;
    if (attitude.size(0) != n || attitude.size(1) != 3 || attitude.size(2) != 3 || velocity.size(0) != n ||
        velocity.size(1) != 3 || mounting.size(0) != MOUNT || lever.size(0) != 3)
        return refused("states");
    if (out.size(1) != QUANTITIES || out.size(2) != columns) return refused("derivatives");
    const Mounting mount(mounting.data());
    const Matrix by_lever = skew(vector(lever.data()));
    std::fill_n(out.data(), out.total(), 0.0);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        double *J = out.data() + k * QUANTITIES * columns;
        const Derivatives own(matrix(attitude.data() + 9 * k), vector(velocity.data() + 3 * k), mount, by_lever);
        for (int quantity = 0; quantity < QUANTITIES; ++quantity)
            own.of(quantity, [&](int column, double by) { J[quantity * columns + column] = by; });
    }
    Py_RETURN_NONE;
}

// quantity_variances(R (n, 3, 3), v (n, 3), mount (5), lever_arm (3), of_keyframes (n, K, d), of_shared (d - K, d - K),
// variance (n, 8), with_point (n, 3)): the variances of the quantities at keyframes, and the covariance of the speed with
// the point that follows the track, from the covariances of a keyframe's tangent with itself and the shared variables, and
// that of these.
PyObject *quantity_variances(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    if (!PyArg_ParseTuple(arguments, "OOOOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5], &py[6], &py[7]))
        return nullptr;
    const Doubles attitude(py[0], 3), velocity(py[1], 2), mounting(py[2], 1), lever(py[3], 1), blocks(py[4], 3),
        of_shared(py[5], 2), variance(py[6], 2, true), with_point(py[7], 2, true);
    for (const Doubles *one : {&attitude, &velocity, &mounting, &lever, &blocks, &of_shared, &variance, &with_point})
        if (!one->ok()) return nullptr;
    const std::ptrdiff_t n = variance.size(0), shared = of_shared.size(0), columns = KEYFRAME + shared;
    if (attitude.size(0) != n || attitude.size(1) != 3 || attitude.size(2) != 3 || velocity.size(0) != n ||
        velocity.size(1) != 3 || mounting.size(0) != MOUNT || lever.size(0) != 3)
        return refused("states");
    if (shared < SHARED || of_shared.size(1) != shared || blocks.size(0) != n || blocks.size(1) != KEYFRAME ||
        blocks.size(2) != columns)
        return refused("covariances");
    if (variance.size(1) != QUANTITIES || with_point.size(0) != n || with_point.size(1) != 3) return refused("results");
    const Mounting mount(mounting.data());
    const Matrix by_lever = skew(vector(lever.data()));
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        const double *block = blocks.data() + k * KEYFRAME * columns;
        const auto between = [&](int i, int j) {
            if (i < KEYFRAME) return block[i * columns + j];
            return j < KEYFRAME ? block[j * columns + i] : of_shared.data()[(i - KEYFRAME) * shared + j - KEYFRAME];
        };
        const Derivatives own(matrix(attitude.data() + 9 * k), vector(velocity.data() + 3 * k), mount, by_lever);
        for (int quantity = 0; quantity < QUANTITIES; ++quantity) {
            double sum = 0.0;
            own.of(quantity, [&](int i, double by) {
                own.of(quantity, [&](int j, double by_other) { sum += by * by_other * between(i, j); });
            });
            variance.data()[QUANTITIES * k + quantity] = sum;
        }
        for (int axis = 0; axis < 3; ++axis) {
            double sum = 0.0;
            own.of(SPEED, [&](int i, double by) { sum += by * between(i, KEYFRAME + POINT + axis); });
            with_point.data()[3 * k + axis] = sum;
        }
    }
    Py_RETURN_NONE;
}

// trajectory_rows(motion, keyframes, mount (5), lever_arm (3), direction, of_point (3, 3), keyframe (m), out (m, 16)): the
// quantities of rows of motion, each with its sigma. Of the motion: R (m, 3, 3), p, v and the body rate (m, 3), distance,
// fraction and the time that the rate is a mean of (m). Of the keyframes: times (n), densities of the accelerometer's and
// the gyro's noise between them (n - 1, 3), variances of the quantities (n, 8) and covariance of the speed with the point
// that follows the track (n, 3), whose own is `of_point`.
PyObject *trajectory_rows(PyObject *, PyObject *arguments) {
    PyObject *py[7];
    double direction;
    if (!PyArg_ParseTuple(arguments, "OOOOdOOO", &py[0], &py[1], &py[2], &py[3], &direction, &py[4], &py[5], &py[6]))
        return nullptr;
    const Arrays motion(py[0]), keyframes(py[1]);
    if (!motion.ok() || !keyframes.ok()) return nullptr;
    const Doubles mounting(py[2], 1), lever(py[3], 1), of_point(py[4], 2);
    if (!mounting.ok() || !lever.ok() || !of_point.ok()) return nullptr;
    const Integers interval(py[5], 1);
    const Doubles out(py[6], 2, true);
    if (!interval.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t m = out.size(0);
    const std::ptrdiff_t widths[] = {9, 3, 3, 3, 1, 1, 1};
    if (motion.count() != std::size(widths) || keyframes.count() != 5) return refused("rows");
    for (std::size_t i = 0; i < std::size(widths); ++i)
        if (!motion.has(i, m, widths[i])) return refused("rows");
    const std::ptrdiff_t n = keyframes.rows(0);
    if (!keyframes.has(0, n, 1) || n < 2 || !keyframes.has(1, n - 1, 3) || !keyframes.has(2, n - 1, 3) ||
        !keyframes.has(3, n, QUANTITIES) || !keyframes.has(4, n, 3))
        return refused("keyframes");
    if (mounting.size(0) != MOUNT || lever.size(0) != 3 || of_point.total() != 9 || interval.size(0) != m ||
        out.size(1) != 2 * QUANTITIES)
        return refused("results");
    for (std::ptrdiff_t i = 0; i < m; ++i)
        if (interval.data()[i] < 0 || interval.data()[i] > n - 2) return refused("intervals");
    const Mounting mount(mounting.data());
    const Vector arm = vector(lever.data()), from_track = arm - vector(mounting.data() + POINT), forward = mount.forward();
    const Vector by_rate = cross(from_track, forward);  // of the speed, by the body rate
    const Matrix point = matrix(of_point.data());
    for (std::ptrdiff_t i = 0; i < m; ++i) {
        const std::ptrdiff_t k = interval.data()[i];
        const Matrix R = matrix(motion.data(0) + 9 * i);
        const Vector p = vector(motion.data(1) + 3 * i) - R * arm, rate = vector(motion.data(3) + 3 * i);
        const Vector on_track = transposed(R) * vector(motion.data(2) + 3 * i) - cross(rate, from_track);
        const Angles angles(R * mount.R);
        const double value[QUANTITIES] = {direction * motion.data(4)[i], p[0], p[1], p[2], dot(on_track, forward),
                                          angles.roll, angles.pitch, angles.yaw};
        const double h = motion.data(5)[i], rest = 1.0 - h, span = keyframes.data(0)[k + 1] - keyframes.data(0)[k];
        const double bridge = span * h * rest, *before = keyframes.data(3) + QUANTITIES * k, *after = before + QUANTITIES;
        const double swing = bridge * bridge * (rest * rest * before[SPEED] + h * h * after[SPEED]);
        double accel = 0.0, by_gyro = 0.0, variance[QUANTITIES], gyro[3];
        for (int axis = 0; axis < 3; ++axis) {
            const double felt = keyframes.data(1)[3 * k + axis], turned = keyframes.data(2)[3 * k + axis];
            accel += felt * felt / 3.0, gyro[axis] = turned * turned;
            by_gyro += gyro[axis] * by_rate[axis] * by_rate[axis];
        }
        for (int j = 0; j < QUANTITIES; ++j) variance[j] = before[j] * rest + after[j] * h;
        for (int j = 0; j < SPEED; ++j) variance[j] += accel * bridge * bridge * bridge / 3.0 + swing;
        const Vector swung = cross(forward, rate);
        const double *with_speed = keyframes.data(4) + 3 * k;
        variance[SPEED] += accel * bridge + by_gyro / motion.data(6)[i] + dot(swung, point * swung) +
                           2.0 * dot(rest * vector(with_speed) + h * vector(with_speed + 3), swung);
        for (int axis = 0; axis < 3; ++axis) variance[ATTITUDE + axis] += gyro[axis] * bridge;
        for (int j = 0; j < QUANTITIES; ++j) {
            out.data()[2 * (QUANTITIES * i + j)] = value[j];
            out.data()[2 * (QUANTITIES * i + j) + 1] = std::sqrt(variance[j]);
        }
    }
    Py_RETURN_NONE;
}
