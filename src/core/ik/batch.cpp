#include "ik/batch.h"

#include <algorithm>

#include "common/threads.h"

namespace pinproof {

void solve_batch(const IkSolver& solver, const Seeds& seeds, const Goal& goal, const double* targets, const double* q0,
                 std::size_t rows, long long count, std::size_t threads, const BatchResults& out) {
    const std::size_t n = solver.chain.dof;
    for_each_block(rows, threads, [&] {
        return [&, search = Search(solver, seeds, goal)](std::size_t first, std::size_t last) mutable {
            for (std::size_t row = first; row < last; ++row) {
                search.begin(read_transform(targets + 16 * row), q0 + n * row);
                const Candidate& found = search.next(count, true);
                std::copy(found.q.begin(), found.q.end(), out.q + n * row);
                out.position_error[row] = found.error.position;
                out.orientation_error[row] = found.error.orientation;
                out.fulfils[row] = found.fulfils;
                out.iterations[row] = found.iterations;
                out.attempts[row] = found.attempts;
            }
        };
    });
}

}  // namespace pinproof
