#include "collision/occupancy.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "collision/gjk.h"

namespace pinproof {
namespace {

// Allowances for rounding, far above it and far below what a camera resolves.
constexpr double kPixelSlack = 1e-6;  // pixels
constexpr double kDepthSlack = 1e-9;  // m
constexpr double kSingle = 2e-7;      // share of a number: above the rounding to single precision

constexpr double kNear = 1e-6;  // m; points nearer to the plane of the camera, or behind it, are not in its view

constexpr std::size_t kLeaf = 4;  // cells along the side of a block whose cells are judged one by one
constexpr std::size_t kNodes = kLeaf + 1;

// Windows of pixels begin at every second pixel; those of more than 2^kDenseLevels pixels are a quarter of their side
// apart. With a window at every pixel the tables would not fit into the cache.
constexpr int kDenseLevels = 3;

// A rectangle of pixels, both ends included.
struct PixelRect {
    int left, top, right, bottom;
};

// What is known of some pixels: every surface in them is at `nearest` or farther, and nothing is proven or measured
// beyond `farthest`.
struct DepthRange {
    float nearest, farthest;
};

// The depth range of windows of 2^level x 2^level pixels, cut off at the edges of the image.
class WindowTable {
public:
    WindowTable(const DepthBounds& depth, int width, int height) : width_(width), height_(height) {
        Level pairs = make(1);
        for (int y = 0; y < height; ++y) {
            const std::size_t row = static_cast<std::size_t>(y) * width;
            float* out = pairs.values.data() + 2 * static_cast<std::size_t>(y >> 1) * pairs.width;
            for (int x = 0; x < width; ++x) {
                const float nearest = depth.nearest[row + x], farthest = depth.farthest[row + x];
                float* window = out + 2 * (x >> 1);
                window[0] = smaller(window[0], nearest);
                window[1] = smaller(window[1], -std::max(nearest, farthest));
            }
        }
        levels_.push_back(std::move(pairs));
        for (int level = 2; (1 << level) <= std::min(width, height); ++level) add(level);
    }

    // The range of windows that contain the rectangle and reach at most three pixels, or a quarter of it, beyond it.
    DepthRange over(const PixelRect& rect) const {
        const int shorter = std::min(rect.right - rect.left, rect.bottom - rect.top) + 1;
        const int level = std::max(static_cast<int>(std::bit_width(static_cast<unsigned>(shorter))) - 1, 1);
        const Level& windows = levels_[static_cast<std::size_t>(level - 1)];
        const int side = 1 << level, shift = windows.shift;
        // A window that ends at the edge of the rectangle or beyond it.
        const int last_x = (std::max(rect.right + 1 - side, rect.left) + (1 << shift) - 1) >> shift;
        const int last_y = (std::max(rect.bottom + 1 - side, rect.top) + (1 << shift) - 1) >> shift;
        float nearest = std::numeric_limits<float>::infinity(), farthest = nearest;
        for (int y = rect.top >> shift;; y = std::min(y + (side >> shift), last_y)) {
            for (int x = rect.left >> shift;; x = std::min(x + (side >> shift), last_x)) {
                const float* here = windows.at(std::min(x, windows.width - 1), std::min(y, windows.height - 1));
                nearest = smaller(nearest, here[0]);
                farthest = smaller(farthest, here[1]);
                if (x >= last_x) break;
            }
            if (y >= last_y) break;
        }
        return {nearest, -farthest};
    }

private:
    // Both ends of a range are stored as numbers of which the smaller one holds: nearest, and minus farthest.
    struct Level {
        int width, height;  // windows
        int shift;          // window (x, y) begins at pixel (x << shift, y << shift)
        std::vector<float> values;

        const float* at(int x, int y) const { return values.data() + 2 * (static_cast<std::size_t>(y) * width + x); }
    };

    static float smaller(float a, float b) { return a < b ? a : b; }

