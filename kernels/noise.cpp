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
constexpr double NEAR_MEAN = 0.15;  // In standard deviations: medians of 256 normal values scatter by half of it.
constexpr std::uint8_t NOWHERE[CHANNELS] = {};

// In the order of NOISE_LIMITS in trackfg.sensors.imu_noise.sample_blocks, which says what they are.
struct Limits {
    double scatter, euler, same, longer, extremes, fine_steps, near_extreme, shock_spread, pause_s, shock_s, shock_limit;
};
static_assert(NOISE_LIMITS == sizeof(Limits) / sizeof(double));

// Spectra of blocks of one length.
class Spectrum {
  public:
    explicit Spectrum(std::ptrdiff_t length)
        : length_(length), half_(length / 2), window_(length), cosine_(half_), sine_(half_), reversed_(half_),
          real_(half_ * CHANNELS), imaginary_(half_ * CHANNELS), power_(half_ * CHANNELS) {
        for (std::ptrdiff_t i = 0; i < length; ++i) {
            const double angle = 2.0 * M_PI * static_cast<double>(i) / static_cast<double>(length);
            window_[i] = 0.5 - 0.5 * std::cos(angle);
            window_power_ += window_[i] * window_[i];
            if (i < half_) cosine_[i] = std::cos(angle), sine_[i] = -std::sin(angle);
        }
        for (std::ptrdiff_t i = 1, bits = half_ / 2; i < half_; ++i) {
            std::ptrdiff_t j = reversed_[i - 1], bit = bits;
            for (; j & bit; bit >>= 1) j ^= bit;
            reversed_[i] = j | bit;
        }
    }

    std::ptrdiff_t length() const { return length_; }
    double window_power() const { return window_power_; }

