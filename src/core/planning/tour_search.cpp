#include "planning/tour_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <limits>

namespace pinproof {
namespace {

// Seconds: smaller differences are rounding.
constexpr double kGain = 1e-9;

// Largest number of stops of a part that moves to another position.
constexpr int kLongestPart = 8;

// Share of the disturbances that move jobs; the others exchange two neighbouring parts, most of them short.
constexpr double kMoves = 0.6;

// Number of neighbouring jobs that such a disturbance moves.
constexpr int kMoved = 4;

// Largest number of stops of a short part.
constexpr int kShort = 10;

// Temperature of the first disturbance, as a share of the mean time of an arc; it falls linearly to zero.
constexpr double kTemperature = 0.05;

// A tour and its improvement. All orders satisfy the pairs, as the first one does.
class TourSearch {
  public:
    // `first` (n) the option of each job in order
    TourSearch(TourProblem problem, std::span<const int> first)
        : problem_(std::move(problem)),
          width_(problem_.job.size() + 1),
          count_(problem_.jobs()),
          place_(count_),
          latest_(count_ + 2),
          earliest_(count_ + 2),
          forth_(count_ + 2),
          back_(count_ + 2),
          queued_(count_, 0) {
        const int home = problem_.options();
        stops_.reserve(count_ + 2);
        stops_.push_back(home);
        stops_.insert(stops_.end(), first.begin(), first.end());
        stops_.push_back(home);
        for (int option = 0; option < home; ++option)
            if (option == 0 || problem_.job[option] != problem_.job[option - 1]) first_option_.push_back(option);
        first_option_.push_back(home);
        refresh();
    }

    // Improve the tour until no move of a job or of a part of the tour makes it shorter.
    void improve() {
        for (int p = 1; p <= count_; ++p) wake(p);
        empty_queue();
    }

    // Disturb and improve the tour.
    void search(std::span<const double> draws) {
        improve();
        std::vector<int> now = stops_, best = stops_;
        double seconds = total(), least = seconds;
        const double mean = seconds / (count_ + 1);
        for (std::size_t k = 0; k + kTourDraws <= draws.size(); k += kTourDraws) {
            if (!disturb(draws.subspan(k, kTourDraws))) continue;
            empty_queue();
            const double found = forth_[count_ + 1];
            const double cooled = 1.0 - static_cast<double>(k) / static_cast<double>(draws.size());
            const double worse = -kTemperature * cooled * mean * std::log1p(-draws[k]);
            if (found > seconds + worse) {
                stops_ = now;
                refresh();
                continue;
            }
            now = stops_, seconds = found;
            if (found < least - kGain) best = stops_, least = found;
        }
        stops_ = best;
        refresh();
        improve();
    }

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

    double total() const {
        double sum = 0.0;
        for (int p = 0; p <= count_; ++p) sum += time(stops_[p], stops_[p + 1]);
        return sum;
    }

    // What depends on the stops.
    void refresh() {
        for (int p = 1; p <= count_; ++p) place_[job(p)] = p;
        std::fill(latest_.begin(), latest_.end(), 0);
        std::fill(earliest_.begin(), earliest_.end(), count_ + 1);
        for (const auto& [before, after] : problem_.pairs) {
            latest_[place_[after]] = std::max(latest_[place_[after]], place_[before]);
            earliest_[place_[before]] = std::min(earliest_[place_[before]], place_[after]);
        }
        for (int p = 0; p <= count_; ++p) {
            forth_[p + 1] = forth_[p] + time(stops_[p], stops_[p + 1]);
            back_[p + 1] = back_[p] + time(stops_[p + 1], stops_[p]);
        }
    }

    // Make the best change for each queued job, and queue those beside it.
    void empty_queue() {
        do {
            while (!queue_.empty()) {
                const int job = queue_.front();
                queue_.pop_front();
                queued_[job] = 0;
                const Change change = best_change(job);
                if (change.seconds < -kGain) apply(change);
            }
        } while (choose_options());
    }

