// A bound on how much closer two bodies can come while the joints stay in a box about a configuration.
//
// Let every joint i between bodies a and b stay within delta_i of its value, and fix any link L between them. The joints
// from L to b are moved one after another, the one closest to L first, so that each carries everything beyond it as it is
// at the configuration; likewise from L to a. For an obstacle, L is the root.
//
// Simple bound: points move by at most the chord 2 rho_i sin(delta_i / 2), where rho_i is the largest distance of a point
// of the body from axis i (for a prismatic joint: delta_i). L is chosen such that the sum is smallest. Exchanging a and b
// for single joints, without a link that separates them, or using the smallest radius instead, would be wrong.
//
// Tight bound: only motion along a unit vector u that is fixed in L counts. The first-order terms theta_i w_i x (y - p_i)
// are summed over the joints before the maximum over the body is taken, so that opposite motions cancel. The remainder is
// due to the inner rotations and to the curvature of the arcs.
//
// The derivation is in docs/mathematics.md, "Motion bounds". Sources: F. Schwarzer, M. Saha, J.-C. Latombe (2005),
// "Adaptive dynamic collision checking for single and multiple articulated robots in complex environments", IEEE
// Transactions on Robotics 21(3), section III; S. Quinlan (1994), "Real-time modification of collision-free paths", PhD
// thesis, Stanford, chapter 3.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "collision/world.h"

namespace pinproof {

// rad or m. The growth of the tight bound with the box holds for boxes that are larger by at most this.
inline constexpr double kGrowthRange = 0.05;

// The motion of one joint within the box.
struct JointSwing {
    double chord;       // of its rotation at radius 1: 2 sin(delta / 2); delta of a prismatic joint
    double bend;        // the deviation of that rotation from first order: delta - sin(delta) + 1 - cos(delta)
    double angle;       // delta
    double bare_chord;  // the chord without the tolerance that is added to every joint
    double share;       // |multiplier|: motion of the joint per motion of its entry of q
};

// The motion of a joint while its entry of q stays within delta + extra of its value.
JointSwing swing_of(bool prismatic, double multiplier, double delta, double extra);
inline JointSwing swing_of(const Joint& joint, double delta, double extra) {
    return swing_of(joint.prismatic, joint.multiplier, delta, extra);
}

// A first-order motion of a rigid body: its points x, in the root frame, move by shift + turn x x.
struct Displacement {
    Vec3 shift, turn;

    Vec3 of(const Vec3& x) const { return shift + cross(turn, x); }
};
inline Displacement operator-(const Displacement& a, const Displacement& b) { return {a.shift - b.shift, a.turn - b.turn}; }

// How much closer two bodies can come.
struct Approach {
    double distance;  // m
    double growth;    // its growth per rad or m by which the box grows in every joint
    double bare;      // the distance without the tolerance of the joints
    int split;        // the number of joints, from a, that are assigned to the points of a; the others to those of b

    // Add the motion of a joint at a radius.
    void add(double radius, const JointSwing& swing) {
        distance += radius * swing.chord;
        growth += radius * swing.share;
        bare += radius * swing.bare_chord;
    }
};

// The largest g . x over the points x of a body about its centre, by its box or by its ball.
double extent(const PlacedBody& body, const Shape& shape, const Vec3& g);

// The largest distance of a point of a placed body from the axis of a joint, by its bounding ball; 1 if prismatic.
double radius_about(const Joint& joint, const Transform& axis, const PlacedBody& body, const Shape& shape);

// The bounds for all pairs of a world about one configuration.
class MotionBounds {
public:
    explicit MotionBounds(const World& world);

    // Choose the configuration and the box: `bodies` are placed at its middle, and entry i of q stays within
    // delta[i] + extra[i]. They must outlive the bounds.
    void set(const Placement& bodies, const double* delta, const double* extra);

    // The simple bound.
    Approach rough(const Pair& pair) const {
        return pair.with_obstacle ? of_body_[static_cast<std::size_t>(pair.a)] : rough_between(pair);
    }
    // The simple bound of a body of the robot and any obstacle.
    const Approach& rough_to_obstacles(int body) const { return of_body_[static_cast<std::size_t>(body)]; }

    // Choose a piece of a curve, with control points (points, dof) about the middle of the box, for tight bounds.
    void set_piece(const double* control, int points, const double* middle);

    // The tight bound (m) of the support gap along u, the unit vector in the root frame from a to b, on the piece.
    double tight(const Pair& pair, int split, const Vec3& u) const {
        return first_order(pair, split, u) + remainder(pair, split, &u).distance;
    }
    // The growth of the tight bound with the box.
    double growth(const Pair& pair, int split, const Vec3& u) const { return remainder(pair, split, &u).growth; }

    // The same from above, with every joint as if it moved the bodies along u.
    struct Simple {
        double distance, growth;
    };
    Simple nearly_tight(const Pair& pair, int split, const Vec3& u) const {
        if (pair.with_obstacle) return nearly_tight_to_obstacles(pair.a, u);
        Simple sum = remainder(pair, split, nullptr);
        sum.distance += first_order(pair, split, u);
        return sum;
    }
    Simple nearly_tight_to_obstacles(int body, const Vec3& u) const;

private:
    Approach rough_between(const Pair& pair) const;
    double radius(int body, int joint) const {
        return radius_[static_cast<std::size_t>(body) * swings_.size() + joint];
    }
    double radius_of_any(int body, int joint) const;
    double first_order(const Pair& pair, int split, const Vec3& u) const;
    // What a tight bound adds to the first order, and its growth. Without u every joint moves points by its full speed.
    static Simple remainder_per_radius(const Joint& joint, const JointSwing& swing, const Simple& inner);
    Simple remainder(const Pair& pair, int split, const Vec3* u) const;
    const Displacement& displacement(int row, int joint) const { return displacements_[row * (swings_.size() + 1) + joint + 1]; }

    const World& world_;
    const Placement* bodies_ = nullptr;
    const double* extra_ = nullptr;
    std::vector<JointSwing> swings_;
    std::vector<double> radius_;     // (robot bodies, joints) radius_about; only joints that carry the body or, for a
                                     // pair, are between it and another are set
    std::vector<Approach> of_body_;  // towards anything that is fixed to the root
    std::vector<Simple> remainder_of_;  // of the tight bounds of bodies and obstacles
    std::vector<Simple> per_radius_;    // (joints) see remainder_per_radius, for the root as the separating link
    std::vector<Simple> inner_;         // (1 + joints) sums of the chords and shares of the joints up to each
    std::vector<Displacement> displacements_;  // (control points, 1 + joints) of what a joint carries; the first is that of the root
    int rows_ = 0;               // the control points in use
    bool straight_ = false;      // one end of a straight piece, which is symmetric about its middle
    std::vector<std::vector<int>>
        needed_;  // for each body of the robot the joints between it and another body or the root
};

}  // namespace pinproof
