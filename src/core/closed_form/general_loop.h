// All configurations of a loop of six revolute joints in general position.
#pragma once

#include <vector>

#include "closed_form/elimination.h"

namespace pinproof {

// A configuration of the loop.
struct LoopRoot {
    double q[6];
    double weakest;  // the smallest pivot of the Jacobian; 0 also if Newton's method did not converge
};

// The distinct configurations found so far, by one or several cuts.
struct LoopRoots {
    static constexpr int kMost = kEigenRows;  // a loop with more has infinitely many

    int count = 0;
    LoopRoot root[kMost];
    bool too_many = false;

    void add(const LoopRoot& one);
    int regular_count() const;
};

class GeneralLoop {
  public:
    // Add the configurations of E_0 ... E_5 = g that one cut of the loop finds. Returns whether no other exist: all 16
    // eigenvalues are certainly complex or belong to a regular configuration.
    bool solve(const RevoluteLine (&lines)[6], const Transform& g, const Cut& cut, LoopRoots& roots);

  private:
    Elimination elimination_;
    EliminationResult result_;
};

// A random configuration of the loop, of a trial.
struct LoopTrial {
    RevoluteLine lines[6];
    double q[6];
};

// The cuts that find all configurations in most trials, best first; none if the elimination fails for this arm.
std::vector<Cut> choose_cuts(const std::vector<LoopTrial>& trials);

}  // namespace pinproof
