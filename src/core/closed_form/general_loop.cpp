#include "closed_form/general_loop.h"

#include <algorithm>
#include <cmath>

#include "closed_form/prismatic_loop.h"
#include "geometry/sincos.h"

namespace pinproof {
namespace {

constexpr double kSameRoot = 1e-7;  // rad: configurations that differ by less in every joint are the same

// Lengths of the arm and rad. A configuration with a smaller residual after Newton's method solves the loop; one with the
// larger value may do so where the Jacobian is singular, and is left to the refinement on the chain.
constexpr double kSolved = 1e-11, kNearlySolved = 1e-4;

// A configuration whose Jacobian has a smaller pivot may be a double root or belong to a self-motion. At the distance d from
// a double root, the residual is about d^2 and the pivot d, so this must exceed the square root of kSolved.
constexpr double kRegular = 1e-5;

// A unit vector and one of half the arm's length, in general position.
constexpr Vec3 kBesideAxis{0.48, -0.6, 0.64}, kBesideShift{0.31, 0.27, -0.28};

constexpr int kMostCuts = 4;
constexpr double kReliable = 0.75;  // share of the trials that a cut must solve completely

Transform loop_at(const LoopLine (&lines)[6], const double (&q)[6]) {
    Transform product;
    for (int k = 0; k < 6; ++k) product = product * motion_of(lines[k], q[k]);
    return product;
}

}  // namespace

void LoopRoots::add(const LoopRoot& one) {
    for (int i = 0; i < count; ++i)
        if (same_configuration(one.q, root[i].q, 6, kSameRoot)) return;
    if (count == kMost) {
        too_many = true;
        return;
    }
    root[count++] = one;
}

bool LoopRoots::all_regular() const {
    return std::all_of(root, root + count, [](const LoopRoot& r) { return r.weakest > kRegular; });
}

void GeneralLoop::find_starts(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real) {
    if (is_prismatic_loop(lines)) {
        solve_prismatic_loop(lines, g, cut, nearly_real, result_);
    } else {
        solve_by_elimination(lines, g, cut, nearly_real, result_);
    }
}

void GeneralLoop::polish(const LoopLine (&lines)[6], const Transform& g, LoopRoots& roots) const {
    for (int i = 0; i < result_.count; ++i) {
        LoopRoot root;
        std::copy_n(result_.start[i], 6, root.q);
        const PolishedLoop polished = polish_loop(lines, g, root.q);
        root.weakest = polished.residual < kSolved ? polished.weakest : 0.0;
        if (polished.residual < kNearlySolved) roots.add(root);
    }
}

int GeneralLoop::solve(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, LoopRoots& roots) {
    find_starts(lines, g, cut, kNearlyReal);
    polish(lines, g, roots);
    return result_.usable ? result_.existing : kUnknown;
}

void GeneralLoop::solve_beside(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double amount,
                               LoopRoots& roots) {
    find_starts(lines, beside(g, amount), cut, amount);
    LoopRoots found;
    polish(lines, g, found);
    for (int i = 0; i < found.count; ++i)
        if (found.root[i].weakest > kRegular) roots.add(found.root[i]);
}

Transform beside(const Transform& g, double amount) {
    const auto [sine, cosine] = sincos(amount);
    return {g.rotation * rotation_about(kBesideAxis, sine, cosine), g.translation + amount * kBesideShift};
}

std::vector<Cut> choose_cuts(const std::vector<LoopTrial>& trials) {
    struct Scored {
        Cut cut;
        int complete;
    };
    std::vector<Scored> scored;
    GeneralLoop loop;
    for (int dropped = 0; dropped < 6; ++dropped)
        for (const bool reversed : {false, true}) {
            const Cut cut{dropped, reversed, false};
            int complete = 0;
            for (const LoopTrial& trial : trials) {
                LoopRoots roots;
                if (!roots.all_of(loop.solve(trial.lines, loop_at(trial.lines, trial.q), cut, roots))) continue;
                complete += std::any_of(roots.root, roots.root + roots.count,
                                        [&](const LoopRoot& r) { return same_configuration(r.q, trial.q, 6, kSameRoot); });
            }
            if (complete >= kReliable * static_cast<double>(trials.size())) scored.push_back({cut, complete});
        }
    std::stable_sort(scored.begin(), scored.end(),
                     [](const Scored& a, const Scored& b) { return a.complete > b.complete; });
    std::vector<Cut> cuts;
    for (const bool shifted : {false, true})
        for (const Scored& one : scored)
            if (cuts.size() < kMostCuts) cuts.push_back({one.cut.dropped, one.cut.reversed, shifted});
    return cuts;
}

}  // namespace pinproof
