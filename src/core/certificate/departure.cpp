#include "certificate/departure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace pinproof {
namespace {

// Number of bisections of the interval in which a body separates: its end is found to 1/4000 of the interval.
constexpr int kHalvings = 12;

}  // namespace

double extent(const Shape& shape, const Transform& root_from_shape, const Vec3& direction) {
    const double origin = dot(direction, root_from_shape.translation);
    if (shape.kind == ShapeKind::kHalfSpace) return origin;
    const Vec3 local = transposed_times(root_from_shape.rotation, direction);
    return origin + dot(support(shape, local), local) + shape.radius * norm(local);
}

Departure::Departure(std::shared_ptr<const Geometry> space, int body, std::shared_ptr<const Shape> hull,
                     const Vec3& normal, double level)
    : space_(std::move(space)),
      body_(body),
      hull_(std::move(hull)),
      normal_(normal),
      level_(level),
      at_(Placement(*space_)[body]) {
    for (int k = space_->robot[static_cast<std::size_t>(body)].joint; k != kRoot; k = space_->tree.joints[k].parent)
        chain_.push_back(k);
    std::ranges::reverse(chain_);
    axes_.resize(chain_.size());
    deviation_.resize(chain_.size());
    along_.resize(chain_.size());
    turned_.resize(chain_.size());
}

void Departure::place_at(const double* q) {
    if (chain_.empty()) return;
    for (std::size_t i = 0; i < chain_.size(); ++i) {
        const Joint& joint = space_->tree.joints[chain_[i]];
        axes_[i] = placed_joint(joint, i == 0 ? nullptr : &axes_[i - 1], q);
    }
    const Body& body = space_->robot[static_cast<std::size_t>(body_)];
    at_ = placed(axes_.back() * body.joint_from_body, *body.shape);
}

double Departure::gap(const double* q) {
    place_at(q);
    return -reach(-normal_) - level_;
}

GapDecrease Departure::decrease(const double* piece, std::size_t points) {
    const std::size_t dof = this->dof();
    left_.resize(points * dof);
    right_.resize(points * dof);
    halve(piece, points, dof, left_.data(), right_.data());
    const double* middle = right_.data();  // where both halves meet
    place_at(middle);
    double turned = 0.0, shifted = 0.0;  // the sums of chords at radius 1, and of chords, up to this joint
    for (std::size_t i = 0; i < chain_.size(); ++i) {
        const Joint& joint = space_->tree.joints[chain_[i]];
        double delta = 0.0;
        for (std::size_t r = 0; r < points; ++r)
            delta = std::max(delta, std::abs(piece[r * dof + joint.index] - middle[joint.index]));
        delta *= std::abs(joint.multiplier);
        const double rho = radius_about(joint, axes_[i], at_, space_->shape(body_));
        const Vec3 axis = axes_[i].rotation.column(2);
        if (joint.prismatic) {
            shifted += delta;
            deviation_[i] = turned;  // the joints beyond i do not change the speed of a translation
            along_[i] = dot(axis, normal_);
            turned_[i] = {};
        } else {
            const double chord = 2.0 * std::sin(0.5 * std::min(delta, std::numbers::pi));
            turned += chord;
            shifted += rho * chord;
            deviation_[i] = rho * turned - shifted;  // and `shifted` of all joints, below
            turned_[i] = cross(normal_, axis);
            along_[i] = -dot(turned_[i], axes_[i].translation);
        }
    }
    for (std::size_t i = 0; i < chain_.size(); ++i)
        if (!space_->tree.joints[chain_[i]].prismatic) deviation_[i] += shifted;
    double decrease = 0.0;
    for (std::size_t r = 0; r + 1 < points; ++r) {
        double most = 0.0, constant = 0.0;
        Vec3 slope;
        for (std::size_t i = 0; i < chain_.size(); ++i) {
            const Joint& joint = space_->tree.joints[chain_[i]];
            const double rate =
                joint.multiplier * (piece[(r + 1) * dof + joint.index] - piece[r * dof + joint.index]);
            most += std::abs(rate) * deviation_[i];
            constant += rate * along_[i];
            slope += rate * turned_[i];
        }
        const double slowest = constant - reach(-slope);
        decrease += std::max(most - slowest, 0.0);
    }
    return {decrease, shifted};
}

DepartureProof Departure::follow(const CurveView& curve, double enough, double tolerance, std::int64_t max_intervals) {
    struct Interval {
        double start, stop;
        std::vector<double> part;
    };
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const std::size_t size = curve.points * curve.dof;
    DepartureProof proof{curve.knots.front(), infinity, curve.knots.front(), 0, gap(curve.piece(0))};
    if (proof.gap > enough) proof.until = proof.end;
    std::vector<double> last(curve.piece(0), curve.piece(0) + curve.dof);  // q at the end of the proof
    double lost = 0.0;
    std::vector<Interval> stack;
    for (std::size_t i = 0; i < curve.pieces() && proof.stopped <= proof.end; ++i) {
        stack.push_back({curve.knots[i], curve.knots[i + 1], {curve.piece(i), curve.piece(i) + size}});
        while (!stack.empty()) {
            Interval here = std::move(stack.back());
            stack.pop_back();
            ++proof.intervals;
            const GapDecrease bound = decrease(here.part.data(), curve.points);
            if (lost + bound.decrease <= space_->rounding) {
                lost += bound.decrease;
                proof.end = proof.stopped = here.stop;
                std::copy_n(here.part.data() + size - curve.dof, curve.dof, last.data());
                if (proof.until == infinity && gap(last.data()) > enough)
                    proof.until = crossing(here.start, here.stop, std::move(here.part), enough);
                continue;
            }
            // Written so that a bound that is not a number ends the proof.
            if (!(bound.motion >= tolerance) || proof.intervals >= max_intervals) {
                proof.stopped = here.stop;
                break;
            }
            const double middle = 0.5 * (here.start + here.stop);
            stack.push_back({middle, here.stop, right_});
            stack.push_back({here.start, middle, left_});
        }
    }
    proof.gap = gap(last.data());
    return proof;
}

// An upper bound of the parameter at which a gap that does not decrease exceeds `enough`.
double Departure::crossing(double start, double stop, std::vector<double> part, double enough) {
    const std::size_t dof = this->dof(), points = part.size() / dof;
    for (int i = 0; i < kHalvings; ++i) {
        const double middle = 0.5 * (start + stop);
        halve(part.data(), points, dof, left_.data(), right_.data());
        if (gap(right_.data()) > enough) {
            stop = middle;
            part = left_;
        } else {
            start = middle;
            part = right_;
        }
    }
    return stop;
}

}  // namespace pinproof
