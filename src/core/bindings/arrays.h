// NumPy arrays at the boundary between Python and the core: types of the arguments, and arrays for results.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

namespace pinproof {

namespace nb = nanobind;

// Arguments: C-contiguous arrays of doubles on the CPU, read only. Python converts before it calls.
using Numbers = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;  // of any shape
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Stack = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using IndexMatrix = nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// A NumPy array that owns its memory.
template <class Number>
struct OwnedArray {
    Number* data;
    nb::ndarray<nb::numpy, Number> array;
};

// The number of entries of an array, at least 1. Arrays that memory cannot hold are refused: their size in bytes overflows.
template <class Number>
std::size_t entries(std::initializer_list<std::size_t> shape) {
    constexpr std::size_t most = std::numeric_limits<std::ptrdiff_t>::max() / sizeof(Number);
    if (std::find(shape.begin(), shape.end(), std::size_t{0}) != shape.end()) return 1;
    std::size_t count = 1;
    for (std::size_t side : shape) {
        if (side > most / count) throw std::bad_alloc();
        count *= side;
    }
    return count;
}

// An array of a result, with zeros.
template <class Number = double>
OwnedArray<Number> new_array(std::initializer_list<std::size_t> shape) {
    auto memory = std::make_unique<Number[]>(entries<Number>(shape));
    Number* data = memory.release();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<Number*>(p); });
    return {data, nb::ndarray<nb::numpy, Number>(data, shape.size(), shape.begin(), owner)};
}

// The same for an array that Python may not change.
struct ReadOnlyArray {
    double* data;
    nb::ndarray<nb::numpy, const double> array;
};

inline ReadOnlyArray new_read_only_array(std::initializer_list<std::size_t> shape) {
    auto memory = std::make_unique<double[]>(entries<double>(shape));
    double* data = memory.release();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    return {data, nb::ndarray<nb::numpy, const double>(data, shape.size(), shape.begin(), owner)};
}

// A vector as an array.
inline nb::object array_of(const std::vector<double>& values) {
    auto array = new_array({values.size()});
    std::copy(values.begin(), values.end(), array.data);
    return nb::cast(array.array);
}

// A vector as an array that Python cannot change.
inline nb::object read_only_array_of(const std::vector<double>& values) {
    auto memory = std::make_unique<double[]>(values.size() + 1);
    std::copy(values.begin(), values.end(), memory.get());
    const std::size_t size = values.size();
    const double* data = memory.release();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, const double>(data, 1, &size, owner));
}

// Refuse an argument whose size differs from what the core is about to read or write.
inline void require_size(const char* name, std::size_t found, std::size_t expected) {
    if (found != expected)
        throw std::invalid_argument(std::string(name) + " has size " + std::to_string(found) + ", expected " +
                                    std::to_string(expected));
}

// Refuse an array whose numbers are not finite, where the core relies on them.
inline void require_finite(const char* name, const double* numbers, std::size_t count) {
    if (!std::all_of(numbers, numbers + count, [](double x) { return std::isfinite(x); }))
        throw std::invalid_argument(std::string(name) + " holds a number that is not finite");
}

// Refuse a random number outside [0, 1): indices are derived from them.
inline void require_draws(const Matrix& draws) {
    if (!std::all_of(draws.data(), draws.data() + draws.size(), [](double x) { return x >= 0.0 && x < 1.0; }))
        throw std::invalid_argument("draws must be in [0, 1)");
}

// Refuse a size that is zero, negative or NaN.
inline void require_positive(const char* name, double value) {
    if (!(value > 0.0)) throw std::invalid_argument(std::string(name) + " must be positive");
}

// Refuse a negative number of something.
inline void require_count(const char* name, std::int64_t value) {
    if (value < 0) throw std::invalid_argument(std::string(name) + " must not be negative");
}

}  // namespace pinproof
