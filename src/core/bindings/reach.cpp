// Proofs that a pose is out of reach.
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "geometry/rigid.h"
#include "reach/reach_proof.h"

namespace pinproof {
namespace {

// Rad: 2 pi, with rounding.
constexpr double kFullRotation = 6.2831853071796;

// Overlaps that exclude a configuration.
struct Overlaps {
    std::vector<Overlap> all;

    Overlaps(const IndexMatrix& links, const Matrix& balls, const Stack& poses, const Matrix& sizes) {
        const std::size_t count = links.shape(0);
        require_size("a row of links", links.shape(1), 2);
        require_size("balls", balls.shape(0), count);
        require_size("a row of balls", balls.shape(1), 4);
        require_size("poses", poses.shape(0), count);
        require_size("a pose", poses.shape(1) * poses.shape(2), 16);
        require_size("sizes", sizes.shape(0), count);
        require_size("a row of sizes", sizes.shape(1), 4);
        require_finite("balls", balls.data(), balls.size());
        require_finite("sizes", sizes.data(), sizes.size());
        for (std::size_t i = 0; i < count; ++i) {
            const double *ball = balls.data() + 4 * i, *pose = poses.data() + 16 * i, *size = sizes.data() + 4 * i;
            if (!is_rigid(pose)) throw std::invalid_argument("a pose is not a rigid transform");
            if (!(*std::min_element(size, size + 4) >= 0.0) || !(ball[3] >= 0.0))
                throw std::invalid_argument("a size is negative");
            const std::int64_t ball_link = links(i, 0), box_link = links(i, 1);
            if (std::min(ball_link, box_link) < 0 || std::max(ball_link, box_link) > kMostProofJoints)
                throw std::invalid_argument("a link does not exist");
            all.push_back({static_cast<int>(ball_link), {ball[0], ball[1], ball[2]}, ball[3],
                           static_cast<int>(box_link), inverse(read_transform(pose)), {size[0], size[1], size[2]},
                           size[3]});
        }
    }
};

// A chain with its constraints and limits. Calls hold the GIL or, in a batch, have their own prover.
class Reach {
  public:
    Reach(const Chain& chain, const Vector& lower, const Vector& upper)
        : chain_(checked(chain, lower, upper)), loop_(loop_distances(chain_)),
          lower_(lower.data(), lower.data() + lower.size()), upper_(upper.data(), upper.data() + upper.size()) {}
    Reach(const Reach&) = delete;

    ReachProof prove(const Matrix& target, double position, double orientation, std::int64_t budget,
                     bool record, const Overlaps* overlaps) const {
        require_size("target", target.size(), 16);
        if (!is_rigid(target.data())) throw std::invalid_argument("the target is not a rigid transform");
        if (!(position >= 0.0) || !(orientation >= 0.0)) throw std::invalid_argument("a tolerance is negative");
        require_count("budget", budget);
        if (overlaps != nullptr)
            for (const Overlap& each : overlaps->all)
                if (std::max(each.ball_link, each.box_link) > static_cast<int>(chain_.dof))
                    throw std::invalid_argument("an overlap is on a link that the chain does not have");
        nb::gil_scoped_release release;
        ReachProver prover(chain_, loop_, lower_.data(), upper_.data());
        return prover.prove(read_transform(target.data()), {position, orientation, budget, record,
                                                            overlaps == nullptr ? std::vector<Overlap>{} : overlaps->all});
    }

    nb::object keeps(const Stack& targets, const Matrix& q, const Vector& tolerances, std::int64_t budget) const {
        const std::size_t count = targets.shape(0);
        require_size("a target", targets.shape(1) * targets.shape(2), 16);
        require_size("q", q.shape(0), count);
        require_size("a row of q", q.shape(1), chain_.dof);
        require_size("tolerances", tolerances.size(), count);
        require_finite("q", q.data(), q.size());
        require_finite("tolerances", tolerances.data(), count);
        require_count("budget", budget);
        auto kept = new_array<bool>({count});
        nb::gil_scoped_release release;
        ReachProver prover(chain_, loop_, lower_.data(), upper_.data());
        for (std::size_t i = 0; i < count; ++i)
            kept.data[i] = prover.keeps(read_transform(targets.data() + 16 * i), q.data() + chain_.dof * i,
                                        {tolerances(i), tolerances(i), budget, false, {}});
        nb::gil_scoped_acquire acquire;
        return nb::cast(kept.array);
    }

    const LoopDistances& loop() const { return loop_; }

