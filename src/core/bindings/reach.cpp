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

ReachArm make_arm(const Chain& chain, const Vector& lower, const Vector& upper) {
    const auto low = finite("lower", lower, {chain.dof}), high = finite("upper", upper, {chain.dof});
    if (chain.has_mimic_joints()) refuse("the chain has a mimic joint");
    if (chain.joints.empty() || chain.joints.size() > kMostProofJoints) refuse("the chain has no joints, or too many");
    ReachArm arm{chain, {}, loop_distances(chain)};
    for (std::size_t k = 0; k < chain.dof; ++k) {
        const Joint& joint = chain.joints[k];
        if (joint.index != k) refuse("the joints are not in the order of q");
        if (!(low[k] <= high[k]) || (!joint.prismatic && high[k] - low[k] > kFullRotation))
            refuse("the range of a joint is empty, or more than a full rotation");
        arm.limits.lower[k] = low[k];
        arm.limits.upper[k] = high[k];
    }
    return arm;
}

ReachProof prove_reach(const ReachArm& arm, const Matrix& target, double position, double orientation,
                       std::int64_t budget, bool record, const std::vector<Overlap>& overlaps) {
    const Transform base_from_tcp = transform("target", target);
    if (!is_rigid(target.data())) refuse("the target is not a rigid transform");
    if (!(position >= 0.0) || !(orientation >= 0.0)) refuse("a tolerance is negative");
    for (const Overlap& overlap : overlaps)
        if (std::max(overlap.ball_link, overlap.box_link) > static_cast<int>(arm.chain.dof))
            refuse("an overlap is on a link that the chain does not have");
    const ReachSettings settings{position, orientation, counted("budget", budget), record, overlaps};
    nb::gil_scoped_release release;
    return prove_out_of_reach(arm, base_from_tcp, settings);
}

NewArrayOf<bool> keeps(const ReachArm& arm, const Stack& targets, const Matrix& q, const Vector& tolerances,
                       std::int64_t budget) {
    const std::size_t count = targets.shape(0), dof = arm.chain.dof;
    const double* poses = shaped("targets", targets, {kAny, 4, 4}).data();
    const double* at = finite("q", q, {count, dof}).data();
    const auto t = finite("tolerances", tolerances, {count});
    counted("budget", budget);
    return filled<bool>({count}, [&](bool* kept) {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < count; ++i)
            kept[i] = search_keeps(arm, read_transform(poses + 16 * i), at + dof * i, {t[i], t[i], budget, false, {}});
    });
}

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
    nb::class_<ReachArm>(module, "Reach", "Proofs that a pose is out of reach of a chain within its limits.")
        .def(nb::new_(&make_arm), "chain"_a, "lower"_a, "upper"_a)
        .def("prove", &prove_reach, "target"_a, "position_tolerance"_a, "orientation_tolerance"_a, "budget"_a,
             "record"_a, "overlaps"_a = std::vector<Overlap>())
        .def("keeps", &keeps, "targets"_a, "q"_a, "tolerances"_a, "budget"_a,
             "For tests: (N,) whether the boxes on the path of the search to each of the solutions q (N, n) keep it.")
        .def_prop_ro("size", [](const ReachArm& arm) { return arm.loop.size; })
        .def_prop_ro("points", [](const ReachArm& arm) { return arm.loop.points; })
        .def_prop_ro("constraints", [](const ReachArm& arm) {
            std::vector<std::tuple<int, int>> pairs;
            for (const LoopConstraint& c : arm.loop.constraints) pairs.emplace_back(c.points[0], c.points[1]);
            return pairs;
        });
}

}  // namespace pinproof
