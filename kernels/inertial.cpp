// Preintegration of inertial increments and the factor on two navigation states, as GTSAM computes them.
//
// GTSAM 4.3: `TangentPreintegration` (Forster et al., "On-manifold preintegration for real-time visual-inertial
// odometry", IEEE Trans. Robotics 33 (2017), in the tangent space of the state at the start), the exact transition in a
// frame that turns (Brossard, Barrau and Bonnabel, "Associating uncertainty to extended poses for on Lie group IMU
// preintegration with rotating Earth", IEEE Trans. Robotics 38 (2022); borglab/gtsam#2688), and the covariance in the
// coordinates of the residual (#2719, #2806). Tangents of a navigation state are (rotation, position, velocity), all in
// its body axes.
#include <cmath>
#include <utility>

#include "arrays.h"
#include "factors.h"
#include "rotations.h"
#include "samples.h"

namespace {

using State = NavState;

// How states go on by themselves over h seconds in a frame that turns at the rate w and falls: with the velocity against
// a frame at rest, u = v + w x p, they are p' = turn (p + h u) + fall_p, u' = turn u + fall_u, R' = turn R.
struct Frame {
    double rate[3], turn[3][3], fall_p[3], fall_u[3];

    void over(double h, double gravity) {
        const Vector down = {{0.0, 0.0, -gravity}};
        const Rotation back((-h) * vector(rate));
        const double q = dot(back.t, back.t), angle = std::sqrt(q);
        // The integral of s Exp(-w h s) over s from 0 to 1 is I / 2 + first W + second W^2.
        double first = 1.0 / 3 - q / 30 * (1 - q / 28 * (1 - q / 54)), second = (1 - q / 18 * (1 - q / 40)) / 8;
        if (q >= 0.04) {
            first = (std::sin(angle) / angle - std::cos(angle)) / q;
            second = (0.5 - (angle * std::sin(angle) + std::cos(angle) - 1) / q) / q;
        }
        const Matrix whole = back.exponential();
        std::memcpy(turn, whole.x, sizeof turn);
        const Vector u = h * ((IDENTITY + back.b * back.W + back.c * back.WW) * down);
        const Vector p = (h * h) * ((0.5 * IDENTITY + first * back.W + second * back.WW) * down);
        for (int i = 0; i < 3; ++i) fall_u[i] = u[i], fall_p[i] = p[i];
    }
};

// What is known of an interval: the preintegrated measurement about a bias, and its frame.
struct Delta {
    double bias[6], duration, tangent[9], by_bias[9][6], root[9][9];  // root'root is the covariance's inverse, upper
    Frame frame;
};
constexpr std::ptrdiff_t SIZE = sizeof(Delta) / sizeof(double);

struct Moments {
    Vector rotation{}, position{}, velocity{};
    double by_bias[9][6] = {}, P[9][9] = {};

    // Multiply the rows of M (9, columns) by the transition of one increment: [T 0 0; h/2 V, I, h I; V, 0, I].
    template <int columns>
    static void transit(double (&M)[9][columns], const Matrix &T, const Matrix &V, double h) {
        for (int j = 0; j < columns; ++j) {
            const Vector turn = {{M[0][j], M[1][j], M[2][j]}}, turned = T * turn, pushed = V * turn;
            for (int i = 0; i < 3; ++i) {
                M[i][j] = turned[i];
                M[3 + i][j] += h * (M[6 + i][j] + 0.5 * pushed[i]);
                M[6 + i][j] += pushed[i];
            }
        }
    }

