// The white floor of inertial samples, what they hide and what shocks show: trackfg.sensors.imu_noise, in one pass.
//
// Spectra are those of blocks of 2^k samples: a fast Fourier transform of radix two (Cooley and Tukey, Mathematics of
// Computation 19 (1965)) of all six channels side by side, two real samples to a complex number.
#include <algorithm>
#include <cfloat>
#include <cmath>
#include <vector>

#include "arrays.h"
#include "median.h"
#include "samples.h"

namespace {

constexpr int CHANNELS = 6, AXES = 3, BANDS = 3, NEIGHBOURS = 5;
static_assert(SHORTEST_BLOCK == 2 << BANDS);
constexpr double FARTHEST = 1e100;

// In the order of _LIMITS in imu_noise.py, which says what they are.
struct Limits {
    double scatter, euler, same, longer, extremes, fine_steps, near_extreme, shock_spread, pause_s, shock_s, shock_limit;
};
static_assert(NOISE_LIMITS == sizeof(Limits) / sizeof(double));

// Spectra of blocks of one length.
class Spectrum {
  public:
    explicit Spectrum(std::ptrdiff_t length)
        : length_(length), half_(length / 2), window_(length), cosine_(half_), sine_(half_), reversed_(half_),
          real_(half_ * CHANNELS), imaginary_(half_ * CHANNELS) {
        for (std::ptrdiff_t i = 0; i < length; ++i) {
            const double angle = 2.0 * M_PI * static_cast<double>(i) / static_cast<double>(length);
            window_[i] = 0.5 - 0.5 * std::cos(angle);
            power_ += window_[i] * window_[i];
            if (i < half_) cosine_[i] = std::cos(angle), sine_[i] = -std::sin(angle);
        }
        for (std::ptrdiff_t i = 1, bits = half_ / 2; i < half_; ++i) {
            std::ptrdiff_t j = reversed_[i - 1], bit = bits;
            for (; j & bit; bit >>= 1) j ^= bit;
            reversed_[i] = j | bit;
        }
    }

    std::ptrdiff_t length() const { return length_; }
    double window_power() const { return power_; }

    // Write the mean log of the power in each band, (CHANNELS, BANDS), of the samples of a block, (length, CHANNELS).
    void mean_logs(const double *samples, double *out) {
        transform(samples);
        for (int band = 0; band < BANDS; ++band) {
            const std::ptrdiff_t begin = half_ >> (BANDS - band), end = 2 * begin;
            double sums[CHANNELS] = {};
            for (int c = 0; c < CHANNELS; ++c) {
                // A logarithm of many values' product, as long as that is far from the ends of the range.
                double product = 1.0;
                for (std::ptrdiff_t k = begin; k < end; ++k) {
                    const double power = std::max(power_at(k, c), DBL_MIN);
                    if (product * power > FARTHEST || product * power < 1.0 / FARTHEST)
                        sums[c] += std::log(product), product = 1.0;
                    product *= power;
                }
                sums[c] += std::log(product);
            }
            for (int c = 0; c < CHANNELS; ++c) out[c * BANDS + band] = sums[c] / static_cast<double>(end - begin);
        }
    }

  private:
    WITH_VECTOR_UNITS void transform(const double *samples) {
        double mean[CHANNELS] = {};
        for (std::ptrdiff_t i = 0; i < length_; ++i)
            for (int c = 0; c < CHANNELS; ++c) mean[c] += samples[i * CHANNELS + c];
        for (double &one : mean) one /= static_cast<double>(length_);
        for (std::ptrdiff_t i = 0; i < half_; ++i) {
            const double *even = samples + 2 * i * CHANNELS, *odd = even + CHANNELS;
            double *real = &real_[reversed_[i] * CHANNELS], *imaginary = &imaginary_[reversed_[i] * CHANNELS];
            for (int c = 0; c < CHANNELS; ++c) {
                real[c] = (even[c] - mean[c]) * window_[2 * i];
                imaginary[c] = (odd[c] - mean[c]) * window_[2 * i + 1];
            }
        }
        for (std::ptrdiff_t reach = 1; reach < half_; reach *= 2)
            for (std::ptrdiff_t begin = 0; begin < half_; begin += 2 * reach)
                for (std::ptrdiff_t k = 0; k < reach; ++k) {
                    const double c = cosine_[k * (half_ / reach)], s = sine_[k * (half_ / reach)];
                    double *a = &real_[(begin + k) * CHANNELS], *b = &imaginary_[(begin + k) * CHANNELS];
                    double *x = a + reach * CHANNELS, *y = b + reach * CHANNELS;
                    for (int i = 0; i < CHANNELS; ++i) {
                        const double turned_x = c * x[i] - s * y[i], turned_y = c * y[i] + s * x[i];
                        x[i] = a[i] - turned_x, y[i] = b[i] - turned_y;
                        a[i] += turned_x, b[i] += turned_y;
                    }
                }
    }

