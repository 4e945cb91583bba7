// Proofs of curves.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <memory>
#include <stdexcept>
#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/exact_judge.h"
#include "certificate/constraint_proof.h"
#include "certificate/curve_proof.h"
#include "certificate/departure.h"
#include "certificate/motion_bounds.h"

namespace pinproof {
namespace {

CurveView view(const Vector& knots, const Stack& control, std::size_t dof) {
    require_size("a control point", control.shape(2), dof);
    if (control.shape(0) == 0 || control.shape(1) == 0) throw std::invalid_argument("the curve has no control points");
    require_size("knots", knots.shape(0), control.shape(0) + 1);
    return {{knots.data(), knots.shape(0)}, {control.data(), control.size()}, control.shape(1), dof};
}

ProofState prove(const World& world, const Vector& knots, const Stack& control, const ProofSettings& settings,
                 const Vector& joint_tolerance, nb::object exact, const ProofState& known) {
    const CurveView curve = view(knots, control, world.space().tree.dof);
    require_size("joint_tolerance", joint_tolerance.shape(0), curve.dof);
    PythonJudge judge(std::move(exact), curve.dof);
    nb::gil_scoped_release release;
    return CurveProof(world).run(curve, settings, joint_tolerance.data(), judge, known);
}

Vec3 read_vector(const char* name, const Vector& vector) {
    require_size(name, vector.shape(0), 3);
    require_finite(name, vector.data(), 3);
    return {vector(0), vector(1), vector(2)};
}

Vec3 read_direction(const char* name, const Vector& vector) {
    const Vec3 direction = read_vector(name, vector);
    if (!(std::abs(norm(direction) - 1.0) < 1e-9)) throw std::invalid_argument(std::string(name) + " is no unit vector");
    return direction;
}

double read_tolerance(double tolerance) {
    require_positive("tolerance", tolerance);
    return tolerance;
}

PathConstraint region_constraint(const Vector& point, const Matrix& base_from_box, const Vector& low,
                                 const Vector& high, double tolerance) {
    require_size("base_from_box", base_from_box.shape(0) == 4 ? base_from_box.shape(1) : 0, 4);
    require_finite("base_from_box", base_from_box.data(), 16);
    require_size("low", low.shape(0), 3);
    require_size("high", high.shape(0), 3);
    for (int i = 0; i < 3; ++i)
        if (!(low(i) <= high(i))) throw std::invalid_argument("low must not exceed high");
    PathConstraint region;
    region.kind = ConstraintKind::kRegion;
    region.point = read_vector("point", point);
    region.base_from_box = read_transform(base_from_box.data());
    region.low = {low(0), low(1), low(2)};
    region.high = {high(0), high(1), high(2)};
    region.tolerance = read_tolerance(tolerance);
    return region;
}

ConstraintState prove_one(const Chain& chain, const PathConstraint& constraint, const Vector& knots,
                          const Stack& control, const ConstraintSettings& settings, const Vector& joint_tolerance) {
    const CurveView curve = view(knots, control, chain.dof);
    require_finite("control", control.data(), control.size());
    require_size("joint_tolerance", joint_tolerance.shape(0), curve.dof);
    nb::gil_scoped_release release;
    ConstrainedTcp tcp(chain, {constraint});
    return prove_constraint(tcp, 0, curve, settings, joint_tolerance.data());
}

nb::object proven_intervals(const ConstraintState& state) {
    auto out = new_array({state.evidence.size(), 2});
    double* row = out.data;
    for (const ProvenInterval& each : state.evidence) {
        *row++ = each.start;
        *row++ = each.end;
    }
    return nb::cast(out.array);
}

void bind_constraints(nb::module_& module) {
    nb::class_<PathConstraint>(module, "PathConstraint", "A constraint of the tcp along a curve.")
        .def_static(
            "direction",
            [](const Vector& axis, const Vector& direction, double tolerance) {
                return PathConstraint{ConstraintKind::kDirection, read_direction("axis", axis),
                                      read_direction("direction", direction), {}, {}, {}, read_tolerance(tolerance)};
            },
            nb::arg("axis"), nb::arg("direction"), nb::arg("tolerance"),
            "The angle between an axis of the tcp and a direction of the base (rad).")
        .def_static("region", &region_constraint, nb::arg("point"), nb::arg("base_from_box"), nb::arg("low"),
                    nb::arg("high"), nb::arg("tolerance"), "The distance of a point of the tcp from a box (m).")
        .def_static(
            "target",
            [](const Vector& axis, const Vector& point, double tolerance) {
                return PathConstraint{ConstraintKind::kTarget, read_direction("axis", axis),
                                      read_vector("point", point), {}, {}, {}, read_tolerance(tolerance)};
            },
            nb::arg("axis"), nb::arg("point"), nb::arg("tolerance"),
            "The angle between an axis of the tcp and the direction from it to a point (rad).");
    nb::class_<ConstraintSettings>(module, "ConstraintSettings", "How a constraint is proven.")
        .def(
            "__init__",
            [](ConstraintSettings* self, double resolution, std::int64_t max_intervals, double goal_share,
               std::int64_t look_ahead, bool record) {
                require_positive("resolution", resolution);
                require_count("max_intervals", max_intervals);
                require_count("look_ahead", look_ahead);
                new (self) ConstraintSettings{resolution, max_intervals, goal_share, look_ahead, record};
            },
            nb::kw_only(), nb::arg("resolution"), nb::arg("max_intervals"), nb::arg("goal_share") = 0.0,
            nb::arg("look_ahead") = 0, nb::arg("record") = false);
    nb::class_<FoundViolation>(module, "FoundViolation", "A configuration of a curve that violates a constraint.")
        .def_ro("time", &FoundViolation::time)
        .def_ro("error", &FoundViolation::error)
        .def_ro("q", &FoundViolation::q);
    nb::class_<UndecidedConstraint>(module, "UndecidedConstraint", "A span of a curve that is undecided.")
        .def_ro("start", &UndecidedConstraint::start)
        .def_ro("end", &UndecidedConstraint::end)
        .def_ro("error", &UndecidedConstraint::error);
    nb::class_<ConstraintState>(module, "ConstraintState", "What is known of a constraint on a curve.")
        .def_ro("intervals", &ConstraintState::intervals)
        .def_ro("observed", &ConstraintState::observed)
        .def_ro("proven", &ConstraintState::proven)
        .def_ro("violation", &ConstraintState::violation)
        .def_ro("open", &ConstraintState::open)
        .def_prop_ro("satisfied", &ConstraintState::satisfied)
        .def_prop_ro("evidence", &proven_intervals, "(L, 2) start and end of each proven interval.");
    module.def("prove_constraint", &prove_one, nb::arg("chain"), nb::arg("constraint"), nb::arg("knots"),
               nb::arg("control"), nb::arg("settings"), nb::arg("joint_tolerance"),
               "The ConstraintState of a curve.");
    module.def(
        "constraint_bound",
        [](const Chain& chain, const PathConstraint& constraint, const Vector& q, const Matrix& piece,
           const Vector& delta, const Vector& extra) {
            require_size("q", q.shape(0), chain.dof);
            require_size("a control point", piece.shape(1), chain.dof);
            require_size("delta", delta.shape(0), chain.dof);
            require_size("extra", extra.shape(0), chain.dof);
            ConstrainedTcp tcp(chain, {constraint});
            tcp.place(q.data());
            const auto bound =
                tcp.bound(0, piece.data(), piece.shape(0), q.data(), delta.data(), extra.data());
            return std::make_tuple(tcp.error(0), bound.error);
        },
        nb::arg("chain"), nb::arg("constraint"), nb::arg("q"), nb::arg("piece"), nb::arg("delta"), nb::arg("extra"),
        "The error at q, and its bound on a piece of a curve about q, for tests.");
}

// The largest difference of the length of a direction from 1.
constexpr double kUnit = 1e-6;

Departure make_departure(const World& world, std::size_t body, std::shared_ptr<Shape> hull, const Vector& normal,
                         double level) {
    if (body >= world.space().robot_bodies) throw std::invalid_argument("not a body of the robot");
    if (hull->kind != ShapeKind::kConvex) throw std::invalid_argument("the hull of a body must be convex");
    const Vec3 along = read_vector("normal", normal);
    if (!(std::abs(norm(along) - 1.0) < kUnit)) throw std::invalid_argument("normal is no unit vector");
    require_finite("level", &level, 1);
    return {world.geometry, static_cast<int>(body), std::move(hull), along, level};
}

void bind_departure(nb::module_& module) {
    nb::class_<DepartureProof>(module, "DepartureProof", "The span of a curve on which a body is proven not to approach.")
        .def_ro("end", &DepartureProof::end, "The parameter up to which it is proven.")
        .def_ro("until", &DepartureProof::until,
                "The parameter after which its gap is also larger than required; infinity if this is not reached.")
        .def_ro("stopped", &DepartureProof::stopped,
                "The end of the first interval in which the proof failed; `end` if it did not fail.")
        .def_ro("intervals", &DepartureProof::intervals, "Number of intervals.");
    nb::class_<Departure>(module, "Departure", "The motion of a body of the robot along one direction.")
        .def(nb::new_([](const World& world, std::size_t body, std::shared_ptr<Shape> hull, const Vector& normal,
                         double level) { return make_departure(world, body, std::move(hull), normal, level); }),
             nb::arg("world"), nb::arg("body"), nb::arg("hull"), nb::arg("normal"), nb::arg("level"),
             "`hull`: a convex shape with the points of the body; `level` (m): the extent of the obstacle along normal.")
        .def_prop_ro(
            "normal",
            [](const Departure& self) {
                auto out = new_array({3});
                for (int i = 0; i < 3; ++i) out.data[i] = self.normal()[i];
                return nb::cast(out.array);
            },
            "(3,) the unit vector in the root frame.")
        .def_prop_ro("level", &Departure::level)
        .def(
            "gap",
            [](Departure& self, const Vector& q) {
                require_size("q", q.shape(0), self.dof());
                require_finite("q", q.data(), q.shape(0));
                return self.gap(q.data());
            },
            nb::arg("q"), "The gap (m) at q: a lower bound of the distance, negative in overlap.")
        .def(
            "decrease",
            [](Departure& self, const Matrix& piece) {
                require_size("a control point", piece.shape(1), self.dof());
                if (piece.shape(0) == 0) throw std::invalid_argument("the piece has no control points");
                require_finite("piece", piece.data(), piece.size());
                const GapDecrease bound = self.decrease(piece.data(), piece.shape(0));
                return std::make_tuple(bound.decrease, bound.motion);
            },
            nb::arg("piece"), "Upper bounds (m) of the decrease of the gap and of the motion over a piece of a curve.")
        .def(
            "follow",
            [](Departure& self, const Vector& knots, const Stack& control, double enough, double tolerance,
               std::int64_t max_intervals) {
                const CurveView curve = view(knots, control, self.dof());
                require_finite("control", control.data(), control.size());
                require_count("max_intervals", max_intervals);
                return self.follow(curve, enough, read_tolerance(tolerance), max_intervals);
            },
            nb::arg("knots"), nb::arg("control"), nb::arg("enough"), nb::arg("tolerance"), nb::arg("max_intervals"),
            "The DepartureProof of a curve: the body has separated beyond the gap `enough` (m).");
}

nb::object evidence(const ProofState& state) {
    auto out = new_array({state.evidence.size(), 7});
    double* row = out.data;
    for (const Evidence& each : state.evidence) {
        const double values[7] = {each.start,      each.end,         static_cast<double>(each.pair),
                                  each.distance,   each.direction.x, each.direction.y,
                                  each.direction.z};
        row = std::copy_n(values, 7, row);
    }
    return nb::cast(out.array);
}

// The motion bounds of the pairs of a world about one configuration, for tests.
class BoundsAt {
public:
    BoundsAt(std::shared_ptr<World> world, const Vector& q, const Vector& delta, const Vector& extra)
        : world_(std::move(world)), workspace_(world_), bounds_(*world_) {
        const std::size_t dof = world_->space().tree.dof;
        require_size("q", q.shape(0), dof);
        require_size("delta", delta.shape(0), dof);
        require_size("extra", extra.shape(0), dof);
        q_.assign(q.data(), q.data() + dof);
        extra_.assign(extra.data(), extra.data() + dof);
        workspace_.place_at(q_.data());
        bounds_.set(workspace_.joints(), workspace_.bodies(), delta.data(), extra_.data());
    }