    Level make(int level) const {
        const int shift = std::max(level - kDenseLevels, 0) + 1;
        const int width = ((width_ - 1) >> shift) + 1, height = ((height_ - 1) >> shift) + 1;
        const auto size = 2 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
        return {width, height, shift, std::vector<float>(size, std::numeric_limits<float>::infinity())};
    }

    void add(int level) {
        const Level& fine = levels_.back();
        Level coarse = make(level);
        const int width = coarse.width, height = coarse.height, ratio = coarse.shift - fine.shift;
        const int half = (1 << (level - 1)) >> fine.shift;  // in windows of the finer level
        // Windows in whose right half there are pixels.
        const int both = std::clamp((fine.width - half + (1 << ratio) - 1) >> ratio, 0, width);
        for (int y = 0; y < height; ++y) {
            const int upper = y << ratio, lower = upper + half < fine.height ? upper + half : upper;
            const float *a = fine.at(0, upper), *b = fine.at(0, lower);
            float* out = coarse.values.data() + 2 * static_cast<std::size_t>(y) * width;
            const auto joined = [&](int from, int right) {
                return smaller(smaller(a[from], a[right]), smaller(b[from], b[right]));
            };
            if (ratio == 0) {
                for (int x = 0; x < 2 * both; ++x) out[x] = joined(x, x + 2 * half);
            } else {
                for (int x = 0; x < both; ++x)
                    for (int end = 0; end < 2; ++end) out[2 * x + end] = joined(4 * x + end, 4 * x + end + 2 * half);
            }
            for (int x = both; x < width; ++x)
                for (int end = 0; end < 2; ++end) {
                    const int from = 2 * (x << ratio) + end;
                    out[2 * x + end] = joined(from, from);
                }
        }
        levels_.push_back(std::move(coarse));
    }

    int width_, height_;  // of the image
    std::vector<Level> levels_;
};

// Where a convex region is in the view: its depths (m) and the ends of its image (pixels).
struct Footprint {
    double near_z, far_z;
    double left, right, top, bottom;
};

// A block of cells: from `first` up to, but without, `end`.
struct Block {
    std::size_t first[3], end[3];
};

class Carver {
public:
    Carver(const CellGrid& grid, const PinholeCamera& camera, const DepthBounds& depth, int pixel_margin,
           std::span<std::uint8_t> cells)
        : grid_(grid),
          camera_(camera),
          depth_(depth),
          margin_(pixel_margin),
          cells_(cells),
          windows_(depth, camera.width, camera.height),
          origin_(camera.camera_from_grid * grid.corner(0, 0, 0)) {
        for (int i = 0; i < 3; ++i) step_[i] = grid.side * camera.camera_from_grid.rotation.column(i);
    }

    void run() {
        std::size_t side = kLeaf;
        while (side < std::max({grid_.count[0], grid_.count[1], grid_.count[2]})) side *= 2;
        visit(0, 0, 0, side);
    }

private:
    // Judge the cells of a cube of blocks; a power of two of cells on each side, of which some may be outside the grid.
    void visit(std::size_t i, std::size_t j, std::size_t k, std::size_t side) {
        if (i >= grid_.count[0] || j >= grid_.count[1] || k >= grid_.count[2]) return;
        const Block block{{i, j, k},
                          {std::min(i + side, grid_.count[0]), std::min(j + side, grid_.count[1]),
                           std::min(k + side, grid_.count[2])}};
        CellState state{};
        if (all_cells(block, state)) {
            fill(block, state);
        } else if (side == kLeaf) {
            judge_each(block);
        } else {
            const std::size_t half = side / 2;
            for (int part = 0; part < 8; ++part)
                visit(i + (part & 1 ? half : 0), j + (part & 2 ? half : 0), k + (part & 4 ? half : 0), half);
        }
    }

    Vec3 in_camera(std::size_t i, std::size_t j, std::size_t k) const {
        return origin_ + static_cast<double>(i) * step_[0] + static_cast<double>(j) * step_[1] +
               static_cast<double>(k) * step_[2];
    }