    // One increment over h seconds with rate w and specific force f, noise variances of gyro, accelerometer, position.
    void add(double h, const Vector &w, const Vector &f, const double *noise) {
        const Rotation turn(rotation);
        const Matrix R = turn.exponential(), inverse = turn.inverse_jacobian();
        const Vector rate = inverse * w, force = R * f;
        const Matrix rate_by = (-1.0) * (inverse * turn.jacobian_times_by(rate));
        const Matrix T = IDENTITY + h * rate_by, V = (-h) * (R * (skew(f) * turn.jacobian()));
        transit(by_bias, T, V, h);
        transit(P, T, V, h);
        for (int i = 0; i < 9; ++i)
            for (int j = 0; j < i; ++j) std::swap(P[i][j], P[j][i]);
        transit(P, T, V, h);
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                by_bias[3 + i][j] -= 0.5 * h * h * R[i][j];
                by_bias[6 + i][j] -= h * R[i][j];
                by_bias[i][3 + j] -= h * inverse[i][j];
                double turned = 0, pushed = 0;
                for (int k = 0; k < 3; ++k) {
                    turned += inverse[i][k] * noise[k] * inverse[j][k];
                    pushed += R[i][k] * noise[3 + k] * R[j][k];
                }
                P[i][j] += h * turned;
                P[3 + i][3 + j] += 0.25 * h * h * h * pushed;
                P[3 + i][6 + j] += 0.5 * h * h * pushed;
                P[6 + i][3 + j] += 0.5 * h * h * pushed;
                P[6 + i][6 + j] += h * pushed;
            }
            P[3 + i][3 + i] += h * noise[6];
        }
        position = position + h * velocity + (0.5 * h * h) * force;
        velocity = velocity + h * force;
        rotation = rotation + h * rate;
    }

    // Turn the covariance into that of the residual, which is in the tangent of the state at the end, in a frame that
    // turns at `rate`.
    void to_residual(const Vector &rate) {
        const Rotation turn(rotation);
        const Matrix back = transposed(turn.exponential()), J = turn.jacobian();
        const Matrix moved = back * (skew(rate) * transposed(back));
        for (int times = 0; times < 2; ++times) {
            for (int j = 0; j < 9; ++j) {
                const Vector t = J * Vector{{P[0][j], P[1][j], P[2][j]}}, p = back * Vector{{P[3][j], P[4][j], P[5][j]}};
                const Vector v = back * Vector{{P[6][j], P[7][j], P[8][j]}} - moved * p;
                for (int i = 0; i < 3; ++i) P[i][j] = t[i], P[3 + i][j] = p[i], P[6 + i][j] = v[i];
            }
            for (int i = 0; i < 9; ++i)
                for (int j = 0; j < i; ++j) std::swap(P[i][j], P[j][i]);
        }
    }

    // Write the upper triangle whose root'root is P^-1: P = U U' with U upper, root = U^-1. False where P is singular.
    bool write_root(double (&root)[9][9]) {
        // GTSAM takes a covariance for diagonal where no other entry is above 1e-9 (`Gaussian::Covariance`).
        bool diagonal = true;
        for (int i = 0; i < 9; ++i)
            for (int j = 0; j < 9; ++j) diagonal = diagonal && (i == j || std::abs(P[i][j]) <= 1e-9);
        for (int i = 0; diagonal && i < 9; ++i)
            for (int j = 0; j < 9; ++j) P[i][j] = i == j ? P[i][j] : 0.0;
        double U[9][9] = {};
        for (int j = 8; j >= 0; --j)
            for (int i = j; i >= 0; --i) {
                double left = P[i][j];
                for (int k = j + 1; k < 9; ++k) left -= U[i][k] * U[j][k];
                if (i == j && !(left > 0)) return false;
                U[i][j] = i == j ? std::sqrt(left) : left / U[j][j];
            }
        for (int j = 0; j < 9; ++j)
            for (int i = 8; i >= 0; --i) {
                double left = i == j ? 1.0 : 0.0;
                for (int k = i + 1; k <= j; ++k) left -= U[i][k] * root[k][j];
                root[i][j] = i > j ? 0.0 : left / U[i][i];
            }
        return true;
    }
};

