// The closed form of an arm.
#include <nanobind/stl/vector.h>

#include <optional>

#include "bindings/structs.h"
#include "closed_form/closed_form.h"
#include "common/threads.h"
#include "geometry/sincos.h"
#include "kinematics/joint_range.h"

namespace pinproof {
namespace {

// The counts of a batch where a target has no number of branches.
enum Count : std::int64_t {
    kBadTarget = -1,   // it is not rigid
    kElsewhere = -2,  // joints are free and there may be branches at other values of them, or more than fit
};

// The branches for one target, sorted by the largest joint difference from the reference.
struct BranchList : BranchSummary {
    std::size_t dof = 0;
    std::vector<Branch> branches;
};

BranchList sorted_list(const Branches& found, const double* reference, std::size_t dof) {
    double distance[Branches::kMost];
    for (int i = 0; i < found.count; ++i) {
        distance[i] = 0.0;
        for (std::size_t j = 0; j < dof; ++j)
            distance[i] = std::max(distance[i], std::abs(found.branch[i].q[j] - reference[j]));
    }
    BranchList list{found, dof, std::vector<Branch>(found.count)};
    // The place of each in the order, of equal ones the first first: for few branches faster than a sort, whose jumps depend
    // on the distances.
    for (int i = 0; i < found.count; ++i) {
        int place = 0;
        for (int k = 0; k < found.count; ++k) place += k < i ? distance[k] <= distance[i] : distance[k] < distance[i];
        list.branches[place] = found.branch[i];
    }
    return list;
}

BranchList list_of_branches(const Matrix& q, const Matrix& errors) {
    const std::size_t count = q.shape(0), dof = q.shape(1);
    if (dof > kMostJoints) refuse("a closed form has at most 8 joints");
    const auto sizes = shaped("errors", errors, {count, 2});
    BranchList list{{}, dof, std::vector<Branch>(count)};
    for (std::size_t i = 0; i < count; ++i) {
        std::copy_n(q.data() + i * dof, dof, list.branches[i].q);
        list.branches[i].distance = sizes[2 * i];
        list.branches[i].angle = sizes[2 * i + 1];
    }
    return list;
}

// Arrays that users see are read-only.
ReadOnlyArray q_of(const BranchList& list) {
    return filled<const double>({list.branches.size(), list.dof}, [&](double* out) {
        for (const Branch& branch : list.branches) out = std::copy_n(branch.q, list.dof, out);
    });
}

ReadOnlyArray errors_of(const BranchList& list) {
    return table<const double>(list.branches, &Branch::distance, &Branch::angle);
}

template <class Read>
auto each_branch(Read read) {
    return [read](const BranchList& list) {
        std::vector<int> values;
        for (const Branch& branch : list.branches) values.push_back(static_cast<int>(read(branch)));
        return values;
    };
}

BranchList selected(const BranchList& list, const std::vector<std::size_t>& indices) {
    BranchList subset{list, list.dof, {}};
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

    std::optional<BranchList> solve(const Matrix& target, const Vector& reference,
                                    const std::optional<Vector>& locked_values) {
        const double* matrix = shaped("target", target, {4, 4}).data();
        const double* near = shaped("reference", reference, {plan_.dof()}).data();
        if (!locked_values && !plan_.locked.empty()) refuse("the values of the locked joints are missing");
        const double* locked = locked_values ? shaped("locked_values", *locked_values, {plan_.locked.size()}).data() : nullptr;
        if (!solver_.solve(matrix, near, locked, found_)) return std::nullopt;
        return sorted_list(found_, near, plan_.dof());
    }

    // The same without locked joints; also None if joints are free and no branch has their values of the reference.
    std::optional<BranchList> solve_here(const Matrix& target, const Vector& reference) {
        std::optional<BranchList> found = solve(target, reference, std::nullopt);
        return found && found->branches.empty() && found->free_joints ? std::nullopt : std::move(found);
    }

    nb::tuple solve_batch(const Stack& targets, const Matrix& references, const Stack& values, std::size_t capacity,
                          std::size_t threads) const;

  private:
    ArmPlan plan_;
    ClosedFormSolver solver_;
    Branches found_;
};

// Row i * v + j is for target i and the values j of the locked joints.
struct BatchRows {
    const double *targets, *references, *values;
    std::size_t value_count, dof, capacity;
    std::size_t locked;  // the number of locked joints
    bool one_reference, one_set_of_values;
    double *q = nullptr, *errors = nullptr;
    std::int64_t *counts = nullptr, *outside = nullptr;
    bool* known = nullptr;

