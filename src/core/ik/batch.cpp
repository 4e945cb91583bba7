#include "ik/batch.h"

#include <algorithm>
#include <vector>

#include "common/threads.h"

namespace pinproof {

void solve_batch(const IkSolver& solver, const Seeds& seeds, const Goal& goal, const double* targets, const double* q0,
                 std::size_t rows, long long count, std::size_t threads, const BatchResults& out) {
    const std::size_t n = solver.chain.dof;
    const auto begin = [&](Search& search, std::size_t row) {
        search.begin(read_transform(targets + 16 * row), q0 + n * row);
    };
    const auto done = [&](const Candidate& found, std::size_t row) {
        std::copy(found.q.begin(), found.q.end(), out.q + n * row);
        out.position_error[row] = found.error.position;
        out.orientation_error[row] = found.error.orientation;
        out.fulfils[row] = found.fulfils;
        out.iterations[row] = found.iterations;
        out.attempts[row] = found.attempts;
    };
    share_rows(rows, threads, [&] {
        return [&, engine = SearchEngine(solver), searches = std::vector<Search>(kLanes, Search(solver, seeds, goal))](
                   Rows& all) mutable { engine.solve_rows(searches, all, count, begin, done); };
    });
}

}  // namespace pinproof
