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

#include <cstddef>
#include <cstdint>
#include <deque>
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

// A tour and its improvement. All orders satisfy the pairs, as the first one does.
class TourSearch {
public:
    // Number of random numbers of a disturbance.
    static constexpr int kDraws = 8;

    // `first` (n) the option of each job in order
    TourSearch(TourProblem problem, std::span<const int> first);

    // Improve the tour until no move of a job or of a part of the tour makes it shorter.
    void improve();
    // Disturb and improve the tour; `draws` are kDraws numbers in [0, 1) for each time.
    void search(std::span<const double> draws);

    // (n) the option of each job in order
    std::vector<int> tour() const { return {stops_.begin() + 1, stops_.end() - 1}; }

private:
    // The stops from `first` to `last` move between `gap` and `gap` + 1, or stay if `gap` is `first` - 1.
    struct Change {
        double seconds = 0.0;
        int first = 0, last = 0, gap = 0;
        int option = -1;  // of the only stop, if at least 0
        bool reversed = false;
    };

    double time(int a, int b) const { return problem_.time[static_cast<std::size_t>(a) * width_ + b]; }
    int job(int position) const { return problem_.job[stops_[position]]; }
    double total() const;
    void refresh();
    void empty_queue();
    void wake(int position);
    void wake_around(int first, int last);
    Change best_change(int job) const;
    void consider_options(int position, Change& best) const;
    void consider_part(int first, int last, Change& best) const;
    void consider_reversals(int position, Change& best) const;
    void apply(const Change& change);
    bool choose_options();
    bool disturb(std::span<const double> draws);
    void move_randomly(int position, double draw);

    TourProblem problem_;
    std::size_t width_;
    int count_;                               // number of jobs
    std::vector<int> stops_;                  // (n + 2) home, the options in order, home
    std::vector<int> place_;                  // (n) the position of each job
    std::vector<int> latest_, earliest_;      // (n + 2) of the predecessors and of the successors of each stop
    std::vector<double> forth_, back_;        // (n + 2) sums of times along the tour in both directions
    std::vector<int> first_option_;           // (n + 1) where the options of each job start
    std::deque<int> queue_;                   // jobs whose moves are tried
    std::vector<char> queued_;                // (n)
};

}  // namespace pinproof