    void solve(ClosedFormSolver& solver, Branches& found, std::size_t row) const {
        const std::size_t i = row / value_count, j = row % value_count;
        const double* reference = references + (one_reference ? 0 : i * dof);
        const double* value = values + locked * ((one_set_of_values ? 0 : i * value_count) + j);
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
        if (found.count > most) return locked > 0 ? most : static_cast<std::int64_t>(kElsewhere);
        if (found.count == 0 && found.free_joints != 0) return kElsewhere;
        return found.count;
    }
};

nb::tuple ClosedForm::solve_batch(const Stack& targets, const Matrix& references, const Stack& values,
                                  std::size_t capacity, std::size_t threads) const {
    const std::size_t count = targets.shape(0), v = values.shape(1), n = plan_.dof();
    const std::size_t reference_rows = references.shape(0) == 1 ? 1 : count;
    const std::size_t value_rows = values.shape(0) == 1 ? 1 : count;
    BatchRows batch{.targets = shaped("targets", targets, {kAny, 4, 4}).data(),
                    .references = shaped("references", references, {reference_rows, n}).data(),
                    .values = shaped("values", values, {value_rows, kAny, plan_.locked.size()}).data(),
                    .value_count = v, .dof = n, .capacity = capacity, .locked = plan_.locked.size(),
                    .one_reference = references.shape(0) == 1, .one_set_of_values = values.shape(0) == 1};
    const auto arrays = nb::make_tuple(filled({count, v, capacity, n}, batch.q),
                                       filled({count, v, capacity, 2}, batch.errors), filled({count, v}, batch.counts), filled({count, v}, batch.outside),
                                       filled({count, v}, batch.known));
    struct Worker {
        const BatchRows& batch;
        ClosedFormSolver solver;
        Branches found;
        void operator()(Rows& rows) {
            for (std::size_t row; rows.take(row);) batch.solve(solver, found, row);
        }
    };
    nb::gil_scoped_release release;
    share_rows(count * v, threads, [&] { return Worker{batch, ClosedFormSolver(plan_), {}}; });
    return arrays;
}

void check_plan(const ArmPlan& plan) {
    const std::size_t count = plan.joints.size();
    if (plan.locked.size() > kMostLocked || count != 6 + plan.locked.size())
        refuse("a loop has six joints, and at most two that are locked");
    if (!plan.true_joints.empty()) require_size("true_joints", plan.true_joints.size(), count);
    if (plan.chain.dof > kMostJoints || !(plan.size > 0.0)) refuse("at most 8 joints, and a positive size");
    bool exist = plan.first_of_triple >= -1 && plan.first_of_triple <= 3 && plan.normal >= 0 && plan.normal <= 2;
    int last = -1;
    for (const int k : plan.locked) {
        exist = exist && k > last && k < static_cast<int>(count) && !plan.joints[k].is_virtual();
        last = k;
    }
    for (const auto* joints : {&plan.joints, &plan.true_joints})
        for (const PlannedJoint& joint : *joints)
            exist = exist && joint.index >= -1 && joint.index < static_cast<int>(plan.chain.dof);
    if (!exist) refuse("an index of a joint is out of range");
}

ClosedForm* make_closed_form(ArmPlan plan) {
    plan.equation_tolerance = plan.rounding;
    if (!plan.true_joints.empty()) prepare_cuts(plan);  // there are none if the elimination fails for this arm
    return new ClosedForm(std::move(plan));
}

ClosedForm* with_tolerances(const ClosedForm& form, double position, double orientation, double virtual_tolerance) {
    ArmPlan plan = form.plan();
    const double relative = std::max(position / plan.size, orientation);
    plan.position_tolerance = position;
    plan.orientation_tolerance = orientation;
    plan.virtual_tolerance = virtual_tolerance;
    plan.border = std::max(plan.border, kNear * relative);
    plan.equation_tolerance = std::max(kNear * relative, kRounding);
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

// Elementary parts, for tests.
void bind_parts_of_closed_forms(nb::module_& module) {
    module.def("angle_of", &angle_of, "y"_a, "x"_a);
    module.def("nearest_winding", &nearest_winding, "value"_a, "lower"_a, "upper"_a, "slack"_a, "reference"_a);
    module.def(
        "linear_roots",
        [](bool prismatic, double a, double b, double c, double border) -> std::optional<nb::list> {
            const Roots roots = solve({a, b, c, prismatic}, {.border = border, .spread = 0.0});
            if (roots.every_value) return std::nullopt;
            nb::list states;
            for (const JointState& state : std::span(roots.state, roots.count))
                states.append(std::tuple(state.first, state.second));
            return states;
        }, "prismatic"_a, "a"_a, "b"_a, "c"_a, "border"_a,
        "The states that solve a s_1 + b s_2 + c = 0; None if every value does.");
    module.def("quartic_roots", [](const Vector& coefficients, double nearly) {
            double a[5];
            std::ranges::copy(shaped("coefficients", coefficients, {5}), a);
            const QuarticRoots roots = quartic_roots(a, nearly);
            return Doubles(roots.value, roots.value + roots.count);
        }, "coefficients"_a, "nearly"_a = 0.0);
    module.def("eigenvalues", [](const Matrix& matrix) -> std::optional<nb::list> {
            shaped("matrix", matrix, {kEigenRows, kEigenRows});
            EigenMatrix m;
            for (int i = 0; i < kEigenRows; ++i)
                for (int j = 0; j < kEigenRows; ++j) m[i][j] = matrix(i, j);
            HessenbergForm form;
            form.reduce(m);
            Eigenvalue values[kEigenRows];
            if (!form.eigenvalues(values)) return std::nullopt;
            nb::list result;
            for (const Eigenvalue& one : values)
                result.append(std::tuple(one.real, one.imaginary, form.condition(one)));
            return result;
        }, "matrix"_a, "Real part, imaginary part and condition number of each eigenvalue of a (16, 16) matrix.");
}

}  // namespace

void bind_closed_form(nb::module_& module) {
    bind_result<BranchList>(module, "Branches", "The branches for one target, nearest to the reference first.",
                            "all_free_joints", &BranchList::free_joints, FIELDS(BranchList, failed, outside,
                                                                                by_quartic, doubtful, unresolved))
        .def(nb::new_(&list_of_branches), "q"_a, "errors"_a)
        .def("__len__", [](const BranchList& list) { return list.branches.size(); })
        .def_prop_ro("q", &q_of, "(k, n)")
        .def_prop_ro("errors", &errors_of, "(k, 2) distance (m) and angle (rad) by forward kinematics")
        .def_prop_ro("free_joints", each_branch([](const Branch& b) { return b.free_joints; }),
                     "for each branch, the set (bits) of the joints of q that are free to move")
        .def_prop_ro("numbers", each_branch([](const Branch& b) { return b.number.code(); }),
                     "identify the same solution at neighbouring values of a free joint")
        .def_prop_ro("solution_bits", each_branch([](const Branch& b) { return b.number.bit(); }),
                     "the bit of each branch in `unresolved`")
        .def("select", &selected, "indices"_a);
    bind_result<Cut>(module, "Cut", "A cut of a loop for the general elimination: see closed_form/elimination.h.",
                     FIELDS(Cut, dropped, reversed, shifted));
    bind_struct<PlannedJoint>(module, "PlannedJoint",
                              "The line of a joint at zero, with lengths relative to the size of the arm, its index in "
                              "q (-1: a virtual joint, which must be zero) and its limits.",
                              unchecked, MEMBERS(PlannedJoint, direction, point, prismatic, index),
                              LIMITS(PlannedJoint, lower, upper));
    bind_struct<ArmPlan>(module, "ArmPlan", "How the closed form of an arm is found: see closed_form/arm_plan.h.",
                         check_plan, MEMBERS(ArmPlan, chain, size, joints, tool, first_of_triple, planar, reversed,
                                             normal, locked, border, spread, rounding, true_joints))
        .def_ro("cuts", &ArmPlan::cuts, "the cuts of the loop for the general elimination, best first");
    nb::class_<ClosedForm>(module, "ClosedForm", "An arm prepared for the closed form.")
        .def(nb::new_(&make_closed_form), "plan"_a)
        .def_prop_ro("plan", &ClosedForm::plan)
        .def("with_tolerances", &with_tolerances, "position"_a, "orientation"_a, "virtual_tolerance"_a,
             nb::rv_policy::take_ownership)
        .def("without_limits", &without_limits, nb::rv_policy::take_ownership)
        .def("solve", &ClosedForm::solve, "target"_a, "reference"_a, "locked_values"_a = nb::none(),
             "The branches for a homogeneous matrix (4, 4); None if it is not rigid.")
        .def("solve_here", &ClosedForm::solve_here, "target"_a, "reference"_a,
             "The same without locked joints; also None if joints are free and no branch has their values of the "
             "reference.")
        .def("solve_batch", &ClosedForm::solve_batch, "targets"_a, "references"_a, "values"_a, "capacity"_a,
             "threads"_a = 1,
             "q (N, v, k, n), errors (N, v, k, 2), counts, solutions outside the limits and whether all are known "
             "(N, v), for targets (N, 4, 4) at values (1 or N, v, l) of the locked joints.");
    module.attr("BAD_TARGET") = static_cast<int>(kBadTarget);
    module.attr("ELSEWHERE") = static_cast<int>(kElsewhere);
    module.attr("EQUATION_ROUNDING") = kRounding;
    bind_parts_of_closed_forms(module);
}

}  // namespace pinproof
