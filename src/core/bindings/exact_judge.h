// Calls back into Python for pairs of bodies that only coal can measure.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include "bindings/arrays.h"
#include "certificate/curve_proof.h"

namespace pinproof {

// `object` has the methods measure(q, pair) -> (attained, proven) and any_contact(q, pairs) -> bool.
class PythonJudge : public ExactJudge {
public:
    PythonJudge(nb::object object, std::size_t dof) : object_(std::move(object)), dof_(dof) {}

    void measure(const double* q, std::span<const int> pairs, std::span<ExactDistance> found) override {
        nb::gil_scoped_acquire acquire;
        using Answers = std::vector<std::pair<double, double>>;
        const auto answers = nb::cast<Answers>(object_.attr("measure")(array(q), list(pairs)));
        require_size("the list of distances", answers.size(), found.size());
        for (std::size_t i = 0; i < found.size(); ++i) found[i] = {answers[i].first, answers[i].second};
    }

    bool any_contact(const double* q, std::span<const int> pairs) override {
        nb::gil_scoped_acquire acquire;
        return nb::cast<bool>(object_.attr("any_contact")(array(q), list(pairs)));
    }

private:
    NewArray array(const double* q) const { return array_of(std::span(q, dof_)); }
    static std::vector<int> list(std::span<const int> pairs) { return {pairs.begin(), pairs.end()}; }

    nb::object object_;
    std::size_t dof_;
};

}  // namespace pinproof
