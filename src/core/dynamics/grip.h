// The wrenches that a grip transmits to a part, and the share of them that a load needs.
//
// A contact presses on the part along a common normal n of its points x_k. Its normal force N, at most F, is distributed
// over the points by a convex combination of given distributions d (sum_k d_k = 1), and the friction at each point is at
// most mu times the normal force there. A suction cup also pulls by the constant force F, so that N is at most 2 F. The
// wrenches of a grip are a convex set W, the sum of those of its contacts, with the support function
//
//     h(a) = sum_contacts max(0, F max_d sum_k d_k (u_k . n + mu |u_k - (u_k . n) n|)) ,  u_k = a_f + a_m x x_k .
//
// The share of a load w is the gauge of W, the least s with w in s W. It is the value of the linear programme
//
//     min sum_j c_j ,  sum_j c_j v_j = w ,  c >= 0 ,  v_j in W ,
//
// with infinitely many columns, solved by the simplex method, whose pricing is the support function: the dual a of the
// present basis is proven to be optimal up to the factor h(a). Every basis gives an upper bound, so that a share below 1
// proves that the grip transmits the load. (Column generation: G. Dantzig, P. Wolfe (1960), "Decomposition principle for
// linear programs", Operations Research 8(1).) What is transmitted beyond a wrench g is W - g, with h(a) - a . g.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "geometry/lanes.h"
#include "geometry/vectors.h"

namespace pinproof {

struct GripContact {
    std::vector<double> points;         // (K, 3), m
    std::vector<double> distributions;  // (D, K), each at least 0 and with the sum 1; a cup pulls with the first one
    Vec3 normal;                        // along which the hand presses on the part
    double force = 0.0;                 // F, N
    double friction = 0.0;
    bool pulls = false;                 // whether it is a suction cup
};

// Relative difference between a share and its lower bound at which the simplex method ends.
inline constexpr double kShareTolerance = 2e-4;

// Force, then moment. In the coordinates of a grip, the moment is about its centre and divided by its length.
using Wrench = std::array<double, 6>;

class Grip {
  public:
    explicit Grip(const std::vector<GripContact>& contacts);

    // h(a), and a wrench of W with that value; both in the coordinates of the grip.
    double support(const Wrench& a, Wrench& at) const;

    // A wrench about the origin in the coordinates of the grip, and bounds of the errors of its entries.
    Wrench local(const Wrench& wrench) const;
    Wrench local_error(const Wrench& error) const;

    // An upper bound of the share of any wrench whose entries are at most these.
    double share_of_error(const Wrench& error) const;

    // An upper bound of the share of the unit wrench along an axis, in its positive or its negative direction.
    double axis_share(std::size_t axis, bool negative) const { return axes_[axis][negative ? 1 : 0]; }

    // Whether there is no direction in which the grip transmits next to nothing.
    bool complete() const { return complete_; }

  private:
    struct Contact {
        std::vector<LaneVec3> points;  // four in each; there may be some without a share at the end
        std::vector<Lanes> shares;     // of the first four points in each distribution, of the next four, ...
        Vec3 normal;
        double most, friction;
        std::size_t distributions;
    };
    std::vector<Contact> contacts_;
    Wrench offset_{};
    Vec3 centre_;
    double length_ = 0.0;
    bool complete_ = false;
    std::array<std::array<double, 2>, 6> axes_{};
};

// The shares of wrenches that follow each other, such as those along a motion: the basis of one is the start of the next.
class ShareOfGrip {
  public:
    explicit ShareOfGrip(const Grip& grip) : grip_(grip) {}

    // The shares of what the grip transmits beyond a wrench `from`, whose own share is at most `share`, below 1.
    ShareOfGrip(const Grip& grip, const Wrench& from, double share) : grip_(grip), from_(from), axes_(1.0 / (1.0 - share)) {}

    // An upper bound of the share of w, in the coordinates of the grip.
    double operator()(const Wrench& w);

    // The largest s in [0, 1] for which the grip transmits g + s d, up to some tolerances and never more, if only the part
    // `kept` of what it transmits is used; 0 if it does not transmit g.
    double reach(const Wrench& g, const Wrench& d, double kept = 1.0);

  private:
    friend class Grip;
    // The bound by the basis of a wrench that is displaced by this share of its bound by the axes.
    double solve(const Wrench& wrench, double displaced);

    double axis(std::size_t k, double value) const { return axes_ * grip_.axis_share(k, value < 0.0); }

    const Grip& grip_;
    Wrench from_{};
    double axes_ = 1.0;  // by this factor, at most, the shares of the axes beyond `from` exceed those of the grip
    bool started_ = false;
    std::array<Wrench, 6> columns_{}, inverse_{};  // of the basis
    Wrench cost_{}, shares_{};
    double error_ = 0.0;  // part of the last bound, for what the basis does not represent
};

// Chords of the section of W that limits s'' and s'^2 at a point of a path, and the share at rest; the wrench of the motion
// is s'' alpha + s'^2 beta, that of gravity gamma. Each chord is -below <= row . (s'', s'^2) <= 1, where the lower limit is
// that of the other chords.
inline constexpr std::size_t kChords = 8;
struct Section {
    std::array<std::array<double, 2>, kChords> rows{};
    std::array<double, kChords> below{};
    double at_rest = 0.0;
};
Section section_of(const Grip& grip, ShareOfGrip& share, const Wrench& alpha, const Wrench& beta, const Wrench& gamma);

}  // namespace pinproof