    // The squared magnitude of the spectrum at frequency k, 0 < k < half: even samples and odd ones put together.
    double power_at(std::ptrdiff_t k, int channel) const {
        const std::ptrdiff_t near = k * CHANNELS + channel, far = (half_ - k) * CHANNELS + channel;
        const double even_x = 0.5 * (real_[near] + real_[far]), even_y = 0.5 * (imaginary_[near] - imaginary_[far]);
        const double odd_x = 0.5 * (imaginary_[near] + imaginary_[far]), odd_y = 0.5 * (real_[far] - real_[near]);
        const double x = even_x + cosine_[k] * odd_x - sine_[k] * odd_y;
        const double y = even_y + cosine_[k] * odd_y + sine_[k] * odd_x;
        return x * x + y * y;
    }

    std::ptrdiff_t length_, half_;
    double power_ = 0.0;
    std::vector<double> window_, cosine_, sine_;
    std::vector<std::ptrdiff_t> reversed_;
    std::vector<double> real_, imaginary_;
};

// A record in blocks of `length` samples: block j begins at sample starts[j]; `dt` is its sampling interval, s.
class Record {
  public:
    Record(const Samples &samples, const std::int64_t *starts, std::ptrdiff_t blocks, std::ptrdiff_t length, double dt,
           const Limits &limits)
        : edges_(samples.edges), gyro_(samples.gyro), accel_(samples.accel), bridged_(samples.bridged), starts_(starts),
          count_(samples.count), blocks_(blocks), length_(length), dt_(dt), limits_(limits) {
        for (int c = 0; c < CHANNELS; ++c) {
            step_[c] = HUGE_VAL;
            for (std::ptrdiff_t i = 1; i < count_; ++i) {
                const double difference = std::abs(at(i, c) - at(i - 1, c));
                if (difference > limits_.same) step_[c] = std::min(step_[c], difference);
            }
            if (!std::isfinite(step_[c])) step_[c] = 0.0;
        }
    }

    // Densities squared of the floor, or of rounding where that is more, (blocks, CHANNELS).
    void floor(double *seen) const {
        thread_local Spectrum spectrum(length_);
        if (spectrum.length() != length_) spectrum = Spectrum(length_);
        std::vector<double> logs(blocks_ * CHANNELS * BANDS), block(length_ * CHANNELS);
        for (std::ptrdiff_t j = 0; j < blocks_; ++j) {
            for (std::ptrdiff_t i = 0; i < length_; ++i)
                for (int c = 0; c < CHANNELS; ++c) block[i * CHANNELS + c] = at(starts_[j] + i, c);
            spectrum.mean_logs(block.data(), &logs[j * CHANNELS * BANDS]);
        }
        double scatter[BANDS];
        for (int band = 0; band < BANDS; ++band)
            scatter[band] = limits_.scatter / std::sqrt(static_cast<double>((length_ / 2) >> (BANDS - band)));
        for (std::ptrdiff_t j = 0; j < blocks_; ++j) {
            const std::uint8_t *own = bridged_ + starts_[j];
            const bool whole = std::none_of(own, own + length_, [](std::uint8_t one) { return one != 0; });
            for (int c = 0; c < CHANNELS; ++c) {
                double least = HUGE_VAL;
                for (int band = 0; band < BANDS; ++band) {
                    double near[NEIGHBOURS];
                    for (std::ptrdiff_t i = 0; i < NEIGHBOURS; ++i) {
                        const std::ptrdiff_t neighbour = std::clamp(j + i - NEIGHBOURS / 2, std::ptrdiff_t{0}, blocks_ - 1);
                        near[i] = logs[(neighbour * CHANNELS + c) * BANDS + band];
                    }
                    least = std::min(least, middle(near) + scatter[band]);
                }
                const double density = whole ? std::exp(least + limits_.euler) * dt_ / spectrum.window_power() : 0.0;
                seen[j * CHANNELS + c] = std::max(density, rounding(j, c));
            }
        }
    }