    // Whether one state holds for all cells of a block.
    bool all_cells(const Block& block, CellState& state) const {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        Footprint print{infinity, -infinity, infinity, -infinity, infinity, -infinity};
        Vec3 corners[8];
        for (int c = 0; c < 8; ++c) {
            corners[c] = in_camera(c & 1 ? block.end[0] : block.first[0], c & 2 ? block.end[1] : block.first[1],
                                   c & 4 ? block.end[2] : block.first[2]);
            print.near_z = std::min(print.near_z, corners[c].z);
            print.far_z = std::max(print.far_z, corners[c].z);
        }
        state = CellState::kUnknown;
        if (print.far_z < kNear) return true;
        if (print.near_z < kNear) return false;
        // The image of a convex body in front of the camera is the hull of the images of its corners.
        for (const Vec3& corner : corners) {
            const double u = camera_.fx * corner.x / corner.z + camera_.cx;
            const double v = camera_.fy * corner.y / corner.z + camera_.cy;
            print.left = std::min(print.left, u);
            print.right = std::max(print.right, u);
            print.top = std::min(print.top, v);
            print.bottom = std::max(print.bottom, v);
        }
        const Outlook outlook = look(print);
        state = outlook.state;
        return outlook.decided;
    }

    // What the tables show of a region in front of the camera: one state for all cells in it, or the pixels that decide.
    struct Outlook {
        bool decided;
        CellState state;
        bool inside;  // whether all of its image is within that of the camera
        PixelRect rect;
    };

    Outlook look(const Footprint& print) const {
        Outlook outlook{true, CellState::kUnknown, false, {}};
        PixelRect& rect = outlook.rect;
        outlook.inside = pixels_of(print, rect);
        if (rect.left > rect.right || rect.top > rect.bottom) return outlook;
        const DepthRange range = windows_.over(rect);
        if (outlook.inside && print.far_z + kDepthSlack < range.nearest)
            outlook.state = CellState::kFree;
        else  // unless everything that the pixels prove or measure is in front of it
            outlook.decided = range.farthest <= 0.0f || print.near_z - kDepthSlack > range.farthest;
        return outlook;
    }

    // The pixels of the image that a footprint, widened by the margin, touches; whether all of it is in the image.
    bool pixels_of(const Footprint& print, PixelRect& rect) const {
        const double more = margin_ + 0.5 + kPixelSlack;
        const double left = std::ceil(print.left - more), right = std::floor(print.right + more);
        const double top = std::ceil(print.top - more), bottom = std::floor(print.bottom + more);
        const double w = camera_.width - 1, h = camera_.height - 1;
        // Clamped before the conversion to integers, which is undefined for large numbers.
        rect = {static_cast<int>(std::clamp(left, 0.0, w + 1)), static_cast<int>(std::clamp(top, 0.0, h + 1)),
                static_cast<int>(std::clamp(right, -1.0, w)), static_cast<int>(std::clamp(bottom, -1.0, h))};
        return left >= 0.0 && right <= w && top >= 0.0 && bottom <= h;
    }

    void fill(const Block& block, CellState state) {
        for (std::size_t i = block.first[0]; i < block.end[0]; ++i)
            for (std::size_t j = block.first[1]; j < block.end[1]; ++j)
                std::fill_n(cells_.data() + grid_.index(i, j, block.first[2]), block.end[2] - block.first[2],
                            static_cast<std::uint8_t>(state));
    }

    // Nodes of the lattice of a block, and then their extremes over the nodes of each cell.
    using Nodes = double[kNodes][kNodes][kNodes + 3];  // rows padded to whole vector registers

