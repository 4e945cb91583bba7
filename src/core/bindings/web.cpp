// The block of numbers that describes a cell to the core as WebAssembly.
#include "web/cell.h"

#include "bindings/structs.h"

namespace pinproof {
namespace {

// An arm with its solver: Clik for complete poses, and the plan of its closed form.
CellArm* make_cell_arm(const IkSolver& solver, const Matrix& seeds, const std::optional<ArmPlan>& plan, int attempts, int base,
                  const std::vector<int>& joints) {
    const auto* clik = std::get_if<ClikStep>(&solver.rule);
    if (clik == nullptr || solver.task.positions + solver.task.angles != 6) refuse("not a solver of Clik for poses");
    require_size("joints", joints.size(), solver.chain.dof);
    return new CellArm{.chain = solver.chain, .ranges = solver.ranges,
                       .position_tolerance = solver.task.position_tolerance,
                       .orientation_tolerance = solver.task.orientation_tolerance, .damping = clik->damping,
                       .max_step = solver.max_step, .max_iterations = solver.max_iterations, .stall = solver.stall,
                       .attempts = attempts, .seeds = list_of(shaped("seeds", seeds, {kSome, solver.chain.dof})),
                       .plan = plan ? std::vector{*plan} : std::vector<ArmPlan>{}, .base = base, .joints = joints};
}

NewArray cell_block(const World& world, const Indices& joints, const Stack& poses, const std::vector<CellArm>& arms) {
    Cell cell = cell_of(world);
    const auto on = shaped("joints", joints, {kAny});
    const double* pose = finite("poses", poses, {on.size(), 4, 4}).data();
    for (std::int64_t joint : on) {
        cell.frames.push_back({static_cast<int>(joint), read_transform(pose)});
        pose += 16;
    }
    cell.arms = arms;
    const std::vector<double> block = write_cell(std::move(cell));
    if (!read_cell(block)) refuse("a frame, an arm or a joint of the cell does not exist");
    return array_of(block);
}

}  // namespace

void bind_web(nb::module_& module) {
    nb::class_<CellArm>(module, "CellArm", "An arm of a cell with its solvers, for cell_block.")
        .def(nb::new_(&make_cell_arm), "solver"_a, "seeds"_a, "plan"_a.none(), nb::kw_only(), "attempts"_a, "base"_a,
             "joints"_a);
    module.def("cell_block", &cell_block, "world"_a, "joints"_a, "poses"_a, "arms"_a,
               "The bodies and pairs of a world, frames on joints (K,), -1 for the root, at poses (K, 4, 4), and arms as "
               "one block of numbers, see web/cell.h.");
}

}  // namespace pinproof
