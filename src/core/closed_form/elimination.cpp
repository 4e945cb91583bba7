#include "closed_form/elimination.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "closed_form/line.h"
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

namespace {

// A smaller pivot of the elimination, relative to the largest: the products of joints 1 and 2 depend on each other.
constexpr double kDependent = 1e-11;

// Rad: values of t_0 that are tried until the condition number of A_0 is good; above the second value it is useless.
constexpr double kShifts[] = {0.7, 2.27, -0.87, -2.44, 1.49, -1.65};
constexpr double kOtherShifts = 0.37;  // added to them for another matrix
constexpr double kGoodCondition = 3e3, kWorstCondition = 1e12;

// The eigenvalues are those of a matrix that differs by this multiple of the rounding unit, the norm and the condition of
// A_0; a safety factor for the steps before is included.
constexpr double kBackwardError = 30.0;

// An eigenvalue is complex for certain if its imaginary part exceeds the bound of its error by this factor.
constexpr double kSafety = 10.0;

// The condition number of eigenvalues whose imaginary part is much larger than their error is not computed: it would have
// to exceed this.
constexpr double kLargeCondition = 1e6;

// The functions: four vectors, then two scalars.
constexpr int kH = 0, kP = 3, kCross = 6, kReflected = 9, kSquare = 12, kProduct = 13;

struct Sampled {
    Vec3 point, direction;
};

// (1, 0), and (cos, sin) of 120 and 240 degrees; for prismatic joints, 0 and this length on both sides.
constexpr double kHalfRoot3 = 0.86602540378443864676;
constexpr double kCosines[3] = {1.0, -0.5, -0.5}, kSines[3] = {0.0, kHalfRoot3, -kHalfRoot3};
constexpr double kTravels[3] = {0.0, 1.0, -1.0};

// The motion of a joint by each of the three values, or by their negatives.
struct ThreeMotions {
    Mat3 rotation[3];
    Vec3 offset[3];

    ThreeMotions(const LoopLine& line, double sign) {
        for (int k = 1; k < 3; ++k) {
            if (line.prismatic) {
                offset[k] = (sign * kTravels[k]) * line.direction;
                continue;
            }
            rotation[k] = rotation_about(line.direction, sign * kSines[k], kCosines[k]);
            offset[k] = line.point - rotation[k] * line.point;
        }
    }
    Sampled operator()(int k, const Sampled& s) const {
        if (k == 0) return s;
        return {rotation[k] * s.point + offset[k], rotation[k] * s.direction};
    }
};

// The frame with its origin and z axis on the line of joint 3.
struct LineFrame {
    Vec3 x, y, z, origin;

