// The test whether matrices are rigid transforms.
#pragma once

#include <cmath>

#include "geometry/vectors.h"

namespace pinproof {

// Whether a transform is rigid up to rounding: finite, a rotation whose columns are orthonormal up to 1e-14.
inline bool is_rigid(const Transform& t) {
    constexpr double rounding = 1e-14;
    const Vec3 x = t.rotation.column(0), y = t.rotation.column(1), z = t.rotation.column(2), &p = t.translation;
    const double off[] = {dot(x, x) - 1.0, dot(y, y) - 1.0, dot(z, z) - 1.0, dot(x, y), dot(x, z), dot(y, z)};
    bool rigid = dot(cross(x, y), z) > 0.0 && std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
    for (double one : off) rigid = rigid && std::abs(one) <= rounding;
    return rigid;
}

// The same for a homogeneous matrix (16 numbers), with (0, 0, 0, 1) as the last row.
inline bool is_rigid(const double* matrix) {
    return is_rigid(read_transform(matrix)) && matrix[12] == 0.0 && matrix[13] == 0.0 && matrix[14] == 0.0 &&
           matrix[15] == 1.0;
}

}  // namespace pinproof