    // Replace the value of each node by the extreme of the eight nodes of the cell that begins at it.
    template <class Pick>
    static void over_cells(Nodes& value, Pick pick) {
        for (std::size_t i = 0; i < kNodes; ++i)
            for (std::size_t j = 0; j < kNodes; ++j)
                for (std::size_t k = 0; k < kLeaf; ++k) value[i][j][k] = pick(value[i][j][k], value[i][j][k + 1]);
        for (std::size_t i = 0; i < kNodes; ++i)
            for (std::size_t j = 0; j < kLeaf; ++j)
                for (std::size_t k = 0; k < kLeaf; ++k) value[i][j][k] = pick(value[i][j][k], value[i][j + 1][k]);
        for (std::size_t i = 0; i < kLeaf; ++i)
            for (std::size_t j = 0; j < kLeaf; ++j)
                for (std::size_t k = 0; k < kLeaf; ++k) value[i][j][k] = pick(value[i][j][k], value[i + 1][j][k]);
    }

    void judge_each(const Block& block) {
        constexpr auto smaller = [](double a, double b) { return a < b ? a : b; };
        constexpr auto larger = [](double a, double b) { return a > b ? a : b; };
        Nodes left{}, right{}, top{}, bottom{}, near_z{}, far_z{};
        for (std::size_t i = 0; i < kNodes; ++i)
            for (std::size_t j = 0; j < kNodes; ++j) {
                const Vec3 row = in_camera(block.first[0] + i, block.first[1] + j, block.first[2]);
                for (std::size_t k = 0; k < kNodes; ++k) {
                    const double s = static_cast<double>(k), z = row.z + s * step_[2].z;
                    // Cells behind the plane of the camera are not judged by their image.
                    const double in_front = larger(z, kNear);
                    left[i][j][k] = right[i][j][k] = camera_.fx * (row.x + s * step_[2].x) / in_front + camera_.cx;
                    top[i][j][k] = bottom[i][j][k] = camera_.fy * (row.y + s * step_[2].y) / in_front + camera_.cy;
                    near_z[i][j][k] = far_z[i][j][k] = z;
                }
            }
        over_cells(left, smaller);
        over_cells(right, larger);
        over_cells(top, smaller);
        over_cells(bottom, larger);
        over_cells(near_z, smaller);
        over_cells(far_z, larger);
        for (std::size_t i = block.first[0]; i < block.end[0]; ++i)
            for (std::size_t j = block.first[1]; j < block.end[1]; ++j)
                for (std::size_t k = block.first[2]; k < block.end[2]; ++k) {
                    const std::size_t a = i - block.first[0], b = j - block.first[1], c = k - block.first[2];
                    const Footprint print{near_z[a][b][c], far_z[a][b][c], left[a][b][c],
                                          right[a][b][c],  top[a][b][c],   bottom[a][b][c]};
                    cells_[grid_.index(i, j, k)] = static_cast<std::uint8_t>(state_of(print));
                }
    }

    CellState state_of(const Footprint& print) const {
        if (print.near_z < kNear) return CellState::kUnknown;
        const Outlook outlook = look(print);
        return outlook.decided ? outlook.state : state_by_pixels(print, outlook.rect, outlook.inside);
    }

    // The tables reach a little beyond the rectangle; its own pixels decide.
    CellState state_by_pixels(const Footprint& print, const PixelRect& rect, bool inside) const {
        // Single precision, rounded away from the cell.
        const auto far_z = static_cast<float>((print.far_z + kDepthSlack) * (1.0 + kSingle));
        const auto near_z = static_cast<float>((print.near_z - kDepthSlack) * (1.0 - kSingle));
        bool blocked = !inside;
        for (int y = rect.top; y <= rect.bottom; ++y) {
            const float* nearest = depth_.nearest.data() + static_cast<std::size_t>(y) * camera_.width;
            const float* farthest = depth_.farthest.data() + static_cast<std::size_t>(y) * camera_.width;
            int within = 0, seen = 0;
            for (int x = rect.left; x <= rect.right; ++x) {
                const int reached = far_z >= nearest[x];
                within |= reached;
                seen |= reached & (farthest[x] > 0.0f) & (near_z <= farthest[x]);
            }
            if (seen) return CellState::kSeen;
            blocked = blocked || within;
        }
        return blocked ? CellState::kUnknown : CellState::kFree;
    }