  private:
    static const Chain& checked(const Chain& chain, const Vector& lower, const Vector& upper) {
        if (chain.has_mimic_joints()) throw std::invalid_argument("the chain has a mimic joint");
        if (chain.joints.empty() || chain.joints.size() > kMostProofJoints || chain.joints.size() != chain.dof)
            throw std::invalid_argument("the chain has no joints, or too many");
        for (std::size_t k = 0; k < chain.dof; ++k)
            if (chain.joints[k].index != k) throw std::invalid_argument("the joints are not in the order of q");
        require_size("lower", lower.size(), chain.dof);
        require_size("upper", upper.size(), chain.dof);
        require_finite("lower", lower.data(), lower.size());
        require_finite("upper", upper.data(), upper.size());
        for (std::size_t k = 0; k < chain.dof; ++k)
            if (!(lower(k) <= upper(k)) || (!chain.joints[k].prismatic && upper(k) - lower(k) > kFullRotation))
                throw std::invalid_argument("the range of a joint is empty, or more than a full rotation");
        return chain;
    }

    Chain chain_;
    LoopDistances loop_;
    std::vector<double> lower_, upper_;
};

template <class Number, class Read>
nb::object column(const ReachProof& proof, Read read) {
    auto values = new_array<Number>({proof.steps.size()});
    for (std::size_t i = 0; i < proof.steps.size(); ++i) values.data[i] = static_cast<Number>(read(proof.steps[i]));
    return nb::cast(values.array);
}

nb::dict points_of(const LoopDistances& loop) {
    nb::dict points;
    nb::list first, at, error;
    for (const LoopPoint& point : loop.points) {
        auto rows = new_array({point.at.size(), 3});
        for (std::size_t i = 0; i < point.at.size(); ++i)
            for (int j = 0; j < 3; ++j) rows.data[3 * i + j] = point.at[i][j];
        first.append(point.first);
        at.append(rows.array);
        error.append(point.error);
    }
    points["first"] = first;
    points["at"] = at;
    points["error"] = error;
    return points;
}

}  // namespace

void bind_reach(nb::module_& module) {
    module.attr("MOST_PROOF_JOINTS") = kMostProofJoints;
    nb::class_<ReachProof>(module, "ReachProof", "The result of a search for a proof that a pose is out of reach.")
        .def_prop_ro("excluded", [](const ReachProof& p) { return p.outcome == ReachOutcome::kExcluded; })
        .def_ro("boxes", &ReachProof::boxes)
        .def_ro("width", &ReachProof::width)
        .def_prop_ro("remaining", [](const ReachProof& p) { return array_of(p.remaining); })
        .def_prop_ro("used",
                     [](const ReachProof& p) { return nb::bytes(p.used.data(), p.used.size()); },
                     "A byte for each overlap: 1 if it excluded a box.")
        .def_prop_ro("kinds",
                     [](const ReachProof& p) { return column<std::int64_t>(p, [](auto& s) { return s.kind; }); })
        .def_prop_ro("joints",
                     [](const ReachProof& p) { return column<std::int64_t>(p, [](auto& s) { return s.joint; }); })
        .def_prop_ro("constraints",
                     [](const ReachProof& p) { return column<std::int64_t>(p, [](auto& s) { return s.constraint; }); })
        .def_prop_ro("evaluations",
                     [](const ReachProof& p) { return column<std::int64_t>(p, [](auto& s) { return s.evaluation; }); })
        .def_prop_ro("values", [](const ReachProof& p) { return column<double>(p, [](auto& s) { return s.value; }); });
    nb::class_<Overlaps>(module, "Overlaps", "Overlaps of bodies on the links of a chain; link 0 is the base.")
        .def(nb::init<const IndexMatrix&, const Matrix&, const Stack&, const Matrix&>(), nb::arg("links"),
             nb::arg("balls"), nb::arg("poses"), nb::arg("sizes"),
             "(k, 2) the links of ball and box, (k, 4) centre and radius, (k, 4, 4) link_from_box, (k, 4) half sides and "
             "radius of the rounding.")
        .def("__len__", [](const Overlaps& o) { return o.all.size(); });
    nb::class_<Reach>(module, "Reach", "Proofs that a pose is out of reach of a chain within its limits.")
        .def(nb::init<const Chain&, const Vector&, const Vector&>(), nb::arg("chain"), nb::arg("lower"),
             nb::arg("upper"))
        .def("prove", &Reach::prove, nb::arg("target"), nb::arg("position_tolerance"),
             nb::arg("orientation_tolerance"), nb::arg("budget"), nb::arg("record"),
             nb::arg("overlaps").none() = nb::none())
        .def("keeps", &Reach::keeps, nb::arg("targets"), nb::arg("q"), nb::arg("tolerances"), nb::arg("budget"),
             "For tests: (N,) whether the boxes on the path of the search to each of the solutions q (N, n) keep it.")
        .def_prop_ro("size", [](const Reach& r) { return r.loop().size; })
        .def_prop_ro("points", [](const Reach& r) { return points_of(r.loop()); })
        .def_prop_ro("constraints", [](const Reach& r) {
            nb::list pairs;
            for (const LoopConstraint& c : r.loop().constraints) pairs.append(nb::make_tuple(c.points[0], c.points[1]));
            return pairs;
        });
}

}  // namespace pinproof
