// Constraints of the tcp along a curve: their error at a configuration, and a bound of it in a box about one.
//
// Every constraint states that a point y, which the joints move, is in a closed convex set: a cone of directions about
// an axis, or the points within the tolerance of a box.
//
//     direction  y = R a, the axis a of the tcp, as a point on the unit sphere; cone about a direction of the base
//     region     y = R c + p, a point of the tcp; box in the base frame, whose sides may be 0 or infinite
//     target     y = the target as it moves relative to the tcp; cone about the axis of the tcp with its apex there
//
// The joints are moved one after another, the one closest to the frame of the set first (for a target: the last joint of
// the chain, in reverse). With the images y_r of the control points of a piece to first order, and the remainder rem,
//
//     distance <= max_r distance(y_r) + rem,    angle <= max_r angle(y_r, u) + asin(rem / min_r u . y_r)
//
// for the axis u of a cone. The derivation is in docs/mathematics.md, "Constraints of the tcp".
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "certificate/curve_proof.h"
#include "certificate/motion_bounds.h"
#include "kinematics/chain.h"

namespace pinproof {

enum class ConstraintKind { kDirection, kRegion, kTarget };

struct PathConstraint {
    ConstraintKind kind = ConstraintKind::kDirection;
    Vec3 axis;                // kDirection, kTarget: unit vector in the tcp frame
    Vec3 point;               // kDirection: unit vector in the base frame; kRegion: point in the tcp frame (m);
                              // kTarget: point in the base frame (m)
    Transform base_from_box;  // kRegion
    Vec3 low, high;           // kRegion: corners of the box (m)
    double tolerance = 0.0;   // largest allowed error: rad, or m for a region
};

// A linear equation of the rates of q that reduces the error of a constraint.
struct ConstraintEquation {
    std::vector<double> row;  // (dof)
    double right;
};

// The tcp of a chain at a configuration, and its constraints there.
class ConstrainedTcp {
public:
    ConstrainedTcp(Chain chain, std::vector<PathConstraint> constraints);

    std::size_t dof() const { return chain_.dof; }
    std::size_t size() const { return constraints_.size(); }
    double tolerance(std::size_t i) const { return constraints_[i].tolerance; }

    // Place the joints and the tcp at q (dof), which must be finite.
    void place(const double* q);

    // The error (rad or m) of constraint i at the placed configuration; pi if the direction to a target is undefined.
    double error(std::size_t i) const;

    // A bound (rad or m) of the error of constraint i on a piece of a curve: its control points (points, dof) are about
    // `middle`, the placed configuration, entry j of q stays within delta[j] of it, and may deviate by extra[j] more.
    // `change` is the part of the bound that a bisection of the piece reduces.
    struct Bound {
        double error, change;
    };
    Bound bound(std::size_t i, const double* control, std::size_t points, const double* middle, const double* delta,
                const double* extra) const;

    // Append the equations of a Newton step to the nearest configuration with the given error, if the present error of
    // constraint i is larger.
    void append_equations(std::size_t i, double wanted, std::vector<ConstraintEquation>& equations) const;

    // What is added (rad or m) to every bound for floating-point errors; it grows with large joint values.
    double rounding() const { return rounding_; }

private:
    struct Axis {
        Vec3 origin, direction;
    };

    Vec3 velocity(std::size_t k, const Vec3& point) const;

    Chain chain_;
    std::vector<PathConstraint> constraints_;
    std::vector<Axis> axes_;
    Transform tcp_;
    double reach_, rounding_;
};

// The proof that a whole curve satisfies a constraint: intervals in path order, bisected until each is decided.
struct ConstraintSettings {
    double resolution = 1e-6;           // rad or m; an interval with less motion is not bisected further
    std::int64_t max_intervals = 2000;  // after which the rest of the curve is undecided
    double goal_share = 0.0;            // prove this share of the difference of the tolerance and the largest error found
    std::int64_t look_ahead = 0;        // intervals to check for a violation after an undecided span
    bool record = false;                // store the proven intervals
};

struct FoundViolation {
    double time, error;
    std::vector<double> q;
};

struct UndecidedConstraint {
    double start, end, error;  // error: the largest found there (rad or m)
};

struct ProvenInterval {
    double start, end;
};

struct ConstraintState {
    std::int64_t intervals = 0;
    double observed = 0.0;  // the largest error found (rad or m)
    double proven = 0.0;    // the largest bound of the error on the proven intervals
    std::optional<FoundViolation> violation;
    std::optional<UndecidedConstraint> open;  // the first undecided span
    std::vector<ProvenInterval> evidence;

    bool satisfied() const { return !violation && !open; }
};

// Prove constraint i on a curve, or find a violation, the first one up to the resolution.
ConstraintState prove_constraint(ConstrainedTcp& tcp, std::size_t i, const CurveView& curve,
                                 const ConstraintSettings& settings, const double* joint_tolerance);

}  // namespace pinproof
