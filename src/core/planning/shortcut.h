// Shorter paths: random shortcuts, removal of waypoints, and moving them towards the straight line.
//
// Sources: R. Geraerts, M. Overmars, "Creating high-quality paths for motion planning", IJRR 26(8), 2007 (random
// shortcuts, also of single joints); S. Sekhavat, P. Svestka, J.-P. Laumond, M. Overmars, "Multilevel path planning for
// nonholonomic robots using semiholonomic subsystems", IJRR 17(8), 1998 (removal of waypoints).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "planning/edge_checker.h"

namespace pinproof {

// A path (waypoints, dof) with the same ends that is not longer; all edges that are added are proven free. `draws` are two
// numbers in [0, 1) for each random shortcut; without any, waypoints are only connected to the farthest ones. `tighten`:
// in the end, waypoints are moved in more and smaller steps. The operations are done without proofs first, and the edges
// that remain are proven in the end: most edges that are added are replaced later, and few proofs fail. If one fails, all
// operations are done again with samples of half the distance, and if one fails then, with proofs.
std::vector<double> shortened_path(EdgeChecker& edges, std::span<const double> path, std::span<const double> draws,
                                   bool tighten);

}  // namespace pinproof
