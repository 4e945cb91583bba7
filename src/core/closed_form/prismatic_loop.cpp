#include "closed_form/prismatic_loop.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "closed_form/line.h"
#include "geometry/sincos.h"

namespace pinproof {
namespace {

// Squares of sines of angles: axes at a smaller angle are parallel, and another cut is used.
constexpr double kParallel = 1e-10;

// Rad: values of joint B at which the samples may begin. The first is used for which A^2 + B^2 is, at all samples, at least
// this share of its largest value.
constexpr double kFirstSamples[] = {0.1, 0.23, 0.33, 0.17};
constexpr double kOtherSamples = 0.06;  // added to them for other samples
constexpr double kSmallestShare = 1e-4;

// The error of the coefficients is taken as this multiple of the largest one that should be zero, or of rounding.
constexpr double kNoiseSafety = 20.0;

// Coefficients below this multiple of their error are zero: their roots are at 0 and at infinity.
constexpr double kVanishing = 100.0;

constexpr int kMostRounds = 80;           // of Aberth's iteration
constexpr double kRootConverged = 1e-15;  // relative to the root

// A value of joint A at which the determinant, relative to its coefficients, is larger is not tried if the other is smaller.
constexpr double kNearlyZero = 1e-3;

// A number of configurations that is never reached: there may be infinitely many.
constexpr int kUnlimited = EliminationResult::kMost + 1;

// Below this determinant of their unit directions, prismatic joints may have a self-motion at this target; below the second
// value, their travels are not computed.
constexpr double kDependentRails = 1e-6, kUndetermined = 1e-20;

// Two prismatic joints are parallel at a root, and there is no configuration close to it, if the translation that remains
// across them is longer (lengths of the arm). At a configuration whose joints are this close (rad) to the root, it would be a
// few times shorter.
constexpr double kAcrossRails = 0.05, kCloseToRoot = 1e-3;

// At a smaller discriminant (relative) of three revolute joints, both values of the middle one may be a double root.
constexpr double kDouble = 1e-9;

double triple_product(const Vec3& a, const Vec3& b, const Vec3& c) { return dot(a, cross(b, c)); }

// The angle of the rotation about the unit vector h that moves v next to w.
double angle_between(const Vec3& h, const Vec3& v, const Vec3& w) {
    const JointState state = align(h, v, w).state;
    return std::atan2(state.second, state.first);
}

class PrismaticLoop {
  public:
    // As Elimination::solve.
    void solve(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
               EliminationResult& out) {
        out.count = out.existing = 0;
        out.usable = false;
        cut_ = cut_loop(lines, g, cut);
        revolute_count_ = prismatic_count_ = 0;
        for (int k = 0; k < 6; ++k) {
            if (cut_.line[k].prismatic) {
                prismatic_[prismatic_count_++] = k;
            } else {
                revolute_[revolute_count_++] = k;
            }
        }
        if (revolute_count_ == 3) return solve_three(nearly_real, out);
        if (!prepare() || !expand(cut.shifted) || !find_roots()) return;
        classify(nearly_real, out);
        out.usable = true;
    }

  private:
    static constexpr int kDegree = 4, kMostRoots = 2 * kDegree, kSamples = 16;
    using Complex = std::complex<double>;

    // A vector of the link between joints C and D by its components along h_C, h_D and h_C x h_D.
    struct Components {
        double c, d, normal;
    };

    // (1) at a value of joint B: cosine cos a + sine sin a = constant; and (2) by the multiples of a, 1, cos, sin, cos 2a,
    // sin 2a.
    struct FirstJoint {
        double cosine, sine, constant;
        double determinant[5];

        double size2() const { return cosine * cosine + sine * sine; }
        double discriminant() const { return size2() - constant * constant; }
        double determinant_at(double a) const {
            const auto [s, c] = sincos(a);
            return determinant[0] + determinant[1] * c + determinant[2] * s + determinant[3] * (c * c - s * s) +
                   determinant[4] * 2.0 * c * s;
        }

        // Times size2. With u^2 = discriminant / size2^2, the states at both roots are (c -+ sine u, s +- cosine u); their
        // determinants are p +- q u.
        double product_of_determinants() const {
            const double inverse = 1.0 / size2(), c = cosine * constant * inverse, s = sine * constant * inverse;
            const double u2 = discriminant() * inverse * inverse;
            const double p = determinant[0] + determinant[1] * c + determinant[2] * s +
                             determinant[3] * (c * c - s * s + (sine * sine - cosine * cosine) * u2) +
                             2.0 * determinant[4] * (c * s - sine * cosine * u2);
            const double q = determinant[2] * cosine - determinant[1] * sine -
                             2.0 * determinant[3] * (c * sine + s * cosine) +
                             2.0 * determinant[4] * (c * cosine - s * sine);
            return size2() * (p * p - q * q * u2);
        }
    };