// The predicted state at the end, and the parts that derivatives need.
struct Prediction {
    double tangent[9];  // the preintegrated measurement, corrected for the bias
    Matrix turned;      // the attitude at the start, as the frame's turning leaves it
    State end;

    Prediction(const Delta &delta, const State &start, const double *bias) {
        for (int i = 0; i < 9; ++i) {
            tangent[i] = delta.tangent[i];
            for (int j = 0; j < 6; ++j) tangent[i] += delta.by_bias[i][j] * (bias[j] - delta.bias[j]);
        }
        const Matrix turn = matrix(delta.frame.turn[0]);
        const Vector rate = vector(delta.frame.rate), u = start.v + cross(rate, start.p);
        turned = turn * start.R;
        end.R = turned * Rotation(vector(tangent)).exponential();
        end.p = turn * (start.p + delta.duration * u) + vector(delta.frame.fall_p) + turned * vector(tangent + 3);
        end.v = turn * u + vector(delta.frame.fall_u) + turned * vector(tangent + 6) - cross(rate, end.p);
    }
};

// Write r, the logarithm in SE_2(3) of the predicted state seen from that at the end, whitened, to b as -root r; and its
// derivatives by the tangents of both states and by the bias, whitened, to rows of `columns`.
void factor(const Delta &delta, const State &start, const State &end, const double *bias, double *out, int columns) {
    const Prediction predicted(delta, start, bias);
    const Matrix to_end = transposed(end.R);
    const Vector e_R = logarithm(to_end * predicted.end.R), way = to_end * (predicted.end.p - end.p);
    const Vector faster = to_end * (predicted.end.v - end.v);
    const Rotation back(-1.0 * e_R);
    const Matrix D = back.inverse_jacobian();  // the inverse of the left Jacobian at e_R
    const Vector e_p = D * way, e_v = D * faster;
    double r[9], J[9][24] = {};
    for (int i = 0; i < 3; ++i) r[i] = e_R[i], r[3 + i] = e_p[i], r[6 + i] = e_v[i];

    if (columns > 1) {
        const double h = delta.duration;
        const Rotation turn(vector(predicted.tangent));
        const Matrix across = to_end * predicted.turned;
        const Matrix rate = to_end * (skew(vector(delta.frame.rate)) * end.R);  // [w]x in the axes of the end
        // Derivatives of the predicted rotation in its own axes, and of p and v in those of the end, first that of
        // u = v + w x p: by the tangents of the start and of the end, and by the bias.
        double R[3][24] = {}, p[3][24] = {}, v[3][24] = {};
        const Matrix R_R = transposed(turn.exponential()), by_turn = turn.jacobian();
        const Matrix p_R = (-1.0) * (across * skew(vector(predicted.tangent + 3)));
        const Matrix u_R = (-1.0) * (across * skew(vector(predicted.tangent + 6)));
        const Matrix u_p = rate * across;  // the frame's turning and [w]x commute
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                R[i][j] = R_R[i][j], p[i][j] = p_R[i][j], v[i][j] = u_R[i][j];
                p[i][3 + j] = across[i][j] + h * u_p[i][j], v[i][3 + j] = u_p[i][j];
                p[i][6 + j] = h * across[i][j], v[i][6 + j] = across[i][j];
            }
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 6; ++j)
                for (int k = 0; k < 3; ++k) {
                    R[i][18 + j] += by_turn[i][k] * delta.by_bias[k][j];
                    p[i][18 + j] += across[i][k] * delta.by_bias[3 + k][j];
                    v[i][18 + j] += across[i][k] * delta.by_bias[6 + k][j];
                }
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 24; ++j)
                for (int k = 0; k < 3; ++k) v[i][j] -= rate[i][k] * p[k][j];
        const Matrix of_way = skew(way), of_faster = skew(faster);
        for (int i = 0; i < 3; ++i) {
            p[i][12 + i] = v[i][15 + i] = -1.0;
            for (int j = 0; j < 3; ++j) p[i][9 + j] = of_way[i][j], v[i][9 + j] = of_faster[i][j];
        }
        const Matrix p_of_e = D * back.jacobian_times_by(e_p), v_of_e = D * back.jacobian_times_by(e_v);
        for (int j = 0; j < 24; ++j) {
            Vector e = transposed(D) * Vector{{R[0][j], R[1][j], R[2][j]}};
            if (j >= 9 && j < 12) e = {{-D[0][j - 9], -D[1][j - 9], -D[2][j - 9]}};
            const Vector of_p = D * Vector{{p[0][j], p[1][j], p[2][j]}} + p_of_e * e;
            const Vector of_v = D * Vector{{v[0][j], v[1][j], v[2][j]}} + v_of_e * e;
            for (int i = 0; i < 3; ++i) J[i][j] = e[i], J[3 + i][j] = of_p[i], J[6 + i][j] = of_v[i];
        }
    }
    for (int i = 0; i < 9; ++i) {
        double *row = out + i * columns;
        for (int j = 0; j < columns; ++j) row[j] = 0.0;
        for (int k = i; k < 9; ++k) {
            for (int j = 0; j + 1 < columns; ++j) row[j] += delta.root[i][k] * J[k][j];
            row[columns - 1] -= delta.root[i][k] * r[k];
        }
    }
}

}  // namespace

