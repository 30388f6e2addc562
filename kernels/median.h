// Medians of numbers in memory of the caller's, which are put into another order.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

// As numpy has it: the mean of the middle two of an even number, and no number of those that are not all numbers.
inline double median(std::vector<double> &values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    for (const double value : values)
        if (std::isnan(value)) return value;
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1) return *middle;
    return 0.5 * (*std::max_element(values.begin(), middle) + *middle);
}
