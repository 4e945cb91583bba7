#include "closed_form/triple.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

// The motion W of the triple for given outer joints, applied to a point and to two directions.
struct TripleMotion {
    Vec3 point, goal;      // a point of the last line (of the middle one between two prismatic joints), and W of it
    Vec3 direction, seen;  // e, perpendicular to that line, and W of it
    Vec3 top;              // W h_l of a spherical triple
};

class Triple {
  public:
    Triple(const Loop& loop, const LoopTolerances& tolerances, const OuterSolution& outer, bool assume_free,
           LoopSolutions& out)
        : f_(loop.line[Loop::kFirst]),
          g_(loop.line[Loop::kMiddle]),
          l_(loop.line[Loop::kLast]),
          loop_(loop),
          tolerances_(tolerances),
          outer_(outer),
          assume_free_(assume_free),
          out_(out) {}

    void solve() {
        move_probes();
        if (loop_.between_prismatic()) {
            one_middle(align(g_.direction, motion_.direction, motion_.seen).state, 0);
            return;
        }
        loop_.planar ? pose_planar() : pose_spherical();
        Roots roots = pinproof::solve(equation_, settings_);
        if (roots.every_value) {
            roots = {1, false, {reference_state(g_), {}}};
            free_ |= 1u << Loop::kMiddle;
            if (settings_.free != kFree) assumed_ |= 1u << Loop::kMiddle;
        }
        for (int i = 0; i < roots.count; ++i) one_middle(roots.state[i], i);
    }

  private:
    Vec3 backward_through_outer(const Vec3& v) const {
        const Line &a = loop_.line[Loop::kA], &b = loop_.line[Loop::kB], &c = loop_.line[Loop::kC];
        const Vec3 before_a = move_direction(a, outer_.a, Sense::backward, v);
        return move_direction(c, outer_.c, Sense::backward, move_direction(b, outer_.b, Sense::backward, before_a));
    }

    void move_probes() {
        const Line &a = loop_.line[Loop::kA], &b = loop_.line[Loop::kB], &c = loop_.line[Loop::kC];
        const Line& probed = loop_.probed();
        const Transform& rest = loop_.rest;
        TripleMotion& w = motion_;
        w.point = w.goal = probed.point;
        w.direction = loop_.perpendicular;
        w.top = l_.direction;
        if (loop_.reversed) {
            const auto forward = [&](const Vec3& p) {
                const Vec3 after_c = move_point(c, outer_.c, Sense::forward, p);
                return move_point(a, outer_.a, Sense::forward, move_point(b, outer_.b, Sense::forward, after_c));
            };
            const Vec3 after_c =
                move_direction(c, outer_.c, Sense::forward, transposed_times(rest.rotation, w.direction));
            w.goal = forward(transposed_times(rest.rotation, w.point - rest.translation));
            w.seen =
                move_direction(a, outer_.a, Sense::forward, move_direction(b, outer_.b, Sense::forward, after_c));
            return;
        }
        w.seen = rest.rotation * backward_through_outer(w.direction);
        if (!loop_.planar) {
            w.top = rest.rotation * backward_through_outer(l_.direction);
            return;
        }
        const Vec3 before_a = move_point(a, outer_.a, Sense::backward, w.point);
        w.goal = rest * move_point(c, outer_.c, Sense::backward, move_point(b, outer_.b, Sense::backward, before_a));
    }

    void pose_spherical() {
        const ErrorBound& e = outer_.error;
        const double alpha = dot(f_.direction, g_.direction), beta = dot(l_.direction, g_.direction);
        const double height = dot(f_.direction, motion_.top), tilt = std::abs(std::abs(alpha) - std::abs(beta));
        top_across_ = across(motion_.top, f_.direction);
        length_ = norm(top_across_);
        equation_error_ = {kRounding * tilt + (length_ + e.rounding) * e.rounding,
                           kRounding * tilt + (length_ + e.tolerance) * e.tolerance};
        equation_ = {dot(f_.direction, l_.direction) - alpha * beta,
                     dot(f_.direction, cross(g_.direction, l_.direction)), alpha * beta - height, false};
        settings_ = {.border = std::max(tolerances_.border, kNear * equation_error_.tolerance),
                     .spread = tolerances_.spread,
                     .square = gram_determinant(alpha, beta, height, squared_norm(top_across_))};
    }

    void pose_planar() {
        const ErrorBound& e = outer_.error;
        const Curve r = point_curve(g_, Sense::forward, l_.point);
        if (f_.prismatic) {
            const Vec3 over = cross(loop_.normal, f_.direction);
            equation_ = {dot(over, r.first), dot(over, r.second), dot(over, r.centre - motion_.goal), g_.prismatic};
            equation_error_ = {kRounding + e.rounding, kRounding + e.tolerance};
        } else {
            const Vec3 near_axis = across(r.centre - f_.point, loop_.normal);
            const Vec3 far = across(motion_.goal - f_.point, loop_.normal);
            equation_ = {2.0 * dot(near_axis, r.first), g_.prismatic ? 1.0 : 2.0 * dot(near_axis, r.second),
                         squared_norm(near_axis) - squared_norm(far) + (g_.prismatic ? 0.0 : squared_norm(r.first)),
                         g_.prismatic};
            length_ = norm(far);
            equation_error_ = {kRounding + (2.0 * length_ + e.rounding) * e.rounding,
                               kRounding + (2.0 * length_ + e.tolerance) * e.tolerance};
        }
        settings_ = {.border = std::max(tolerances_.border, kNear * equation_error_.tolerance),
                     .spread = tolerances_.spread};
        const double largest = equation_.largest_coefficient(), unsure = kUncertain * equation_error_.rounding;
        if (largest < unsure && largest >= 0.7 * kFree) {
            out_.undecided = true;
            if (assume_free_) settings_.free = 2.0 * unsure;
        }
    }