    explicit LineFrame(const LoopLine& line)
        : x(unit_perpendicular(line.direction)), y(cross(line.direction, x)), z(line.direction), origin(line.point) {}
    Vec3 direction(const Vec3& v) const { return {dot(x, v), dot(y, v), dot(z, v)}; }
};

// All 14 functions of a point and a direction, at place `at` of each row.
void write_functions(const LineFrame& frame, const Sampled& sampled, double (*rows)[9], int at) {
    const Vec3 p = frame.direction(sampled.point - frame.origin), h = frame.direction(sampled.direction);
    const double square = dot(p, p), product = dot(p, h);
    const Vec3 normal = cross(p, h), reflected = square * h - (2.0 * product) * p;
    const Vec3* const vectors[] = {&h, &p, &normal, &reflected};
    for (int k = 0; k < 4; ++k) {
        rows[3 * k][at] = vectors[k]->x;
        rows[3 * k + 1][at] = vectors[k]->y;
        rows[3 * k + 2][at] = vectors[k]->z;
    }
    rows[kSquare][at] = square;
    rows[kProduct][at] = product;
}

// From the samples at the three values of a joint to the coefficients of 1, cos, sin; or of 1, d, d^2 if it is prismatic.
void to_states(bool prismatic, double& a, double& b, double& c) {
    if (prismatic) {
        const double linear = 0.5 * (b - c), square = 0.5 * (b + c) - a;
        b = linear;
        c = square;
        return;
    }
    const double constant = (a + b + c) / 3.0, sine = (b - c) / (2.0 * kHalfRoot3);
    b = a - constant;
    a = constant;
    c = sine;
}

// To the coefficients of the powers of the half-angle tangent, times 1 + tangent^2; or of the powers of d.
void to_powers(bool prismatic, double& a, double& b, double& c) {
    if (prismatic) return to_states(prismatic, a, b, c);
    const double constant = (a + b + c) / 3.0, sine = (b - c) / (2.0 * kHalfRoot3);
    b = 2.0 * sine;
    c = 2.0 * constant - a;
}

// For the samples of two joints, the first in steps of 3.
template <class Convert>
void convert_samples(double (*rows)[9], int count, bool first_prismatic, bool second_prismatic, Convert convert) {
    for (int i = 0; i < count; ++i) {
        double* const s = rows[i];
        for (int k = 0; k < 3; ++k) convert(second_prismatic, s[3 * k], s[3 * k + 1], s[3 * k + 2]);
        for (int k = 0; k < 3; ++k) convert(first_prismatic, s[k], s[k + 3], s[k + 6]);
    }
}

// The value of a joint from the powers (1, x, x^2, ...) of its half-angle tangent, or of its value if it is prismatic: the
// ratio of adjacent ones.
double value_from_powers(bool prismatic, const double* power, int count) {
    int at = 0;
    double largest = -1.0;
    for (int k = 0; k + 1 < count; ++k) {
        const double size = std::abs(power[k]) + std::abs(power[k + 1]);
        if (size > largest) {
            largest = size;
            at = k;
        }
    }
    if (prismatic) return power[at + 1] / power[at];
    return 2.0 * std::atan2(power[at + 1], power[at]);
}

}  // namespace

CutLoop cut_loop(const LoopLine (&lines)[6], const Transform& g, const Cut& cut) {
    // Lines up to the dropped one are moved behind the others: E_{d+1} ... E_5 (G^-1 E_0 G) ... (G^-1 E_d G) = G.
    const Transform g_inverse = inverse(g);
    LoopLine ordered[6];
    int source[6];
    for (int k = 0; k < 6; ++k) {
        const int j = (cut.dropped + 1 + k) % 6;
        source[k] = j;
        ordered[k] = lines[j];
        if (j <= cut.dropped && cut.dropped != 5)
            ordered[k] = {g_inverse.rotation * lines[j].direction, g_inverse * lines[j].point, lines[j].prismatic};
    }
    CutLoop out;
    out.loop = g;
    if (!cut.reversed) {
        std::copy(ordered, ordered + 6, out.line);
        std::copy(source, source + 6, out.source);
        return out;
    }
    // E_1 ... E_6 = G is E_5^-1 ... E_1^-1 (G E_6^-1 G^-1) = G^-1.
    for (int k = 0; k < 5; ++k) {
        out.line[k] = {-ordered[4 - k].direction, ordered[4 - k].point, ordered[4 - k].prismatic};
        out.source[k] = source[4 - k];
    }
    out.line[5] = {-(g.rotation * ordered[5].direction), g * ordered[5].point, ordered[5].prismatic};
    out.source[5] = source[5];
    out.loop = g_inverse;
    return out;
}

namespace {

class Elimination {
  public:
    void solve(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
               EliminationResult& out) {
        out.count = out.existing = 0;
        out.usable = false;
        cut_ = cut_loop(lines, g, cut);
        if (cut_.line[2].prismatic || cut_.line[5].prismatic) return;
        expand_sides();
        if (!eliminate() || !choose_shift(cut.shifted)) return;
        make_matrix();
        double largest = 0.0;
        for (const auto& row : matrix_)
            for (double one : row) largest = std::max(largest, std::abs(one));
        if (!(largest < 1e12)) return;  // also NaN
        hessenberg_.reduce(matrix_);
        Eigenvalue values[kEigenRows];
        if (!hessenberg_.eigenvalues(values)) return;
        const double error = kBackwardError * kEpsilon * hessenberg_.norm() * condition_;
        out.existing = kEigenRows;
        for (int k = 0; k < kEigenRows; ++k) {
            const auto [real, imaginary] = values[k];
            if (imaginary == 0.0) {
                start_from(real, out);
                continue;
            }
            // Complex eigenvalues are in pairs; the second is that of the other sign.
            const double distance = std::abs(imaginary);
            const bool sure = distance > kSafety * kLargeCondition * error ||
                              distance > kSafety * error * hessenberg_.condition(values[k]);
            if (sure) out.existing -= 2;
            if (2.0 * distance < nearly_real * (1.0 + real * real)) start_from(real, out);
            ++k;
        }
        out.usable = true;
    }