    // Returns false if the axes of joints C and D are parallel, or those of A and of D at this target.
    bool prepare() {
        const LoopLine &a = cut_.line[revolute_[0]], &c = cut_.line[revolute_[2]], &d = cut_.line[revolute_[3]];
        w_ = cut_.loop.rotation * d.direction;
        normal_ = cross(c.direction, d.direction);
        normal2_ = squared_norm(normal_);
        if (normal2_ < kParallel || squared_norm(cross(a.direction, w_)) < kParallel) return false;
        offset_ = components(d.point - c.point);
        target_ = cut_.loop * d.point;
        for (int k = 0; k < 2; ++k) direction_in_link_[k] = components(cut_.line[prismatic_[k]].direction);
        return true;
    }

    Components components(const Vec3& v) const {
        const Vec3 &c = cut_.line[revolute_[2]].direction, &d = cut_.line[revolute_[3]].direction;
        return {triple_product(v, d, normal_) / normal2_, triple_product(v, normal_, c) / normal2_,
                dot(v, normal_) / normal2_};
    }

    FirstJoint first_joint(double b) const {
        const LoopLine &first = cut_.line[revolute_[0]], &second = cut_.line[revolute_[1]];
        const auto [sine_b, cosine_b] = sincos(b);
        const Mat3 moved = rotation_about(second.direction, sine_b, cosine_b);
        const Vec3 k = moved * cut_.line[revolute_[2]].direction;
        const double along = dot(first.direction, k) * dot(first.direction, w_);
        FirstJoint joint{dot(k, w_) - along,
                         dot(first.direction, cross(k, w_)),
                         dot(cut_.line[revolute_[2]].direction, cut_.line[revolute_[3]].direction) - along,
                         {}};
        constexpr int samples = 5;
        for (int j = 0; j < samples; ++j) {
            const double angle = j * 2.0 * std::numbers::pi / samples;
            const auto [s, c] = sincos(angle);
            const double value = determinant(rotation_about(first.direction, s, c), moved) / samples;
            const double basis[] = {1.0, 2.0 * c, 2.0 * s, 2.0 * (c * c - s * s), 4.0 * c * s};
            for (int i = 0; i < samples; ++i) joint.determinant[i] += basis[i] * value;
        }
        return joint;
    }

    // (2) at the rotations of joints A and B.
    double determinant(const Mat3& first, const Mat3& second) const {
        const LoopLine &a = cut_.line[revolute_[0]], &b = cut_.line[revolute_[1]], &c = cut_.line[revolute_[2]];
        const Vec3 k = first * (second * c.direction), n = cross(k, w_);
        const auto in_base = [&](const Components& v) { return v.c * k + v.d * w_ + v.normal * n; };
        const Vec3 before = a.point + first * (b.point - a.point + second * (c.point - b.point));
        const Vec3 x = before + in_base(offset_) - target_;
        Vec3 direction[2];
        for (int i = 0; i < 2; ++i) {
            const Vec3& u = cut_.line[prismatic_[i]].direction;
            const auto joints_before =
                std::count_if(revolute_, revolute_ + 4, [&](int r) { return r < prismatic_[i]; });
            direction[i] = joints_before == 0   ? u
                           : joints_before == 1 ? first * u
                           : joints_before == 2 ? first * (second * u)
                           : joints_before == 3 ? in_base(direction_in_link_[i])
                                                : cut_.loop.rotation * u;
        }
        return triple_product(x, direction[0], direction[1]);
    }

    // The coefficients of the polynomial in z. Returns false if they are not determined.
    bool expand(bool shifted) {
        for (double begin : kFirstSamples) {
            if (shifted) begin += kOtherSamples;
            FirstJoint joint[kSamples];
            double least = std::numeric_limits<double>::infinity(), most = 0.0;
            for (int j = 0; j < kSamples; ++j) {
                joint[j] = first_joint(begin + j * 2.0 * std::numbers::pi / kSamples);
                least = std::min(least, joint[j].size2());
                most = std::max(most, joint[j].size2());
            }
            if (!(least > kSmallestShare * most)) continue;
            Complex fourier[kSamples / 2] = {};
            double rounding = 0.0;
            for (int j = 0; j < kSamples; ++j) {
                const double value = joint[j].product_of_determinants() / kSamples;
                rounding = std::max(rounding, kEpsilon * std::abs(value));
                for (int k = 0; k < kSamples / 2; ++k) {
                    const auto [s, c] = sincos(-k * (begin + j * 2.0 * std::numbers::pi / kSamples));
                    fourier[k] += value * Complex(c, s);
                }
            }
            noise_ = rounding;
            for (int k = kDegree + 1; k < kSamples / 2; ++k) noise_ = std::max(noise_, std::abs(fourier[k]));
            noise_ *= kNoiseSafety;
            int degree = kDegree;
            while (degree > 0 && !(std::abs(fourier[degree]) > kVanishing * noise_)) --degree;
            roots_ = 2 * degree;
            for (int k = 0; k <= degree; ++k) {
                coefficient_[degree + k] = fourier[k];
                coefficient_[degree - k] = std::conj(fourier[k]);
            }
            return degree > 0 || std::abs(fourier[0]) > kVanishing * noise_;
        }
        return false;
    }

