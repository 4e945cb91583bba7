// A robot in its cell as one block of numbers (float64), which a page holds for the core as WebAssembly.
//
// `write_cell` and `read_cell` are its only writer and its only reader, and one function visits the members for both.
// Shapes and their trees are stored as they are in the core, so that a page computes with the same numbers.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "closed_form/arm_plan.h"
#include "collision/world.h"
#include "ik/ik_solver.h"

namespace pinproof {

// A frame that a page draws or moves: on a joint, or on the root.
struct CellFrame {
    int joint = kRoot;
    Transform joint_from_frame;
};

// An arm with the settings of Clik for complete poses, and its closed form, if it has one.
struct CellArm {
    Chain chain;
    std::vector<JointRange> ranges;
    double position_tolerance = 0.0, orientation_tolerance = 0.0, damping = 0.0, max_step = 0.0;
    int max_iterations = 0;
    Stall stall{};
    int attempts = 0;
    std::vector<double> seeds;  // (count, n), row by row
    std::vector<ArmPlan> plan;  // one, or none
    int base = 0;               // the frame from which poses of the tcp are measured
    std::vector<int> joints;    // of the arm in the configuration of the cell
};

struct Cell {
    JointTree tree;
    std::vector<Body> robot, obstacles;
    double rounding = 0.0;
    std::vector<std::int64_t> pairs;  // two bodies each
    std::vector<double> margins;      // of the pairs
    std::vector<CellFrame> frames;
    std::vector<CellArm> arms;

    std::shared_ptr<const World> world() const;
};

// The bodies, pairs and margins of a world, without frames and arms.
Cell cell_of(const World& world);

std::vector<double> write_cell(Cell cell);

// None if the numbers are not those of a cell.
std::optional<Cell> read_cell(std::span<const double> numbers);

}  // namespace pinproof
