// The closed form of an arm.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "closed_form/closed_form.h"
#include "closed_form/windings.h"
#include "common/threads.h"
#include "geometry/angle.h"

namespace pinproof {
namespace {

// The counts of a batch where a target has no number of branches.
enum Count : std::int64_t {
    kBadTarget = -1,   // it is not rigid
    kElsewhere = -2,  // joints are free and there may be branches at other values of them, or more than fit
};

// The branches for one target, sorted by the largest joint difference from the reference.
struct BranchList {
    std::size_t dof;
    std::vector<Branch> branches;
    unsigned free_joints = 0, unresolved = 0;
    int failed = 0, outside = 0;
    bool by_quartic = false, doubtful = false;

    template <class Read>
    std::vector<int> each(Read read) const {
        std::vector<int> values;
        for (const Branch& branch : branches) values.push_back(static_cast<int>(read(branch)));
        return values;
    }
};

double away(const double* q, const double* reference, std::size_t n) {
    double largest = 0.0;
    for (std::size_t j = 0; j < n; ++j) largest = std::max(largest, std::abs(q[j] - reference[j]));
    return largest;
}

BranchList sorted_list(const Branches& found, const double* reference, std::size_t dof) {
    int order[Branches::kMost];
    double distance[Branches::kMost];
    for (int i = 0; i < found.count; ++i) {
        order[i] = i;
        distance[i] = away(found.branch[i].q, reference, dof);
    }
    // Few branches: an insertion sort, which is stable.
    for (int i = 1; i < found.count; ++i)
        for (int k = i; k > 0 && distance[order[k]] < distance[order[k - 1]]; --k) std::swap(order[k], order[k - 1]);
    BranchList list{dof,           {},           found.free_joints, found.unresolved, found.failed, found.outside,
                    found.by_quartic, found.doubtful};
    list.branches.reserve(found.count);
    for (int i = 0; i < found.count; ++i) list.branches.push_back(found.branch[order[i]]);
    return list;
}

BranchList list_of(const Matrix& q, const Matrix& errors) {
    require_size("errors", errors.shape(0), q.shape(0));
    require_size("a row of errors", errors.shape(1), 2);
    if (q.shape(1) > kMostJoints) throw std::invalid_argument("a closed form has at most 7 joints");
    BranchList list{q.shape(1), {}};
    for (std::size_t i = 0; i < q.shape(0); ++i) {
        Branch branch{{}, errors(i, 0), errors(i, 1), 0u, {}};
        for (std::size_t j = 0; j < q.shape(1); ++j) branch.q[j] = q(i, j);
        list.branches.push_back(branch);
    }
    return list;
}

// Arrays that users see are read-only.
nb::object q_of(const BranchList& list) {
    const std::size_t count = list.branches.size();
    auto q = new_read_only_array({count, list.dof});
    for (std::size_t i = 0; i < count; ++i)
        std::copy_n(list.branches[i].q, list.dof, q.data + i * list.dof);
    return nb::cast(q.array);
}

nb::object errors_of(const BranchList& list) {
    const std::size_t count = list.branches.size();
    auto errors = new_read_only_array({count, 2});
    for (std::size_t i = 0; i < count; ++i) {
        errors.data[2 * i] = list.branches[i].distance;
        errors.data[2 * i + 1] = list.branches[i].angle;
    }
    return nb::cast(errors.array);
}

BranchList selected(const BranchList& list, const std::vector<std::size_t>& indices) {
    BranchList subset = list;
    subset.branches.clear();
    for (std::size_t index : indices) {
        if (index >= list.branches.size()) throw std::out_of_range("there is no branch of this index");
        subset.branches.push_back(list.branches[index]);
    }
    return subset;
}

// An arm with its solver for single calls, which hold the GIL.
class ClosedForm {
  public:
    explicit ClosedForm(ArmPlan plan) : plan_(std::move(plan)), solver_(plan_) {}
    ClosedForm(const ClosedForm&) = delete;

