// Switchable mistakes for scripts/mutants.py, which copies this file into a copy of the core and inserts calls at operators.
// `a < Mark<7>{} < b` is `a < b`, and `a >= b` if the environment variable PINPROOF_MUTANT is 7 when the core is loaded.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <type_traits>

extern "C" {
__attribute__((visibility("default"))) inline unsigned char pinproof_reached[4096] = {};
}

namespace pinproof::mutation {

inline const int active = std::getenv("PINPROOF_MUTANT") ? std::atoi(std::getenv("PINPROOF_MUTANT")) : 0;

// Whether a mistake is switched on; the place has been reached. Threads write the same value.
inline bool on(int number) {
    __atomic_store_n(&pinproof_reached[number], static_cast<unsigned char>(1), __ATOMIC_RELAXED);
    return active == number;
}

template <int N>
struct Mark {};

template <int N, char K, class A>
struct Left {
    const A& value;
};

#define PINPROOF_OPERATOR(name, right, wrong)                                                   \
    template <class A, int N>                                                                   \
    Left<N, name, A> operator right(const A& a, Mark<N>) {                                      \
        return {a};                                                                             \
    }                                                                                           \
    template <int N, class A, class B>                                                          \
    auto operator right(Left<N, name, A> left, const B& b) {                                    \
        using Result = std::remove_cvref_t<decltype(left.value right b)>;                       \
        if constexpr (requires { static_cast<Result>(left.value wrong b); }) {                  \
            if (on(N)) return static_cast<Result>(left.value wrong b);                          \
        } else if constexpr (requires { static_cast<Result>(-(left.value right b)); }) {        \
            if (on(N)) return static_cast<Result>(-(left.value right b));                       \
        } else {                                                                                \
            if (on(N)) return static_cast<Result>(b);                                           \
        }                                                                                       \
        return static_cast<Result>(left.value right b);                                         \
    }

PINPROOF_OPERATOR('<', <, >=)
PINPROOF_OPERATOR('>', >, <=)
PINPROOF_OPERATOR('l', <=, >)
PINPROOF_OPERATOR('g', >=, <)
PINPROOF_OPERATOR('=', ==, !=)
PINPROOF_OPERATOR('!', !=, ==)
PINPROOF_OPERATOR('+', +, -)
PINPROOF_OPERATOR('-', -, +)
PINPROOF_OPERATOR('*', *, /)
PINPROOF_OPERATOR('/', /, *)
#undef PINPROOF_OPERATOR

template <int N, class T>
T max(const T& a, const T& b) {
    return on(N) ? std::min(a, b) : std::max(a, b);
}

template <int N, class T>
T min(const T& a, const T& b) {
    return on(N) ? std::max(a, b) : std::min(a, b);
}

template <int N>
double number(double value) {
    return on(N) ? 2.0 * value : value;
}

}  // namespace pinproof::mutation
