// Motion in joint space that satisfies constraints of tcps: projection, and steps whose edges are proven.
//
// Source: D. Berenson, S. Srinivasa, J. Kuffner (2011), "Task space regions: a framework for pose-constrained
// manipulation planning", IJRR 30(12): projection by the pseudo-inverse of the Jacobian, and the constrained extension of
// CBiRRT2. There a step is accepted if its end satisfies the constraints; here its edge is proven.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "certificate/path_constraint.h"
#include "planning/edge_checker.h"

namespace pinproof {

class Manifold {
public:
    // The limits (dof) may be infinite. The errors are those of the constraints of the first tcp, then of the next.
    Manifold(std::vector<ConstrainedTcp> tcps, std::vector<double> lower, std::vector<double> upper);

    std::size_t dof() const { return lower_.size(); }
    std::size_t size() const;

    // The error of each constraint at q.
    void errors(const double* q, double* found);
    // Whether all constraints are satisfied at q.
    bool contains(const double* q) { return within(q, 1.0); }
    // Move q to a configuration within the limits at which every error is at most `share` of its tolerance, along the
    // shortest joint motion to first order. False: the iteration did not converge, and q is undefined.
    bool project(double* q, double share);
    // Whether every constraint is proven on the straight edge from a to b.
    bool edge_proven(const double* a, const double* b);

    // A step from a configuration that satisfies the constraints towards a target, at most `length` long before its
    // projection. The edge to `end` is proven. If the target is within reach and satisfies the constraints, `end` is
    // the target itself. False: no step comes closer to the target.
    bool step(const double* from, const double* target, double length, double* end);

    // Steps from a to b whose edges have free samples; (k, dof) waypoints after a, the last of which is b, appended to
    // `path`. False: b is not reached, or only on a path longer than `most`.
    bool connect(EdgeChecker& edges, const double* a, const double* b, double length, double most,
                 std::vector<double>& path);

private:
    bool within(const double* q, double share);
    bool solve(std::vector<double>& step);

    std::vector<ConstrainedTcp> tcps_;
    std::vector<double> lower_, upper_, no_tolerance_, control_, step_;
    std::vector<bool> fixed_;
    std::vector<ConstraintEquation> equations_;
    std::vector<double> gram_, right_;
};

}  // namespace pinproof