bool preintegrated(const double *frame, const double *bias, const double *noise, std::ptrdiff_t m, const Increment &first,
                   double *out) {
    Delta &delta = *reinterpret_cast<Delta *>(out);
    std::memcpy(delta.frame.rate, frame + 1, sizeof delta.frame.rate);
    std::memcpy(delta.bias, bias, sizeof delta.bias);
    delta.duration = 0.0;
    Moments moments;
    const Vector of_accelerometer = vector(bias), of_gyro = vector(bias + 3);
    for (std::ptrdiff_t k = 0; k < m; ++k) {
        const double h = first.duration[k];
        moments.add(h, (1 / h) * vector(first.rotation + 3 * k) - of_gyro,
                    (1 / h) * vector(first.velocity + 3 * k) - of_accelerometer, noise);
        delta.duration += h;
    }
    delta.frame.over(delta.duration, frame[0]);
    for (int i = 0; i < 3; ++i) {
        delta.tangent[i] = moments.rotation[i];
        delta.tangent[3 + i] = moments.position[i];
        delta.tangent[6 + i] = moments.velocity[i];
    }
    std::memcpy(delta.by_bias, moments.by_bias, sizeof delta.by_bias);
    moments.to_residual(vector(delta.frame.rate));
    return moments.write_root(delta.root);
}

void predicted_state(const double *delta, const double *R, const double *p, const double *v, const double *bias, double *end) {
    const Prediction predicted(*reinterpret_cast<const Delta *>(delta), {matrix(R), vector(p), vector(v)}, bias);
    std::memcpy(end, predicted.end.R.x, sizeof predicted.end.R.x);
    std::memcpy(end + 9, predicted.end.p.x, sizeof predicted.end.p.x);
    std::memcpy(end + 12, predicted.end.v.x, sizeof predicted.end.v.x);
}

void inertial_factor(const double *delta, const NavState &start, const NavState &end, const double *bias, double *out,
                     int columns) {
    factor(*reinterpret_cast<const Delta *>(delta), start, end, bias, out, columns);
}

PyObject *not_positive_definite() {
    PyErr_SetString(PyExc_ValueError, "the covariance of a preintegrated measurement is not positive definite");
    return nullptr;
}