    const CellGrid& grid_;
    const PinholeCamera& camera_;
    const DepthBounds& depth_;
    int margin_;
    std::span<std::uint8_t> cells_;
    WindowTable windows_;
    Vec3 origin_;   // of the grid, in the frame of the camera
    Vec3 step_[3];  // of one cell along each axis of the grid
};

}  // namespace

void carve(const CellGrid& grid, const PinholeCamera& camera, const DepthBounds& depth, int pixel_margin,
           std::span<std::uint8_t> cells) {
    if (grid.size() > 0) Carver(grid, camera, depth, pixel_margin, cells).run();
}

std::size_t clear_within(const CellGrid& grid, const Shape& shape, const Transform& shape_from_grid, double padding,
                         std::span<std::uint8_t> cells) {
    // The range of nodes around the box of the shape, in the axes of the grid.
    const Transform grid_from_shape = inverse(shape_from_grid);
    const Vec3 centre = grid_from_shape * shape.centre;
    std::size_t first[3], end[3];  // cells
    for (int i = 0; i < 3; ++i) {
        double reach = padding;
        for (int j = 0; j < 3; ++j) reach += std::abs(grid_from_shape.rotation.m[i][j]) * shape.half[j];
        const double count = static_cast<double>(grid.count[i]), low = static_cast<double>(grid.low[i]);
        first[i] = static_cast<std::size_t>(std::clamp(std::floor((centre[i] - reach) / grid.side) - low, 0.0, count));
        end[i] = static_cast<std::size_t>(std::clamp(std::ceil((centre[i] + reach) / grid.side) - low, 0.0, count));
        if (first[i] >= end[i]) return 0;
    }
    const double origin[3] = {0.0, 0.0, 0.0}, disc[1] = {0.0};
    const Shape point = make_shape(ShapeKind::kConvex, origin, disc, 0.0, {}, {}, {});
    // A shape and its padding are convex, so a cell is within the padding if its eight nodes are.
    const std::size_t ny = end[1] - first[1] + 1, nz = end[2] - first[2] + 1;
    std::vector<std::uint8_t> within[2] = {std::vector<std::uint8_t>(ny * nz), std::vector<std::uint8_t>(ny * nz)};
    std::size_t cleared = 0;
    for (std::size_t i = first[0]; i <= end[0]; ++i) {
        std::swap(within[0], within[1]);
        for (std::size_t j = 0; j < ny; ++j) {
            Separation separation;
            for (std::size_t k = 0; k < nz; ++k) {
                const Transform at{{}, shape_from_grid * grid.corner(i, first[1] + j, first[2] + k)};
                const DistanceQuery query{.above = padding, .below = padding};
                DistanceBounds bounds = bound_distance(shape, point, at, query, separation);
                if (bounds.lower <= padding && padding < bounds.upper) {  // The simplex of the previous node was flat.
                    separation = {};
                    bounds = bound_distance(shape, point, at, query, separation);
                }
                within[1][j * nz + k] = bounds.upper <= padding;
            }
        }
        if (i == first[0]) continue;
        for (std::size_t j = 0; j + 1 < ny; ++j)
            for (std::size_t k = 0; k + 1 < nz; ++k) {
                bool all = true;
                for (const auto& layer : within)
                    for (std::size_t n : {j * nz + k, j * nz + k + 1, (j + 1) * nz + k, (j + 1) * nz + k + 1})
                        all = all && layer[n];
                std::uint8_t& cell = cells[grid.index(i - 1, first[1] + j, first[2] + k)];
                if (!all || cell == static_cast<std::uint8_t>(CellState::kFree)) continue;
                cell = static_cast<std::uint8_t>(CellState::kFree);
                ++cleared;
            }
    }
    return cleared;
}

}  // namespace pinproof