    // Write the mean log of the power in each band, (CHANNELS, BANDS), of the samples of a block, (length, CHANNELS).
    void mean_logs(const double *samples, double *out) {
        transform(samples);
        for (int band = 0; band < BANDS; ++band) {
            const std::ptrdiff_t begin = half_ >> (BANDS - band), end = 2 * begin;
            // A logarithm of many values' product, as long as that is far from the ends of the range.
            double sums[CHANNELS] = {}, products[CHANNELS];
            std::fill_n(products, CHANNELS, 1.0);
            for (std::ptrdiff_t k = begin; k < end; ++k)
                for (int c = 0; c < CHANNELS; ++c) {
                    const double power = power_[k * CHANNELS + c], product = products[c] * power;
                    const bool far = product > FARTHEST || product < 1.0 / FARTHEST;
                    if (far) sums[c] += std::log(products[c]);
                    products[c] = far ? power : product;
                }
            for (int c = 0; c < CHANNELS; ++c)
                out[c * BANDS + band] = (sums[c] + std::log(products[c])) / static_cast<double>(end - begin);
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
        for (std::ptrdiff_t k = half_ >> BANDS; k < half_; ++k) {  // even samples and odd ones put together
            const double *near_x = &real_[k * CHANNELS], *near_y = &imaginary_[k * CHANNELS];
            const double *far_x = &real_[(half_ - k) * CHANNELS], *far_y = &imaginary_[(half_ - k) * CHANNELS];
            const double c = 0.5 * cosine_[k], s = 0.5 * sine_[k];
            double *power = &power_[k * CHANNELS];
            for (int i = 0; i < CHANNELS; ++i) {
                const double odd_x = near_y[i] + far_y[i], odd_y = far_x[i] - near_x[i];
                const double x = 0.5 * (near_x[i] + far_x[i]) + c * odd_x - s * odd_y;
                const double y = 0.5 * (near_y[i] - far_y[i]) + c * odd_y + s * odd_x;
                power[i] = std::max(x * x + y * y, DBL_MIN);
            }
        }
    }

    std::ptrdiff_t length_, half_;
    double window_power_ = 0.0;
    std::vector<double> window_, cosine_, sine_;
    std::vector<std::ptrdiff_t> reversed_;
    std::vector<double> real_, imaginary_, power_;  // (half, CHANNELS); of the power from the lowest band on
};

// How each channel's samples (count, CHANNELS) lie: the smallest step from one to the next that is one, 0 without any, and
// both ends of their range, with how many are there.
struct Extent {
    double step[CHANNELS], lowest[CHANNELS], highest[CHANNELS], at_lowest[CHANNELS], at_highest[CHANNELS];
};

WITH_VECTOR_UNITS Extent extent_of(const double *samples, std::ptrdiff_t count, double same) {
    Extent of;
    for (int c = 0; c < CHANNELS; ++c) {
        of.step[c] = of.lowest[c] = HUGE_VAL, of.highest[c] = -HUGE_VAL;
        of.at_lowest[c] = of.at_highest[c] = 0.0;
    }
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (int c = 0; c < CHANNELS; ++c) {
            const double value = samples[i * CHANNELS + c];
            const double difference = i > 0 ? std::abs(value - samples[(i - 1) * CHANNELS + c]) : 0.0;
            const double step = difference > same ? difference : HUGE_VAL;
            of.step[c] = step < of.step[c] ? step : of.step[c];
            of.lowest[c] = value < of.lowest[c] ? value : of.lowest[c];
            of.highest[c] = value > of.highest[c] ? value : of.highest[c];
        }
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (int c = 0; c < CHANNELS; ++c) {
            of.at_lowest[c] += std::abs(samples[i * CHANNELS + c] - of.lowest[c]) < same ? 1.0 : 0.0;
            of.at_highest[c] += std::abs(samples[i * CHANNELS + c] - of.highest[c]) < same ? 1.0 : 0.0;
        }
    for (int c = 0; c < CHANNELS; ++c)
        if (!std::isfinite(of.step[c])) of.step[c] = 0.0;
    return of;
}

// How often each channel changes within samples (count, CHANNELS).
WITH_VECTOR_UNITS void count_changes(const double *samples, std::ptrdiff_t count, double same, double *changes) {
    std::fill_n(changes, CHANNELS, 0.0);
    for (std::ptrdiff_t i = 1; i < count; ++i)
        for (int c = 0; c < CHANNELS; ++c)
            changes[c] += std::abs(samples[i * CHANNELS + c] - samples[(i - 1) * CHANNELS + c]) > same ? 1.0 : 0.0;
}

// Which channels of a block (count, CHANNELS), of an even number of samples, have none further from the median than `spread`
// times what more than half of them are from it, as far as that is seen without the median: it is near the mean where less
// than half of the samples are on either side of what is near.
WITH_VECTOR_UNITS void find_usual(const double *samples, std::ptrdiff_t count, double spread, bool *usual) {
    double mean[CHANNELS] = {}, near[CHANNELS] = {}, furthest[CHANNELS] = {};
    double below[CHANNELS] = {}, above[CHANNELS] = {}, far[CHANNELS] = {};
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (int c = 0; c < CHANNELS; ++c) {
            const double change = samples[i * CHANNELS + c] - samples[c];
            mean[c] += change, near[c] += change * change;
        }
    for (int c = 0; c < CHANNELS; ++c) {
        mean[c] /= static_cast<double>(count);
        near[c] = NEAR_MEAN * std::sqrt(near[c] / static_cast<double>(count) - mean[c] * mean[c]);
        mean[c] += samples[c];
    }
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (int c = 0; c < CHANNELS; ++c) {
            const double off = samples[i * CHANNELS + c] - mean[c];
            below[c] += off < -near[c] ? 1.0 : 0.0;
            above[c] += off > near[c] ? 1.0 : 0.0;
            furthest[c] = std::abs(off) > furthest[c] ? std::abs(off) : furthest[c];
        }
    for (int c = 0; c < CHANNELS; ++c) furthest[c] = (furthest[c] + near[c]) / spread + near[c];
    for (std::ptrdiff_t i = 0; i < count; ++i)
        for (int c = 0; c < CHANNELS; ++c)
            far[c] += std::abs(samples[i * CHANNELS + c] - mean[c]) >= furthest[c] ? 1.0 : 0.0;
    for (int c = 0; c < CHANNELS; ++c)
        usual[c] = 2.0 * std::max(below[c], above[c]) < static_cast<double>(count) &&
                   2.0 * far[c] > static_cast<double>(count);
}

// A record in blocks of `length` samples: block j begins at sample starts[j]; `dt` is its sampling interval, s.
class Record {
  public:
    Record(const Samples &samples, const std::int64_t *starts, std::ptrdiff_t blocks, std::ptrdiff_t length, double dt,
           const Limits &limits)
        : edges_(samples.edges), bridged_(samples.bridged), starts_(starts), count_(samples.count), blocks_(blocks),
          length_(length), dt_(dt), limits_(limits), samples_(count_ * CHANNELS) {
        for (std::ptrdiff_t i = 0; i < count_; ++i)
            for (int axis = 0; axis < AXES; ++axis) {
                samples_[i * CHANNELS + axis] = samples.gyro[i * AXES + axis];
                samples_[i * CHANNELS + AXES + axis] = samples.accel[i * AXES + axis];
            }
        extent_ = extent_of(samples_.data(), count_, limits_.same);
    }

