#include "kinematics/chain.h"

#include "geometry/sincos.h"

namespace pinproof {

Transform forward_kinematics(const Chain& chain, const double* q) {
    Transform pose;
    for (const Joint& joint : chain.joints) {
        pose = pose * joint.before;
        const double value = joint.value(q);
        if (joint.prismatic) {
            pose.translation += value * pose.rotation.column(2);
        } else {
            const auto [sine, cosine] = sincos_of_any(value);
            rotate_about_z(pose.rotation, sine, cosine);
        }
    }
    return pose * chain.tool;
}

}  // namespace pinproof
