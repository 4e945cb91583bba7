#include "closed_form/loop_newton.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/sincos.h"

namespace pinproof {
namespace {

constexpr int kMostNewtonSteps = 12;
constexpr double kNoFurtherStep = 1e-14;    // residual that needs no further step
constexpr double kLastStep = 1e-7;          // a regular step from a smaller residual ends below rounding
constexpr double kLongestNewtonStep = 0.5;  // rad, or lengths of the arm
constexpr double kSingular = 1e-13;         // a smaller pivot counts as zero

struct LinearSystem {
    double row[6][7];

    // Solve by elimination with partial pivoting. Returns the smallest pivot.
    double solve(double (&x)[6]) {
        double smallest = std::numeric_limits<double>::infinity();
        for (int k = 0; k < 6; ++k) {
            int pivot = k;
            for (int i = k + 1; i < 6; ++i)
                if (std::abs(row[i][k]) > std::abs(row[pivot][k])) pivot = i;
            if (pivot != k)
                for (int j = k; j < 7; ++j) std::swap(row[k][j], row[pivot][j]);
            smallest = std::min(smallest, std::abs(row[k][k]));
            if (!(std::abs(row[k][k]) > kSingular)) return 0.0;
            const double inverse = 1.0 / row[k][k];
            for (int i = k + 1; i < 6; ++i) {
                const double factor = row[i][k] * inverse;
                for (int j = k + 1; j < 7; ++j) row[i][j] -= factor * row[k][j];
            }
        }
        for (int i = 5; i >= 0; --i) {
            double value = row[i][6];
            for (int j = i + 1; j < 6; ++j) value -= row[i][j] * x[j];
            x[i] = value / row[i][i];
        }
        return smallest;
    }
};

}  // namespace

Transform motion_of(const LoopLine& line, double value) {
    if (line.prismatic) return {{}, value * line.direction};
    const auto [sine, cosine] = sincos(value);
    const Mat3 rotation = rotation_about(line.direction, sine, cosine);
    return {rotation, line.point - rotation * line.point};
}

PolishedLoop polish_loop(const LoopLine (&lines)[6], const Transform& g, double (&q)[6]) {
    const Vec3& reference = lines[5].point;
    const Vec3 wanted = g * reference;
    PolishedLoop result{std::numeric_limits<double>::infinity(), 0.0};
    double best[6], weakest = 0.0;
    std::copy(q, q + 6, best);
    for (int step = 0; step < kMostNewtonSteps; ++step) {
        Transform moved;
        Vec3 direction[6], point[6];
        for (int k = 0; k < 6; ++k) {
            direction[k] = moved.rotation * lines[k].direction;
            point[k] = moved * lines[k].point;
            moved = moved * motion_of(lines[k], q[k]);
        }
        const Vec3 tip = moved * reference, gap = wanted - tip;
        Vec3 turn;
        for (int j = 0; j < 3; ++j) turn += 0.5 * cross(moved.rotation.column(j), g.rotation.column(j));
        const double residual = std::sqrt(squared_norm(gap) + squared_norm(turn));
        double trace = 0.0;
        for (int j = 0; j < 3; ++j) trace += dot(moved.rotation.column(j), g.rotation.column(j));
        // Beyond a right angle, the vector part of the rotation does not measure it.
        const double measured = trace > 1.0 ? residual : residual + 2.0;
        if (measured < result.residual) {
            result.residual = measured;
            std::copy(q, q + 6, best);
        } else if (step > 2 && measured > 4.0 * result.residual) {
            break;
        }
        LinearSystem system;
        for (int k = 0; k < 6; ++k) {
            const bool prismatic = lines[k].prismatic;
            const Vec3 linear = prismatic ? direction[k] : cross(direction[k], tip - point[k]);
            for (int i = 0; i < 3; ++i) {
                system.row[i][k] = linear[i];
                system.row[i + 3][k] = prismatic ? 0.0 : direction[k][i];
            }
        }
        for (int i = 0; i < 3; ++i) {
            system.row[i][6] = gap[i];
            system.row[i + 3][6] = turn[i];
        }
        double move[6];
        weakest = system.solve(move);
        result.weakest = weakest;
        if (weakest == 0.0 || measured < kNoFurtherStep) break;
        double longest = 0.0;
        for (double one : move) longest = std::max(longest, std::abs(one));
        const double share = longest > kLongestNewtonStep ? kLongestNewtonStep / longest : 1.0;
        for (int k = 0; k < 6; ++k) q[k] += share * move[k];
        if (measured < kLastStep && longest < kLastStep) {
            // The error of the last step is its square.
            result.residual = measured * measured;
            return result;
        }
    }
    std::copy(best, best + 6, q);
    return result;
}

}  // namespace pinproof