    // All roots by Aberth's iteration, which needs no initial guess. Returns false if it does not converge.
    bool find_roots() {
        for (int i = 0; i < roots_; ++i)
            root_[i] = std::polar(1.0 + 0.05 * i, 0.4 + 2.0 * std::numbers::pi * i / roots_);
        for (int round = 0; round < kMostRounds; ++round) {
            double largest = 0.0;
            for (int i = 0; i < roots_; ++i) {
                Complex& z = root_[i];
                Complex value = coefficient_[roots_], slope = 0.0, others = 0.0;
                for (int k = roots_ - 1; k >= 0; --k) {
                    slope = slope * z + value;
                    value = value * z + coefficient_[k];
                }
                for (int k = 0; k < roots_; ++k)
                    if (k != i && root_[k] != z) others += 1.0 / (z - root_[k]);
                const Complex below = slope - value * others;
                if (value == 0.0 || below == 0.0) continue;
                const Complex step = value / below;
                z -= step;
                largest = std::max(largest, std::abs(step) / (1e-3 + std::abs(z)));
            }
            if (!std::isfinite(largest)) return false;
            if (largest < kRootConverged) break;
        }
        return true;
    }

    // Which roots are surely not on the unit circle, and configurations near those that are on it or close to it.
    void classify(double nearly_real, EliminationResult& out) {
        double radius[kMostRoots];
        bool perhaps_real[kMostRoots];  // the disc, or one that overlaps it, touches the circle
        for (int i = 0; i < roots_; ++i) {
            const Complex z = root_[i];
            Complex value = 0.0;
            double error = 0.0, apart = std::abs(coefficient_[roots_]);
            for (int k = roots_; k >= 0; --k) {
                value = value * z + coefficient_[k];
                error = error * std::abs(z) + noise_;
            }
            for (int k = 0; k < roots_; ++k)
                if (k != i) apart *= std::abs(z - root_[k]);
            radius[i] = roots_ * (std::abs(value) + error) / apart;
            perhaps_real[i] = !(std::abs(std::abs(z) - 1.0) > radius[i]);
        }
        // As many roots as discs are in discs that overlap: a double root has two.
        for (int pass = 0; pass < roots_; ++pass)
            for (int i = 0; i < roots_; ++i)
                for (int k = 0; k < roots_; ++k)
                    if (perhaps_real[k] && !(std::abs(root_[i] - root_[k]) > radius[i] + radius[k]))
                        perhaps_real[i] = true;
        int existing = 0;
        for (int i = 0; i < roots_; ++i) {
            bool at_infinity = false;
            if (std::abs(std::log(std::abs(root_[i]))) < nearly_real)
                at_infinity = !start_from_second(std::arg(root_[i]), out) && radius[i] < kCloseToRoot;
            existing += perhaps_real[i] && !at_infinity;
        }
        if (out.existing != kUnlimited) out.existing = existing;
    }

    // The configurations at a value of joint B. Returns false if its prismatic joints are parallel there, and the translation is
    // not, so that they would have to move to infinity: (2) is zero, but there is no configuration.
    bool start_from_second(double b, EliminationResult& out) const {
        const FirstJoint joint = first_joint(b);
        const double middle = std::atan2(joint.sine, joint.cosine);
        const double half = std::atan2(std::sqrt(std::max(0.0, joint.discriminant())), joint.constant);
        const double angle[2] = {middle + half, middle - half};
        double determinant[2], scale = 0.0;
        for (double one : joint.determinant) scale += std::abs(one);
        for (int i = 0; i < 2; ++i) determinant[i] = std::abs(joint.determinant_at(angle[i]));
        bool exists = false;
        for (int i = 0; i < 2; ++i) {
            if (determinant[i] > determinant[1 - i] && determinant[i] > kNearlyZero * scale) continue;
            const LoopLine &first = cut_.line[revolute_[0]], &second = cut_.line[revolute_[1]];
            const auto [sine_a, cosine_a] = sincos(angle[i]);
            const auto [sine_b, cosine_b] = sincos(b);
            const Mat3 moved =
                rotation_about(first.direction, sine_a, cosine_a) * rotation_about(second.direction, sine_b, cosine_b);
            double value[6] = {};
            value[revolute_[0]] = angle[i];
            value[revolute_[1]] = b;
            value[revolute_[2]] = angle_between(cut_.line[revolute_[2]].direction, cut_.line[revolute_[3]].direction,
                                                transposed_times(moved, w_));
            exists |= complete(value, out);
        }
        return exists;
    }

