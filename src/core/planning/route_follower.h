// The route of the tcp in space: straight segments between poses, with optionally rounded corners.
//
// On every piece, with a local parameter u from 0 to 1, the pose is
//
//     position     c - a(u) t + b(u) t'
//     orientation  C exp(-a(u) w) exp(b(u) w')
//
// where (c, C) is a pose, (t, w) the direction of the incoming segment and (t', w') that of the outgoing one, each a
// translation in the base frame and a rotation vector in the tcp frame. On a segment, a = 0 and b is linear.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "geometry/vectors.h"
#include "ik/tracker.h"

namespace pinproof {

struct RouteDirection {
    Vec3 translation, rotation;
};

struct RoutePiece {
    static constexpr std::size_t kCoefficients = 6;

    Transform pose;
    RouteDirection into, out;
    std::array<double, kCoefficients> a, b;  // in the Bernstein basis
    double start, end;                       // parameters of the route
    // The sizes of the derivatives by the parameter of the route are at most these:
    double acceleration;       // of the position
    double turn, turn_change;  // of the angular velocity, and of its derivative

    Transform at(double u) const;
};

struct Route {
    std::vector<RoutePiece> pieces;  // at least one; they follow one another

    const RoutePiece& piece_at(double s) const;
    Transform pose(double s) const;
};

// Joint curves along which the tcp follows a route, on one IK branch and without jumps.
//
// The poses of a route are solved one after another and joined by a spline. The deviation of the tcp from the route is
// bounded at every point of the spline, from samples and second derivatives:
//
// Between two samples at a distance h, a twice differentiable vector D differs from the linear interpolation of its
// values by at most h^2 / 8 sup |D''|. Hence |D| is at most the larger of the two values plus this term. D is
//
// * the difference of the positions, D = p - p_route, with |D''| <= |p''| + |p_route''|;
// * the difference of the orientations as matrices (Frobenius norm), or of one axis. An angle theta between two
//   rotations corresponds to a distance of 2 sqrt(2) sin(theta / 2), between two unit vectors to 2 sin(theta / 2).
//
// For a chain of joints with values theta_k(s), from the base outward k = 1..m, let r_k bound the distance of the tcp
// from the origin of joint k; for a prismatic joint, r_k is replaced by 1. Then
//
//     |p''| <= sum_k r_k |theta_k''| + sum_k r_k |theta_k'| (|theta_k'| + 2 sum_{i<k} |theta_i'|)
//     |w|   <= sum_k |theta_k'|,    |w'| <= sum_k |theta_k''| + sum_{i<k} |theta_i'| |theta_k'|
//
// where the sums over i, and all of w, are over revolute joints: d p / d theta_k = z_k x (p - o_k) has at most the
// length r_k, and a rotation of an inner joint i rotates this vector. With R' = [w] R and R'' = ([w'] + [w]^2) R, the
// Frobenius norm of R'' is at most sqrt(2) (|w'| + |w|^2), and the second derivative of one axis at most |w'| + |w|^2.
//
// Source of the derivatives of the chain: J. Craig, "Introduction to Robotics" (2005), sections 5.6 and 5.7.
struct FollowerSettings {
    double deviation, rotation_deviation;  // m, rad; allowed at every point
    double max_joint_step;                 // rad or m between solved poses
    bool only_complete;  // the curve and the exact end are not wanted of a route that cannot be followed completely
};

// Why a curve ends before its route.
enum class RouteStop {
    kNone,
    kPose,       // a pose cannot be solved
    kDeviation,  // the curve between two poses deviates too much, or may leave the limits
};

// The joint curve along a route: the spline through q at the knots.
struct JointCurve {
    std::vector<double> knots, q, slopes;          // (k), (k, n), (k, n)
    double deviation = 0.0, rotation_deviation = 0.0;  // upper bounds

    RouteStop stop = RouteStop::kNone;
    // kPose: the parameter of the pose, and the configuration before it.
    double at = 0.0;
    std::vector<double> before;
    std::vector<double> reached;  // the configuration closest to that pose
    // kDeviation: the bounds, and by how much each joint may leave its limits.
    double deviation_there = 0.0, rotation_deviation_there = 0.0;
    std::vector<double> outside;
};

// Upper bounds of the deviation (m, rad) on each piece of a curve; infinite if it would require too many samples.
struct RouteDeviation {
    double position, orientation;
};

// The slopes (k, n) of the twice differentiable cubic spline through points (k, n) at increasing knots (k), with equal
// third derivatives in the two first and in the two last pieces (C. de Boor 2001, "A practical guide to splines",
// chapter IV); a parabola through three points, a line through two.
std::vector<double> spline_slopes(std::span<const double> knots, std::span<const double> points, std::size_t n);

class RouteFollower {
public:
    // The curve keeps the limits lower and upper (n); poses are solved within those of `tracking`.
    RouteFollower(TrackingTask tracking, const FollowerSettings& settings, std::vector<double> lower,
                  std::vector<double> upper);

    // Follow a route from its first pose, at which the arm is at `first` (n), within both limits, with poses at the
    // knots after the first; more poses are solved where necessary.
    JointCurve follow(const Route& route, std::vector<double> knots, const std::vector<double>& first) const;

    // The deviation of a curve with the same parameter; its knots include all borders of the route up to its end.
    std::vector<RouteDeviation> deviations(const Route& route, std::span<const double> knots,
                                           std::span<const double> control) const;

    std::size_t dof() const { return tracking_.chain.dof; }

    // The first joint whose value (n) is outside its limits by more than rounding; dof() if there is none.
    std::size_t outside(std::span<const double> q) const;

private:
    struct Tracked;
    Tracked track(const Route& route, std::span<const double> knots, const std::vector<double>& first) const;
    std::vector<double> levers(std::span<const double> control) const;
    RouteDeviation difference(const Route& route, double s, const double* q) const;

    TrackingTask tracking_;
    FollowerSettings settings_;
    std::vector<double> lower_, upper_;
    bool position_;             // whether the task constrains the position
    std::vector<int> columns_;  // the axes whose directions count: all, one, or none
    double scale_;              // of a chord: sqrt(2) for a rotation, 1 for an axis
};

}  // namespace pinproof