    void wake(int position) {
        if (position < 1 || position > count_ || queued_[job(position)]) return;
        queued_[job(position)] = 1;
        queue_.push_back(job(position));
    }

    void wake_around(int first, int last) {
        for (int end : {first, last})
            for (int position : {end - 1, end, end + 1}) wake(position);
    }

    Change best_change(int job) const {
        Change best;
        const int position = place_[job];
        consider_options(position, best);
        for (int length = 2; length <= std::min(kLongestPart, count_ - 1); ++length) {
            if (position + length - 1 <= count_) consider_part(position, position + length - 1, best);
            if (position - length + 1 >= 1) consider_part(position - length + 1, position, best);
        }
        consider_reversals(position, best);
        return best;
    }

    // Every position of a stop, with every option of its job.
    void consider_options(int position, Change& best) const {
        const int p = position, j = job(p);
        const double removed = time(stops_[p - 1], stops_[p]) + time(stops_[p], stops_[p + 1]);
        const double joined = time(stops_[p - 1], stops_[p + 1]);
        for (int option = first_option_[j]; option < first_option_[j + 1]; ++option) {
            const double there = time(stops_[p - 1], option) + time(option, stops_[p + 1]) - removed;
            if (there < best.seconds) best = {there, p, p, p - 1, option};
        }
        // Between the last predecessor and the first successor, but not beside its present position.
        for (int gap = latest_[p]; gap < earliest_[p]; ++gap) {
            if (gap == p - 1 || gap == p) continue;
            const double opened = time(stops_[gap], stops_[gap + 1]);
            for (int option = first_option_[j]; option < first_option_[j + 1]; ++option) {
                const double change =
                    joined - removed + time(stops_[gap], option) + time(option, stops_[gap + 1]) - opened;
                if (change < best.seconds) best = {change, p, p, gap, option};
            }
        }
    }

    // Every position of a part, in both directions. A part with a pair inside is not moved.
    void consider_part(int first, int last, Change& best) const {
        const int low = *std::max_element(latest_.begin() + first, latest_.begin() + last + 1);
        const int high = *std::min_element(earliest_.begin() + first, earliest_.begin() + last + 1);
        if (low >= first) return;
        const int a = stops_[first], b = stops_[last];
        const double left =
            time(stops_[first - 1], stops_[last + 1]) - time(stops_[first - 1], a) - time(b, stops_[last + 1]);
        const double turned = (back_[last] - back_[first]) - (forth_[last] - forth_[first]);
        for (int gap = low; gap < high; ++gap) {
            if (gap >= first - 1 && gap <= last) continue;
            const int c = stops_[gap], d = stops_[gap + 1];
            const double opened = left - time(c, d);
            const double same = opened + time(c, a) + time(b, d);
            const double other = opened + time(c, b) + time(a, d) + turned;
            if (same < best.seconds) best = {same, first, last, gap};
            if (other < best.seconds) best = {other, first, last, gap, -1, true};
        }
    }

    // The reversal of every part that starts or ends with a stop and has no pair inside.
    void consider_reversals(int position, Change& best) const {
        const auto consider = [&](int first, int last) {
            const double change = time(stops_[first - 1], stops_[last]) + time(stops_[first], stops_[last + 1]) -
                                  time(stops_[first - 1], stops_[first]) - time(stops_[last], stops_[last + 1]) +
                                  (back_[last] - back_[first]) - (forth_[last] - forth_[first]);
            if (change < best.seconds) best = {change, first, last, first - 1, -1, true};
        };
        for (int last = position + 1; last <= count_ && latest_[last] < position; ++last) consider(position, last);
        for (int first = position - 1; first >= 1 && earliest_[first] > position; --first) consider(first, position);
    }

