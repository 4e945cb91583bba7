// Proofs that a pose is out of reach.
#include "bindings/structs.h"
#include "geometry/rotations.h"
#include "reach/reach_proof.h"

namespace pinproof {
namespace {

// Rad: 2 pi, with rounding.
constexpr double kFullRotation = 6.2831853071796;

void check_overlap(const Overlap& overlap) {
    if (!is_rigid(overlap.link_from_box)) refuse("a pose is not a rigid transform");
    if (!(std::min({overlap.half.x, overlap.half.y, overlap.half.z, overlap.box_radius, overlap.ball_radius}) >= 0.0))
        refuse("a size is negative");
    if (std::min(overlap.ball_link, overlap.box_link) < 0) refuse("a link does not exist");
}

// A chain with its constraints and limits. Calls hold the GIL or, in a batch, have their own prover.
class Reach {
  public:
    Reach(const Chain& chain, const Vector& lower, const Vector& upper)
        : chain_(chain), lower_(list_of(finite("lower", lower, {chain.dof}))),
          upper_(list_of(finite("upper", upper, {chain.dof}))), loop_(checked()) {}
    Reach(const Reach&) = delete;

    ReachProof prove(const Matrix& target, double position, double orientation, std::int64_t budget, bool record,
                     const std::vector<Overlap>& overlaps) const {
        const Transform base_from_tcp = transform("target", target);
        if (!is_rigid(target.data())) refuse("the target is not a rigid transform");
        if (!(position >= 0.0) || !(orientation >= 0.0)) refuse("a tolerance is negative");
        for (const Overlap& overlap : overlaps)
            if (std::max(overlap.ball_link, overlap.box_link) > static_cast<int>(chain_.dof))
                refuse("an overlap is on a link that the chain does not have");
        const ReachSettings settings{position, orientation, counted("budget", budget), record, overlaps};
        nb::gil_scoped_release release;
        return ReachProver(chain_, loop_, lower_.data(), upper_.data()).prove(base_from_tcp, settings);
    }

    NewArrayOf<bool> keeps(const Stack& targets, const Matrix& q, const Vector& tolerances, std::int64_t budget) const {
        const std::size_t count = targets.shape(0);
        const double* poses = shaped("targets", targets, {kAny, 4, 4}).data();
        const double* at = finite("q", q, {count, chain_.dof}).data();
        const auto t = finite("tolerances", tolerances, {count});
        counted("budget", budget);
        return filled<bool>({count}, [&](bool* kept) {
            nb::gil_scoped_release release;
            ReachProver prover(chain_, loop_, lower_.data(), upper_.data());
            for (std::size_t i = 0; i < count; ++i)
                kept[i] = prover.keeps(read_transform(poses + 16 * i), at + chain_.dof * i,
                                       {t[i], t[i], budget, false, {}});
        });
    }

    const LoopDistances& loop() const { return loop_; }

  private:
    LoopDistances checked() const {
        if (chain_.has_mimic_joints()) refuse("the chain has a mimic joint");
        if (chain_.joints.empty() || chain_.joints.size() > kMostProofJoints || chain_.joints.size() != chain_.dof)
            refuse("the chain has no joints, or too many");
        for (std::size_t k = 0; k < chain_.dof; ++k) {
            if (chain_.joints[k].index != k) refuse("the joints are not in the order of q");
            if (!(lower_[k] <= upper_[k]) || (!chain_.joints[k].prismatic && upper_[k] - lower_[k] > kFullRotation))
                refuse("the range of a joint is empty, or more than a full rotation");
        }
        return loop_distances(chain_);
    }

    Chain chain_;
    Doubles lower_, upper_;
    LoopDistances loop_;
};

}  // namespace

void bind_reach(nb::module_& module) {
    module.attr("MOST_PROOF_JOINTS") = kMostProofJoints;
    // A number of each step of a proof.
    const auto steps = [](auto member) {
        using Value = std::remove_cvref_t<std::invoke_result_t<decltype(member), ReachStep>>;
        using Number = std::conditional_t<std::is_same_v<Value, double>, double, std::int64_t>;
        return [member](const ReachProof& proof) { return column<Number>(proof.steps, member); };
    };
    bind_result<ReachProof>(
        module, "ReachProof",
        "A search for a proof that a pose is out of reach; `used` (k,): whether each overlap excluded a box.",
        FIELDS(ReachProof, boxes, width, remaining),
        "excluded", [](const ReachProof& proof) { return proof.outcome == ReachOutcome::kExcluded; },
        "used", [](const ReachProof& proof) { return column<bool>(proof.used, std::identity{}); },
        "kinds", steps(&ReachStep::kind), "joints", steps(&ReachStep::joint),
        "constraints", steps(&ReachStep::constraint), "evaluations", steps(&ReachStep::evaluation), "values", steps(&ReachStep::value));
    bind_struct<Overlap>(module, "Overlap",
                         "A ball on a link of a chain that overlaps a box with rounded edges on another link; link 0 "
                         "is the base. `half` are half sides, and `box_radius` is that of the rounding.",
                         check_overlap, MEMBERS(Overlap, ball_link, centre, ball_radius, box_link, link_from_box, half,
                                                box_radius));
    bind_result<LoopPoint>(module, "LoopPoint", "A point on several links: where it is on each, from the first on.",
                           FIELDS(LoopPoint, first, at, error));
    nb::class_<Reach>(module, "Reach", "Proofs that a pose is out of reach of a chain within its limits.")
        .def(nb::init<const Chain&, const Vector&, const Vector&>(), "chain"_a, "lower"_a, "upper"_a)
        .def("prove", &Reach::prove, "target"_a, "position_tolerance"_a, "orientation_tolerance"_a, "budget"_a,
             "record"_a, "overlaps"_a = std::vector<Overlap>())
        .def("keeps", &Reach::keeps, "targets"_a, "q"_a, "tolerances"_a, "budget"_a,
             "For tests: (N,) whether the boxes on the path of the search to each of the solutions q (N, n) keep it.")
        .def_prop_ro("size", [](const Reach& r) { return r.loop().size; })
        .def_prop_ro("points", [](const Reach& r) { return r.loop().points; })
        .def_prop_ro("constraints", [](const Reach& r) {
            std::vector<std::tuple<int, int>> pairs;
            for (const LoopConstraint& c : r.loop().constraints) pairs.emplace_back(c.points[0], c.points[1]);
            return pairs;
        });
}

}  // namespace pinproof
