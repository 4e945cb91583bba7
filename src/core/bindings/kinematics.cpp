// Joints, chains and trees of them.
#include <cmath>

#include "bindings/arms.h"
#include "bindings/structs.h"
#include "geometry/rotations.h"
#include "geometry/sincos.h"
#include "kinematics/chain.h"

namespace pinproof {
namespace {

void require_indices(const std::vector<Joint>& joints, std::size_t dof) {
    for (const Joint& joint : joints)
        if (joint.index >= dof) refuse("the index of a joint is not smaller than dof");
}

void check_tree(const JointTree& tree) {
    require_indices(tree.joints, tree.dof);
    for (std::size_t k = 0; k < tree.joints.size(); ++k)
        if (tree.joints[k].parent < kRoot || tree.joints[k].parent >= static_cast<int>(k))
            refuse("the parent of a joint must come before it");
}

// Place the chain at each row of the configurations (N, n), and call `record(row, posture)`.
template <class Record>
void place_rows(const Chain& chain, const Matrix& configurations, Record record) {
    const double* q = shaped("configurations", configurations, {kAny, chain.dof}).data();
    nb::gil_scoped_release release;
    Posture posture(chain);
    for (std::size_t row = 0; row < configurations.shape(0); ++row, q += chain.dof) {
        posture.evaluate(chain, Frame{}, q);
        record(row, posture);
    }
}

NewArray forward_batch(const Chain& chain, const Matrix& configurations) {
    return filled<double>({configurations.shape(0), 4, 4}, [&](double* out) {
        place_rows(chain, configurations, [&](std::size_t row, const Posture& posture) {
            write_homogeneous(transform_of(posture.tcp()), out + 16 * row);
        });
    });
}

NewArray manipulability_batch(const Chain& chain, const Matrix& configurations) {
    return filled<double>({configurations.shape(0)}, [&](double* out) {
        Jacobian jacobian(chain.dof);
        place_rows(chain, configurations, [&](std::size_t row, const Posture& posture) {
            posture.jacobian(chain, jacobian);
            out[row] = std::exp(log_manipulability(jacobian));
        });
    });
}

std::tuple<Transform, NewArray> evaluate(const Chain& chain, const Vector& q, const Matrix& start) {
    const double *values = shaped("q", q, {chain.dof}).data(), *from = shaped("start", start, {4, 4}).data();
    Posture posture(chain);
    Jacobian columns(chain.dof);
    posture.evaluate(chain, frame_of(read_transform(from)), values);
    posture.jacobian(chain, columns);
    return {transform_of(posture.tcp()), jacobian_array(columns)};
}

std::vector<std::size_t> not_rigid(const Stack& matrices) {
    const auto numbers = shaped("matrices", matrices, {kAny, 4, 4});
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < matrices.shape(0); ++i)
        if (!is_rigid(numbers.data() + 16 * i)) indices.push_back(i);
    return indices;
}

}  // namespace

NewArray jacobian_array(const Jacobian& columns) {
    return filled<double>({6, columns.size()}, [&](double* out) {
        for (int i = 0; i < 6; ++i)
            for (const Twist& column : columns) *out++ = i < 3 ? column.linear[i] : column.angular[i - 3];
    });
}

Jacobian read_jacobian(const char* name, const Matrix& matrix) {
    shaped(name, matrix, {6, kAny});
    Jacobian columns(matrix.shape(1));
    for (std::size_t j = 0; j < columns.size(); ++j)
        for (std::size_t i = 0; i < 3; ++i) {
            columns[j].linear[i] = matrix(i, j);
            columns[j].angular[i] = matrix(i + 3, j);
        }
    return columns;
}

void bind_kinematics(nb::module_& module) {
    bind_struct<Joint>(module, "Joint",
                       "A joint about or along the z axis of its frame, with the value multiplier * q[index] + offset, "
                       "behind a constant transform from its parent (in a tree; -1: the root) or the previous joint.",
                       unchecked, member("before", &Joint::before), member("prismatic", &Joint::prismatic),
                       member("index", &Joint::index), member("multiplier", &Joint::multiplier),
                       member("offset", &Joint::offset), optional("parent", &Joint::parent));
    bind_struct<JointTree>(module, "JointTree", "The joints of a robot, each after its parent.", check_tree,
                           member("joints", &JointTree::joints), member("dof", &JointTree::dof));
    bind_struct<Chain>(module, "Chain",
                       "The joints of an arm from base to tcp: base_from_tcp(q) = before_1 X_1(q) before_2 X_2(q) ... "
                       "tool, where X_k is a rotation about z or a translation along z by the value of the joint.",
                       [](const Chain& chain) { require_indices(chain.joints, chain.dof); },
                       member("joints", &Chain::joints), member("tool", &Chain::tool), member("dof", &Chain::dof))
        .def_prop_ro("has_mimic_joints", &Chain::has_mimic_joints)
        .def("forward_batch", &forward_batch, "configurations"_a,
             "base_from_tcp (N, 4, 4) at each row of the configurations (N, n).")
        .def("manipulability_batch", &manipulability_batch, "configurations"_a,
             "sqrt(det(J J^T)) of the Jacobian of the tcp at each row (N, n); of J^T J with fewer than 6 joints.")
        .def("evaluate", &evaluate, "q"_a, "start"_a,
             "start times base_from_tcp (4, 4) at q (n,), and the Jacobian of the tcp (6, n) in the axes of start.");

    module.def(
        "is_rigid", [](const Matrix& matrix) { return is_rigid(shaped("matrix", matrix, {4, 4}).data()); }, "matrix"_a,
        "Whether a (4, 4) matrix is a rigid transform up to rounding.");
    module.def("all_finite", [](const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers) {
            return std::all_of(numbers.data(), numbers.data() + numbers.size(),
                               [](double x) { return std::isfinite(x); });
        }, "numbers"_a, "Whether all numbers of an array are finite.");
    module.def("not_rigid", &not_rigid, "matrices"_a,
               "The indices of the matrices (N, 4, 4) that are not rigid transforms up to rounding.");
}

}  // namespace pinproof
