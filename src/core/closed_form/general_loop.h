// All configurations of a loop of six joints in general position.
#pragma once

#include <vector>

#include "closed_form/elimination.h"
#include "kinematics/joint_range.h"

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
    // Whether these are all configurations if at most this many exist.
    bool all_of(int existing) const { return !too_many && all_regular() && count >= existing; }

  private:
    bool all_regular() const;
};

class GeneralLoop {
  public:
    // Add the configurations of E_0 ... E_5 = g that one cut of the loop finds. Returns how many exist at most; kUnknown if
    // the equations fail.
    int solve(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, LoopRoots& roots);

    // As above, but starts are found for a slightly different g: configurations that share the value of joint 3 have a
    // multiple eigenvalue, whose eigenvectors are combinations of theirs, and separate there.
    void solve_beside(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double amount,
                      LoopRoots& roots);

    static constexpr int kUnknown = kEigenRows + 1;

    // Configurations near the eigenvalues that are real or perhaps a double real one, before Newton's method.
    const EliminationResult& starts(const LoopLine (&lines)[6], const Transform& g, const Cut& cut) {
        find_starts(lines, g, cut, kPerhapsReal);
        return result_;
    }

  private:
    void find_starts(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real);
    void polish(const LoopLine (&lines)[6], const Transform& g, LoopRoots& roots) const;

    EliminationResult result_;
};

// A random configuration of the loop, of a trial.
struct LoopTrial {
    LoopLine lines[6];
    double q[6];
};

// A target at this distance from g (lengths of the arm and rad), in general position.
Transform beside(const Transform& g, double amount);

// The cuts that find all configurations in most trials, best first; none if the elimination fails for this arm.
std::vector<Cut> choose_cuts(const std::vector<LoopTrial>& trials);

}  // namespace pinproof
