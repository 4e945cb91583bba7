// Structs of the core in Python: a constructor with an argument for each member, which it checks, and read-only members.
#pragma once

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

#include "bindings/arrays.h"

namespace pinproof {

// How a member is passed from Python: as an array, if it is one.
template <class Value>
inline constexpr bool kIsArray = false;
template <std::size_t size>
inline constexpr bool kIsArray<std::array<double, size>> = true;
template <class Value>
inline constexpr bool kIsVector = std::is_same_v<Value, Vec3> || std::is_same_v<Value, Doubles> || kIsArray<Value>;
template <class Value>
inline constexpr bool kIsMatrix = std::is_same_v<Value, Transform> || std::is_same_v<Value, Mat3>;
template <class Value>
using Passed = std::conditional_t<kIsVector<Value>, Vector, std::conditional_t<kIsMatrix<Value>, Matrix, Value>>;

// A member with its name in Python. Numbers must be finite, except those of lists and of members that may be infinite.
template <class T, class Value, bool optional>
struct Member {
    const char* name;
    Value T::* pointer;
    bool may_be_infinite;

    using Type = const Passed<Value>&;
    auto argument() const {
        if constexpr (optional) return nb::arg(name) = T{}.*pointer;
        else return nb::arg(name);
    }
    void read(T& out, Type value) const {
        Value& to = out.*pointer;
        if constexpr (std::is_same_v<Value, Doubles>) to = list_of(shaped(name, value, {kAny}));
        else if constexpr (std::is_same_v<Value, Vec3>) to = vec3(name, value);
        else if constexpr (std::is_same_v<Value, Transform>) to = transform(name, value);
        else if constexpr (std::is_same_v<Value, Mat3>) std::ranges::copy(finite(name, value, {3, 3}), &to.m[0][0]);
        else if constexpr (kIsArray<Value>) std::ranges::copy(finite(name, value, {to.size()}), to.begin());
        else to = value;
        if constexpr (std::is_same_v<Value, double>)
            if (std::isnan(value) || (std::isinf(value) && !may_be_infinite)) finite(name, value);
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

// Members that have the same name in Python: MEMBERS, LIMITS and OPTIONALS for bind_struct, FIELDS for bind_result.
// EACH(of, T, a, b, ...) is of(T, a), of(T, b), ..., for up to 26 names.
#define EACH(of, T, ...) EXPAND(EACH_NEXT(of, T, __VA_ARGS__))
#define EACH_NEXT(of, T, name, ...) of(T, name) __VA_OPT__(, EACH_LATER PARENTHESES (of, T, __VA_ARGS__))
#define EACH_LATER() EACH_NEXT
#define PARENTHESES ()
#define EXPAND(...) EXPAND_9(EXPAND_9(EXPAND_9(__VA_ARGS__)))
#define EXPAND_9(...) EXPAND_3(EXPAND_3(EXPAND_3(__VA_ARGS__)))
#define EXPAND_3(...) EXPAND_1(EXPAND_1(EXPAND_1(__VA_ARGS__)))
#define EXPAND_1(...) __VA_ARGS__
#define FIELD(T, name) #name, &T::name
#define MEMBER(T, name) member(FIELD(T, name))
#define LIMIT(T, name) limit(FIELD(T, name))
#define OPTIONAL(T, name) optional(FIELD(T, name))
#define FIELDS(...) EACH(FIELD, __VA_ARGS__)
#define MEMBERS(...) EACH(MEMBER, __VA_ARGS__)
#define LIMITS(...) EACH(LIMIT, __VA_ARGS__)
#define OPTIONALS(...) EACH(OPTIONAL, __VA_ARGS__)

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
