// Grids of cubic cells that a depth image proves to be free, and the cells within a convex body.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "collision/shape.h"
#include "geometry/vectors.h"

namespace pinproof {

// What is known of a cell. The states are ordered: of two views of a cell, the smaller state holds.
enum class CellState : std::uint8_t {
    kFree = 0,     // no surface is in it
    kSeen = 1,     // not free, and a surface was measured in it or right beside it
    kUnknown = 2,  // not free, and hidden or outside the view
};

// Cell (i, j, k) is the cube from (low + (i, j, k)) * side to (low + (i + 1, j + 1, k + 1)) * side.
struct CellGrid {
    std::int64_t low[3];
    std::size_t count[3];
    double side;  // m

    std::size_t size() const { return count[0] * count[1] * count[2]; }
    std::size_t index(std::size_t i, std::size_t j, std::size_t k) const { return (i * count[1] + j) * count[2] + k; }
    Vec3 corner(std::size_t i, std::size_t j, std::size_t k) const {
        return {static_cast<double>(low[0] + static_cast<std::int64_t>(i)) * side,
                static_cast<double>(low[1] + static_cast<std::int64_t>(j)) * side,
                static_cast<double>(low[2] + static_cast<std::int64_t>(k)) * side};
    }
};

// A pinhole camera without distortion: the point (x, y, z) of its frame is at u = fx x / z + cx, v = fy y / z + cy.
// Pixel (column, row) is the square within 1/2 of (u, v) = (column, row).
struct PinholeCamera {
    double fx, fy, cx, cy;
    int width, height;
    Transform camera_from_grid;
};

// For each pixel (row by row), bounds of the depth z (m) of the surfaces in it: all are at `nearest` or farther, and one
// was measured at `farthest` or nearer. Zeros: nothing is known, or no surface was measured.
struct DepthBounds {
    std::span<const float> nearest, farthest;
};

// Set the state of every cell (grid.size()) from one depth image. A cell is free if, in each pixel that its image
// covers and in `pixel_margin` pixels around it, every surface is farther than each point of the cell.
void carve(const CellGrid& grid, const PinholeCamera& camera, const DepthBounds& depth, int pixel_margin,
           std::span<std::uint8_t> cells);

// Set the cells that are entirely within `padding` (m) of a convex shape to free; returns how many were not free.
std::size_t clear_within(const CellGrid& grid, const Shape& shape, const Transform& shape_from_grid, double padding,
                         std::span<std::uint8_t> cells);

}  // namespace pinproof
