#include "planning/route.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

double evaluate(std::array<double, RoutePiece::kCoefficients> c, double u) {
    for (std::size_t n = c.size() - 1; n > 0; --n)
        for (std::size_t i = 0; i < n; ++i) c[i] = c[i] * (1.0 - u) + c[i + 1] * u;
    return c[0];
}

// The rotation by `share` of a rotation vector.
Mat3 rotation_by(const Vec3& vector, double share) {
    const double angle = norm(vector);
    if (!(angle > 0.0)) return {};
    return rotation_about((1.0 / angle) * vector, std::sin(angle * share), std::cos(angle * share));
}

}  // namespace

Transform RoutePiece::at(double u) const {
    const double back = evaluate(a, u), on = evaluate(b, u);
    return {pose.rotation * (rotation_by(into.rotation, -back) * rotation_by(out.rotation, on)),
            pose.translation - back * into.translation + on * out.translation};
}

const RoutePiece& Route::piece_at(double s) const {
    const auto next = std::upper_bound(pieces.begin() + 1, pieces.end(), s,
                                       [](double at, const RoutePiece& piece) { return at < piece.start; });
    return *(next - 1);
}

Transform Route::pose(double s) const {
    const RoutePiece& piece = piece_at(s);
    const double width = piece.end - piece.start;
    return piece.at(width > 0.0 ? std::clamp((s - piece.start) / width, 0.0, 1.0) : 0.0);
}

}  // namespace pinproof
