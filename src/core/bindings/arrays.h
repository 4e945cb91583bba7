// NumPy arrays at the boundary between Python and the core: arguments that check themselves, and arrays for results.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "geometry/vectors.h"

namespace pinproof {

namespace nb = nanobind;
using namespace nb::literals;

// Arguments: C-contiguous arrays on the CPU, read only. Their sizes are checked with `shaped` or `finite`, which name
// the argument in the error.
template <class Number, int dimensions>
using Array = nb::ndarray<const Number, nb::ndim<dimensions>, nb::c_contig, nb::device::cpu>;
using Vector = Array<double, 1>;
using Matrix = Array<double, 2>;
using Stack = Array<double, 3>;
using Indices = Array<std::int64_t, 1>;
using IndexMatrix = Array<std::int64_t, 2>;
using Doubles = std::vector<double>;

using Sizes = std::initializer_list<std::size_t>;
inline constexpr std::size_t kAny = std::numeric_limits<std::size_t>::max(), kSome = kAny - 1;  // kSome: at least one

inline void refuse(const std::string& message) { throw std::invalid_argument(message); }

// The text of a shape, such as (N, 4, 4).
template <class Range>
std::string shape_text(const Range& sizes) {
    std::string text;
    for (std::size_t size : sizes)
        text += (text.empty() ? "" : ", ") + (size == kAny ? "N" : size == kSome ? "at least 1" : std::to_string(size));
    return '(' + text + (sizes.size() == 1 ? ",)" : ")");
}

// Refuse another number of something than the core is about to read or write.
inline void require_size(const char* name, std::size_t size, std::size_t expected) {
    if (size != expected)
        refuse(std::string(name) + " has size " + std::to_string(size) + ", expected " + std::to_string(expected));
}

// The numbers of an array, row by row; other shapes are refused.
template <class Array>
std::span<typename Array::Scalar> shaped(const char* name, const Array& array, Sizes sizes) {
    const std::span found(array.shape_ptr(), array.ndim());
    const auto fits = [](std::int64_t size, std::size_t expected) {
        return expected == kAny || (expected == kSome ? size > 0 : static_cast<std::size_t>(size) == expected);
    };
    if (!std::equal(found.begin(), found.end(), sizes.begin(), sizes.end(), fits))
        refuse(std::string(name) + " has shape " + shape_text(found) + ", expected " + shape_text(sizes));
    return {array.data(), array.size()};
}

inline double finite(const char* name, double number) {
    if (!std::isfinite(number)) refuse(std::string(name) + " holds a number that is not finite");
    return number;
}

// The same; numbers that are not finite are refused too.
template <class Array>
std::span<const double> finite(const char* name, const Array& array, Sizes sizes) {
    const std::span<const double> numbers = shaped(name, array, sizes);
    for (double number : numbers) finite(name, number);
    return numbers;
}

// Random numbers, from which indices are derived.
inline std::span<const double> draws_of(const Matrix& draws, std::size_t columns) {
    const auto numbers = shaped("draws", draws, {kAny, columns});
    if (!std::ranges::all_of(numbers, [](double x) { return x >= 0.0 && x < 1.0; })) refuse("draws must be in [0, 1)");
    return numbers;
}

// Numbers that increase, at least one.
inline std::span<const double> knots_of(const Vector& knots, std::size_t size = kSome) {
    const auto numbers = finite("knots", knots, {size});
    if (std::ranges::adjacent_find(numbers, std::greater_equal{}) != numbers.end()) refuse("knots must increase");
    return numbers;
}

inline double positive(const char* name, double value) {
    if (!(value > 0.0)) refuse(std::string(name) + " must be positive");
    return value;
}

inline std::int64_t counted(const char* name, std::int64_t value) {
    if (value < 0) refuse(std::string(name) + " must not be negative");
    return value;
}

inline Doubles list_of(std::span<const double> numbers) { return {numbers.begin(), numbers.end()}; }

inline Vec3 vec3(const char* name, const Vector& array) {
    const auto v = finite(name, array, {3});
    return {v[0], v[1], v[2]};
}

// A direction whose length may differ from 1 by `tolerance`.
inline Vec3 unit_vector(const char* name, const Vector& array, double tolerance) {
    const Vec3 direction = vec3(name, array);
    if (!(std::abs(norm(direction) - 1.0) < tolerance)) refuse(std::string(name) + " is not a unit vector");
    return direction;
}

inline Transform transform(const char* name, const Matrix& matrix) {
    return read_transform(finite(name, matrix, {4, 4}).data());
}

// The result of a function that runs without the GIL.
template <class Function>
auto without_gil(Function function) {
    nb::gil_scoped_release release;
    return function();
}

// An array of a result; Python cannot change it if its numbers are constant.
template <class Number>
struct NewArrayOf : nb::ndarray<nb::numpy, Number> {
    using nb::ndarray<nb::numpy, Number>::ndarray;
};
using NewArray = NewArrayOf<double>;
using ReadOnlyArray = NewArrayOf<const double>;

// An array that owns its memory, filled by `fill(numbers)`. Arrays that memory cannot hold are refused: their size in
// bytes overflows.
template <class Number, class Fill>
NewArrayOf<Number> filled(Sizes shape, Fill fill) {
    using Stored = std::remove_const_t<Number>;
    constexpr std::size_t most = std::numeric_limits<std::ptrdiff_t>::max() / sizeof(Number);
    std::size_t count = 1;
    for (std::size_t side : shape) {
        if (side > 0 && count > most / side) throw std::bad_alloc();
        count *= side;
    }
    auto memory = std::make_unique<Stored[]>(std::max<std::size_t>(count, 1));
    fill(memory.get());
    nb::capsule owner(memory.get(), [](void* p) noexcept { delete[] static_cast<Stored*>(p); });
    return {memory.release(), shape.size(), shape.begin(), owner};
}
// The same with zeros, whose memory becomes `numbers`.
template <class Number>
NewArrayOf<Number> filled(Sizes shape, Number*& numbers) {
    return filled<Number>(shape, [&](Number* memory) { numbers = memory; });
}

// Numbers as an array (N,), or as rows of `columns` numbers.
template <class Number = double, class Range>
NewArrayOf<Number> array_of(const Range& values) {
    return filled<Number>({values.size()}, [&](auto* out) { std::copy(values.begin(), values.end(), out); });
}
inline NewArray rows_of(std::span<const double> values, std::size_t columns) {
    return filled<double>({values.size() / columns, columns}, [&](double* out) { std::ranges::copy(values, out); });
}

// An array with one number of each element, a member or what a function returns.
template <class Number, class Range, class Read>
NewArrayOf<Number> column(const Range& elements, Read read) {
    return filled<Number>({elements.size()}, [&](auto* out) {
        for (const auto& element : elements) *out++ = static_cast<Number>(std::invoke(read, element));
    });
}

// An array with a row of numbers of each element: members, or what functions return.
template <class Number = double, class Range, class... Reads>
NewArrayOf<Number> table(const Range& elements, Reads... reads) {
    return filled<Number>({elements.size(), sizeof...(reads)}, [&](auto* out) {
        for (const auto& element : elements) ((*out++ = static_cast<double>(std::invoke(reads, element))), ...);
    });
}

}  // namespace pinproof

