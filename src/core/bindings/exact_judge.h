// Calls back into Python for pairs of bodies that only coal can measure.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>

#include <algorithm>

#include "bindings/arrays.h"
#include "certificate/curve_proof.h"

namespace pinproof {

// `object` has the methods measure(q, pair) -> (attained, proven) and any_contact(q, pairs) -> bool.
class PythonJudge : public ExactJudge {
public:
    PythonJudge(nb::object object, std::size_t dof) : object_(std::move(object)), dof_(dof) {}

    void measure(const double* q, std::span<const int> pairs, std::span<ExactDistance> found) override {
        nb::gil_scoped_acquire acquire;
        const nb::list answers = nb::cast<nb::list>(object_.attr("measure")(array(q), list(pairs)));
        require_size("the list of distances", answers.size(), found.size());  // Reading a list checks no index.
        for (std::size_t i = 0; i < found.size(); ++i) {
            const auto [attained, proven] = nb::cast<std::pair<double, double>>(answers[i]);
            found[i] = {attained, proven};
        }
    }

    bool any_contact(const double* q, std::span<const int> pairs) override {
        nb::gil_scoped_acquire acquire;
        return nb::cast<bool>(object_.attr("any_contact")(array(q), list(pairs)));
    }

private:
    nb::object array(const double* q) const {
        auto copy = new_array({dof_});
        std::copy_n(q, dof_, copy.data);
        return nb::cast(copy.array);
    }
    static nb::list list(std::span<const int> pairs) {
        nb::list indices;
        for (int pair : pairs) indices.append(pair);
        return indices;
    }

    nb::object object_;
    std::size_t dof_;
};

}  // namespace pinproof
