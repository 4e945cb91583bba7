"""Planning: RRT-Connect, simplification of paths, and Cartesian moves; every path has a certificate."""

from pinproof.common import faces
from pinproof.planning.among_movers import TimedPlanResult as TimedPlanResult, plan_among_movers as plan_among_movers
from pinproof.planning.cartesian import plan_linear as plan_linear
from pinproof.planning.closed_chain import (
    CarryPlan as CarryPlan,
    ChainDeviation as ChainDeviation,
    plan_carry as plan_carry,
)
from pinproof.planning.coordination import (
    CoordinationResult as CoordinationResult,
    coordinate as coordinate,
    plan_arms as plan_arms,
)
from pinproof.planning.routes import (
    Route as Route,
    RouteFollower as RouteFollower,
    nearest_target as nearest_target,
    routes_through as routes_through,
)
from pinproof.planning.goals import Goal as Goal, GoalPose as GoalPose
from pinproof.planning.motion_plan import MotionPlan as MotionPlan, plan as plan
from pinproof.planning.moves import MovingEnds as MovingEnds
from pinproof.planning.optimisation import OptimiseResult as OptimiseResult, optimise as optimise
from pinproof.planning.plan_results import (
    Barrier as Barrier,
    InvalidEnd as InvalidEnd,
    LinearPlanResult as LinearPlanResult,
    LinearStatus as LinearStatus,
    OutsideLimits as OutsideLimits,
    PlannedMotion as PlannedMotion,
    PlanProgress as PlanProgress,
    PlanResult as PlanResult,
    PlanStatus as PlanStatus,
)
from pinproof.planning.planners import (
    DEFAULT_PLANNER as DEFAULT_PLANNER,
    CertifiedPlanner as CertifiedPlanner,
    Planner as Planner,
    planner_of as planner_of,
)
from pinproof.planning.problem import (
    Edges as Edges,
    Ends as Ends,
    find_barriers as find_barriers,
    read_ends as read_ends,
    sampling_box as sampling_box,
    with_turns as with_turns,
)
from pinproof.planning.replanning import Replan as Replan, ReplanStatus as ReplanStatus, replan as replan
from pinproof.planning.rrt_connect import RrtConnect as RrtConnect
from pinproof.planning.simplification import (
    SimplifyResult as SimplifyResult,
    blend as blend,
    shortcut as shortcut,
    simplify as simplify,
)

__all__ = faces.exported(globals())
