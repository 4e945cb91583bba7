// Chains of joints.
#include <nanobind/stl/vector.h>

#include <stdexcept>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "kinematics/chain.h"

namespace pinproof {
namespace {

Chain make_chain(const Stack& before, const std::vector<bool>& prismatic, const std::vector<std::size_t>& index,
                 const Vector& multiplier, const Vector& offset, const Matrix& tool, std::size_t dof) {
    const std::size_t count = prismatic.size();
    require_size("before", before.shape(0), count);
    require_size("index", index.size(), count);
    require_size("multiplier", multiplier.shape(0), count);
    require_size("offset", offset.shape(0), count);
    require_size("a matrix of before", before.shape(1) * before.shape(2), 16);
    require_size("tool", tool.size(), 16);
    Chain chain;
    chain.dof = dof;
    chain.tool = read_transform(tool.data());
    for (std::size_t k = 0; k < count; ++k) {
        if (index[k] >= dof) throw std::invalid_argument("the index of a joint is not smaller than dof");
        chain.joints.push_back(
            {read_transform(before.data() + 16 * k), prismatic[k], index[k], multiplier(k), offset(k)});
    }
    return chain;
}

nb::object forward_batch(const Chain& chain, const Matrix& configurations) {
    require_size("a configuration", configurations.shape(1), chain.dof);
    const std::size_t count = configurations.shape(0);
    auto poses = new_array({count, 4, 4});
    {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < count; ++i)
            write_homogeneous(forward_kinematics(chain, configurations.data() + i * chain.dof), poses.data + 16 * i);
    }
    return nb::cast(poses.array);
}

}  // namespace

void bind_kinematics(nb::module_& module) {
    nb::class_<Chain>(module, "Chain", "The joints of an arm from base to tcp.")
        .def(
            "__init__",
            [](Chain* self, const Stack& before, const std::vector<bool>& prismatic,
               const std::vector<std::size_t>& index, const Vector& multiplier, const Vector& offset,
               const Matrix& tool, std::size_t dof) {
                new (self) Chain(make_chain(before, prismatic, index, multiplier, offset, tool, dof));
            },
            nb::arg("before"), nb::arg("prismatic"), nb::arg("index"), nb::arg("multiplier"), nb::arg("offset"),
            nb::arg("tool"), nb::arg("dof"))
        .def("forward_batch", &forward_batch, nb::arg("configurations"),
             "base_from_tcp (N, 4, 4) at each row of the configurations (N, n).");
}

}  // namespace pinproof