    const ArmPlan& plan() const { return plan_; }

    std::optional<BranchList> solve(const Matrix& target, const Vector& reference, double locked_value) {
        require_size("target", target.size(), 16);
        require_size("reference", reference.size(), plan_.dof());
        if (!solver_.solve(target.data(), reference.data(), locked_value, found_)) return std::nullopt;
        return sorted_list(found_, reference.data(), plan_.dof());
    }

    nb::tuple solve_batch(const Stack& targets, const Matrix& references, const Matrix& values, std::size_t capacity,
                          std::size_t threads) const;

  private:
    ArmPlan plan_;
    ClosedFormSolver solver_;
    Branches found_;
};

// Row i * v + j is for target i and value j of the locked joint.
struct BatchRows {
    const double *targets, *references, *values;
    std::size_t value_count, dof, capacity;
    bool one_reference, one_set_of_values, locked;
    double *q, *errors;
    std::int64_t *counts, *outside;
    bool* known;

    void solve(ClosedFormSolver& solver, Branches& found, std::size_t row) const {
        const std::size_t i = row / value_count, j = row % value_count;
        const double* reference = references + (one_reference ? 0 : i * dof);
        const double value = values[(one_set_of_values ? 0 : i * value_count) + j];
        const bool rigid = solver.solve(targets + 16 * i, reference, value, found);
        known[row] = rigid && found.all_known();
        outside[row] = rigid ? found.outside : 0;
        counts[row] = rigid ? count_of(found) : kBadTarget;
        const std::size_t written = counts[row] > 0 ? static_cast<std::size_t>(counts[row]) : 0;
        constexpr double nan = std::numeric_limits<double>::quiet_NaN();
        for (std::size_t b = 0; b < capacity; ++b) {
            double *to = q + (row * capacity + b) * dof, *error = errors + (row * capacity + b) * 2;
            if (b < written) {
                std::copy_n(found.branch[b].q, dof, to);
                error[0] = found.branch[b].distance;
                error[1] = found.branch[b].angle;
            } else {
                std::fill_n(to, dof, nan);
                std::fill_n(error, 2, nan);
            }
        }
    }

