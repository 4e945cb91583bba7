// Proofs of curves.
#include "bindings/arrays.h"
#include "bindings/structs.h"
#include "certificate/curve_proof.h"
#include "certificate/departure.h"
#include "certificate/motion_bounds.h"
#include "certificate/path_constraint.h"
#include "certificate/separation.h"

namespace pinproof {
namespace {

// A curve of pieces with control points (k, p, n), which `read` checks: `shaped` or `finite`.
template <class Read>
CurveView curve_of(const Vector& knots, const Stack& control, std::size_t dof, Read read) {
    const std::span<const double> points = read("control", control, Sizes{kSome, kSome, dof});
    return {shaped("knots", knots, {control.shape(0) + 1}), points, control.shape(1), dof};
}
constexpr auto read_shaped = [](const auto&... arguments) { return shaped(arguments...); };
constexpr auto read_finite = [](const auto&... arguments) { return finite(arguments...); };

ProofState prove(const World& world, const Vector& knots, const Stack& control, const ProofSettings& settings,
                 const Vector& joint_tolerance, const ProofState& known) {
    const CurveView curve = curve_of(knots, control, world.space().tree.dof, read_shaped);
    const double* tolerance = shaped("joint_tolerance", joint_tolerance, {curve.dof}).data();
    nb::gil_scoped_release release;
    return CurveProof(world).run(curve, settings, tolerance, known);
}

ConstraintState prove_one(const Chain& chain, const PathConstraint& constraint, const Vector& knots,
                          const Stack& control, const ConstraintSettings& settings, const Vector& joint_tolerance) {
    const CurveView curve = curve_of(knots, control, chain.dof, read_finite);
    const double* tolerance = shaped("joint_tolerance", joint_tolerance, {curve.dof}).data();
    nb::gil_scoped_release release;
    ConstrainedTcp tcp(chain, {constraint});
    return prove_constraint(tcp, 0, curve, settings, tolerance);
}

template <class Settings>
void check_counts(const Settings& settings) {
    counted("max_intervals", settings.max_intervals);
    counted("look_ahead", settings.look_ahead);
}

// The largest difference of the length of a direction from 1: of a constraint, and of a departure.
constexpr double kExactUnit = 1e-9, kUnit = 1e-6;

PathConstraint cone(ConstraintKind kind, const Vector& axis, const Vec3& point, double tolerance) {
    return {kind, unit_vector("axis", axis, kExactUnit), point, {}, {}, {}, positive("tolerance", tolerance)};
}

PathConstraint region_constraint(const Vector& point, const Matrix& base_from_box, const Vector& low,
                                 const Vector& high, double tolerance) {
    // The sides of the box may be infinite.
    const auto l = shaped("low", low, {3}), h = shaped("high", high, {3});
    for (int i = 0; i < 3; ++i)
        if (!(l[i] <= h[i])) refuse("low must not exceed high");
    return {ConstraintKind::kRegion, {}, vec3("point", point), transform("base_from_box", base_from_box),
            {l[0], l[1], l[2]}, {h[0], h[1], h[2]}, positive("tolerance", tolerance)};
}

void bind_constraints(nb::module_& module) {
    nb::class_<PathConstraint>(module, "PathConstraint", "A constraint of the tcp along a curve.")
        .def_static("direction", [](const Vector& axis, const Vector& direction, double tolerance) {
                const Vec3 along = unit_vector("direction", direction, kExactUnit);
                return cone(ConstraintKind::kDirection, axis, along, tolerance);
            }, "axis"_a, "direction"_a, "tolerance"_a,
            "The angle between an axis of the tcp and a direction of the base (rad).")
        .def_static("region", &region_constraint, "point"_a, "base_from_box"_a, "low"_a, "high"_a, "tolerance"_a,
                    "The distance of a point of the tcp from a box (m).")
        .def_static("target", [](const Vector& axis, const Vector& point, double tolerance) {
                return cone(ConstraintKind::kTarget, axis, vec3("point", point), tolerance);
            }, "axis"_a, "point"_a, "tolerance"_a,
            "The angle between an axis of the tcp and the direction from it to a point (rad).");
    using Settings = ConstraintSettings;
    bind_struct<Settings>(
        module, "ConstraintSettings", "How a constraint is proven.",
        [](const Settings& settings) {
            positive("resolution", settings.resolution);
            check_counts(settings);
        }, MEMBERS(Settings, resolution, max_intervals),
        OPTIONALS(Settings, goal_share, look_ahead, record));
    bind_result<FoundViolation>(module, "FoundViolation", "A configuration of a curve that violates a constraint.",
                                FIELDS(FoundViolation, time, error, q));
    bind_result<UndecidedConstraint>(module, "UndecidedConstraint", "A span of a curve that is undecided.",
                                     FIELDS(UndecidedConstraint, start, end, error));
    bind_result<ConstraintState>(module, "ConstraintState", "What is known of a constraint on a curve.",
                                 FIELDS(ConstraintState, intervals, observed, proven, violation, open, satisfied))
        .def_prop_ro("evidence", [](const ConstraintState& state) {
                return table(state.evidence, &ProvenInterval::start, &ProvenInterval::end);
            }, "(L, 2) start and end of each proven interval.");
    module.def("prove_constraint", &prove_one, "chain"_a, "constraint"_a, "knots"_a, "control"_a, "settings"_a,
               "joint_tolerance"_a, "The ConstraintState of a curve.");
}

Departure make_departure(const World& world, std::size_t body, const Vector& normal, double level) {
    if (body >= world.space().robot.size()) refuse("not a body of the robot");
    return {world.geometry, static_cast<int>(body), hull_of(world.space().robot[body].shape),
            unit_vector("normal", normal, kUnit), finite("level", level)};
}

// A pair of a body of the robot and an obstacle that no joint moves.
int pair_with_obstacle(const World& world, std::int64_t pair) {
    if (pair < 0 || static_cast<std::size_t>(pair) >= world.size()) refuse("not a pair of bodies");
    if (!world.pair(static_cast<int>(pair)).with_obstacle) refuse("not a pair with an obstacle");
    return static_cast<int>(pair);
}

std::vector<PairSeparation> separate_pairs(const World& world, const Indices& pairs, const Vector& knots,
                                     const Stack& control, const SeparationSettings& settings, const Matrix& more) {
    const CurveView curve = curve_of(knots, control, world.space().tree.dof, read_finite);
    const double* d = shaped("more", more, {kAny, 3}).data();
    std::vector<Vec3> directions;
    for (std::size_t i = 0; i < more.shape(0); ++i) directions.push_back({d[3 * i], d[3 * i + 1], d[3 * i + 2]});
    std::vector<int> stated;
    for (std::int64_t pair : shaped("pairs", pairs, {kAny})) stated.push_back(pair_with_obstacle(world, pair));
    nb::gil_scoped_release release;
    return separate(world, curve, settings, stated, directions);
}

NewArray facet_directions(const World& world, std::int64_t index, const Vector& q, double reach) {
    const Pair& pair = world.pair(pair_with_obstacle(world, index));
    std::vector<Vec3> found;
    if (world.shape(pair.b).kind == ShapeKind::kMesh) {
        Workspace space(std::make_shared<World>(world));
        space.place_at(finite("q", q, {world.space().tree.dof}).data());
        const ClosePair close{space.bodies()[pair.a], space.bodies()[pair.b],
                              hull_of(world.space().robot[pair.a].shape), world.shape(pair.b)};
        found = close.directions_to_facets(reach);
    }
    return table(found, &Vec3::x, &Vec3::y, &Vec3::z);
}

void bind_departure(nb::module_& module) {
    bind_result<DepartureProof>(
        module, "DepartureProof",
        "The span of a curve on which a body is proven not to approach: its end, the parameter after which its gap is "
        "also larger than required (infinity if this is not reached), the end of the first interval in which the proof "
        "failed (`end` if it did not fail), the number of intervals, and the gap (m) at the end.",
        FIELDS(DepartureProof, end, until, stopped, intervals, gap));
    nb::class_<Departure>(module, "Departure", "The motion of a body of the robot along one direction.")
        .def(nb::new_(&make_departure), "world"_a, "body"_a, "normal"_a, "level"_a,
             "`level` (m): the extent of an obstacle along normal.")
        .def("gap", [](Departure& self, const Vector& q) { return self.gap(finite("q", q, {self.dof()}).data()); },
             "q"_a, "The gap (m) at q: a lower bound of the distance, negative in overlap.")
        .def("decrease", [](Departure& self, const Matrix& piece) {
                const auto points = finite("piece", piece, {kSome, self.dof()});
                const GapDecrease bound = self.decrease(points.data(), piece.shape(0));
                return std::tuple(bound.decrease, bound.motion);
            }, "piece"_a, "Upper bounds (m) of the decrease of the gap and of the motion over a piece of a curve.");
    using Settings = SeparationSettings;
    bind_struct<Settings>(
        module, "SeparationSettings", "Which pairs are close at the start of a curve, and how they are followed.",
        [](const Settings& settings) {
            positive("tolerance", settings.tolerance);
            counted("max_intervals", settings.max_intervals);
        }, LIMITS(Settings, near), MEMBERS(Settings, deepest, displaced, tolerance, max_intervals));
    bind_result<SeparatingGroup>(
        module, "SeparatingGroup", "An obstacle, or facets of it, from which a body separates along one direction.",
        FIELDS(SeparatingGroup, normal, level, gap, slack, proof), "facets", [](const SeparatingGroup& group) {
            return array_of<std::int64_t>(group.facets);
        });
    bind_result<PairSeparation>(
        module, "PairSeparation", "How a body separates from an obstacle that it may touch.",
        FIELDS(PairSeparation, far, overlaps, gap, groups, complete),
        "rest", [](const PairSeparation& found) { return array_of<std::int64_t>(found.rest); },
        "unclear", [](const PairSeparation& found) { return array_of<std::int64_t>(found.unclear); });
    module.def("separate", &separate_pairs, "world"_a, "pairs"_a, "knots"_a, "control"_a, "settings"_a, "more"_a,
               "The PairSeparation of each pair with an obstacle along a curve; `more` (D, 3): directions to try.");
    module.def("facet_directions", &facet_directions, "world"_a, "pair"_a, "q"_a, "reach"_a,
               "(K, 3) unit vectors from a body at q to the facets of a mesh within `reach` (m).");
}

// The motion bounds of the pairs of a world about one configuration, for tests.
class BoundsAt {
public:
    BoundsAt(std::shared_ptr<World> world, const Vector& q, const Vector& delta, const Vector& extra)
        : world_(std::move(world)), workspace_(world_), bounds_(*world_) {
        const std::size_t dof = world_->space().tree.dof;
        q_ = list_of(shaped("q", q, {dof}));
        extra_ = list_of(shaped("extra", extra, {dof}));
        workspace_.place_at(q_.data());
        bounds_.set(workspace_.bodies(), shaped("delta", delta, {dof}).data(), extra_.data());
    }

