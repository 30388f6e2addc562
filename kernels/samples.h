// Inertial samples, and what more than one kernel computes from them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "arrays.h"
#include "rotations.h"

constexpr std::ptrdiff_t NOISE_LIMITS = 11, SHORTEST_BLOCK = 16;  // a block has two values of a spectrum in the lowest band

// Sample i is over the time from edges[i] to edges[i + 1], s.
struct Samples {
    const double *edges, *gyro, *accel;
    const std::uint8_t *bridged;
    std::ptrdiff_t count;
};

// Where the numbers of an increment, or of a turn over an interval, go.
struct Increment {
    double *duration, *rotation, *velocity;
};
struct Turned {
    double *turn, *mean, *mean_by_time;
};

// The increment of the samples from `begin` to `end`, and the attitude along these: turning.cpp.
void compress_group(const Samples &samples, std::ptrdiff_t begin, std::ptrdiff_t end, const Vector &bias,
                    const Increment &increment);
void follow_turn(const Samples &samples, std::ptrdiff_t begin, std::ptrdiff_t end, const Vector &bias,
                 const double *distance, double at_rest, const Turned &turning);
// How far a turn (3, 3) with its means is ahead of a steady one, (3): ahead_of_a_steady_turn() in turning.cpp.
void ahead_of_steady(const double *turn, const double *mean, const double *mean_by_time, double least, double *ahead);
// The mean (3) of values (n, 3) between edges t (n + 1) over `width` around a time.
void mean_around(double time, double width, const double *t, const double *values, std::ptrdiff_t n, double *mean);

// What is taken for white noise: densities squared that are declared, (6), how clearly they must be exceeded, what is
// added to those seen, (6), and the Limits of noise.cpp.
struct NoiseRule {
    const double *declared, *excess, *limits;
    double clearly;
};
// Densities squared (m, 6) between times (m + 1) as all samples show them in blocks of `length`, 0 if they are too few:
// noise.cpp.
void noise_between(const Samples &samples, std::ptrdiff_t length, double dt, const NoiseRule &rule, const double *times,
                   std::ptrdiff_t m, double *variance);

// The preintegrated measurement of m increments, (DELTA_SIZE), and the state (15) that it predicts: inertial.cpp. False
// where its covariance is not positive definite.
bool preintegrated(const double *frame, const double *bias, const double *noise, std::ptrdiff_t m, const Increment &first,
                   double *delta);
PyObject *not_positive_definite();  // raises that as ValueError
void predicted_state(const double *delta, const double *R, const double *p, const double *v, const double *bias, double *end);
