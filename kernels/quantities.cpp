// The derivatives of what a trajectory tells of a vehicle, by the states: trackfg.output.trajectory.
#include "states.h"

namespace {

constexpr int QUANTITIES = 8, CHAINAGE = 0, PLACE = 1, SPEED = 4, ATTITUDE = 5;
constexpr int AT_NAV = ODO + BIAS;  // in a tangent

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
    const Matrix to_travel = transposed(mount.R), by_lever = skew(vector(lever.data()));
    const Vector forward = mount.forward();
    const double cy = mount.R[1][1], sy = -mount.R[0][1];
    const Vector by_mount[2] = {to_travel * Vector{{-sy, cy, 0}}, to_travel * Vector{{0, 0, 1}}};
    std::fill_n(out.data(), out.total(), 0.0);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        double *J = out.data() + k * QUANTITIES * columns;
        const auto at = [&](int row, int column) -> double & { return J[row * columns + column]; };
        const Matrix R = matrix(attitude.data() + 9 * k), by_turn = R * by_lever;
        const Matrix rates = Angles(R * mount.R).euler_rates(), by_attitude = rates * to_travel;
        const Vector faster = cross(forward, transposed(R) * vector(velocity.data() + 3 * k));
        at(CHAINAGE, DISTANCE) = 1.0;
        for (int i = 0; i < 3; ++i) {
            at(SPEED, AT_NAV + i) = faster[i], at(SPEED, AT_NAV + 6 + i) = forward[i];
            for (int j = 0; j < 3; ++j) {
                at(PLACE + i, AT_NAV + j) = by_turn[i][j], at(PLACE + i, AT_NAV + 3 + j) = R[i][j];
                at(ATTITUDE + i, AT_NAV + j) = by_attitude[i][j];
            }
        }
        for (int angle = 0; angle < 2; ++angle) {
            const Vector own = rates * by_mount[angle];
            for (int i = 0; i < 3; ++i) at(ATTITUDE + i, KEYFRAME + angle) = own[i];
        }
    }
    Py_RETURN_NONE;
}
