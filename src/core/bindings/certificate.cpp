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
#include "certificate/curve_proof.h"
#include "certificate/motion_bounds.h"

namespace pinproof {
namespace {

CurveView view(const Vector& knots, const Stack& control, const World& world) {
    const std::size_t dof = world.space().tree.dof;
    require_size("a control point", control.shape(2), dof);
    if (control.shape(0) == 0 || control.shape(1) == 0) throw std::invalid_argument("the curve has no control points");
    require_size("knots", knots.shape(0), control.shape(0) + 1);
    return {{knots.data(), knots.shape(0)}, {control.data(), control.size()}, control.shape(1), dof};
}

ProofState prove(const World& world, const Vector& knots, const Stack& control, const ProofSettings& settings,
                 const Vector& joint_tolerance, nb::object exact, const ProofState& known) {
    const CurveView curve = view(knots, control, world);
    require_size("joint_tolerance", joint_tolerance.shape(0), curve.dof);
    PythonJudge judge(std::move(exact), curve.dof);
    nb::gil_scoped_release release;
    return CurveProof(world).run(curve, settings, joint_tolerance.data(), judge, known);
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
        .def_ro("max_intervals", &ProofSettings::max_intervals);
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
