// Grids of cells that depth images prove to be free.
#include <nanobind/stl/tuple.h>

#include <bit>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "collision/occupancy.h"

namespace pinproof {
namespace {

using Image = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Cells = nb::ndarray<std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

// Cells on either side of the origin along each axis: their corners are exact doubles, and no index overflows.
constexpr std::int64_t kMostCells = std::int64_t{1} << 40;

// An image is addressed by int, and its windows by a shift of it.
constexpr std::size_t kMostPixels = 1 << 16;

CellGrid grid_of(const Cells& cells, const Indices& low, double side) {
    require_size("low", low.shape(0), 3);
    require_positive("side", side);
    require_finite("side", &side, 1);
    CellGrid grid{{low(0), low(1), low(2)}, {cells.shape(0), cells.shape(1), cells.shape(2)}, side};
    for (std::int64_t index : grid.low)
        if (index < -kMostCells || index > kMostCells) throw std::invalid_argument("low is out of range");
    return grid;
}

Transform placement_of(const char* name, const Matrix& matrix) {
    require_size(name, matrix.size(), 16);
    require_finite(name, matrix.data(), 16);
    return read_transform(matrix.data());
}

// The depths in single precision, rounded down or up, so that bounds remain bounds. The next number of a positive one is
// that whose bits, read as an integer, are one more.
template <bool up>
std::vector<float> rounded(const Image& image) {
    const double* depth = image.data();
    std::vector<float> values(image.size());
    bool valid = true;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const auto nearest = static_cast<float>(depth[i]);
        const auto bits = std::bit_cast<std::uint32_t>(nearest);
        const auto wrong = static_cast<std::uint32_t>(up ? nearest < depth[i] : nearest > depth[i]);
        values[i] = std::bit_cast<float>(up ? bits + wrong : bits - wrong);
        valid &= depth[i] >= 0.0;
    }
    if (!valid) throw std::invalid_argument("a depth is negative or NaN");
    return values;
}

}  // namespace

void bind_occupancy(nb::module_& module) {
    module.def(
        "carve",
        [](Cells cells, const Indices& low, double side, const Matrix& camera_from_grid, const Vector& intrinsics,
           const Image& nearest, const Image& farthest, int pixel_margin) {
            const CellGrid grid = grid_of(cells, low, side);
            require_size("intrinsics", intrinsics.shape(0), 4);
            require_finite("intrinsics", intrinsics.data(), 4);
            require_positive("fx", intrinsics(0));
            require_positive("fy", intrinsics(1));
            const std::size_t height = nearest.shape(0), width = nearest.shape(1);
            require_size("rows of farthest", farthest.shape(0), height);
            require_size("columns of farthest", farthest.shape(1), width);
            if (height == 0 || width == 0 || height > kMostPixels || width > kMostPixels)
                throw std::invalid_argument("an image has 1 to 65536 rows and columns");
            if (pixel_margin < 0 || pixel_margin > static_cast<int>(kMostPixels))
                throw std::invalid_argument("pixel_margin is out of range");
            const std::vector<float> near_bounds = rounded<false>(nearest), far_bounds = rounded<true>(farthest);
            const PinholeCamera camera{intrinsics(0),
                                       intrinsics(1),
                                       intrinsics(2),
                                       intrinsics(3),
                                       static_cast<int>(width),
                                       static_cast<int>(height),
                                       placement_of("camera_from_grid", camera_from_grid)};
            nb::gil_scoped_release release;
            carve(grid, camera, {near_bounds, far_bounds}, pixel_margin, {cells.data(), grid.size()});
        },
        nb::arg("cells").noconvert(), nb::arg("low"), nb::arg("side"), nb::arg("camera_from_grid"),
        nb::arg("intrinsics"), nb::arg("nearest"), nb::arg("farthest"), nb::arg("pixel_margin"),
        "Set the state of each cell (nx, ny, nz) from one depth image, given as bounds of depth (m); see "
        "collision/occupancy.h. The intrinsics are fx, fy, cx, cy.");
    module.def(
        "clear_within",
        [](Cells cells, const Indices& low, double side, const Shape& shape, const Matrix& shape_from_grid,
           double padding) {
            const CellGrid grid = grid_of(cells, low, side);
            if (shape.kind != ShapeKind::kConvex) throw std::invalid_argument("the shape is not convex and bounded");
            if (!(padding >= 0.0 && padding <= std::numeric_limits<double>::max()))
                throw std::invalid_argument("padding must be 0 or more");
            const Transform placement = placement_of("shape_from_grid", shape_from_grid);
            nb::gil_scoped_release release;
            return clear_within(grid, shape, placement, padding, {cells.data(), grid.size()});
        },
        nb::arg("cells").noconvert(), nb::arg("low"), nb::arg("side"), nb::arg("shape"), nb::arg("shape_from_grid"),
        nb::arg("padding"),
        "Set the cells that are entirely within the padding (m) of a convex shape to free; returns how many were not.");
}

}  // namespace pinproof
