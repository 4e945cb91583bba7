// Proofs that a body moving away from an obstacle never approaches it along one direction.
//
// Let n be a unit vector that is fixed with the obstacle. The gap g is the least n . y over the points y of the body less
// the extent of the obstacle: a positive gap is a distance, a negative one an overlap along n. It does not decrease on a
// piece of a curve if for every coefficient r of the rates s_r of the joints
//
//     L_r = min_y sum_i s_ri f_i(y) - sum_i |s_ri| epsilon_i >= 0 ,
//
// where f_i = n . (w_i x (y - p_i)), or n . w_i for a prismatic joint, is the speed of a point along n per rate of joint i
// at the middle, and epsilon_i bounds its change over the piece. If some L_r are negative, g decreases by at most the sum
// of their magnitudes. The derivation is in docs/mathematics.md, "Contact at the start".
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
