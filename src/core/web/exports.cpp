// The functions of the WebAssembly module. Numbers are passed in one list, which JavaScript sees as a Float64Array:
// `numbers(count)` makes room, and each function replaces its arguments there by its results.
#if defined(__wasm__)

#include <cmath>
#include <memory>

#include "closed_form/closed_form.h"
#include "collision/near.h"
#include "ik/search.h"
#include "web/cell.h"

// An error of the library, such as too little memory, ends a call: JavaScript sees an exception. Without this, the module
// would print a message, and need an operating system.
_LIBCPP_BEGIN_NAMESPACE_STD
void __libcpp_verbose_abort(const char*, ...) noexcept { __builtin_trap(); }
_LIBCPP_END_NAMESPACE_STD

namespace pinproof {
namespace {

#define EXPORT(name) extern "C" __attribute__((export_name(#name)))

std::vector<double> list;

// An arm with its solvers.
struct Solvers {
    IkSolver clik;
    Seeds seeds;
    SearchEngine engine;
    Search search;
    std::unique_ptr<ClosedFormSolver> closed_form;

    explicit Solvers(const CellArm& arm)
        : clik{arm.chain, arm.ranges,
               Task({true, true, true, true, true, true}, arm.position_tolerance, arm.orientation_tolerance),
               ClikStep{arm.damping}, arm.max_iterations, arm.max_step, arm.stall},
          seeds(arm.chain, arm.seeds.data(), arm.seeds.size() / arm.joints.size()),
          engine(clik),
          search(clik, seeds, {}) {
        if (!arm.plan.empty()) closed_form = std::make_unique<ClosedFormSolver>(arm.plan[0]);
    }
};

// The cell of the page, and what was moved in it.
struct Session {
    Cell cell;                                       // as it was loaded
    Transform root_from_robot;                       // the displacement of all robots
    std::vector<Transform> displacements;            // (obstacles)
    bool is_moved = false;
    std::unique_ptr<Workspace> moving, still;        // still: the pairs that no joint moves
    std::vector<std::unique_ptr<Solvers>> solvers;   // of the arms

    explicit Session(Cell loaded) : cell(std::move(loaded)), root_from_robot(identity()) {
        displacements.assign(cell.obstacles.size(), identity());
        for (const CellArm& arm : cell.arms) solvers.push_back(std::make_unique<Solvers>(arm));
        build();
    }

    static Transform identity() { return {{{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}}, {}}; }

    // The bodies where they are now.
    void build() {
        Cell now{.tree = cell.tree, .robot = cell.robot, .obstacles = cell.obstacles, .rounding = cell.rounding,
                 .pairs = cell.pairs, .margins = cell.margins};
        const auto put = [&](const Transform& displacement, Transform& place) {
            place = displacement * place;
            // Rounding grows with the size of the cell.
            now.rounding = std::max(now.rounding, cell.rounding + 1e-9 * norm(displacement.translation));
        };
        if (is_moved) {
            for (Joint& joint : now.tree.joints)
                if (joint.parent == kRoot) put(root_from_robot, joint.before);
            for (Body& body : now.robot)
                if (body.joint == kRoot) put(root_from_robot, body.joint_from_body);
            for (std::size_t i = 0; i < displacements.size(); ++i) put(displacements[i], now.obstacles[i].joint_from_body);
        }
        const auto world = now.world();
        moving = std::make_unique<Workspace>(world);
        still = std::make_unique<Workspace>(std::make_shared<World>(world->of_still_pairs()));
    }