    // Rows at which samples are missing or cut off, and how much of each channel that hides; returns their number.
    std::ptrdiff_t hidden(std::int64_t *rows, double *lost) const {
        std::vector<std::uint8_t> cut_off = this->cut_off();
        std::ptrdiff_t found = 0, of_block = -1;
        double furthest[CHANNELS];
        for (std::ptrdiff_t i = 0; i < count_; ++i) {
            const double duration = edges_[i + 1] - edges_[i];
            const double longer = duration > limits_.longer * dt_ && !bridged_[i] ? duration - dt_ : 0.0;
            const std::uint8_t *at_end = &cut_off[i * CHANNELS];
            if (!(longer > 0.0) && std::none_of(at_end, at_end + CHANNELS, [](std::uint8_t one) { return one != 0; }))
                continue;
            if (block_of(i) != of_block) {
                of_block = block_of(i);
                for (int c = 0; c < CHANNELS; ++c) furthest[c] = deviation(of_block, c, false).spread;
            }
            rows[found] = i;
            for (int c = 0; c < CHANNELS; ++c)
                lost[found * CHANNELS + c] = std::max(longer, at_end[c] ? dt_ : 0.0) * furthest[c];
            ++found;
        }
        return found;
    }

    // Rows in shocks, and the changes of velocity that they show, (rows, CHANNELS); returns their number.
    std::ptrdiff_t shocks(std::int64_t *rows, double *change) const {
        std::vector<Deviation> usual(blocks_ * AXES);
        for (std::ptrdiff_t j = 0; j < blocks_; ++j)
            for (int axis = 0; axis < AXES; ++axis) usual[j * AXES + axis] = range_of_usual(j, AXES + axis);
        const auto pause = static_cast<std::ptrdiff_t>(std::nearbyint(limits_.pause_s / dt_));
        std::vector<std::uint8_t> beyond(count_ * AXES);
        std::vector<Span> spans;
        for (std::ptrdiff_t i = 0; i < count_; ++i) {
            const Deviation *of_block = &usual[block_of(i) * AXES];
            bool any = false;
            for (int axis = 0; axis < AXES; ++axis) {
                const double limit = std::max(of_block[axis].spread, limits_.fine_steps * step_[AXES + axis]);
                const bool out = std::abs(at(i, AXES + axis) - of_block[axis].centre) > limit;
                beyond[i * AXES + axis] = out;
                any = any || out;
            }
            if (!any) continue;
            if (!spans.empty() && (i == spans.back().end || i - spans.back().end < pause))
                spans.back().end = i + 1;
            else
                spans.push_back({i, i + 1});
        }
        std::vector<Shock> shocks;
        std::ptrdiff_t found = 0;
        double squares = 0.0;
        for (const Span &span : spans) {
            if (static_cast<double>(span.end - span.begin) * dt_ > limits_.shock_s) continue;
            Shock shock{found, found + span.end - span.begin, {}};
            for (int axis = 0; axis < AXES; ++axis) {
                bool counts = false;
                for (std::ptrdiff_t i = span.begin; i < span.end; ++i) counts = counts || beyond[i * AXES + axis];
                const int c = AXES + axis;
                const double around =
                    0.5 * (at(std::max<std::ptrdiff_t>(span.begin - 1, 0), c) + at(std::min(span.end, count_ - 1), c));
                double sum = 0.0;
                for (std::ptrdiff_t i = span.begin; i < span.end; ++i) {
                    const double own = counts ? (at(i, c) - around) * (edges_[i + 1] - edges_[i]) : 0.0;
                    change[(shock.begin + i - span.begin) * CHANNELS + c] = own;
                    sum += own;
                }
                shock.size[axis] = std::abs(sum);
            }
            for (std::ptrdiff_t i = span.begin; i < span.end; ++i) {
                std::fill_n(change + found * CHANNELS, AXES, 0.0);  // nothing of the gyro
                rows[found++] = i;
            }
            squares += shock.size[0] * shock.size[0];
            shocks.push_back(shock);
        }
        const double most = limits_.shock_limit * std::sqrt(squares / static_cast<double>(shocks.size()));
        for (const Shock &shock : shocks)
            for (int axis = 1; axis < AXES; ++axis)
                if (shock.size[axis] > most)
                    for (std::ptrdiff_t i = shock.begin; i < shock.end; ++i)
                        change[i * CHANNELS + AXES + axis] *= most / shock.size[axis];
        return found;
    }

