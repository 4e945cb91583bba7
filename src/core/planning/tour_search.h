// Short tours through jobs with options: which option of each job, and in which order.
//
// The arcs of a tour lead from home through one option of each job and back home. A local search moves a job to another
// position with any of its options (Or-opt), moves and reverses parts of the tour (Or-opt, 2-opt), and chooses the best
// options for the order by dynamic programming. An iterated local search then exchanges two neighbouring short parts and
// improves again around the change; a slightly longer tour is accepted with a probability that falls to zero.
//
// Sources: G. Croes (1958), "A method for solving traveling-salesman problems", Operations Research 6(6); I. Or (1976),
// "Traveling salesman-type combinatorial problems and their relation to the logistics of regional blood banking";
// O. Martin, S. Otto, E. Felten (1991), "Large-step Markov chains for the traveling salesman problem", Complex Systems
// 5(3); F. Suarez-Ruiz, T. Lembono, Q.-C. Pham (2018), "RoboTSP", ICRA.
#pragma once

#include <span>
#include <utility>
#include <vector>

namespace pinproof {

// A problem with M options of n jobs.
struct TourProblem {
    std::vector<int> job;                    // of each option, ascending from 0
    std::vector<double> time;                // (M + 1, M + 1) from option to option, with the time of the second one;
                                             // the last row and column are home; blocked arcs have a large finite time
    std::vector<std::pair<int, int>> pairs;  // of jobs: the first remains before the second

    int options() const { return static_cast<int>(job.size()); }
    int jobs() const { return job.empty() ? 0 : job.back() + 1; }
};

// Random numbers for each disturbance.
inline constexpr int kTourDraws = 8;

// A short tour, the option of each job in order (n), from a first one, in an order that satisfies the pairs. `draws` are
// kTourDraws numbers in [0, 1) for each disturbance.
std::vector<int> search_tour(TourProblem problem, std::span<const int> first, std::span<const double> draws);

}  // namespace pinproof