    Transform root_from_frame(int number) const {
        const CellFrame& frame = cell.frames[static_cast<std::size_t>(number)];
        return (frame.joint == kRoot ? root_from_robot : moving->bodies().joint(frame.joint)) * frame.joint_from_frame;
    }

};

std::unique_ptr<Session> session;

void put(const Vec3& v) { list.insert(list.end(), {v.x, v.y, v.z}); }

// Place the bodies at a configuration, which must be finite.
bool place(const double* q) { return session->moving->place_at(q) && session->still->place_at(q); }

// A pair: its two bodies, bounds of the distance (m), and the closest points.
void put(const Workspace& bodies, int number) {
    const Pair& pair = bodies.world().pair(number);
    const Measured measured = bodies.measure(number);
    list.insert(list.end(), {double(pair.a), double(pair.b), measured.bounds.lower, measured.bounds.upper});
    put(measured.points.of_a);
    put(measured.points.of_b);
}

// Arguments of inverse kinematics: root_from_target (16, row by row) and the configuration of the cell.
struct Asked {
    const CellArm* arm;
    Solvers* solvers;
    std::vector<double> all, q;  // of the cell, and of the arm
    Transform base_from_target;
};

std::optional<Asked> asked(int number) {
    if (!session || number < 0 || static_cast<std::size_t>(number) >= session->cell.arms.size()) return {};
    const CellArm& arm = session->cell.arms[static_cast<std::size_t>(number)];
    Asked it{&arm, session->solvers[static_cast<std::size_t>(number)].get(), {}, {}, {}};
    it.all.assign(list.begin() + 16, list.begin() + 16 + static_cast<std::ptrdiff_t>(session->cell.tree.dof));
    const std::optional<Transform> target = rigid_transform(list.data());
    if (!target || !place(it.all.data())) return {};
    it.base_from_target = inverse(session->root_from_frame(arm.base)) * *target;
    for (int joint : arm.joints) it.q.push_back(it.all[static_cast<std::size_t>(joint)]);
    return it;
}

// Append the configuration of the cell with that of the arm in it.
void put(const Asked& it, const double* q) {
    std::vector<double> all = it.all;
    for (int joint : it.arm->joints) all[static_cast<std::size_t>(joint)] = *q++;
    list.insert(list.end(), all.begin(), all.end());
}

}  // namespace

EXPORT(numbers) double* numbers(int count) {
    if (count > 0 && static_cast<std::size_t>(count) > list.size()) list.resize(static_cast<std::size_t>(count));
    return list.data();
}

// Load the cell of a block of `count` numbers; returns the number of joint values, or -1 if it is not a cell.
EXPORT(load) int load(int count) {
    session.reset();
    std::optional<Cell> cell = read_cell({list.data(), static_cast<std::size_t>(count)});
    list = {};
    if (!cell) return -1;
    session = std::make_unique<Session>(std::move(*cell));
    return static_cast<int>(session->cell.tree.dof);
}

// Displace the obstacle bodies from `first` to `last`, or the robots (first -1), by a rigid transform (16) from where
// they were loaded; returns whether it is one.
EXPORT(move) int move(int first, int last) {
    const std::optional<Transform> displacement = rigid_transform(list.data());
    if (!displacement || first < -1 || last > static_cast<int>(session->displacements.size())) return 0;
    if (first == -1) session->root_from_robot = *displacement;
    for (int i = std::max(first, 0); i < last; ++i) session->displacements[static_cast<std::size_t>(i)] = *displacement;
    session->is_moved = true;
    session->build();
    return 1;
}

// The contacts at a configuration, see `put`, after: whether it is finite, a lower bound of the smallest distance of
// bodies that do not overlap, the number of contacts, and the closest pair (of bodies -1 if there is none). Then the
// manipulability of each arm and the poses of all frames (16, column by column).
EXPORT(check) int check() {
    const std::vector<double> q(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(session->cell.tree.dof));
    list.clear();
    if (!place(q.data())) {
        list.assign(1, 0.0);
        return 1;
    }
    Workspace* closest = session->still.get();
    Nearest nearest = closest->find_nearest();
    if (const Nearest other = session->moving->find_nearest(); other.upper < nearest.upper || nearest.pair < 0) {
        const double lower = std::min(nearest.lower, other.lower);
        nearest = other;
        nearest.lower = lower;
        closest = session->moving.get();
    } else {
        nearest.lower = std::min(nearest.lower, other.lower);
    }
    list.assign({1.0, nearest.lower, 0.0});
    if (nearest.pair >= 0) put(*closest, nearest.pair);
    else list.insert(list.end(), {-1.0, -1.0, nearest.lower, nearest.upper, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0});
    for (Workspace* bodies : {session->still.get(), session->moving.get()}) {
        bodies->find_contacts();
        for (int pair : bodies->contacts()) put(*bodies, pair);
        list[2] += static_cast<double>(bodies->contacts().size());
    }
    for (const CellArm& arm : session->cell.arms) {
        std::vector<double> own;
        for (int joint : arm.joints) own.push_back(q[static_cast<std::size_t>(joint)]);
        Posture posture(arm.chain);
        Jacobian jacobian(arm.chain.dof);
        posture.evaluate(arm.chain, Frame{}, own.data());
        posture.jacobian(arm.chain, jacobian);
        list.push_back(std::exp(log_manipulability(jacobian)));
    }
    for (std::size_t k = 0; k < session->cell.frames.size(); ++k) {
        const Transform t = session->root_from_frame(static_cast<int>(k));
        for (int column = 0; column < 3; ++column) {
            put(t.rotation.column(column));
            list.push_back(0.0);
        }
        put(t.translation);
        list.push_back(1.0);
    }
    return static_cast<int>(list.size());
}

// The solution of Clik nearest to a configuration: whether it reaches the target, its errors (m, rad), the iterations,
// and the configuration.
EXPORT(solve) int solve(int arm) {
    const std::optional<Asked> it = asked(arm);
    if (!it) return 0;
    Solvers& solvers = *it->solvers;
    solvers.search.begin(it->base_from_target, it->q.data());
    const Candidate& found = solvers.engine.next(solvers.search, it->arm->attempts, true);
    list.assign({found.fulfils ? 1.0 : 0.0, found.error.position, found.error.orientation, double(found.iterations)});
    put(*it, found.q.data());
    return static_cast<int>(list.size());
}

// The branches of the closed form, at the values that redundant joints have: whether all are known, how many solutions
// are outside the limits, how many branches there are, and their configurations.
EXPORT(branches) int branches(int arm) {
    const std::optional<Asked> it = asked(arm);
    if (!it || !it->solvers->closed_form) return 0;
    const ArmPlan& plan = it->arm->plan[0];
    std::vector<double> locked;
    for (int k : plan.locked) locked.push_back(it->q[static_cast<std::size_t>(plan.joints[static_cast<std::size_t>(k)].index)]);
    double target[16];
    write_homogeneous(it->base_from_target, target);
    static Branches found;
    if (!it->solvers->closed_form->solve(target, it->q.data(), locked.data(), found)) return 0;
    list.assign({found.all_known() && locked.empty() ? 1.0 : 0.0, double(found.outside), double(found.count)});
    for (int i = 0; i < found.count; ++i) put(*it, found.branch[i].q);
    return static_cast<int>(list.size());
}

}  // namespace pinproof

#endif