  private:
    static constexpr int kFunctions = 14, kProducts = 8, kLeft = kFunctions - kProducts;

    void expand_sides() {
        const LineFrame frame(cut_.line[2]);
        const Sampled last{cut_.line[5].point, cut_.line[5].direction};
        const ThreeMotions fourth(cut_.line[3], 1.0), fifth(cut_.line[4], 1.0);
        for (int b = 0; b < 3; ++b) {
            const Sampled moved = fifth(b, last);
            for (int a = 0; a < 3; ++a) write_functions(frame, fourth(a, moved), left_, 3 * a + b);
        }
        convert_samples(left_, kFunctions, cut_.line[3].prismatic, cut_.line[4].prismatic, to_powers);

        const Sampled target{cut_.loop * last.point, cut_.loop.rotation * last.direction};
        const ThreeMotions first(cut_.line[0], -1.0), second(cut_.line[1], -1.0);
        for (int a = 0; a < 3; ++a) {
            const Sampled moved = first(a, target);
            for (int b = 0; b < 3; ++b) write_functions(frame, second(b, moved), right_, 3 * a + b);
        }
        convert_samples(right_, kFunctions, cut_.line[0].prismatic, cut_.line[1].prismatic, to_states);
    }

    // Eliminate the eight products from the 14 equations `functions = right_`. In the first eight rows remains one product,
    // in the last six none.
    bool eliminate() {
        constexpr int columns = 24;
        for (int i = 0; i < kFunctions; ++i) {
            std::fill_n(reduced_[i], columns, 0.0);
            std::copy_n(right_[i] + 1, kProducts, reduced_[i]);
            reduced_[i][kProducts + i] = 1.0;
        }
        bool used[kProducts] = {};
        double largest = 0.0;
        for (int k = 0; k < kProducts; ++k) {
            double pivot = 0.0;
            int row = k, column = 0;
            for (int i = k; i < kFunctions; ++i)
                for (int j = 0; j < kProducts; ++j)
                    if (!used[j] && std::abs(reduced_[i][j]) > pivot) {
                        pivot = std::abs(reduced_[i][j]);
                        row = i;
                        column = j;
                    }
            largest = std::max(largest, pivot);
            if (!(pivot > kDependent * largest)) return false;
            used[column] = true;
            product_[k] = column + 1;
            if (row != k) std::swap_ranges(reduced_[row], reduced_[row] + columns, reduced_[k]);
            const double inverse = 1.0 / reduced_[k][column];
            for (int j = 0; j < columns; ++j) reduced_[k][j] *= inverse;
            for (int i = 0; i < kFunctions; ++i) {
                if (i == k) continue;
                const double factor = reduced_[i][column];
                for (int j = 0; j < columns; ++j) reduced_[i][j] -= factor * reduced_[k][j];
            }
        }
        for (int r = 0; r < kLeft; ++r) {
            const double* const n = reduced_[kProducts + r] + kProducts;
            double scale = 0.0, constant = 0.0;
            for (int i = 0; i < kFunctions; ++i) scale += n[i] * n[i];
            scale = 1.0 / std::sqrt(scale);
            double* const row = reduced_[kProducts + r];
            for (int j = 0; j < columns; ++j) row[j] *= scale;
            for (int i = 0; i < kFunctions; ++i) constant += n[i] * right_[i][0];
            for (int m = 0; m < 9; ++m) {
                double fixed = n[kSquare] * left_[kSquare][m] + n[kProduct] * left_[kProduct][m], along = 0.0,
                       across = 0.0;
                for (int k = 0; k < 12; k += 3) {
                    along += n[k] * left_[k][m] + n[k + 1] * left_[k + 1][m];
                    across += n[k + 1] * left_[k][m] - n[k] * left_[k + 1][m];
                    fixed += n[k + 2] * left_[k + 2][m];
                }
                constant_[r][m] = fixed;
                cosine_[r][m] = along;
                sine_[r][m] = across;
            }
            // (1 + x^2)(1 + y^2), or 1 instead of a factor for a prismatic joint
            for (int m : {0, 2, 6, 8})
                if ((m < 6 || !cut_.line[3].prismatic) && (m % 3 == 0 || !cut_.line[4].prismatic))
                    constant_[r][m] -= constant;
        }
        return true;
    }

