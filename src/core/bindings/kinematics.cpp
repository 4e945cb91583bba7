// Chains of joints.
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/jacobians.h"
#include "common/threads.h"
#include "geometry/rigid.h"
#include "geometry/sincos.h"
#include "kinematics/chain.h"
#include "kinematics/manipulability.h"

namespace pinproof {
namespace {

void require_homogeneous(const char* name, const Matrix& matrix) {
    require_size(name, matrix.shape(0) == 4 ? matrix.shape(1) : 0, 4);
}

Chain make_chain(const Stack& before, const std::vector<bool>& prismatic, const std::vector<std::size_t>& index,
                 const std::vector<double>& multiplier, const std::vector<double>& offset, const Matrix& tool,
                 std::size_t dof) {
    const std::size_t count = prismatic.size();
    require_size("before", before.shape(0), count);
    require_size("index", index.size(), count);
    require_size("multiplier", multiplier.size(), count);
    require_size("offset", offset.size(), count);
    require_size("a matrix of before", before.shape(1) == 4 ? before.shape(2) : 0, 4);
    require_homogeneous("tool", tool);
    Chain chain;
    chain.dof = dof;
    chain.tool = read_transform(tool.data());
    for (std::size_t k = 0; k < count; ++k) {
        if (index[k] >= dof) throw std::invalid_argument("the index of a joint is not smaller than dof");
        chain.joints.push_back(
            {read_transform(before.data() + 16 * k), prismatic[k], index[k], multiplier[k], offset[k]});
    }
    return chain;
}

nb::object before_of(const Chain& chain) {
    auto matrices = new_array({chain.joints.size(), 4, 4});
    for (std::size_t k = 0; k < chain.joints.size(); ++k)
        write_homogeneous(chain.joints[k].before, matrices.data + 16 * k);
    return nb::cast(matrices.array);
}

nb::object tool_of(const Chain& chain) {
    auto matrix = new_array({4, 4});
    write_homogeneous(chain.tool, matrix.data);
    return nb::cast(matrix.array);
}

// An array with one number of each joint.
template <class Number, class Get>
nb::object each_joint(const Chain& chain, Get get) {
    auto numbers = new_array<Number>({chain.joints.size()});
    for (std::size_t k = 0; k < chain.joints.size(); ++k) numbers.data[k] = static_cast<Number>(get(chain.joints[k]));
    return nb::cast(numbers.array);
}

nb::object forward_batch(const Chain& chain, const Matrix& configurations) {
    require_size("a configuration", configurations.shape(1), chain.dof);
    const std::size_t count = configurations.shape(0);
    auto poses = new_array({count, 4, 4});
    {
        nb::gil_scoped_release release;
        Posture posture(chain);
        for (std::size_t i = 0; i < count; ++i) {
            posture.evaluate(chain, Frame{}, configurations.data() + i * chain.dof);
            write_homogeneous(transform_of(posture.tcp()), poses.data + 16 * i);
        }
    }
    return nb::cast(poses.array);
}

nb::object manipulability_batch(const Chain& chain, const Matrix& configurations) {
    require_size("a configuration", configurations.shape(1), chain.dof);
    const std::size_t count = configurations.shape(0);
    auto measures = new_array({count});
    {
        nb::gil_scoped_release release;
        Posture posture(chain);
        Jacobian jacobian(chain.dof);
        for (std::size_t i = 0; i < count; ++i) {
            posture.evaluate(chain, Frame{}, configurations.data() + i * chain.dof);
            posture.jacobian(chain, jacobian);
            measures.data[i] = std::exp(log_manipulability(jacobian));
        }
    }
    return nb::cast(measures.array);
}

// Both transforms of the tcp, and its Jacobian, at q from a start frame.
nb::tuple evaluate(const Chain& chain, const Vector& q, const Matrix& start) {
    require_size("q", q.shape(0), chain.dof);
    require_homogeneous("start", start);
    Posture posture(chain);
    Jacobian columns(chain.dof);
    posture.evaluate(chain, frame_of(read_transform(start.data())), q.data());
    posture.jacobian(chain, columns);
    auto pose = new_array({4, 4});
    write_homogeneous(transform_of(posture.tcp()), pose.data);
    return nb::make_tuple(nb::cast(pose.array), jacobian_array(columns));
}

nb::list not_rigid(const Stack& matrices) {
    require_size("a transform", matrices.shape(1) == 4 ? matrices.shape(2) : 0, 4);
    nb::list found;
    for (std::size_t i = 0; i < matrices.shape(0); ++i)
        if (!is_rigid(matrices.data() + 16 * i)) found.append(i);
    return found;
}

}  // namespace

nb::object jacobian_array(const Jacobian& columns) {
    auto matrix = new_array({6, columns.size()});
    for (std::size_t j = 0; j < columns.size(); ++j)
        for (int i = 0; i < 3; ++i) {
            matrix.data[i * columns.size() + j] = columns[j].linear[i];
            matrix.data[(i + 3) * columns.size() + j] = columns[j].angular[i];
        }
    return nb::cast(matrix.array);
}

Jacobian read_jacobian(const Matrix& matrix) {
    require_size("the rows of a Jacobian", matrix.shape(0), 6);
    Jacobian columns(matrix.shape(1));
    for (std::size_t j = 0; j < columns.size(); ++j)
        for (std::size_t i = 0; i < 3; ++i) {
            columns[j].linear[i] = matrix(i, j);
            columns[j].angular[i] = matrix(i + 3, j);
        }
    return columns;
}

void bind_kinematics(nb::module_& module) {
    nb::class_<Chain>(module, "Chain", "The joints of an arm from base to tcp.")
        .def(
            "__init__",
            [](Chain* self, const Stack& before, const std::vector<bool>& prismatic,
               const std::vector<std::size_t>& index, const std::vector<double>& multiplier,
               const std::vector<double>& offset, const Matrix& tool, std::size_t dof) {
                new (self) Chain(make_chain(before, prismatic, index, multiplier, offset, tool, dof));
            },
            nb::arg("before"), nb::arg("prismatic"), nb::arg("index"), nb::arg("multiplier"), nb::arg("offset"),
            nb::arg("tool"), nb::arg("dof"),
            "base_from_tcp(q) = before[0] X_0(q) before[1] X_1(q) ... tool, where X_k is a rotation about z or a "
            "translation along z by multiplier[k] * q[index[k]] + offset[k].")
        .def("__reduce__",
             [](nb::handle self) {
                 nb::list arguments;
                 for (const char* name : {"before", "prismatic", "index", "multiplier", "offset"}) {
                     nb::object value = self.attr(name);
                     arguments.append(nb::str(name).equal(nb::str("before")) ? value : value.attr("tolist")());
                 }
                 arguments.append(self.attr("tool"));
                 arguments.append(self.attr("dof"));
                 return nb::make_tuple(self.type(), nb::tuple(arguments));
             })
        .def_prop_ro("before", &before_of, "(m, 4, 4) the constant transform before each joint.")
        .def_prop_ro("tool", &tool_of, "(4, 4) the constant transform behind the last joint.")
        .def_prop_ro("prismatic",
                     [](const Chain& c) { return each_joint<bool>(c, [](const Joint& j) { return j.prismatic; }); })
        .def_prop_ro(
            "index", [](const Chain& c) { return each_joint<std::int64_t>(c, [](const Joint& j) { return j.index; }); },
            "(m,) the index in q of the value of each joint.")
        .def_prop_ro("multiplier",
                     [](const Chain& c) { return each_joint<double>(c, [](const Joint& j) { return j.multiplier; }); })
        .def_prop_ro("offset",
                     [](const Chain& c) { return each_joint<double>(c, [](const Joint& j) { return j.offset; }); })
        .def_prop_ro("dof", [](const Chain& c) { return c.dof; })
        .def_prop_ro("has_mimic_joints", &Chain::has_mimic_joints)
        .def("forward_batch", &forward_batch, nb::arg("configurations"),
             "base_from_tcp (N, 4, 4) at each row of the configurations (N, n).")
        .def("manipulability_batch", &manipulability_batch, nb::arg("configurations"),
             "sqrt(det(J J^T)) of the Jacobian of the tcp at each row (N, n); of J^T J with fewer than 6 joints.")
        .def("evaluate", &evaluate, nb::arg("q"), nb::arg("start"),
             "start times base_from_tcp (4, 4) at q (n,), and the Jacobian of the tcp (6, n) in the axes of start.");

    module.def(
        "is_rigid",
        [](const Matrix& matrix) {
            require_homogeneous("matrix", matrix);
            return is_rigid(matrix.data());
        },
        nb::arg("matrix"), "Whether a (4, 4) matrix is a rigid transform up to rounding.");
    module.def(
        "all_finite",
        [](const Numbers& numbers) {
            return std::all_of(numbers.data(), numbers.data() + numbers.size(),
                               [](double x) { return std::isfinite(x); });
        },
        nb::arg("numbers"), "Whether all numbers of an array are finite.");
    module.def("not_rigid", &not_rigid, nb::arg("matrices"),
               "The indices of the matrices (N, 4, 4) that are not rigid transforms up to rounding.");
    module.def("sincos", [](double angle) {
        const auto [sine, cosine] = sincos(angle);
        return std::make_tuple(sine, cosine);
    });
}

}  // namespace pinproof
