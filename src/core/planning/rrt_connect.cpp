#include "planning/rrt_connect.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// rad or m. Samples are within this of a node in every joint. Among 1.5, 2.5, pi and the complete limits, this value
// needed the fewest checks on arms among shelves and bars, the complete limits twice as many.
constexpr double kReach = 2.5;

// This fraction of the samples is within kReach / 2^x of a node, with x uniform in [0, kNarrowest]: in narrow spaces
// all long steps are blocked.
constexpr double kNarrowShare = 0.2, kNarrowest = 6.0;

// Goals to which a connection along the constraints is tried before the first sample.
constexpr std::size_t kDirectGoals = 8;

}  // namespace

int Tree::add(const double* q, int parent) {
    nodes_.insert(nodes_.end(), q, q + dof_);
    parents_.push_back(parent);
    removed_.push_back(false);
    return size() - 1;
}

void Tree::cut(int node) {
    std::vector<bool> below(static_cast<std::size_t>(size()), false);
    below[node] = true;
    for (int child = node; child < size(); ++child) {  // A child has a larger number than its parent.
        below[child] = below[child] || below[parents_[child]];
        if (!below[child]) continue;
        removed_[child] = true;
        std::fill_n(nodes_.begin() + static_cast<std::ptrdiff_t>(child * dof_), dof_, kInfinity);
    }
}

std::vector<int> Tree::branch(int node) const {
    std::vector<int> nodes{node};
    while (parents_[nodes.back()] != nodes.back()) nodes.push_back(parents_[nodes.back()]);
    return nodes;
}

int Tree::nearest(const double* q) const {
    double best = kInfinity;
    int index = 0;
    for (int i = 0; i < size(); ++i) {
        const double distance = squared_distance(node(i), q, dof_);
        if (distance < best) {
            best = distance;
            index = i;
        }
    }
    return index;
}

RrtSearch::RrtSearch(EdgeChecker& edges, std::span<const double> start, std::span<const double> goals,
                     std::span<const double> box, const RrtSettings& settings, Manifold* manifold)
    : edges_(edges),
      manifold_(manifold),
      settings_(settings),
      box_(box.begin(), box.end()),
      trees_{Tree(start.size()), Tree(start.size())},
      target_(start.size()),
      end_(start.size()) {
    trees_[0].add_root(start.data());
    for (std::size_t row = 0; row < goals.size(); row += start.size()) trees_[1].add_root(goals.data() + row);
    if (manifold_ == nullptr) return;
    for (int goal = 0; goal < trees_[1].size(); ++goal) direct_.push_back(goal);
    const auto from_start = [&](int goal) { return squared_distance(trees_[1].node(goal), start.data(), start.size()); };
    std::ranges::stable_sort(direct_, [&](int a, int b) { return from_start(a) < from_start(b); });
    direct_.resize(std::min(direct_.size(), kDirectGoals));
    std::ranges::reverse(direct_);
}

void RrtSearch::add_draws(std::span<const double> draws) {
    draws_.assign(draws.begin(), draws.end());
    used_draws_ = 0;
}

RrtSearch::Event RrtSearch::grow(std::int64_t until) {
    const std::size_t dof = target_.size();
    while (edges_.samples() < until) {
        if (phase_ == Phase::kSample) {
            if (trees_[0].size() + trees_[1].size() >= settings_.max_nodes || samples_ >= settings_.max_samples)
                return Event::kSpent;
            if (!direct_.empty()) {
                begin_connection();
            } else {
                if (used_draws_ + dof + 2 > draws_.size()) return Event::kNeedsDraws;
                begin_sample();
            }
        }
        Tree& tree = trees_[growing_];
        const double* start = tree.node(from_);
        const double left = std::sqrt(squared_distance(target_.data(), start, dof));
        if (phase_ == Phase::kConnect) gap_ = std::min(gap_, left);
        if (left == 0.0) {  // The sample is a node, or a root that the other tree has reached.
            const bool met = phase_ == Phase::kConnect;
            phase_ = Phase::kSample;
            meeting_[growing_] = from_;
            if (met) return Event::kMet;
            continue;
        }
        if (!extend(start, left) || !edges_.samples_free(start, end_.data())) {
            phase_ = Phase::kSample;
            continue;
        }
        const int added = tree.add(end_.data(), from_);
        if (phase_ == Phase::kExtend) {
            turn_to_other_tree(added);
        } else if (end_ == target_) {
            meeting_[growing_] = added;
            phase_ = Phase::kSample;
            return Event::kMet;
        } else {
            from_ = added;
        }
    }
    return Event::kPaused;
}

// The end of the next edge from a node towards the target, from which it is `left` away. Returns false if it does not
// exist.
bool RrtSearch::extend(const double* start, double left) {
    if (manifold_ != nullptr) return manifold_->step(start, target_.data(), settings_.step, end_.data());
    const double share = std::min(settings_.step / left, 1.0);
    for (std::size_t j = 0; j < end_.size(); ++j)
        end_[j] = share == 1.0 ? target_[j] : start[j] + (target_[j] - start[j]) * share;
    return true;
}

// The tree of the start grows to a goal.
void RrtSearch::begin_connection() {
    growing_ = 0;
    meeting_[1] = direct_.back();
    direct_.pop_back();
    target_.assign(trees_[1].node(meeting_[1]), trees_[1].node(meeting_[1]) + target_.size());
    from_ = trees_[0].nearest(target_.data());
    phase_ = Phase::kConnect;
}

double RrtSearch::distance_of_trees() const {
    double square = kInfinity;
    for (int i = 0; i < trees_[1].size(); ++i) {
        if (trees_[1].removed(i)) continue;
        const double* q = trees_[1].node(i);
        square = std::min(square, squared_distance(trees_[0].node(trees_[0].nearest(q)), q, dof()));
    }
    return std::sqrt(square);
}

// Draw a random sample about a random node of the smaller tree, which grows towards it.
void RrtSearch::begin_sample() {
    const std::size_t dof = target_.size();
    const double* numbers = draws_.data() + used_draws_;
    used_draws_ += dof + 2;
    ++samples_;
    growing_ = trees_[0].size() <= trees_[1].size() ? 0 : 1;
    const Tree& tree = trees_[growing_];
    const int chosen = static_cast<int>(numbers[1] * tree.size());
    const double* around = tree.node(tree.removed(chosen) ? 0 : chosen);
    double reach = kReach;
    if (numbers[0] < kNarrowShare) reach *= std::exp2(-kNarrowest * numbers[0] / kNarrowShare);
    for (std::size_t j = 0; j < dof; ++j) {
        const double low = std::max(around[j] - reach, box_[j]), high = std::min(around[j] + reach, box_[dof + j]);
        target_[j] = low + numbers[2 + j] * (high - low);
    }
    from_ = tree.nearest(target_.data());
    phase_ = Phase::kExtend;
}

// The other tree grows to the node that this one has reached.
void RrtSearch::turn_to_other_tree(int reached) {
    meeting_[growing_] = reached;
    target_ = end_;
    growing_ = 1 - growing_;
    from_ = trees_[growing_].nearest(target_.data());
    phase_ = Phase::kConnect;
}

}  // namespace pinproof