    // Choose t_0, and solve with A_0: fills inverse_.
    bool choose_shift(bool shifted) {
        constexpr int columns = 40;
        double best[12][columns], best_condition = std::numeric_limits<double>::infinity();
        for (double shift : kShifts) {
            if (shifted) shift += kOtherShifts;
            const auto [sine, cosine] = sincos(shift);
            double row[12][columns] = {};
            double norm = 0.0;
            for (int r = 0; r < kLeft; ++r) {
                const double* const n = reduced_[kProducts + r] + kProducts;
                for (int m = 0; m < 9; ++m) {
                    const double value = constant_[r][m] + cosine * cosine_[r][m] + sine * sine_[r][m];
                    row[r][m] = row[r + 6][m + 3] = value;
                    norm += 2.0 * value * value;
                }
                // P = (n_x - i n_y) / 2 exp(i t_0): Im(P a) = Im(P) Re(a) + Re(P) Im(a)
                for (int k = 0; k < 4; ++k) {
                    const double re = 0.5 * (n[3 * k] * cosine + n[3 * k + 1] * sine);
                    const double im = 0.5 * (n[3 * k] * sine - n[3 * k + 1] * cosine);
                    row[r][12 + k] = row[r + 6][16 + k] = im;
                    row[r][20 + k] = row[r + 6][24 + k] = re;
                }
                row[r][28 + r] = row[r + 6][28 + r + 6] = 1.0;
            }
            bool regular = true;
            for (int k = 0; k < 12 && regular; ++k) {
                int pivot = k;
                for (int i = k + 1; i < 12; ++i)
                    if (std::abs(row[i][k]) > std::abs(row[pivot][k])) pivot = i;
                if (!(std::abs(row[pivot][k]) > 0.0)) {
                    regular = false;
                    break;
                }
                if (pivot != k) std::swap_ranges(row[k], row[k] + columns, row[pivot]);
                const double inverse = 1.0 / row[k][k];
                for (int j = 0; j < columns; ++j) row[k][j] *= inverse;
                for (int i = 0; i < 12; ++i) {
                    if (i == k) continue;
                    const double factor = row[i][k];
                    for (int j = 0; j < columns; ++j) row[i][j] -= factor * row[k][j];
                }
            }
            if (!regular) continue;
            double of_inverse = 0.0;
            for (int i = 0; i < 12; ++i)
                for (int j = 28; j < 40; ++j) of_inverse += row[i][j] * row[i][j];
            const double condition = std::sqrt(norm * of_inverse);
            if (condition < best_condition) {
                best_condition = condition;
                std::copy(&row[0][0], &row[0][0] + 12 * columns, &best[0][0]);
                shift_ = shift;
                sine_of_shift_ = sine;
                cosine_of_shift_ = cosine;
            }
            if (best_condition < kGoodCondition) break;
        }
        condition_ = best_condition;
        if (!(best_condition < kWorstCondition)) return false;
        for (int i = 0; i < 12; ++i)
            for (int j = 0; j < 16; ++j) inverse_[i][j] = best[i][12 + j];
        return true;
    }

    // i + 4 W A_0^-1 Im(P .)
    void make_matrix() {
        for (int k = 0; k < 4; ++k)
            for (int part = 0; part < 2; ++part) {
                const double* const w = left_[3 * k + part];
                double* const plain = matrix_[8 * part + k];
                double* const shifted = matrix_[8 * part + 4 + k];
                std::fill_n(plain, kEigenRows, 0.0);
                std::fill_n(shifted, kEigenRows, 0.0);
                for (int m = 0; m < 9; ++m)
                    for (int j = 0; j < kEigenRows; ++j) {
                        plain[j] += 4.0 * w[m] * inverse_[m][j];
                        shifted[j] += 4.0 * w[m] * inverse_[m + 3][j];
                    }
            }
        for (int i = 0; i < 8; ++i) {
            matrix_[i][8 + i] -= 1.0;
            matrix_[8 + i][i] += 1.0;
        }
    }