    // Complete a root of the middle joint.
    void one_middle(const JointState& middle, int root) {
        if (out_.count == LoopSolutions::kMost) {
            out_.doubtful = true;
            return;
        }
        LoopSolution& one = out_.solution[out_.count];
        one.free = outer_.free | free_;
        one.assumed = outer_.assumed | assumed_;
        ErrorBound middle_error;
        if (!loop_.between_prismatic() && !(one.free & 1u << Loop::kMiddle))
            middle_error = root_error(equation_, middle, equation_error_);
        one.error = outer_.error.tolerance + middle_error.tolerance;
        JointState first, last;
        if (loop_.between_prismatic()) {
            if (!share_translation(middle, first, last, one)) return;
        } else {
            first_joint(middle, middle_error.rounding, first, one);
            const Vec3 after_first = move_direction(f_, first, Sense::backward, motion_.seen);
            const Vec3 left = move_direction(g_, middle, Sense::backward, after_first);
            last = align(l_.direction, motion_.direction, left).state;
        }
        one.number = {2 * outer_.root + root, outer_.assumed != 0, one.assumed != outer_.assumed};
        one.state[Loop::kFirst] = first;
        one.state[Loop::kMiddle] = middle;
        one.state[Loop::kLast] = last;
        one.state[Loop::kA] = outer_.a;
        one.state[Loop::kB] = outer_.b;
        one.state[Loop::kC] = outer_.c;
        ++out_.count;
    }

    // W o_g - o_g = q_f d_f + q_l R_g d_l, in the plane; false if both prismatic joints have the same direction.
    bool share_translation(const JointState& middle, JointState& first, JointState& last, LoopSolution& one) {
        const Vec3 offset = motion_.goal - g_.point;
        const Vec3 last_direction = rotated(g_.direction, middle.first, middle.second, l_.direction);
        const double det = dot(loop_.normal, cross(f_.direction, last_direction));
        if (std::abs(det) < std::max(kFree, kUncertain * outer_.error.rounding)) {
            out_.doubtful = true;  // both are free, which is not supported
            return false;
        }
        one.error /= std::min(1.0, std::abs(det));
        first = prismatic_state(dot(loop_.normal, cross(offset, last_direction)) / det);
        last = prismatic_state(dot(loop_.normal, cross(f_.direction, offset)) / det);
        return true;
    }

    void first_joint(const JointState& middle, double middle_rounding, JointState& first, LoopSolution& one) {
        const Vec3 r = loop_.planar ? move_point(g_, middle, Sense::forward, l_.point)
                                    : rotated(g_.direction, middle.first, middle.second, l_.direction);
        if (f_.prismatic) {
            first = prismatic_state(dot(f_.direction, motion_.goal - r));
            return;
        }
        const Alignment alignment = loop_.planar ? align(f_.direction, r - f_.point, motion_.goal - f_.point)
                                                 : align(f_.direction, r, motion_.top);
        first = alignment.state;
        const double uncertain =
            kUncertain * (loop_.planar ? outer_.error.rounding + middle_rounding : outer_.error.rounding);
        if (alignment.size < kFree * kFree || (!loop_.planar && squared_norm(top_across_) < kFree * kFree)) {
            first = reference_state(f_);
            one.free |= 1u << Loop::kFirst;
        } else if (std::min(alignment.size, length_ * length_) < uncertain * uncertain) {
            out_.undecided = true;
            one.error = 1.0;
            if (assume_free_) {
                first = reference_state(f_);
                one.free |= 1u << Loop::kFirst;
                one.assumed |= 1u << Loop::kFirst;
            }
        } else {
            one.error += one.error / std::min(1.0, length_);
        }
    }

    const Line &f_, &g_, &l_;
    const Loop& loop_;
    const LoopTolerances& tolerances_;
    const OuterSolution& outer_;
    bool assume_free_;
    LoopSolutions& out_;

    TripleMotion motion_;
    LinearEquation equation_{};  // of the middle joint
    RootSettings settings_{};
    ErrorBound equation_error_;
    double length_ = 1.0;  // decides whether the first joint is free
    Vec3 top_across_;
    unsigned free_ = 0, assumed_ = 0;
};

}  // namespace

void solve_triple(const Loop& loop, const LoopTolerances& tolerances, const OuterSolution& outer, bool assume_free,
                  LoopSolutions& out) {
    Triple(loop, tolerances, outer, assume_free, out).solve();
}

}  // namespace pinproof