  private:
    struct Span {
        std::ptrdiff_t begin, end;
    };
    struct Shock {
        std::ptrdiff_t begin, end;
        double size[AXES];
    };
    struct Deviation {
        double centre, spread;
    };

    double at(std::ptrdiff_t i, int channel) const {
        return channel < AXES ? gyro_[i * AXES + channel] : accel_[i * AXES + channel - AXES];
    }

    static double middle(double (&values)[NEIGHBOURS]) {
        for (const double value : values)
            if (std::isnan(value)) return value;
        std::nth_element(values, values + NEIGHBOURS / 2, values + NEIGHBOURS);
        return values[NEIGHBOURS / 2];
    }

    // The block in whose middle a sample is.
    std::ptrdiff_t block_of(std::ptrdiff_t i) const {
        return i < length_ / 4 ? 0 : std::min((i - length_ / 4) / (length_ / 2), blocks_ - 1);
    }

    // The median of a block, and the median distance from it, or the largest.
    Deviation deviation(std::ptrdiff_t block, int channel, bool usual) const {
        std::vector<double> values(length_);
        for (std::ptrdiff_t i = 0; i < length_; ++i) values[i] = at(starts_[block] + i, channel);
        const double centre = median(values);
        for (double &value : values) value = std::abs(value - centre);
        return {centre, usual ? median(values) : *std::max_element(values.begin(), values.end())};
    }

    // The median of a block, and how far from it samples are usual; any are where more than half are so far that none is
    // further than this from it.
    Deviation range_of_usual(std::ptrdiff_t block, int channel) const {
        const Deviation all = deviation(block, channel, false);
        const double far = all.spread / limits_.shock_spread;
        std::ptrdiff_t further = 0;
        for (std::ptrdiff_t i = 0; i < length_; ++i)
            further += std::abs(at(starts_[block] + i, channel) - all.centre) >= far;
        if (2 * further > length_) return {all.centre, HUGE_VAL};
        return {all.centre, limits_.shock_spread * deviation(block, channel, true).spread};
    }

    double rounding(std::ptrdiff_t block, int channel) const {
        std::ptrdiff_t changes = 0;
        for (std::ptrdiff_t i = starts_[block] + 1; i < starts_[block] + length_; ++i)
            changes += std::abs(at(i, channel) - at(i - 1, channel)) > limits_.same;
        const double values = static_cast<double>(changes) + 1.0;
        return step_[channel] * step_[channel] / 12.0 * static_cast<double>(length_) * dt_ / values;
    }

    // Which samples are at an end of their range, (n, CHANNELS).
    std::vector<std::uint8_t> cut_off() const {
        std::vector<std::uint8_t> out(count_ * CHANNELS);
        for (int c = 0; c < CHANNELS; ++c) {
            double lowest = HUGE_VAL, highest = -HUGE_VAL;
            for (std::ptrdiff_t i = 0; i < count_; ++i)
                lowest = std::min(lowest, at(i, c)), highest = std::max(highest, at(i, c));
            for (const double sign : {1.0, -1.0}) cut_off_at(c, sign, sign > 0.0 ? highest : lowest, out);
        }
        return out;
    }