    std::int64_t count_of(const Branches& found) const {
        const std::int64_t most = static_cast<std::int64_t>(capacity);
        if (found.count > most) return locked ? most : static_cast<std::int64_t>(kElsewhere);
        if (found.count == 0 && found.free_joints != 0) return kElsewhere;
        return found.count;
    }
};

nb::tuple ClosedForm::solve_batch(const Stack& targets, const Matrix& references, const Matrix& values,
                                  std::size_t capacity, std::size_t threads) const {
    const std::size_t count = targets.shape(0), v = values.shape(1), n = plan_.dof(), rows = count * v;
    require_size("a target", targets.shape(1) * targets.shape(2), 16);
    require_size("a reference", references.shape(1), n);
    if (references.shape(0) != 1) require_size("references", references.shape(0), count);
    if (values.shape(0) != 1) require_size("values", values.shape(0), count);
    auto q = new_array({count, v, capacity, n});
    auto errors = new_array({count, v, capacity, 2});
    auto counts = new_array<std::int64_t>({count, v}), outside = new_array<std::int64_t>({count, v});
    auto known = new_array<bool>({count, v});
    const BatchRows batch{targets.data(), references.data(), values.data(),  v,           n,
                          capacity,       references.shape(0) == 1, values.shape(0) == 1, plan_.locked >= 0,
                          q.data,     errors.data, counts.data, outside.data, known.data};
    struct Worker {
        const BatchRows& batch;
        ClosedFormSolver solver;
        Branches found;
        void operator()(Rows& rows) {
            for (std::size_t row; rows.take(row);) batch.solve(solver, found, row);
        }
    };
    {
        nb::gil_scoped_release release;
        share_rows(rows, threads, [&] { return Worker{batch, ClosedFormSolver(plan_), {}}; });
    }
    return nb::make_tuple(q.array, errors.array, counts.array, outside.array, known.array);
}

// Store the true lines and choose the cuts of the loop; there are none if the elimination fails for this arm.
void prepare_elimination(ArmPlan& plan, const Matrix& directions, const Matrix& points) {
    for (const PlannedJoint& joint : plan.joints)
        if (joint.prismatic) throw std::invalid_argument("the elimination supports revolute joints only");
    plan.true_joints = plan.joints;
    for (std::size_t k = 0; k < plan.joints.size(); ++k) {
        PlannedJoint& joint = plan.true_joints[k];
        joint.direction = {directions(k, 0), directions(k, 1), directions(k, 2)};
        joint.point = {points(k, 0), points(k, 1), points(k, 2)};
    }
    prepare_cuts(plan);
}

ArmPlan make_plan(const Chain& chain, double size, const Matrix& directions, const Matrix& points,
                  const std::vector<bool>& prismatic, const std::vector<int>& indices, const Vector& lower,
                  const Vector& upper, const Matrix& tool, int first_of_triple, bool planar, bool reversed, int normal,
                  std::optional<int> locked, double border, double spread, double rounding, bool eliminated,
                  const Matrix& true_directions, const Matrix& true_points) {
    const std::size_t count = prismatic.size();
    if (count != (locked ? 7 : 6)) throw std::invalid_argument("a loop has six joints, or seven of which one is locked");
    if (chain.dof > kMostJoints || !(size > 0.0)) throw std::invalid_argument("at most 7 joints, and a positive size");
    if (first_of_triple < -1 || first_of_triple > 3 || normal < 0 || normal > 2 ||
        (locked && (*locked < 0 || *locked > 6)))
        throw std::invalid_argument("an index of a joint is out of range");
    require_size("directions", directions.shape(0), count);
    require_size("a direction", directions.shape(1), 3);
    require_size("points", points.shape(0), count);
    require_size("a point", points.shape(1), 3);
    require_size("true_directions", true_directions.shape(0), count);
    require_size("a true direction", true_directions.shape(1), 3);
    require_size("true_points", true_points.shape(0), count);
    require_size("a true point", true_points.shape(1), 3);
    require_size("indices", indices.size(), count);
    require_size("lower", lower.size(), count);
    require_size("upper", upper.size(), count);
    require_size("tool", tool.size(), 16);
    ArmPlan plan{.chain = chain,
                 .size = size,
                 .joints = {},
                 .tool = read_transform(tool.data()),
                 .first_of_triple = first_of_triple,
                 .planar = planar,
                 .reversed = reversed,
                 .normal = normal,
                 .locked = locked.value_or(-1),
                 .border = border,
                 .spread = spread,
                 .position_tolerance = 0.0,
                 .orientation_tolerance = 0.0,
                 .virtual_tolerance = 0.0,
                 .equation_error = {rounding, rounding},
                 .true_joints = {},
                 .cuts = {}};
    for (std::size_t k = 0; k < count; ++k) {
        if (indices[k] < -1 || indices[k] >= static_cast<int>(chain.dof))
            throw std::invalid_argument("an index of a joint is out of range");
        plan.joints.push_back({{directions(k, 0), directions(k, 1), directions(k, 2)},
                               {points(k, 0), points(k, 1), points(k, 2)},
                               prismatic[k],
                               indices[k],
                               lower(k),
                               upper(k)});
    }
    if (eliminated) prepare_elimination(plan, true_directions, true_points);
    return plan;
}

ClosedForm* with_tolerances(const ClosedForm& form, double position, double orientation, double virtual_tolerance) {
    ArmPlan plan = form.plan();
    const double relative = std::max(position / plan.size, orientation);
    plan.position_tolerance = position;
    plan.orientation_tolerance = orientation;
    plan.virtual_tolerance = virtual_tolerance;
    plan.border = std::max(plan.border, kNear * relative);
    plan.equation_error.tolerance = std::max(kNear * relative, kRounding);
    return new ClosedForm(std::move(plan));
}

ClosedForm* without_limits(const ClosedForm& form) {
    ArmPlan plan = form.plan();
    constexpr double infinity = std::numeric_limits<double>::infinity();
    for (std::vector<PlannedJoint>* joints : {&plan.joints, &plan.true_joints})
        for (PlannedJoint& joint : *joints)
            if (!joint.is_virtual()) {
                joint.lower = -infinity;
                joint.upper = infinity;
            }
    return new ClosedForm(std::move(plan));
}

void bind_branch_list(nb::module_& module) {
    nb::class_<BranchList>(module, "Branches", "The branches for one target, nearest to the reference first.")
        .def("__init__", [](BranchList* self, const Matrix& q, const Matrix& errors) {
                new (self) BranchList(list_of(q, errors));
            }, nb::arg("q"), nb::arg("errors"))
        .def("__len__", [](const BranchList& list) { return list.branches.size(); })
        .def_prop_ro("q", &q_of, "(k, n)")
        .def_prop_ro("errors", &errors_of, "(k, 2) distance (m) and angle (rad) by forward kinematics")
        .def_prop_ro("free_joints", [](const BranchList& list) {
                return list.each([](const Branch& b) { return b.free_joints; });
            }, "for each branch, the set (bits) of the joints of q that are free to move")
        .def_prop_ro("numbers", [](const BranchList& list) {
                return list.each([](const Branch& b) { return b.number.code(); });
            }, "identify the same solution at neighbouring values of a free joint")
        .def_prop_ro("solution_bits", [](const BranchList& list) {
                return list.each([](const Branch& b) { return b.number.bit(); });
            }, "the bit of each branch in `unresolved`")
        .def_ro("all_free_joints", &BranchList::free_joints, "set of joints that are free in some solution")
        .def_ro("failed", &BranchList::failed, "number of solutions that forward kinematics did not confirm")
        .def_ro("outside", &BranchList::outside, "number of solutions outside the limits")
        .def_ro("by_quartic", &BranchList::by_quartic)
        .def_ro("doubtful", &BranchList::doubtful, "a case was omitted, or is not supported")
        .def_ro("unresolved", &BranchList::unresolved,
                "set of solutions with a free joint that have no branch for its given value")
        .def("select", &selected, nb::arg("indices"));
}

}  // namespace

void bind_closed_form(nb::module_& module) {
    bind_branch_list(module);
    nb::class_<ClosedForm>(module, "ClosedForm", "An arm prepared for the closed form.")
        .def("__init__",
             [](ClosedForm* self, const Chain& chain, double size, const Matrix& directions, const Matrix& points,
                const std::vector<bool>& prismatic, const std::vector<int>& indices, const Vector& lower,
                const Vector& upper, const Matrix& tool, int first_of_triple, bool planar, bool reversed, int normal,
                std::optional<int> locked, double border, double spread, double rounding,
                bool eliminated, const Matrix& true_directions, const Matrix& true_points) {
                 new (self) ClosedForm(make_plan(chain, size, directions, points, prismatic, indices, lower, upper,
                                                 tool, first_of_triple, planar, reversed, normal, locked, border,
                                                 spread, rounding, eliminated, true_directions, true_points));
             },
             nb::kw_only(), nb::arg("chain"), nb::arg("size"), nb::arg("directions"), nb::arg("points"),
             nb::arg("prismatic"), nb::arg("indices"), nb::arg("lower"), nb::arg("upper"), nb::arg("tool"),
             nb::arg("first_of_triple"), nb::arg("planar"), nb::arg("reversed"), nb::arg("normal"),
             nb::arg("locked").none(), nb::arg("border"), nb::arg("spread"), nb::arg("rounding"),
             nb::arg("eliminated"), nb::arg("true_directions"), nb::arg("true_points"))
        .def_prop_ro("cuts", [](const ClosedForm& form) {
                nb::list cuts;
                for (const Cut& cut : form.plan().cuts) cuts.append(nb::make_tuple(cut.dropped, cut.reversed, cut.shifted));
                return cuts;
            }, "the cuts of the loop for the general elimination, best first: see closed_form/elimination.h")
        .def_prop_ro("first_of_triple", [](const ClosedForm& form) { return form.plan().first_of_triple; })
        .def_prop_ro("planar", [](const ClosedForm& form) { return form.plan().planar; })
        .def("with_tolerances", &with_tolerances, nb::arg("position"), nb::arg("orientation"),
             nb::arg("virtual_tolerance"), nb::rv_policy::take_ownership)
        .def("without_limits", &without_limits, nb::rv_policy::take_ownership)
        .def("solve", &ClosedForm::solve, nb::arg("target"), nb::arg("reference"), nb::arg("locked_value") = 0.0,
             "The branches for a homogeneous matrix (4, 4); None if it is not rigid.")
        .def("solve_batch", &ClosedForm::solve_batch, nb::arg("targets"), nb::arg("references"), nb::arg("values"),
             nb::arg("capacity"), nb::arg("threads") = 1,
             "q (N, v, k, n), errors (N, v, k, 2), counts, solutions outside the limits and whether all are known "
             "(N, v), for targets (N, 4, 4) at values (1 or N, v) of the locked joint.");
    module.attr("BAD_TARGET") = static_cast<int>(kBadTarget);
    module.attr("ELSEWHERE") = static_cast<int>(kElsewhere);
    module.attr("EQUATION_ROUNDING") = kRounding;

    // Elementary parts, for tests.
    module.def("angle_of", &angle_of, nb::arg("y"), nb::arg("x"));
    module.def("nearest_winding", &nearest_winding, nb::arg("value"), nb::arg("lower"), nb::arg("upper"),
               nb::arg("slack"), nb::arg("reference"));
    module.def(
        "linear_roots",
        [](bool prismatic, double a, double b, double c, double border) -> std::optional<nb::list> {
            const Roots roots = solve({a, b, c, prismatic}, {.border = border, .spread = 0.0});
            if (roots.every_value) return std::nullopt;
            nb::list states;
            for (int i = 0; i < roots.count; ++i)
                states.append(nb::make_tuple(roots.state[i].first, roots.state[i].second));
            return states;
        },
        nb::arg("prismatic"), nb::arg("a"), nb::arg("b"), nb::arg("c"), nb::arg("border"),
        "The states that solve a s_1 + b s_2 + c = 0; None if every value does.");
    module.def(
        "quartic_roots",
        [](const Vector& a, double nearly) {
            require_size("a", a.size(), 5);
            const double coefficients[5] = {a(0), a(1), a(2), a(3), a(4)};
            const QuarticRoots roots = quartic_roots(coefficients, nearly);
            return std::vector<double>(roots.value, roots.value + roots.count);
        },
        nb::arg("coefficients"), nb::arg("nearly") = 0.0);
    module.def(
        "eigenvalues",
        [](const Matrix& matrix) -> std::optional<nb::list> {
            require_size("matrix", matrix.shape(0), kEigenRows);
            require_size("matrix", matrix.shape(1), kEigenRows);
            EigenMatrix m;
            for (int i = 0; i < kEigenRows; ++i)
                for (int j = 0; j < kEigenRows; ++j) m[i][j] = matrix(i, j);
            HessenbergForm form;
            form.reduce(m);
            Eigenvalue values[kEigenRows];
            if (!form.eigenvalues(values)) return std::nullopt;
            nb::list result;
            for (const Eigenvalue& one : values)
                result.append(nb::make_tuple(one.real, one.imaginary, form.condition(one)));
            return result;
        },
        nb::arg("matrix"), "Real part, imaginary part and condition number of each eigenvalue of a (16, 16) matrix.");
}

}  // namespace pinproof
