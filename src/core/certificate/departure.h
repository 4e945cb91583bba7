// Proofs that a body moving away from an obstacle never approaches it along one direction.
//
// Let n be a unit vector that is fixed with the obstacle, and
//
//     g(t) = min_{y in body} n . y(t) - max_{x in obstacle} n . x .
//
// If g is positive, the two are at least g apart; if it is negative, they overlap by -g along n. If no point of the
// body moves against n, g never decreases. The speed of a point y along n is sum_i s_i f_i, with the rates s_i of the
// joints that carry it and f_i = n . (w_i x (y - p_i)), or n . w_i for a prismatic joint.
//
// On an interval every joint j stays within delta_j of its value in the middle. Move there joint by joint, starting
// with the one closest to the root. Joints up to i rotate w_i x (y - p_i) as a whole, and joints beyond i move y by
// their chords, at radii that are those of the middle (motion_bounds.h). So f_i stays within
//
//     epsilon_i = rho_i sum_{j <= i} 2 sin(delta_j / 2) + sum_{j > i} 2 rho_j sin(delta_j / 2)
//
// of its value in the middle (prismatic joints do not rotate, and translate by delta_j). On a polynomial piece the
// rates are s_i(u) = sum_r B_r(u) s_ri, with coefficients that are differences of control points, and nonnegative B_r.
// So g does not decrease if for every r
//
//     L_r = min_y sum_i s_ri f_i(y) - sum_i |s_ri| epsilon_i >= 0 ,
//
// with f_i at the middle, where the sum is linear in y and its minimum is a value of the support function. If some L_r
// are negative, g decreases by at most the sum of their magnitudes. Coefficients are compared instead of values because
// at rest both sides are 0.
//
// Source: R. T. Farouki (2012), "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric
// Design 29, section 3 (differences, hull); the rest is derived here.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "certificate/curve_proof.h"
#include "collision/world.h"

namespace pinproof {

// The span of a curve on which a body is proven not to approach.
struct DepartureProof {
    double end;              // the parameter up to which it is proven
    double until;            // the parameter after which its gap is also larger than required; infinity if not reached
    double stopped;          // the end of the first interval in which the proof failed; `end` if it did not fail
    std::int64_t intervals;  // their number
    double gap;              // m, at `end`
};

// Upper bounds over a piece of a curve.
struct GapDecrease {
    double decrease;  // m, of the gap
    double motion;    // m, of the points of the body
};

// The largest direction . x over the points x of a placed convex shape; of a half-space, along its own normal.
double extent(const Shape& shape, const Transform& root_from_shape, const Vec3& direction);

// The motion of a body of the robot along one direction, away from something that does not move. Each thread needs its
// own.
class Departure {
public:
    // `hull` is a convex shape with the points of the body in its frame, `normal` the unit vector in the root frame, and
    // `level` the extent (m) of the obstacle along it.
    Departure(std::shared_ptr<const Geometry> space, int body, std::shared_ptr<const Shape> hull, const Vec3& normal,
              double level);

    std::size_t dof() const { return space_->tree.dof; }

    // The gap (m) at q (dof): a lower bound of the distance, negative in overlap.
    double gap(const double* q);

    // Bounds over a piece with `points` control points (points, dof).
    GapDecrease decrease(const double* piece, std::size_t points);

    // Follow a curve as long as the body is proven not to approach. Beyond the gap `enough` (m) it has separated; an
    // interval in which it moves by less than `tolerance` (m) is not bisected further.
    DepartureProof follow(const CurveView& curve, double enough, double tolerance, std::int64_t max_intervals);

private:
    void place_at(const double* q);
    double reach(const Vec3& direction) const { return extent(*hull_, at_.root_from_body, direction); }
    double crossing(double start, double stop, std::vector<double> part, double enough);

    std::shared_ptr<const Geometry> space_;
    int body_;
    std::shared_ptr<const Shape> hull_;
    Vec3 normal_;
    double level_;
    std::vector<int> chain_;       // the joints that carry the body, from the root outwards
    std::vector<Transform> axes_;  // their placements
    PlacedBody at_;
    std::vector<double> left_, right_;                  // the halves of a piece
    std::vector<double> deviation_, along_;             // of each joint of the chain: epsilon_i, and f_i = along_i +
    std::vector<Vec3> turned_;                          // turned_i . y
};

}  // namespace pinproof