    void cut_off_at(int channel, double sign, double extreme, std::vector<std::uint8_t> &out) const {
        std::vector<std::ptrdiff_t> ends;
        for (std::ptrdiff_t i = 0; i < count_; ++i)
            if (std::abs(at(i, channel) - extreme) < limits_.same) ends.push_back(i);
        if (static_cast<double>(ends.size()) < limits_.extremes) return;  // as a rule, and no median is needed
        std::vector<double> values(count_);
        for (std::ptrdiff_t i = 0; i < count_; ++i) values[i] = at(i, channel);
        const double centre = median(values), most = sign * (extreme - centre);
        const auto is_near = [&](std::ptrdiff_t i) {
            return sign * (at(i, channel) - centre) > (1.0 - limits_.near_extreme) * most;
        };
        ends.erase(std::remove_if(ends.begin(), ends.end(), [&](std::ptrdiff_t i) { return !is_near(i); }), ends.end());
        std::size_t near = 0;
        for (std::ptrdiff_t i = 0; i < count_; ++i) near += is_near(i);
        if (2 * ends.size() <= near || static_cast<double>(ends.size()) < limits_.extremes ||
            !(most > limits_.fine_steps * step_[channel]))
            return;
        for (const std::ptrdiff_t i : ends) out[i * CHANNELS + channel] = 1;
    }

    const double *edges_, *gyro_, *accel_;
    const std::uint8_t *bridged_;
    const std::int64_t *starts_;
    std::ptrdiff_t count_, blocks_, length_;
    double dt_;
    Limits limits_;
    double step_[CHANNELS];
};

Limits limits_of(const double *given) {
    return {given[0], given[1], given[2], given[3], given[4], given[5], given[6], given[7], given[8], given[9], given[10]};
}

// Blocks of a floor: when they begin and end, knots (blocks + 1), and their densities squared (blocks, CHANNELS).
struct Floor {
    const double *knots, *seen;
    std::ptrdiff_t blocks;
};
// Changes (count, CHANNELS) at times, in order, that count as noise.
struct Changes {
    const double *t, *change;
    std::ptrdiff_t count;
};

// The density squared between two times, as NoiseFloor.between has it.
void add_up(double begin, double end, const Floor &floor, const double *declared, double clearly,
            const Changes (&changes)[2], double *out) {
    std::fill_n(out, CHANNELS, 0.0);
    const double *knot = floor.knots;
    for (std::ptrdiff_t b = std::max<std::ptrdiff_t>(std::upper_bound(knot, knot + floor.blocks, begin) - knot - 1, 0);
         b < floor.blocks && knot[b] < end; ++b) {
        const double part = std::max(std::min(end, knot[b + 1]) - std::max(begin, knot[b]), 0.0);
        for (int i = 0; i < CHANNELS; ++i) {
            const double own = floor.seen[b * CHANNELS + i], least = declared[i];
            out[i] += (own > clearly * least ? own : least) * part;
        }
    }
    for (const Changes &kind : changes) {
        double sum[CHANNELS] = {};
        const double *first = kind.t, *last = first + kind.count;
        for (std::ptrdiff_t j = std::lower_bound(first, last, begin) - first; j < kind.count && first[j] < end; ++j)
            for (int i = 0; i < CHANNELS; ++i) sum[i] += kind.change[j * CHANNELS + i];
        for (int i = 0; i < CHANNELS; ++i) out[i] += sum[i] * sum[i];
    }
    for (int i = 0; i < CHANNELS; ++i) out[i] /= end - begin;
}

}  // namespace

void noise_between(const Samples &samples, std::ptrdiff_t length, double dt, const NoiseRule &rule, const double *times,
                   std::ptrdiff_t m, double *variance) {
    const std::ptrdiff_t count = samples.count;
    const double *t = samples.edges;
    std::vector<double> seen(CHANNELS), knots = {t[0], t[count]}, lost, shock, lost_t, shock_t;
    if (length > 0) {
        std::vector<std::int64_t> starts, lost_rows(count), shock_rows(count);
        for (std::ptrdiff_t at = 0; at < count - length; at += length / 2) starts.push_back(at);
        starts.push_back(count - length);
        const auto blocks = static_cast<std::ptrdiff_t>(starts.size());
        seen.resize(blocks * CHANNELS), knots.resize(blocks + 1), knots[blocks] = t[count];
        const auto centre = [&](std::ptrdiff_t j) { return 0.5 * (t[starts[j]] + t[starts[j] + length]); };
        for (std::ptrdiff_t j = 1; j < blocks; ++j) knots[j] = 0.5 * (centre(j) + centre(j - 1));
        lost.resize(count * CHANNELS), shock.resize(count * CHANNELS);
        const Record record(samples, starts.data(), blocks, length, dt, limits_of(rule.limits));
        record.floor(seen.data());
        lost_t.resize(record.hidden(lost_rows.data(), lost.data()));
        shock_t.resize(record.shocks(shock_rows.data(), shock.data()));
        for (std::size_t j = 0; j < lost_t.size(); ++j) lost_t[j] = t[lost_rows[j]];
        for (std::size_t j = 0; j < shock_t.size(); ++j) shock_t[j] = 0.5 * (t[shock_rows[j]] + t[shock_rows[j] + 1]);
    }
    for (std::size_t i = 0; i < seen.size(); ++i) seen[i] += rule.excess[i % CHANNELS];
    const Floor floor = {knots.data(), seen.data(), static_cast<std::ptrdiff_t>(knots.size()) - 1};
    const Changes changes[2] = {{lost_t.data(), lost.data(), static_cast<std::ptrdiff_t>(lost_t.size())},
                                {shock_t.data(), shock.data(), static_cast<std::ptrdiff_t>(shock_t.size())}};
    for (std::ptrdiff_t k = 0; k < m; ++k)
        add_up(times[k], times[k + 1], floor, rule.declared, rule.clearly, changes, variance + k * CHANNELS);
}

