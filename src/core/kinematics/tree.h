// Joints, and the joints of a robot as a tree, for the placements of all links and not only of those between base and tcp.
#pragma once

#include <cstddef>
#include <vector>

#include "geometry/sincos.h"
#include "geometry/vectors.h"

namespace pinproof {

inline constexpr int kRoot = -1;

// A joint that rotates about, or moves along, the z axis of its own frame. A mimic joint follows the value of another.
struct Joint {
    Transform before;  // constant transform from the frame behind the parent
    bool prismatic;
    std::size_t index;          // of its value in q
    double multiplier, offset;  // value = multiplier * q[index] + offset; 1 and 0 except for mimic joints
    int parent = kRoot;         // in a tree: a joint with a smaller number, or kRoot; in a chain the previous joint

    double value(const double* q) const { return multiplier * q[index] + offset; }
};

struct JointTree {
    std::vector<Joint> joints;
    std::size_t dof = 0;  // the length of q
};

// Move a frame by the value of a joint, along or about its z axis. F is a frame with columns, of one problem or of several in
// lanes, and Number is a double or lanes.
template <class F, class Number>
void move(F& frame, bool prismatic, const Number& value, const Number& sine, const Number& cosine) {
    if (prismatic) {
        frame.origin = frame.origin + value * frame.z;
    } else {
        const auto x = frame.x;
        frame.x = cosine * x + sine * frame.y;
        frame.y = cosine * frame.y - sine * x;
    }
}
inline void move(Transform& frame, bool prismatic, double value) {
    if (prismatic) {
        frame.translation += value * frame.rotation.column(2);
    } else {
        const auto [sine, cosine] = sincos_of_any(value);
        rotate_about_z(frame.rotation, sine, cosine);
    }
}

// root_from_joint at q, which must be finite; `root_from_parent` is null for a joint on the root.
inline Transform placed_joint(const Joint& joint, const Transform* root_from_parent, const double* q) {
    Transform place = root_from_parent == nullptr ? joint.before : *root_from_parent * joint.before;
    move(place, joint.prismatic, joint.value(q));
    return place;
}

}  // namespace pinproof
