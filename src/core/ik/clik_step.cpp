#include "ik/clik_step.h"

#include <algorithm>
#include <cmath>

#include "algebra/least_squares.h"

namespace pinproof {

void ClikStep::operator()(double growth, double longest, double squared_residual, const Twist& pull,
                          const Jacobian& jacobian, std::vector<double>& step) const {
    double shift = 0.5 * growth * damping * squared_residual + kSmallestDamping;
    const Symmetric6 square = gram(jacobian);
    Factor6 factor;
    for (int growths = 0; growths < kMostGrowths; ++growths, shift *= kGrowth) {
        if (!factor.factorise(square, shift)) continue;
        const Twist x = factor.solve(pull);
        double largest = 0.0;
        for (std::size_t i = 0; i < jacobian.size(); ++i) {
            step[i] = -dot(jacobian[i], x);
            largest = std::max(largest, std::abs(step[i]));
        }
        if (largest <= longest) return;
    }
}

}  // namespace pinproof