    // Three revolute joints: the middle one by h_A . R_B h_C, then the first.
    void solve_three(double nearly_real, EliminationResult& out) {
        const Vec3 &a = cut_.line[revolute_[0]].direction, &b = cut_.line[revolute_[1]].direction;
        const Vec3 &c = cut_.line[revolute_[2]].direction, w = cut_.loop.rotation * c;
        const double along = dot(b, c) * dot(a, b), cosine = dot(a, c) - along, sine = dot(a, cross(b, c));
        const double constant = dot(a, w) - along, size2 = cosine * cosine + sine * sine;
        if (size2 < kParallel || squared_norm(cross(a, w)) < kParallel) return;
        out.usable = true;
        const double discriminant = size2 - constant * constant;
        out.existing = discriminant < -kDouble ? 0 : discriminant > kDouble ? 2 : kUnlimited;
        if (discriminant < -std::max(kDouble, nearly_real * nearly_real)) return;
        const double middle = std::atan2(sine, cosine),
                     half = std::atan2(std::sqrt(std::max(0.0, discriminant)), constant);
        for (double angle : {middle + half, middle - half}) {
            const auto [s, k] = sincos(angle);
            double value[6] = {};
            value[revolute_[1]] = angle;
            value[revolute_[0]] = angle_between(a, rotation_about(b, s, k) * c, w);
            complete(value, out);
        }
    }

    // The last revolute joint from the remaining rotation, and the prismatic joints from the remaining translation. Returns false
    // if they would have to move to infinity.
    bool complete(double (&value)[6], EliminationResult& out) const {
        const int last = revolute_[revolute_count_ - 1];
        Mat3 before;
        for (int k = 0; k < revolute_count_ - 1; ++k)
            before = before * motion_of(cut_.line[revolute_[k]], value[revolute_[k]]).rotation;
        const Vec3& axis = cut_.line[last].direction;
        const Vec3 from = unit_perpendicular(axis);
        value[last] = angle_between(axis, from, transposed_times(before, cut_.loop.rotation * from));

        Transform moved;
        Vec3 direction[3];
        for (int k = 0, p = 0; k < 6; ++k) {
            if (cut_.line[k].prismatic) {
                direction[p++] = moved.rotation * cut_.line[k].direction;
            } else {
                moved = moved * motion_of(cut_.line[k], value[k]);
            }
        }
        const Vec3 gap = cut_.loop.translation - moved.translation;
        if (prismatic_count_ == 2) direction[2] = cross(direction[0], direction[1]);
        const double determinant = triple_product(direction[0], direction[1], direction[2]);
        bool far = !(std::abs(determinant) > kUndetermined);
        for (int p = 0; p < prismatic_count_ && !far; ++p) {
            value[prismatic_[p]] = triple_product(gap, direction[(p + 1) % 3], direction[(p + 2) % 3]) / determinant;
            far = !(std::abs(value[prismatic_[p]]) < kFarthest);
        }
        if (far && prismatic_count_ == 2 && norm(cross(gap, direction[0])) > kAcrossRails) return false;
        if (far)
            for (int p = 0; p < prismatic_count_; ++p) value[prismatic_[p]] = 0.0;
        if (!(std::abs(determinant) > kDependentRails)) out.existing = kUnlimited;
        double* const start = out.start[out.count++];
        for (int k = 0; k < 6; ++k) start[cut_.source[k]] = value[k];
        return true;
    }

    CutLoop cut_;
    int revolute_[4], prismatic_[3], revolute_count_, prismatic_count_;
    Vec3 w_, normal_;
    double normal2_;
    Components offset_;                // from the point of joint C to that of joint D
    Vec3 target_;                      // G o_D
    Components direction_in_link_[2];  // of a prismatic joint between C and D
    Complex coefficient_[kMostRoots + 1];
    Complex root_[kMostRoots];
    int roots_;     // that are not at 0 or infinity
    double noise_;  // of each coefficient
};

}  // namespace

bool is_prismatic_loop(const LoopLine (&lines)[6]) {
    const auto count = std::count_if(lines, lines + 6, [](const LoopLine& line) { return line.prismatic; });
    return count == 2 || count == 3;
}

void solve_prismatic_loop(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
                          EliminationResult& out) {
    PrismaticLoop().solve(lines, g, cut, nearly_real, out);
}

}  // namespace pinproof
