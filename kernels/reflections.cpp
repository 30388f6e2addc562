// QR by Householder reflections, compiled for the vector units that processors differ in.
#include "reflections.h"

#include <cmath>

namespace {

constexpr std::ptrdiff_t PANEL = 4;  // reflections that are applied together: more would not fit the registers

// Explicit vectors need a body for each kind of unit: where the compiler clones a function, it has taken them apart
// before. Nothing that other sources use as well may be compiled here: of two such copies the linker keeps any.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define FOR_EACH_VECTOR_UNIT
#pragma GCC push_options
#pragma GCC target("avx512f")
namespace avx512 {
constexpr std::ptrdiff_t LANES = 8;
#include "triangularised.h"
}  // namespace avx512
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx2,fma")
namespace avx2 {
constexpr std::ptrdiff_t LANES = 4;
#include "triangularised.h"
}  // namespace avx2
#pragma GCC pop_options
#endif

constexpr std::ptrdiff_t LANES = 2;
#include "triangularised.h"

using Body = void (*)(double *, std::ptrdiff_t, std::ptrdiff_t, std::ptrdiff_t, double **, double *);

Body for_this_processor() {
#ifdef FOR_EACH_VECTOR_UNIT
    if (__builtin_cpu_supports("avx512f")) return avx512::triangularised;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2::triangularised;
#endif
    return triangularised;
}

}  // namespace

void triangularise(Rows &A, std::ptrdiff_t rows, std::ptrdiff_t pivots, Workspace &work) {
    static const Body body = for_this_processor();
    if (static_cast<std::ptrdiff_t>(work.touched.size()) < rows) {
        work.touched.resize(rows);
        work.v.resize(rows * PANEL);
    }
    body(A.numbers.data(), A.stride, rows, pivots < rows ? pivots : rows, work.touched.data(), work.v.data());
}