    void start_from(double eigenvalue, EliminationResult& out) const {
        double a[kEigenRows], v[12] = {};
        hessenberg_.eigenvector(eigenvalue, a);
        for (int i = 0; i < 12; ++i)
            for (int j = 0; j < kEigenRows; ++j) v[i] += inverse_[i][j] * a[j];
        int row = 0, column = 0;
        double longest_row = -1.0, longest_column = -1.0;
        for (int i = 0; i < 4; ++i) {
            const double* const one = v + 3 * i;
            const double size = one[0] * one[0] + one[1] * one[1] + one[2] * one[2];
            if (size > longest_row) {
                longest_row = size;
                row = i;
            }
        }
        for (int j = 0; j < 3; ++j) {
            double size = 0.0;
            for (int i = 0; i < 4; ++i) size += v[3 * i + j] * v[3 * i + j];
            if (size > longest_column) {
                longest_column = size;
                column = j;
            }
        }
        double value[6];
        value[2] = shift_ + 2.0 * std::atan2(1.0, eigenvalue);
        value[4] = value_from_powers(cut_.line[4].prismatic, v + 3 * row, 3);
        const double powers[4] = {v[column], v[3 + column], v[6 + column], v[9 + column]};
        value[3] = value_from_powers(cut_.line[3].prismatic, powers, 4);

        // The functions at joints 3 to 5, and the products of joints 1 and 2 from the first rows.
        const Transform third = motion_of(cut_.line[2], value[2]);
        const Transform behind = third * motion_of(cut_.line[3], value[3]) * motion_of(cut_.line[4], value[4]);
        double functions[kFunctions][9];
        write_functions(LineFrame(cut_.line[2]),
                        {behind * cut_.line[5].point, behind.rotation * cut_.line[5].direction}, functions, 0);
        double products[9] = {};
        for (int k = 0; k < kProducts; ++k)
            for (int i = 0; i < kFunctions; ++i)
                products[product_[k]] += reduced_[k][kProducts + i] * (functions[i][0] - right_[i][0]);
        // The products of one state with 1: sine and cosine, or d and d^2.
        value[0] = cut_.line[0].prismatic ? products[3] : std::atan2(products[6], products[3]);
        value[1] = cut_.line[1].prismatic ? products[1] : std::atan2(products[2], products[1]);

        const Mat3 before = (motion_of(cut_.line[0], value[0]) * motion_of(cut_.line[1], value[1]) * behind).rotation;
        const Vec3& axis = cut_.line[5].direction;
        const Vec3 from = unit_perpendicular(axis), to = transposed_times(before, cut_.loop.rotation * from);
        value[5] = std::atan2(dot(axis, cross(from, to)), dot(from, to));

        for (double one : value)
            if (!(std::abs(one) < kFarthest)) return;  // also NaN: a prismatic joint at infinity
        double* const start = out.start[out.count++];
        for (int k = 0; k < 6; ++k) start[cut_.source[k]] = value[k];
    }

    CutLoop cut_;
    double left_[kFunctions][9];      // of joints 4 and 5, in powers of their half-angle tangents
    double right_[kFunctions][9];     // of joints 1 and 2, in products of (1, cos, sin)
    double reduced_[kFunctions][24];  // rows of [products | functions] after the elimination
    int product_[kProducts];          // the product of each of the first rows
    double constant_[kLeft][9], cosine_[kLeft][9], sine_[kLeft][9];  // of A by q_3
    double shift_, sine_of_shift_, cosine_of_shift_;                 // t_0
    double inverse_[12][32];                                         // [A_0^-1 Im(P .) (16) | A_0^-1 (12)]
    double condition_;                                               // of A_0
    EigenMatrix matrix_;
    HessenbergForm hessenberg_;
};

}  // namespace

void solve_by_elimination(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
                          EliminationResult& out) {
    Elimination().solve(lines, g, cut, nearly_real, out);
}

}  // namespace pinproof