    Approach rough(std::size_t pair) const { return bounds_.rough(world_->pairs.at(pair)); }
    Approach tight(std::size_t pair, const Vector& u, int split, const Matrix& piece) const {
        require_size("u", u.shape(0), 3);
        require_size("a control point", piece.shape(1), q_.size());
        if (piece.shape(0) == 0) throw std::invalid_argument("the piece has no control points");
        if (split < 0 || static_cast<std::size_t>(split) > joints_between(pair))
            throw std::invalid_argument("split exceeds the number of joints between the bodies");
        return bounds_.tight<true>(world_->pairs.at(pair), split, {u(0), u(1), u(2)}, piece.data(),
                                   static_cast<int>(piece.shape(0)), q_.data());
    }
    std::size_t joints_between(std::size_t pair) const { return world_->pairs.at(pair).joints; }

private:
    std::shared_ptr<World> world_;
    Workspace workspace_;
    MotionBounds bounds_;
    std::vector<double> q_, extra_;
};

}  // namespace

void bind_certificate(nb::module_& module) {
    bind_constraints(module);
    bind_departure(module);
    nb::class_<ProofSettings>(module, "ProofSettings", "How a curve is proven.")
        .def(
            "__init__",
            [](ProofSettings* self, double tolerance, std::int64_t max_intervals, double obstacle_tolerance,
               double goal_share, std::int64_t look_ahead, bool wants_tubes, bool record) {
                require_count("max_intervals", max_intervals);
                require_count("look_ahead", look_ahead);
                new (self) ProofSettings{tolerance,  max_intervals, obstacle_tolerance, goal_share,
                                         look_ahead, wants_tubes,   record};
            },
            nb::kw_only(), nb::arg("tolerance"), nb::arg("max_intervals"), nb::arg("obstacle_tolerance") = 0.0,
            nb::arg("goal_share") = 0.0, nb::arg("look_ahead") = 0, nb::arg("wants_tubes") = false,
            nb::arg("record") = false)
        .def_ro("tolerance", &ProofSettings::tolerance)
        .def_ro("max_intervals", &ProofSettings::max_intervals)
        .def_ro("record", &ProofSettings::record);
    nb::class_<FoundContact>(module, "FoundContact", "A contact at a configuration of a curve.")
        .def_ro("time", &FoundContact::time)
        .def_ro("pair", &FoundContact::pair)
        .def_ro("q", &FoundContact::q);
    nb::class_<OpenSpan>(module, "OpenSpan", "A span of a curve that is undecided, and its least proven pair.")
        .def_ro("start", &OpenSpan::start)
        .def_ro("end", &OpenSpan::end)
        .def_ro("pair", &OpenSpan::pair)
        .def_ro("distance", &OpenSpan::distance);
    nb::class_<ProofState>(module, "ProofState", "What is known of a curve.")
        .def(nb::init<>())
        .def_ro("intervals", &ProofState::intervals)
        .def_rw("observed", &ProofState::observed)
        .def_rw("spare", &ProofState::spare)
        .def_rw("proven", &ProofState::proven)
        .def_rw("joint_tube", &ProofState::joint_tube)
        .def_rw("obstacle_tube", &ProofState::obstacle_tube)
        .def_ro("contact", &ProofState::contact)
        .def_ro("open", &ProofState::open)
        .def_prop_ro("free", &ProofState::free)
        .def_prop_ro("evidence", &evidence,
                     "(L, 7) start, end, pair, proven distance, direction in the root frame (zeros: balls).");
    module.def("prove", &prove, nb::arg("world"), nb::arg("knots"), nb::arg("control"), nb::arg("settings"),
               nb::arg("joint_tolerance"), nb::arg("exact"), nb::arg("known"),
               "The ProofState of a curve, from what is `known` of it. `exact` measures the pairs that only coal can.");
    nb::class_<JointSwing>(module, "JointSwing", "The motion of a joint within a box.")
        .def_ro("chord", &JointSwing::chord)
        .def_ro("bend", &JointSwing::bend)
        .def_ro("angle", &JointSwing::angle);
    module.def(
        "joint_swing",
        [](bool prismatic, double multiplier, double delta) {
            return swing_of({{}, prismatic, 0, multiplier, 0.0, kRoot}, delta, 0.0);
        },
        nb::arg("prismatic"), nb::arg("multiplier"), nb::arg("delta"), "The motion of a joint, for tests.");
    nb::class_<Approach>(module, "Approach", "How much closer two bodies can come.")
        .def_ro("distance", &Approach::distance)
        .def_ro("growth", &Approach::growth)
        .def_ro("bare", &Approach::bare)
        .def_ro("split", &Approach::split);
    nb::class_<BoundsAt>(module, "MotionBounds", "The motion bounds about a configuration, for tests.")
        .def(nb::init<std::shared_ptr<World>, const Vector&, const Vector&, const Vector&>(), nb::arg("world"),
             nb::arg("q"), nb::arg("delta"), nb::arg("extra"))
        .def("rough", &BoundsAt::rough, nb::arg("pair"))
        .def("tight", &BoundsAt::tight, nb::arg("pair"), nb::arg("u"), nb::arg("split"), nb::arg("piece"))
        .def("joints_between", &BoundsAt::joints_between, nb::arg("pair"));
    module.attr("GROWTH_RANGE") = kGrowthRange;
}

}  // namespace pinproof
