// Vectors and matrices of three dimensions, and rotations.
#pragma once

#include <cmath>

struct Vector {
    double x[3];
    double &operator[](int i) { return x[i]; }
    double operator[](int i) const { return x[i]; }
};

struct Matrix {
    double x[3][3];
    double *operator[](int i) { return x[i]; }
    const double *operator[](int i) const { return x[i]; }
};

inline Vector vector(const double *from) { return {{from[0], from[1], from[2]}}; }

inline Matrix matrix(const double *from) {
    return {{{from[0], from[1], from[2]}, {from[3], from[4], from[5]}, {from[6], from[7], from[8]}}};
}

inline Vector operator+(const Vector &a, const Vector &b) { return {{a[0] + b[0], a[1] + b[1], a[2] + b[2]}}; }
inline Vector operator-(const Vector &a, const Vector &b) { return {{a[0] - b[0], a[1] - b[1], a[2] - b[2]}}; }
inline Vector operator*(double s, const Vector &a) { return {{s * a[0], s * a[1], s * a[2]}}; }
inline double dot(const Vector &a, const Vector &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

inline Vector cross(const Vector &a, const Vector &b) {
    return {{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]}};
}

inline Matrix skew(const Vector &a) { return {{{0, -a[2], a[1]}, {a[2], 0, -a[0]}, {-a[1], a[0], 0}}}; }

inline Matrix transposed(const Matrix &a) {
    return {{{a[0][0], a[1][0], a[2][0]}, {a[0][1], a[1][1], a[2][1]}, {a[0][2], a[1][2], a[2][2]}}};
}

inline Vector operator*(const Matrix &a, const Vector &b) {
    return {{dot(vector(a[0]), b), dot(vector(a[1]), b), dot(vector(a[2]), b)}};
}

inline Matrix operator*(const Matrix &a, const Matrix &b) {
    Matrix out;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
    return out;
}

inline Matrix operator*(double s, const Matrix &a) {
    Matrix out;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) out[i][j] = s * a[i][j];
    return out;
}

inline Matrix operator+(const Matrix &a, const Matrix &b) {
    Matrix out;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) out[i][j] = a[i][j] + b[i][j];
    return out;
}

inline Vector column(const Matrix &a, int j) { return {{a[0][j], a[1][j], a[2][j]}}; }

const Matrix IDENTITY = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

// Coefficients of the exponential map of a rotation vector t and of its right Jacobian, with W = [t]x:
// Exp = I + a W + b W^2, J = I - b W + c W^2, J^-1 = I + W / 2 + d W^2; b_by and c_by are derivatives: grad b = b_by t.
struct Rotation {
    Vector t;
    Matrix W, WW;
    double a, b, c, d, b_by, c_by;

    explicit Rotation(const Vector &vector) : t(vector), W(skew(vector)), WW(W * W) {
        const double q = dot(t, t);
        if (q < 0.04) {  // power series: what is left out is below the rounding of doubles
            a = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110))));
            b = 0.5 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90))));
            c = (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))) / 6;
            d = (1 + q / 60 * (1 + q / 42 * (1 + q / 40 * (1 + q / 39.6)))) / 12;
            b_by = -(1 - q / 15 * (1 - q * 3 / 112 * (1 - q * 2 / 135))) / 12;
            c_by = -(1 - q / 21 * (1 - q / 48 * (1 - q * 2 / 165))) / 60;
        } else {
            const double angle = std::sqrt(q), half = std::sin(0.5 * angle);
            a = std::sin(angle) / angle;
            b = 2 * half * half / q;
            c = (1 - a) / q;
            d = (1 - a / (2 * b)) / q;
            b_by = (a - 2 * b) / q;
            c_by = (b - 3 * c) / q;
        }
    }
    Matrix exponential() const { return IDENTITY + a * W + b * WW; }
    Matrix jacobian() const { return IDENTITY + (-b) * W + c * WW; }
    Matrix inverse_jacobian() const { return IDENTITY + 0.5 * W + d * WW; }

    // Derivative of J(t) u by t.
    Matrix jacobian_times_by(const Vector &u) const {
        const Vector once = cross(t, u), twice = cross(t, once);
        const double along = dot(t, u);
        const Matrix by_skew = skew(u);
        Matrix out;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                out[i][j] = b * by_skew[i][j] - b_by * once[i] * t[j] + c_by * twice[i] * t[j] +
                            c * ((i == j ? along : 0.0) + t[i] * u[j] - 2 * u[i] * t[j]);
        return out;
    }
};

inline Vector logarithm(const Matrix &R) {
    const Vector axis = {{R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]}};  // 2 sin(angle) n
    const double twice_sine = std::sqrt(dot(axis, axis)), twice_cosine = R[0][0] + R[1][1] + R[2][2] - 1;
    if (twice_cosine > -1.9) {
        const double angle = std::atan2(twice_sine, twice_cosine);
        return (twice_sine < 1e-5 ? 0.5 + angle * angle / 12 : angle / twice_sine) * axis;
    }
    // Near half a turn R + R' = 2 cos I + 2 (1 - cos) n n' has the axis, and the skew part its sign.
    const double angle = std::atan2(twice_sine, twice_cosine);
    int k = 0;
    for (int i = 1; i < 3; ++i) k = R[i][i] > R[k][k] ? i : k;
    Vector n = {{R[0][k] + R[k][0], R[1][k] + R[k][1], R[2][k] + R[k][2]}};
    n[k] -= twice_cosine;
    const double sign = dot(n, axis) < 0 ? -1.0 : 1.0;
    return (sign * angle / std::sqrt(dot(n, n))) * n;
}
