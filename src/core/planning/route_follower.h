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

// The segment between two poses, on which the orientation rotates about one fixed axis: its direction per metre, and its
// length (m). In the length, rotations are weighted by kLever (m/rad), about the size of a gripper; it affects the
// spacing of poses only. Lengths up to kMinLength (m), a tenth of the tolerance with which poses are reached, are 0.
struct RouteSegment {
    static constexpr double kLever = 0.25, kMinLength = 1e-7;

    Vec3 translation, rotation;
    double length;

    static RouteSegment between(const Transform& first, const Transform& last);
};

struct RoutePiece {
    static constexpr std::size_t kCoefficients = 6;

    Transform pose;
    RouteSegment into, out;
    std::array<double, kCoefficients> a, b;  // in the Bernstein basis
    double width;                            // m; its share of the parameter of the route
    double start = 0.0, end = 1.0;           // parameters of the route, set by Route::of

    // Upper bounds of the sizes of the derivatives by the parameter of the route.
    struct Derivatives {
        double acceleration;       // of the position
        double turn, turn_change;  // of the angular velocity, and of its derivative
    };

    Transform at(double u) const;
    Derivatives derivatives() const;
};

struct Route {
    std::vector<RoutePiece> pieces;  // at least one; they follow one another

    const RoutePiece& piece_at(double s) const;
    Transform pose(double s) const;

    // The route of pieces that follow one another; its parameter from 0 to 1 is proportional to their widths.
    static Route of(std::vector<RoutePiece> pieces);
    // The route of a single segment.
    static Route straight(const Transform& first, const Transform& last);
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
    double deviation, rotation_deviation;     // m, rad; allowed at every point
    double translation_step, rotation_step;   // m, rad; the largest between the first poses that are solved
    double max_joint_step;                    // rad or m between solved poses
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
    std::vector<double> lower, upper;  // the limits within which the poses were solved
    double spacing = 0.0;              // the largest initial one, by the parameter
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
    // Poses are solved, and the curve is, within the limits of `tracking`.
    RouteFollower(TrackingTask tracking, const FollowerSettings& settings);

    // Follow a route from its first pose, at which the arm is at `first` (n), within the limits. Poses are solved at
    // intervals that do not exceed the steps, and at more points where necessary.
    //
    // If a redundant arm moves along a joint limit, the solved poses are at the limit and the spline through them
    // exceeds it. Then there is a second attempt, with poses solved within limits that are reduced by kLimitGuard; the
    // curve that gets farther is returned.
    JointCurve follow(const Route& route, const std::vector<double>& first) const;

    // The deviation of a curve with the same parameter; its knots include all borders of the route up to its end.
    std::vector<RouteDeviation> deviations(const Route& route, std::span<const double> knots,
                                           std::span<const double> control) const;

    std::size_t dof() const { return tracking_.chain.dof; }
    const Chain& chain() const { return tracking_.chain; }

    // The first joint whose value (n) is outside its limits by more than rounding; dof() if there is none.
    std::size_t outside(std::span<const double> q) const;

private:
    struct Tracked;
    JointCurve follow_within(const TrackingTask& tracking, const Route& route, std::vector<double> knots,
                             const std::vector<double>& first) const;
    std::vector<double> first_knots(const Route& route) const;
    std::vector<double> levers(std::span<const double> control) const;
    RouteDeviation difference(const Route& route, double s, const double* q) const;

    TrackingTask tracking_;
    FollowerSettings settings_;
    bool position_;             // whether the task constrains the position
    std::vector<int> columns_;  // the axes whose directions count: all, one, or none
    double scale_;              // of a chord: sqrt(2) for a rotation, 1 for an axis
};

}  // namespace pinproof