    // Densities squared of the floor, or of rounding where that is more, (blocks, CHANNELS), of some of the blocks.
    void floor(double *seen, std::ptrdiff_t first, std::ptrdiff_t last) const {
        thread_local Spectrum spectrum(length_);
        if (spectrum.length() != length_) spectrum = Spectrum(length_);
        const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(first - NEIGHBOURS / 2, 0);
        const std::ptrdiff_t end = std::min(last + NEIGHBOURS / 2 + 1, blocks_);
        std::vector<double> logs((end - begin) * CHANNELS * BANDS);
        for (std::ptrdiff_t j = begin; j < end; ++j)
            spectrum.mean_logs(&samples_[starts_[j] * CHANNELS], &logs[(j - begin) * CHANNELS * BANDS]);
        double scatter[BANDS], changes[CHANNELS];
        for (int band = 0; band < BANDS; ++band)
            scatter[band] = limits_.scatter / std::sqrt(static_cast<double>((length_ / 2) >> (BANDS - band)));
        for (std::ptrdiff_t j = first; j <= last; ++j) {
            const std::uint8_t *own = bridged_ + starts_[j];
            const bool whole = std::none_of(own, own + length_, [](std::uint8_t one) { return one != 0; });
            count_changes(&samples_[starts_[j] * CHANNELS], length_, limits_.same, changes);
            for (int c = 0; c < CHANNELS; ++c) {
                double least = HUGE_VAL;
                for (int band = 0; band < BANDS; ++band) {
                    double near[NEIGHBOURS];
                    for (std::ptrdiff_t i = 0; i < NEIGHBOURS; ++i) {
                        const std::ptrdiff_t neighbour = std::clamp(j + i - NEIGHBOURS / 2, std::ptrdiff_t{0}, blocks_ - 1);
                        near[i] = logs[((neighbour - begin) * CHANNELS + c) * BANDS + band];
                    }
                    least = std::min(least, middle(near) + scatter[band]);
                }
                const double density = whole ? std::exp(least + limits_.euler) * dt_ / spectrum.window_power() : 0.0;
                const double step = extent_.step[c];
                const double rounding = step * step / 12.0 * static_cast<double>(length_) * dt_ / (changes[c] + 1.0);
                seen[j * CHANNELS + c] = std::max(density, rounding);
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
            const std::uint8_t *at_end = cut_off.empty() ? NOWHERE : &cut_off[i * CHANNELS];
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
        std::vector<std::uint8_t> beyond(count_ * AXES);
        for (std::ptrdiff_t j = 0; j < blocks_; ++j) {
            bool is_usual[CHANNELS];
            find_usual(&samples_[starts_[j] * CHANNELS], length_, limits_.shock_spread, is_usual);
            for (int axis = 0; axis < AXES; ++axis) {
                if (is_usual[AXES + axis]) continue;
                const Deviation usual = range_of_usual(j, AXES + axis);
                if (!std::isfinite(usual.spread)) continue;
                const double limit = std::max(usual.spread, limits_.fine_steps * extent_.step[AXES + axis]);
                for (std::ptrdiff_t i = middle_of(j); i < middle_of(j + 1); ++i)
                    beyond[i * AXES + axis] = std::abs(at(i, AXES + axis) - usual.centre) > limit;
            }
        }
        const auto pause = static_cast<std::ptrdiff_t>(std::nearbyint(limits_.pause_s / dt_));
        std::vector<Span> spans;
        for (auto out = beyond.begin(); (out = std::find(out, beyond.end(), 1)) != beyond.end(); ++out) {
            const std::ptrdiff_t i = (out - beyond.begin()) / AXES;
            if (!spans.empty() && i - spans.back().end < std::max<std::ptrdiff_t>(pause, 1))
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

    double at(std::ptrdiff_t i, int channel) const { return samples_[i * CHANNELS + channel]; }

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

    // The first sample in whose block's middle it is, (blocks + 1).
    std::ptrdiff_t middle_of(std::ptrdiff_t block) const {
        if (block == 0) return 0;
        return block < blocks_ ? std::min(length_ / 4 + block * (length_ / 2), count_) : count_;
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

    // Which samples are at an end of their range, (n, CHANNELS); nothing where too few are at any.
    std::vector<std::uint8_t> cut_off() const {
        std::vector<std::uint8_t> out;
        for (int c = 0; c < CHANNELS; ++c)
            for (const double sign : {1.0, -1.0}) {
                if ((sign > 0.0 ? extent_.at_highest : extent_.at_lowest)[c] < limits_.extremes) continue;
                out.resize(count_ * CHANNELS);
                cut_off_at(c, sign, (sign > 0.0 ? extent_.highest : extent_.lowest)[c], out);
            }
        return out;
    }

    void cut_off_at(int channel, double sign, double extreme, std::vector<std::uint8_t> &out) const {
        std::vector<std::ptrdiff_t> ends;
        for (std::ptrdiff_t i = 0; i < count_; ++i)
            if (std::abs(at(i, channel) - extreme) < limits_.same) ends.push_back(i);
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
            !(most > limits_.fine_steps * extent_.step[channel]))
            return;
        for (const std::ptrdiff_t i : ends) out[i * CHANNELS + channel] = 1;
    }

    const double *edges_;
    const std::uint8_t *bridged_;
    const std::int64_t *starts_;
    std::ptrdiff_t count_, blocks_, length_;
    double dt_;
    Limits limits_;
    std::vector<double> samples_;  // (count, CHANNELS)
    Extent extent_;
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
        const double *knot = knots.data(), *last = knot + blocks;
        const auto first_block = std::max<std::ptrdiff_t>(std::upper_bound(knot, last, times[0]) - knot - 1, 0);
        const auto last_block = std::max(std::lower_bound(knot, last, times[m]) - knot - 1, first_block);
        record.floor(seen.data(), first_block, last_block);
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
    record.floor(seen.data(), 0, blocks - 1);
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