    Approach rough(std::size_t pair) const { return bounds_.rough(pair_at(pair)); }
    Approach tight(std::size_t pair, const Vector& u, int split, const Matrix& piece) {
        const double* control = shaped("piece", piece, {kSome, q_.size()}).data();
        if (split < 0 || static_cast<std::size_t>(split) > pair_at(pair).joints)
            refuse("split exceeds the number of joints between the bodies");
        const Pair& of = pair_at(pair);
        bounds_.set_piece(control, static_cast<int>(piece.shape(0)), q_.data());
        return {bounds_.tight(of, split, vec3("u", u)), bounds_.growth(of, split, vec3("u", u)), 0.0, split};
    }

private:
    const Pair& pair_at(std::size_t pair) const { return world_->table->pairs.at(pair); }

    std::shared_ptr<World> world_;
    Workspace workspace_;
    MotionBounds bounds_;
    Doubles q_, extra_;
};

void bind_parts_of_proofs(nb::module_& module) {
    module.def("joint_swing", [](bool prismatic, double multiplier, double delta) {
            const JointSwing swing = swing_of(prismatic, multiplier, delta, 0.0);
            return std::tuple(swing.chord, swing.bend);
        }, "prismatic"_a, "multiplier"_a, "delta"_a, "The chord and the bend of a joint.");
    bind_result<Approach>(module, "Approach", "How much closer two bodies can come.", FIELDS(Approach, distance,
                                                                                             growth, bare, split));
    nb::class_<BoundsAt>(module, "MotionBounds", "The motion bounds about a configuration, for tests.")
        .def(nb::init<std::shared_ptr<World>, const Vector&, const Vector&, const Vector&>(), "world"_a, "q"_a,
             "delta"_a, "extra"_a)
        .def("rough", &BoundsAt::rough, "pair"_a)
        .def("tight", &BoundsAt::tight, "pair"_a, "u"_a, "split"_a, "piece"_a);
    module.attr("GROWTH_RANGE") = kGrowthRange;
}

}  // namespace

void bind_certificate(nb::module_& module) {
    bind_constraints(module);
    bind_departure(module);
    using Settings = ProofSettings;
    bind_struct<Settings>(
        module, "ProofSettings", "How a curve is proven.", check_counts<Settings>,
        LIMITS(Settings, tolerance), MEMBERS(Settings, max_intervals),
        OPTIONALS(Settings, obstacle_tolerance, goal_share, look_ahead, wants_tubes, record));
    bind_result<FoundContact>(module, "FoundContact", "A contact at a configuration of a curve.", FIELDS(FoundContact,
                                                                                                         time, pair, q));
    bind_result<OpenSpan>(module, "OpenSpan", "An undecided span of a curve, and its least proven pair.",
                          FIELDS(OpenSpan, start, end, pair, distance));
    bind_result<ProofState>(module, "ProofState", "What is known of a curve.", FIELDS(ProofState, intervals, contact,
                                                                                      open, free))
        .def(nb::init<>())
        .def_rw("observed", &ProofState::observed)
        .def_rw("spare", &ProofState::spare)
        .def_rw("proven", &ProofState::proven)
        .def_rw("joint_tube", &ProofState::joint_tube)
        .def_rw("obstacle_tube", &ProofState::obstacle_tube)
        .def_prop_ro("evidence", [](const ProofState& state) {
                const auto along = [](int axis) { return [axis](const Evidence& e) { return e.direction[axis]; }; };
                return table(state.evidence, &Evidence::start, &Evidence::end, &Evidence::pair, &Evidence::distance,
                             along(0), along(1), along(2));
            }, "(L, 7) start, end, pair, proven distance, direction in the root frame (zeros: balls).");
    module.def("prove", &prove, "world"_a, "knots"_a, "control"_a, "settings"_a, "joint_tolerance"_a, "known"_a,
               "The ProofState of a curve, from what is `known` of it.");
    bind_parts_of_proofs(module);
}

}  // namespace pinproof
