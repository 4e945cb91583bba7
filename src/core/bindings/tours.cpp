// The order of jobs with options.
#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "planning/tour_search.h"

namespace pinproof {
namespace {

TourProblem problem_of(const Indices& job, const Matrix& time, const IndexMatrix& pairs) {
    const std::size_t options = job.shape(0);
    if (options == 0) throw std::invalid_argument("job is empty");
    require_size("time", time.shape(0), options + 1);
    require_size("a row of time", time.shape(1), options + 1);
    require_finite("time", time.data(), time.size());
    if (pairs.shape(0) > 0) require_size("a pair", pairs.shape(1), 2);
    TourProblem problem;
    for (std::size_t k = 0; k < options; ++k) {
        const bool next = k == 0 ? job(k) == 0 : job(k) == job(k - 1) || job(k) == job(k - 1) + 1;
        if (!next) throw std::invalid_argument("job must ascend from 0 without gaps");
        problem.job.push_back(static_cast<int>(job(k)));
    }
    problem.time.assign(time.data(), time.data() + time.size());
    for (std::size_t k = 0; k < pairs.shape(0); ++k) {
        for (int side : {0, 1})
            if (pairs(k, side) < 0 || pairs(k, side) >= problem.jobs()) throw std::invalid_argument("no such job");
        problem.pairs.emplace_back(pairs(k, 0), pairs(k, 1));
    }
    return problem;
}

// The first tour, in which every job occurs once, in an order that satisfies the pairs.
std::vector<int> first_of(const TourProblem& problem, const Indices& first) {
    require_size("first", first.shape(0), static_cast<std::size_t>(problem.jobs()));
    std::vector<int> tour, place(problem.jobs(), -1);
    for (std::size_t k = 0; k < first.shape(0); ++k) {
        if (first(k) < 0 || first(k) >= problem.options()) throw std::invalid_argument("no such option");
        tour.push_back(static_cast<int>(first(k)));
        int& at = place[problem.job[tour.back()]];
        if (at >= 0) throw std::invalid_argument("first has two options of a job");
        at = static_cast<int>(k);
    }
    for (const auto& [before, after] : problem.pairs)
        if (place[before] >= place[after]) throw std::invalid_argument("first violates a pair");
    return tour;
}

}  // namespace

void bind_tours(nb::module_& module) {
    module.def(
        "search_tour",
        [](const Indices& job, const Matrix& time, const IndexMatrix& pairs, const Indices& first, const Matrix& draws) {
            if (draws.shape(0) > 0) require_size("a row of draws", draws.shape(1), TourSearch::kDraws);
            require_draws(draws);
            TourProblem problem = problem_of(job, time, pairs);
            const std::vector<int> start = first_of(problem, first);
            std::vector<int> found;
            {
                nb::gil_scoped_release release;
                TourSearch search(std::move(problem), start);
                search.search({draws.data(), draws.size()});
                found = search.tour();
            }
            auto out = new_array<std::int64_t>({found.size()});
            std::copy(found.begin(), found.end(), out.data);
            return nb::cast(out.array);
        },
        nb::arg("job"), nb::arg("time"), nb::arg("pairs"), nb::arg("first"), nb::arg("draws"),
        "A short tour: the option of each job in order (n,), from the jobs of all options (M,), the times between them "
        "and home (M + 1, M + 1), pairs of jobs in a fixed order (K, 2), a first tour (n,), and random numbers "
        "(disturbances, 8) in [0, 1).");
}

}  // namespace pinproof
