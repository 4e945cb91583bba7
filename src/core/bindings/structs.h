// Structs of the core in Python: a constructor with an argument for each member, which it checks, and read-only members.
#pragma once

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

#include "bindings/arrays.h"

namespace pinproof {

// How a value is passed from Python, and read. Arrays must be finite.
template <class Value>
struct Passed {
    using Type = const Value&;
    static const Value& read(const char*, Type value) { return value; }
};
template <>
struct Passed<Vec3> {
    using Type = const Vector&;
    static Vec3 read(const char* name, Type value) { return vec3(name, value); }
};
template <>
struct Passed<Doubles> {
    using Type = const Vector&;
    // The numbers may be infinite.
    static Doubles read(const char* name, Type value) { return list_of(shaped(name, value, {kAny})); }
};
template <>
struct Passed<Transform> {
    using Type = const Matrix&;
    static Transform read(const char* name, Type value) { return transform(name, value); }
};
template <>
struct Passed<Mat3> {
    using Type = const Matrix&;
    static Mat3 read(const char* name, Type value) {
        Mat3 matrix;
        std::ranges::copy(finite(name, value, {3, 3}), &matrix.m[0][0]);
        return matrix;
    }
};
template <std::size_t size>
struct Passed<std::array<double, size>> {
    using Type = const Vector&;
    static std::array<double, size> read(const char* name, Type value) {
        std::array<double, size> numbers;
        std::ranges::copy(finite(name, value, {size}), numbers.begin());
        return numbers;
    }
};

// A member with its name in Python. A single number must be finite, unless it may be infinite.
template <class T, class Value, bool optional>
struct Member {
    const char* name;
    Value T::* pointer;
    bool may_be_infinite;

    using Type = typename Passed<Value>::Type;
    auto argument() const {
        if constexpr (optional) return nb::arg(name) = T{}.*pointer;
        else return nb::arg(name);
    }
    void read(T& out, Type value) const {
        if constexpr (std::is_same_v<Value, double>)
            if (std::isnan(value) || (std::isinf(value) && !may_be_infinite)) finite(name, value);
        out.*pointer = Passed<Value>::read(name, value);
    }
};
template <class T, class Value>
Member<T, Value, false> member(const char* name, Value T::* pointer) { return {name, pointer, false}; }
template <class T>
Member<T, double, false> limit(const char* name, double T::* pointer) { return {name, pointer, true}; }
// The argument may be left out: the member then has the value that the struct declares.
template <class T, class Value>
Member<T, Value, true> optional(const char* name, Value T::* pointer) { return {name, pointer, false}; }

// A struct that Python makes from its members. `check` refuses combinations of them.
template <class T, class Check, class... Members>
nb::class_<T> bind_struct(nb::module_& module, const char* name, const char* text, Check check, Members... members) {
    nb::class_<T> bound(module, name, text);
    bound.def(
        "__init__",
        [check, members...](T* self, typename Members::Type... values) {
            T made{};
            (members.read(made, values), ...);
            check(made);
            new (self) T(std::move(made));
        },
        members.argument()...);
    (bound.def_ro(members.name, members.pointer), ...);
    // It is pickled as a call of its constructor.
    bound.def("__reduce__", [members...](nb::handle self) {
        return nb::make_tuple(self.type(), nb::make_tuple(self.attr(members.name)...));
    });
    return bound;
}

inline constexpr auto unchecked = [](const auto&) {};

// The members of a struct of results: names, each followed by its member, or by what returns its value. Lists of
// numbers are arrays.
template <class T>
void show(nb::class_<T>&) {}
template <class T, class Read, class... More>
void show(nb::class_<T>& bound, const char* name, Read read, More... more) {
    using Value = std::remove_cvref_t<std::invoke_result_t<Read, const T&>>;
    if constexpr (std::is_same_v<Value, Doubles>)
        bound.def_prop_ro(name, [read](const T& self) { return array_of(std::invoke(read, self)); });
    else if constexpr (std::is_member_object_pointer_v<Read>) bound.def_ro(name, read);
    else bound.def_prop_ro(name, read);
    show(bound, more...);
}
template <class T, class... Members>
nb::class_<T> bind_result(nb::module_& module, const char* name, const char* text, Members... members) {
    nb::class_<T> bound(module, name, text);
    show(bound, members...);
    return bound;
}

// Constants of a class: names, each followed by its value.
template <class Bound, class Value, class... More>
void constants(Bound& bound, const char* name, Value value, More... more) {
    bound.attr(name) = value;
    if constexpr (sizeof...(more) > 0) constants(bound, more...);
}

}  // namespace pinproof
