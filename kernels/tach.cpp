// What a wheel rolls over an interval of a stream: the numbers of trackfg.graph.odometry and trackfg.sensors.tach.
#include <algorithm>
#include <cmath>

#include "states.h"

namespace {

constexpr int FORCED = 2;  // where creep in traction and braking begins in a response

// In the order in which tach_interval.py writes them.
struct Interval {
    double t[2], moved, turned, force, speed, creep, creep_per_traction, rolled_at_rest, any_distance, level, quantum;
};
constexpr std::ptrdiff_t INTERVAL = sizeof(Interval) / sizeof(double);

// Whether a time is outside of all spans (s, 2), or at an end of one.
bool is_outside(double time, const Doubles &spans) {
    for (std::ptrdiff_t i = 0; i < spans.size(0); ++i)
        if (time > spans.data()[2 * i] && time < spans.data()[2 * i + 1]) return false;
    return true;
}

// The distance at a time, from rows at times t (n): constant before the first and after the last.
double distance_at(double time, const Doubles &t, const Doubles &distance) {
    const double *times = t.data(), *d = distance.data();
    const std::ptrdiff_t n = t.size(0), next = std::upper_bound(times, times + n, time) - times;
    if (next == 0) return d[0];
    if (next == n) return d[n - 1];
    return d[next - 1] + (d[next] - d[next - 1]) / (times[next] - times[next - 1]) * (time - times[next - 1]);
}

}  // namespace

// tach_interval(t (n), distance (n), gaps (g, 2), uncounted (u, 2), interval, out (8)): `interval` as above: the times of
// both keyframes, how far the vehicle moved and turned between them, the mean forward force in g, the speed at the end, the
// creep per root of the distance and per force, the distance that is added at rest, the sigma of any distance, what sigmas
// are multiplied by, and the distance of a count. Writes the counts at both keyframes, the sigma of the distance that is rolled, and its response
// (5). Returns whether the count at the second one is a reading of its own.
PyObject *tach_interval(PyObject *, PyObject *arguments) {
    PyObject *py[6];
    if (!PyArg_ParseTuple(arguments, "OOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5])) return nullptr;
    const Doubles t(py[0], 1), distance(py[1], 1), gaps(py[2], 2), uncounted(py[3], 2), numbers(py[4], 1), out(py[5], 1, true);
    for (const Doubles *one : {&t, &distance, &gaps, &uncounted, &numbers, &out})
        if (!one->ok()) return nullptr;
    const std::ptrdiff_t n = t.size(0);
    if (n < 1 || distance.size(0) != n || gaps.size(1) != 2 || uncounted.size(1) != 2) return refused("a wheel");
    if (numbers.size(0) != INTERVAL || out.size(0) != 3 + WHEEL) return refused("an interval");
    const Interval &own = *reinterpret_cast<const Interval *>(numbers.data());
    double *counts = out.data(), &sigma = out.data()[2], *response = out.data() + 3;
    bool covered[2], counted = true;
    for (int k = 0; k < 2; ++k) {
        counts[k] = distance_at(own.t[k], t, distance);
        covered[k] = own.t[k] >= t.data()[0] && own.t[k] <= t.data()[n - 1] && is_outside(own.t[k], gaps) &&
                     is_outside(own.t[k], uncounted);
    }
    for (std::ptrdiff_t i = 0; i < uncounted.size(0); ++i)
        counted &= own.t[1] <= uncounted.data()[2 * i] || own.t[0] >= uncounted.data()[2 * i + 1];
    const double length = std::abs(own.moved), way = own.moved > 0.0 ? 1.0 : own.moved < 0.0 ? -1.0 : 0.0;
    const double along = way * own.force, forced = own.creep_per_traction * std::abs(length * own.force);
    const double variance = own.creep * own.creep * (length + own.rolled_at_rest) + forced * forced / (own.t[1] - own.t[0]);
    sigma = (counted ? std::sqrt(variance) : own.any_distance) * own.level;
    response[0] = -own.turned, response[1] = way * std::abs(own.turned);
    response[FORCED] = own.moved * std::max(along, 0.0), response[FORCED + 1] = own.moved * std::min(along, 0.0);
    response[FORCED + 2] = 0.0;  // a count has no offset in motion
    const auto step = [&](double count) { return std::floor(count / std::max(own.quantum, 1e-9) + 0.5); };
    return PyBool_FromLong(covered[1] && (!covered[0] || step(counts[1]) != step(counts[0])));
}