// Arrays of results, from members and properties too: they refer to no memory of the object.
namespace nanobind::detail {

template <class Number>
struct type_caster<pinproof::NewArrayOf<Number>> {
    using Base = make_caster<ndarray<numpy, Number>>;
    NB_TYPE_CASTER(pinproof::NewArrayOf<Number>, Base::Name)

    bool from_python(handle, uint32_t, cleanup_list*) noexcept { return false; }
    static handle from_cpp(const pinproof::NewArrayOf<Number>& array, rv_policy, cleanup_list* cleanup) noexcept {
        return Base::from_cpp(array, rv_policy::automatic, cleanup);
    }
};

// Vectors (3,), matrices (3, 3) and transforms (4, 4) as new arrays.
template <class Value_, class Shape>
struct array_result {
    using Array = ndarray<numpy, double, Shape>;
    NB_TYPE_CASTER(Value_, make_caster<Array>::Name)

    bool from_python(handle, uint32_t, cleanup_list*) noexcept { return false; }  // see vec3 and transform
    static handle from_cpp(const Value_& value, rv_policy policy, cleanup_list* cleanup) noexcept {
        using namespace pinproof;
        NewArray array;
        if constexpr (std::is_same_v<Value_, Vec3>) array = array_of(std::array{value.x, value.y, value.z});
        else if constexpr (std::is_same_v<Value_, Mat3>) array = rows_of({&value.m[0][0], 9}, 3);
        else array = filled<double>({4, 4}, [&](double* out) { write_homogeneous(value, out); });
        return make_caster<NewArray>::from_cpp(array, policy, cleanup);
    }
};

template <>
struct type_caster<pinproof::Vec3> : array_result<pinproof::Vec3, shape<3>> {};
template <>
struct type_caster<pinproof::Mat3> : array_result<pinproof::Mat3, shape<3, 3>> {};
template <>
struct type_caster<pinproof::Transform> : array_result<pinproof::Transform, shape<4, 4>> {};

}  // namespace nanobind::detail
