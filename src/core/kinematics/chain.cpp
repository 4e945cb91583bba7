#include "kinematics/chain.h"

#include <algorithm>
#include <cmath>

#include "algebra/least_squares.h"
#include "geometry/sincos.h"

namespace pinproof {

bool Chain::has_mimic_joints() const {
    if (joints.size() != dof) return true;
    return std::any_of(joints.begin(), joints.end(),
                       [](const Joint& joint) { return joint.multiplier != 1.0 || joint.offset != 0.0; });
}

Transform forward_kinematics(const Chain& chain, const double* q) {
    Transform pose;
    for (const Joint& joint : chain.joints) {
        pose = pose * joint.before;
        move(pose, joint.prismatic, joint.value(q));
    }
    return pose * chain.tool;
}

Posture::Posture(const Chain& chain) : axes_(chain.joints.size()) {
    const std::size_t padded = (chain.joints.size() + 3) / 4 * 4;
    values_.resize(padded);
    sines_.resize(padded);
    cosines_.resize(padded);
}

void Posture::evaluate(const Chain& chain, const Frame& start, const double* q) {
    for (std::size_t k = 0; k < chain.joints.size(); ++k) values_[k] = chain.joints[k].value(q);
    sincos_of_each(values_.data(), sines_.data(), cosines_.data(), values_.size());
    Frame frame = start;
    for (std::size_t k = 0; k < chain.joints.size(); ++k) {
        frame = frame * chain.joints[k].before;
        axes_[k] = {frame.origin, frame.z};
        move(frame, chain.joints[k].prismatic, values_[k], sines_[k], cosines_[k]);
    }
    tcp_ = frame * chain.tool;
}

void Posture::jacobian(const Chain& chain, Jacobian& out) const {
    std::fill(out.begin(), out.end(), Twist{});
    for (std::size_t k = 0; k < chain.joints.size(); ++k) {
        const Joint& joint = chain.joints[k];
        const Double4 direction = joint.multiplier * axes_[k].direction;
        if (joint.prismatic)
            out[joint.index].linear += direction;
        else
            out[joint.index] += Twist{cross(direction, tcp_.origin - axes_[k].origin), direction};
    }
}

namespace {

// Added to the squares of the singular values, so that the logarithm is finite at singularities.
constexpr double kTiny = 1e-14;

// J^T J of fewer than 6 columns, completed by ones on the diagonal.
Symmetric6 inner_products(const Jacobian& columns) {
    Symmetric6 square;
    const int count = static_cast<int>(columns.size());
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j <= i; ++j) square.m[i][j] = i < count ? dot(columns[i], columns[j]) : i == j ? 1.0 : 0.0;
    return square;
}

}  // namespace

double log_manipulability(const Jacobian& jacobian) {
    Factor6 factor;
    if (!factor.factorise(jacobian.size() < 6 ? inner_products(jacobian) : gram(jacobian), kTiny))
        return std::log(kTiny);
    return 0.5 * factor.log_determinant();
}

}  // namespace pinproof
