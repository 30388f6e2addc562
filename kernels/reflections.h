// QR of a matrix that is kept by rows, most of whose entries may be zero.
#pragma once

#include <cstddef>
#include <cstring>
#include <vector>

// Rows in doubles, of which each begins at a multiple of CHUNK; what is behind the columns is zero and stays so.
struct Rows {
    static constexpr std::ptrdiff_t CHUNK = 16;  // columns that are worked on at once: two of the widest vectors

    std::vector<double> numbers;
    std::ptrdiff_t stride = 0;

    void shape(std::ptrdiff_t rows, std::ptrdiff_t columns) {
        stride = (columns + CHUNK - 1) / CHUNK * CHUNK;
        if (static_cast<std::ptrdiff_t>(numbers.size()) < rows * stride) numbers.resize(rows * stride);
        std::memset(numbers.data(), 0, rows * stride * sizeof(double));
    }
    double *row(std::ptrdiff_t i) { return numbers.data() + i * stride; }
};

// What triangularise() works with, kept from one matrix to the next.
struct Workspace {
    std::vector<double *> touched;
    std::vector<double> v;
};

// Make the first `pivots` columns of the first rows zero below the diagonal.
void triangularise(Rows &A, std::ptrdiff_t rows, std::ptrdiff_t pivots, Workspace &work);
