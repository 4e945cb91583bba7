// Shorter paths: random shortcuts, removal of waypoints, and moving waypoints towards the straight line.
//
// Sources: R. Geraerts, M. Overmars, "Creating high-quality paths for motion planning", IJRR 26(8), 2007 (random
// shortcuts); S. Sekhavat, P. Svestka, J.-P. Laumond, M. Overmars, "Multilevel path planning for nonholonomic robots
// using semiholonomic subsystems", IJRR 17(8), 1998 (removal of waypoints).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "planning/edge_checker.h"

namespace pinproof {

// A path of straight edges. Each operation keeps its ends, does not make it longer, and adds only edges that are free.
class PathShortener {
public:
    // `path` (waypoints, dof). Added edges are proven free or, without `proofs`, only their samples are free.
    PathShortener(EdgeChecker& edges, std::span<const double> path, bool proofs);

    // All operations, or without draws only the first. They are done without proofs first, and the edges that remain are
    // proven in the end: most edges that are added are replaced later, and few proofs fail. If one fails, all operations
    // are done again with proofs.
    static std::vector<double> shortened(EdgeChecker& edges, std::span<const double> path,
                                         std::span<const double> draws);

    // Connect each kept waypoint to the farthest later waypoint that a free edge reaches.
    void connect_farthest();
    // Remove each waypoint for which the edge between its neighbours is free.
    void remove_waypoints();
    // Connect random points of different edges; `draws` are two numbers in [0, 1) for each attempt. Ends after some
    // attempts in a row without gain.
    void random_shortcuts(std::span<const double> draws);
    // Move each waypoint towards the straight line between its neighbours, by a share that is halved on failure.
    void straighten();

    // (waypoints, dof) without waypoints that equal their predecessor
    std::vector<double> path() const;

private:
    using Waypoint = std::vector<double>;

    bool free(const Waypoint& a, const Waypoint& b) {
        return proofs_ ? edges_.proven_free(a.data(), b.data()) : edges_.samples_free(a.data(), b.data());
    }
    void run(std::span<const double> draws);
    bool added_edges_proven() const;
    bool random_shortcut(double first_draw, double last_draw);
    bool move_waypoint(std::size_t i, double& share, double min_gain);

    EdgeChecker& edges_;
    bool proofs_;
    std::vector<Waypoint> path_, given_;
};

}  // namespace pinproof