// noise_floor(edges (n + 1), gyro (n, 3), accel (n, 3), bridged (n), starts (b), length, dt, limits, seen (b, 6),
// lost_rows (n), lost (n, 6), shock_rows (n), shock (n, 6)) -> (rows of lost, rows of shock)
PyObject *noise_floor(PyObject *, PyObject *arguments) {
    PyObject *o[11];
    Py_ssize_t length;
    double dt;
    if (!PyArg_ParseTuple(arguments, "OOOOOndOOOOOO", &o[0], &o[1], &o[2], &o[3], &o[4], &length, &dt, &o[5], &o[6],
                          &o[7], &o[8], &o[9], &o[10]))
        return nullptr;
    const Doubles edges(o[0], 1), gyro(o[1], 2), accel(o[2], 2);
    if (!edges.ok() || !gyro.ok() || !accel.ok()) return nullptr;
    const Flags bridged(o[3], 1);
    const Integers starts(o[4], 1);
    if (!bridged.ok() || !starts.ok()) return nullptr;
    const Doubles limits(o[5], 1), seen(o[6], 2, true), lost(o[8], 2, true), shock(o[10], 2, true);
    if (!limits.ok() || !seen.ok() || !lost.ok() || !shock.ok()) return nullptr;
    const Integers lost_rows(o[7], 1, true), shock_rows(o[9], 1, true);
    if (!lost_rows.ok() || !shock_rows.ok()) return nullptr;
    const std::ptrdiff_t count = bridged.size(0), blocks = starts.size(0);
    if (edges.size(0) != count + 1 || gyro.size(0) != count || accel.size(0) != count || gyro.size(1) != AXES ||
        accel.size(1) != AXES || limits.size(0) != NOISE_LIMITS)
        return refused("samples");
    if (seen.size(0) != blocks || seen.size(1) != CHANNELS || lost_rows.size(0) != count || lost.size(0) != count ||
        lost.size(1) != CHANNELS || shock_rows.size(0) != count || shock.size(0) != count || shock.size(1) != CHANNELS)
        return refused("results");
    if (length < SHORTEST_BLOCK || length > count || (length & (length - 1)) != 0 || blocks < 1 || !(dt > 0.0))
        return refused("blocks");
    for (std::ptrdiff_t j = 0; j < blocks; ++j)
        if (starts.data()[j] < 0 || starts.data()[j] > count - length) return refused("blocks");
    std::ptrdiff_t hides, shows;
    Py_BEGIN_ALLOW_THREADS;
    const Record record({edges.data(), gyro.data(), accel.data(), bridged.data(), count}, starts.data(), blocks, length, dt,
                        limits_of(limits.data()));
    record.floor(seen.data());
    hides = record.hidden(lost_rows.data(), lost.data());
    shows = record.shocks(shock_rows.data(), shock.data());
    Py_END_ALLOW_THREADS;
    return Py_BuildValue("(nn)", hides, shows);
}