// preintegrate(frame, bias, noise, duration, rotation, velocity, delta): over the increments of an interval, as
// trackfg.factors.imu.Preintegration has them. frame (4,): gravity and the frame's rate; noise (7,): densities of gyro,
// accelerometer and position, squared; delta (SIZE,) takes the result.
PyObject *preintegrate(PyObject *, PyObject *arguments) {
    PyObject *py[7];
    if (!PyArg_ParseTuple(arguments, "OOOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5], &py[6])) return nullptr;
    const Doubles frame(py[0], 1), bias(py[1], 1), noise(py[2], 1), duration(py[3], 1), rotation(py[4], 2),
        velocity(py[5], 2), out(py[6], 1, true);
    if (!frame.ok() || !bias.ok() || !noise.ok() || !duration.ok() || !rotation.ok() || !velocity.ok() || !out.ok())
        return nullptr;
    const std::ptrdiff_t m = duration.size(0);
    if (frame.size(0) != 4 || bias.size(0) != 6 || noise.size(0) != 7 || out.size(0) != SIZE ||
        rotation.size(0) != m || velocity.size(0) != m || rotation.size(1) != 3 || velocity.size(1) != 3)
        return refused("increments");
    if (!preintegrated(frame.data(), bias.data(), noise.data(), m, {duration.data(), rotation.data(), velocity.data()},
                       out.data()))
        return not_positive_definite();
    Py_RETURN_NONE;
}

// inertial_factors(deltas, R, p, v, bias, rows): the factors of n intervals in a row on n + 1 states R (n + 1, 3, 3), p
// and v (n + 1, 3), with bias (n + 1, 6): rows (n, 9, 25) take [A b], or (n, 9, 1) b alone.
PyObject *inertial_factors(PyObject *, PyObject *arguments) {
    PyObject *py[6];
    if (!PyArg_ParseTuple(arguments, "OOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5])) return nullptr;
    const Doubles deltas(py[0], 2), R(py[1], 3), p(py[2], 2), v(py[3], 2), bias(py[4], 2), rows(py[5], 3, true);
    if (!deltas.ok() || !R.ok() || !p.ok() || !v.ok() || !bias.ok() || !rows.ok()) return nullptr;
    const std::ptrdiff_t n = deltas.size(0), columns = rows.size(2);
    if (deltas.size(1) != SIZE || R.total() != 9 * (n + 1) || p.total() != 3 * (n + 1) || v.total() != 3 * (n + 1) ||
        bias.total() != 6 * (n + 1) || rows.size(0) != n || rows.size(1) != 9 || (columns != 25 && columns != 1))
        return refused("inertial factors");
    Py_BEGIN_ALLOW_THREADS;
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        const State start = {matrix(R.data() + 9 * k), vector(p.data() + 3 * k), vector(v.data() + 3 * k)};
        const State end = {matrix(R.data() + 9 * k + 9), vector(p.data() + 3 * k + 3), vector(v.data() + 3 * k + 3)};
        factor(*reinterpret_cast<const Delta *>(deltas.data() + SIZE * k), start, end, bias.data() + 6 * k,
               rows.data() + 9 * columns * k, static_cast<int>(columns));
    }
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// predict(delta, R, p, v, bias, end): the state after the interval, end (15,): R row by row, p, v.
PyObject *predict(PyObject *, PyObject *arguments) {
    PyObject *py[6];
    if (!PyArg_ParseTuple(arguments, "OOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5])) return nullptr;
    const Doubles delta(py[0], 1), R(py[1], 2), p(py[2], 1), v(py[3], 1), bias(py[4], 1), end(py[5], 1, true);
    if (!delta.ok() || !R.ok() || !p.ok() || !v.ok() || !bias.ok() || !end.ok()) return nullptr;
    if (delta.size(0) != SIZE || R.total() != 9 || p.size(0) != 3 || v.size(0) != 3 || bias.size(0) != 6 ||
        end.size(0) != 15)
        return refused("a state");
    predicted_state(delta.data(), R.data(), p.data(), v.data(), bias.data(), end.data());
    Py_RETURN_NONE;
}

const std::ptrdiff_t DELTA_SIZE = SIZE;