    void apply(const Change& change) {
        const auto at = stops_.begin();
        const int first = change.first, last = change.last, length = last - first + 1;
        if (change.option >= 0) stops_[first] = change.option;
        if (change.reversed) std::reverse(at + first, at + last + 1);
        int to = first;
        if (change.gap < first - 1) {
            std::rotate(at + change.gap + 1, at + first, at + last + 1);
            to = change.gap + 1;
        } else if (change.gap > last) {
            std::rotate(at + first, at + last + 1, at + change.gap + 1);
            to = change.gap + 1 - length;
        }
        refresh();
        wake_around(to, to + length - 1);
        if (to != first) wake_around(to < first ? last : first - 1, to < first ? last + 1 : first);
    }

    // The best options for the order by dynamic programming; whether this makes the tour shorter.
    bool choose_options() {
        const int home = problem_.options();
        std::vector<double> value(width_, 0.0);
        std::vector<int> came(width_, home);
        int from = home, until = home + 1;
        const auto reach = [&](int option) {
            double least = std::numeric_limits<double>::infinity();
            for (int before = from; before < until; ++before) {
                const double seconds = value[before] + time(before, option);
                if (seconds < least) least = seconds, came[option] = before;
            }
            return least;
        };
        for (int p = 1; p <= count_; ++p) {
            const int j = job(p);
            for (int option = first_option_[j]; option < first_option_[j + 1]; ++option) value[option] = reach(option);
            from = first_option_[j], until = first_option_[j + 1];
        }
        if (!(reach(home) < forth_[count_ + 1] - kGain)) return false;
        std::vector<int> changed;
        for (int p = count_, option = came[home]; p >= 1; --p, option = came[option])
            if (stops_[p] != option) stops_[p] = option, changed.push_back(p);
        refresh();
        for (int p : changed) wake_around(p, p);
        return true;
    }

    // Exchange two neighbouring short parts, or move some jobs; false if the pairs forbid the exchange.
    bool disturb(std::span<const double> draws) {
        if (count_ < 2) return false;
        const auto pick = [](double draw, int choices) { return static_cast<int>(draw * choices); };
        const int middle = 1 + pick(draws[1], count_ - 1);  // the last stop of the first part
        if (draws[2] < kMoves) {
            for (int k = 0; k < kMoved; ++k) move_randomly(std::min(middle + k, count_), draws[3 + k]);
            return true;
        }
        const int longest = draws[3] < kMoves ? kShort : count_;
        const int first = std::max(1, middle - pick(draws[4], longest));
        const int last = std::min(count_, middle + 1 + pick(draws[5], longest));
        for (int p = middle + 1; p <= last; ++p)
            for (const auto& [before, after] : problem_.pairs)
                if (after == job(p) && place_[before] >= first && place_[before] <= middle) return false;
        std::rotate(stops_.begin() + first, stops_.begin() + middle + 1, stops_.begin() + last + 1);
        refresh();
        wake_around(first, last);
        wake_around(first + last - middle - 1, first + last - middle);
        return true;
    }

    // Move a stop to a random position between its last predecessor and its first successor.
    void move_randomly(int position, double draw) {
        const int gap = latest_[position] + static_cast<int>(draw * (earliest_[position] - latest_[position]));
        wake_around(position, position);
        if (gap == position || gap == position - 1) return;
        apply({0.0, position, position, gap});
    }

    TourProblem problem_;
    std::size_t width_;
    int count_;                           // number of jobs
    std::vector<int> stops_;              // (n + 2) home, the options in order, home
    std::vector<int> place_;              // (n) the position of each job
    std::vector<int> latest_, earliest_;  // (n + 2) of the predecessors and of the successors of each stop
    std::vector<double> forth_, back_;    // (n + 2) sums of times along the tour in both directions
    std::vector<int> first_option_;       // (n + 1) where the options of each job start
    std::deque<int> queue_;               // jobs whose moves are tried
    std::vector<char> queued_;            // (n)
};

}  // namespace

std::vector<int> search_tour(TourProblem problem, std::span<const int> first, std::span<const double> draws) {
    TourSearch search(std::move(problem), first);
    search.search(draws);
    return search.tour();
}

}  // namespace pinproof