// noise_seen(edges (n + 1), gyro (n, 3), accel (n, 3), bridged (n), length, dt, limits, declared (6), excess (6), clearly,
// t (m + 1), variance (m, 6)): noise_floor and white_noise at once, the densities of the floor higher by `excess`.
PyObject *noise_seen(PyObject *, PyObject *arguments) {
    PyObject *o[9];
    Py_ssize_t length;
    double dt, clearly;
    if (!PyArg_ParseTuple(arguments, "OOOOndOOOdOO", &o[0], &o[1], &o[2], &o[3], &length, &dt, &o[4], &o[5], &o[6], &clearly,
                          &o[7], &o[8]))
        return nullptr;
    const Doubles edges(o[0], 1), gyro(o[1], 2), accel(o[2], 2);
    if (!edges.ok() || !gyro.ok() || !accel.ok()) return nullptr;
    const Flags bridged(o[3], 1);
    const Doubles limits(o[4], 1), declared(o[5], 1), excess(o[6], 1), times(o[7], 1), variance(o[8], 2, true);
    if (!bridged.ok() || !limits.ok() || !declared.ok() || !excess.ok() || !times.ok() || !variance.ok()) return nullptr;
    const std::ptrdiff_t count = bridged.size(0), m = variance.size(0);
    if (count < 1 || edges.size(0) != count + 1 || gyro.size(0) != count || accel.size(0) != count ||
        gyro.size(1) != AXES || accel.size(1) != AXES || limits.size(0) != NOISE_LIMITS ||
        declared.size(0) != CHANNELS || excess.size(0) != CHANNELS)
        return refused("samples");
    if (times.size(0) != m + 1 || variance.size(1) != CHANNELS) return refused("results");
    if (length < 0 || length > count || (length & (length - 1)) != 0 || (length > 0 && length < SHORTEST_BLOCK) ||
        !(dt > 0.0))
        return refused("blocks");
    const Samples samples = {edges.data(), gyro.data(), accel.data(), bridged.data(), count};
    const NoiseRule rule = {declared.data(), excess.data(), limits.data(), clearly};
    Py_BEGIN_ALLOW_THREADS;
    noise_between(samples, length, dt, rule, times.data(), m, variance.data());
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// white_noise(t (m + 1), knots (b + 1), seen (b, 6), declared (6), clearly, lost_t (h), lost (h, 6), shock_t (k), shock (k, 6),
// variance (m, 6)): the densities squared between times, as NoiseFloor.between has them. All times are in order.
PyObject *white_noise(PyObject *, PyObject *arguments) {
    PyObject *o[9];
    double clearly;
    if (!PyArg_ParseTuple(arguments, "OOOOdOOOOO", &o[0], &o[1], &o[2], &o[3], &clearly, &o[4], &o[5], &o[6], &o[7], &o[8]))
        return nullptr;
    const Doubles times(o[0], 1), knots(o[1], 1), seen(o[2], 2), declared(o[3], 1), variance(o[8], 2, true);
    const Doubles event_t[2] = {{o[4], 1}, {o[6], 1}}, events[2] = {{o[5], 2}, {o[7], 2}};
    if (!times.ok() || !knots.ok() || !seen.ok() || !declared.ok() || !variance.ok()) return nullptr;
    for (int i = 0; i < 2; ++i)
        if (!event_t[i].ok() || !events[i].ok()) return nullptr;
    const std::ptrdiff_t intervals = variance.size(0), blocks = seen.size(0);
    if (times.size(0) != intervals + 1 || variance.size(1) != CHANNELS) return refused("results");
    if (blocks < 1 || knots.size(0) != blocks + 1 || seen.size(1) != CHANNELS || declared.size(0) != CHANNELS)
        return refused("blocks");
    for (int i = 0; i < 2; ++i)
        if (event_t[i].size(0) != events[i].size(0) || events[i].size(1) != CHANNELS) return refused("events");
    const Floor floor = {knots.data(), seen.data(), blocks};
    const Changes changes[2] = {{event_t[0].data(), events[0].data(), event_t[0].size(0)},
                                {event_t[1].data(), events[1].data(), event_t[1].size(0)}};
    for (std::ptrdiff_t k = 0; k < intervals; ++k)
        add_up(times.data()[k], times.data()[k + 1], floor, declared.data(), clearly, changes,
               variance.data() + k * CHANNELS);
    Py_RETURN_NONE;
}
