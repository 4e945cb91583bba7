#include "closed_form/lane_check.h"

#include <cmath>

#include "geometry/sincos.h"

namespace pinproof {
namespace {

using Lane = double[kWideLanes];

// The poses of all lanes: rotation[i][j] and translation[i].
struct LanePoses {
    alignas(64) double rotation[3][3][kWideLanes] = {};
    alignas(64) double translation[3][kWideLanes] = {};

    LanePoses() {
        for (int i = 0; i < 3; ++i)
            for (int b = 0; b < kWideLanes; ++b) rotation[i][i][b] = 1.0;
    }

    // Multiply from the right by a constant transform, then by a rotation about z and a translation along z.
    void advance(const Transform& constant, const Lane& sine, const Lane& cosine, const Lane& along) {
        const auto& c = constant.rotation.m;
        const Vec3& t = constant.translation;
        for (int i = 0; i < 3; ++i) {
            auto& row = rotation[i];
            for (int b = 0; b < kWideLanes; ++b) {
                const double r0 = row[0][b], r1 = row[1][b], r2 = row[2][b];
                const double x = r0 * c[0][0] + r1 * c[1][0] + r2 * c[2][0];
                const double y = r0 * c[0][1] + r1 * c[1][1] + r2 * c[2][1];
                const double z = r0 * c[0][2] + r1 * c[1][2] + r2 * c[2][2];
                translation[i][b] += r0 * t.x + r1 * t.y + r2 * t.z + along[b] * z;
                row[0][b] = x * cosine[b] + y * sine[b];
                row[1][b] = y * cosine[b] - x * sine[b];
                row[2][b] = z;
            }
        }
    }
};

}  // namespace

LaneErrors check_lanes(const Chain& chain, const Transform& target, const LaneConfigurations& configurations) {
    LanePoses poses;
    alignas(64) Lane sine = {}, cosine, along;
    for (const Joint& joint : chain.joints) {
        const Lane& q = configurations.q[joint.index];
        if (joint.prismatic) {
            for (int b = 0; b < kWideLanes; ++b) {
                sine[b] = 0.0;
                cosine[b] = 1.0;
                along[b] = joint.multiplier * q[b] + joint.offset;
            }
        } else {
            for (int b = 0; b < kWideLanes; ++b) {
                const auto [s, c] = sincos(joint.multiplier * q[b] + joint.offset);
                sine[b] = s;
                cosine[b] = c;
                along[b] = 0.0;
            }
        }
        poses.advance(joint.before, sine, cosine, along);
    }
    for (int b = 0; b < kWideLanes; ++b) {
        sine[b] = along[b] = 0.0;
        cosine[b] = 1.0;
    }
    poses.advance(chain.tool, sine, cosine, along);

    LaneErrors errors;
    const auto& t = target.rotation.m;
    const auto& p = poses.rotation;
    for (int b = 0; b < kWideLanes; ++b) {
        const double x = poses.translation[0][b] - target.translation.x;
        const double y = poses.translation[1][b] - target.translation.y;
        const double z = poses.translation[2][b] - target.translation.z;
        errors.distance[b] = std::sqrt(x * x + y * y + z * z);
    }
    for (int b = 0; b < kWideLanes; ++b) {
        // target^T R: its trace less 1, and twice the sine of its angle about its axis
        double cosine2 = -1.0, x = 0.0, y = 0.0, z = 0.0;
        for (int i = 0; i < 3; ++i) {
            cosine2 += t[i][0] * p[i][0][b] + t[i][1] * p[i][1][b] + t[i][2] * p[i][2][b];
            x += t[i][2] * p[i][1][b] - t[i][1] * p[i][2][b];
            y += t[i][0] * p[i][2][b] - t[i][2] * p[i][0][b];
            z += t[i][1] * p[i][0][b] - t[i][0] * p[i][1][b];
        }
        errors.angle[b] = angle_of(std::sqrt(x * x + y * y + z * z), cosine2);
    }
    return errors;
}

}  // namespace pinproof
