"""Benchmark of grips in motion: loads against linear programmes, and certified motions simulated with contact.

./scripts/benchmark holding             prints the tables; 10 minutes
./scripts/benchmark holding --docs      rewrites docs/benchmarks/holding.*
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

import pinproof as pp
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, row_table
from pinproof.motion import ContactPatch, HoldLimits
from pinproof.picks import GripLimits, GripperFingers, Pick, PickBudget, Picks, PlaceTarget
from pinproof.spatial import SE3

EDGES = 32
"""Edges of the pyramids in and about the friction cones, which differ by 0.5 %."""

MOMENTS = 50.0
"""Factor of the moments in the equations of equilibrium, so that they are of the size of the forces."""

GRASPS, MOTIONS = 10_000, 500

NEAR = 0.1
"""A motion with a smaller reserve is close to slipping."""

STEP, SETTLE = 5e-4, 0.3
"""Seconds: time step of the simulation, and time for which the hand rests before the motion."""

HEAVY = 1e4
"""kg, and kg m^2: the inertia of the hand."""

MOVED, TURNED = 1e-3, np.deg2rad(2.0)
"""The part stays in the hand if it moves and turns by no more than this (m, rad)."""


# -- loads ------------------------------------------------------------------------------------------------------------


def across(normal: np.ndarray) -> np.ndarray:
    """(2, 3) unit vectors perpendicular to a unit vector and to each other."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def share_by_pyramids(contacts: Sequence[ContactPatch], wrench: np.ndarray, *, inside: bool) -> float:
    """The share of a load on point contacts with friction pyramids in or about the cones, by a linear programme.

    The pressure of each contact is a linear function of the place, at least 0 at every point.
    """
    columns: list[np.ndarray] = []  # force and moment, and the rows of the inequalities, of each variable
    own: list[tuple[int, dict[int, float]]] = []
    rows = 0
    pull = np.zeros(6)

    def load(force: np.ndarray, at: np.ndarray) -> np.ndarray:
        return np.concatenate([force, MOMENTS * np.cross(at, force)])

    bounds: list[tuple[float | None, float | None]] = []
    entries: list[dict[int, float]] = []
    for contact in contacts:
        points, normal = contact.points, contact.normal
        centre, (u, v) = points.mean(axis=0), across(normal)
        places = np.column_stack([np.ones(len(points)), (points - centre) @ u / 0.01, (points - centre) @ v / 0.01])
        # The normal force and its two slopes; at each point: -pressure <= 0, friction - mu pressure <= 0
        for k, shares in enumerate((places / len(points)).T):
            columns.append(sum(load(share * normal, at) for share, at in zip(shares, points, strict=True)))
            entry = {rows + 2 * i: -share for i, share in enumerate(shares)}
            entry |= {rows + 2 * i + 1: -contact.friction * share for i, share in enumerate(shares)}
            entries.append(entry | ({rows + 2 * len(points): 1.0} if k == 0 else {}))
            bounds.append((0.0 if k == 0 else None, None))
        angle = 2 * np.pi * np.arange(EDGES) / EDGES
        wide = 1.0 if inside else 1.0 / np.cos(np.pi / EDGES)
        for i, at in enumerate(points):
            for a in angle:
                columns.append(load(wide * (np.cos(a) * u + np.sin(a) * v), at))
                entries.append({rows + 2 * i + 1: 1.0})
                bounds.append((0.0, None))
        own.append((rows + 2 * len(points), {}))
        if contact.pulls:
            pull -= load(contact.force * normal, centre)
        rows += 2 * len(points) + 1
    # The last variable is the share: N <= share F (2 F of a cup, which also pulls)
    columns.append(pull)
    most = [(2.0 if contact.pulls else 1.0) * contact.force for contact in contacts]
    entries.append({row: -force for (row, _), force in zip(own, most, strict=True)})
    bounds.append((0.0, None))
    unequal = np.zeros((rows, len(columns)))
    for column, entry in enumerate(entries):
        unequal[list(entry), column] = list(entry.values())
    cost = np.zeros(len(columns))
    cost[-1] = 1.0
    wanted = wrench * np.repeat([1.0, MOMENTS], 3)
    found = linprog(cost, unequal, np.zeros(rows), np.array(columns).T, wanted, bounds, method="highs")
    return float(found.fun) if found.status == 0 else np.inf


def random_patch(rng: np.random.Generator, at: np.ndarray, towards: np.ndarray, points: int) -> ContactPatch:
    """A patch of random size and shape, whose normal differs from a direction by up to 15 degrees."""
    normal = towards + np.tan(rng.uniform(0, 0.26)) * (turn := np.cross(towards, rng.standard_normal(3))) / (
        np.linalg.norm(turn)
    )
    normal /= np.linalg.norm(normal)
    sides = 10 ** rng.uniform(-3.0, -1.7, 2)
    if rng.random() < 0.5:  # a rectangle
        plane = rng.uniform(-0.5, 0.5, (points, 2))
    else:  # an ellipse
        angle, radius = rng.uniform(0, 2 * np.pi, points), 0.5 * np.sqrt(rng.uniform(0, 1, points))
        plane = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    force, friction = 10 ** rng.uniform(0.5, 2.3), rng.uniform(0.1, 0.9)
    return ContactPatch(at + (plane * sides) @ across(normal), normal, force, friction)


def random_grasp(rng: np.random.Generator, points: int) -> tuple[str, list[ContactPatch], np.ndarray]:
    """The kind of a grasp, its contacts in the frame of the tcp, and a load with which it nearly slips or holds."""
    centre, kind = (
        np.array([0.0, 0.0, 0.1]) + rng.normal(0, 0.02, 3),
        rng.choice(["two fingers", "three", "cup"], p=[0.6, 0.2, 0.2]),
    )
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    if kind == "cup":
        radius = 10 ** rng.uniform(-2.3, -1.4)
        angle = 2 * np.pi * np.arange(16) / 16
        rim = radius * np.column_stack([np.cos(angle), np.sin(angle)]) @ across(axis)
        contacts = [ContactPatch(centre + rim, axis, 10 ** rng.uniform(0.5, 2.3), rng.uniform(0.1, 0.9), pulls=True)]
    else:
        count = 2 if kind == "two fingers" else 3
        u, v = across(axis)
        force = 10 ** rng.uniform(0.5, 2.3)
        contacts = []
        for k in range(count):
            angle = 2 * np.pi * k / count
            inwards = np.cos(angle) * u + np.sin(angle) * v
            at = centre - 10 ** rng.uniform(-2.3, -1.3) * inwards + rng.normal(0, 0.001, 3)
            contacts.append(replace(random_patch(rng, at, inwards, points), force=force))
    # The load of a body with an offset centre of mass that accelerates and rotates
    force = rng.standard_normal(3)
    arm = rng.normal(0, 0.03, 3)
    moment = np.cross(centre + arm, force) + rng.normal(0, 0.005, 3)
    return str(kind), contacts, np.concatenate([force, moment])


def grasp_rows(seed: int, count: int, points: int, name: str) -> list[Row]:
    """Compare the shares of random loads on random grasps with both linear programmes; loads are scaled to about 1."""
    arm = pp.load_robot("ur5").arm()
    rows: dict[str, Row] = {}
    rng = np.random.default_rng(seed)
    done = 0
    while done < count:
        kind, contacts, wrench = random_grasp(rng, points)
        try:
            limits = HoldLimits(arm, pp.Payload(1.0), contacts)
        except pp.InputError:  # resists next to nothing in some direction
            continue
        scale = np.exp(rng.normal(0, 0.1)) / limits.shares(wrench[None])[0]
        wrench *= scale
        done += 1
        share = float(limits.shares(wrench[None])[0])
        low, high = (share_by_pyramids(contacts, wrench, inside=inside) for inside in (False, True))
        row = rows.setdefault(
            kind, Row(grasp=kind, patch=name, count=0, holds=0, slipping=0, far=0, below=[], above=[])
        )
        row.count += 1
        row.holds += share <= 1.0
        row.slipping += share <= 1.0 < low
        row.far += share > 1.02 * high
        row.below.append(low / share - 1.0)
        row.above.append(share / high - 1.0)
    for row in rows.values():
        row.below, row.above = max(row.below), max(row.above)
    return [rows[kind] for kind in sorted(rows)]


# -- motions ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Carried:
    """A motion of an arm with a box in two fingers, whose pads (sides ``pad``) close along y of the tcp at ``tip``.

    ``payload`` is the mass of the box in its own frame.
    """

    arm: pp.Arm
    trajectory: pp.Trajectory
    size: np.ndarray
    tcp_from_part: SE3
    payload: pp.Payload
    tip: np.ndarray
    pad: np.ndarray
    force: float
    friction: float


def simulated(
    motion: Carried, *, faster: float = 1.0, slippery: float = 1.0, step: float = STEP
) -> tuple[float, float]:
    """How far a part moves (m) and turns (rad) in the hand while a motion is simulated, ``faster`` by a factor.

    The fingers are coupled, as those of a parallel gripper, and pressed with the stated force. The hand is so heavy
    that the part does not move it; its state is that of the motion at every step, and it accelerates as the motion.

    Its frame is between the pads: the simulator leaves out the change of the Jacobian in the acceleration of contacts.
    With pads at a lever r from the origin of the body of the hand, which rotates with w, this would be w x (w x r), and
    the part would creep with the velocity at which the damping of the contacts, 2 / solref, makes up for that.
    """
    mass, inertia, offset = motion.payload.mass, motion.payload.inertia, motion.payload.center_of_mass
    half, pad, gap = motion.size / 2, motion.pad / 2, motion.size[1] / 2
    friction = f'friction="{slippery * motion.friction} 0 0" condim="3" solref="0.004 1" solimp="0.98 0.999 0.0005"'
    fingers = "".join(
        f'<body name="finger{side}" pos="0 {side * (gap + pad[1])} 0">'
        f'<joint name="slide{side}" type="slide" axis="0 {-side} 0" damping="2"/>'
        f'<geom type="box" size="{" ".join(map(str, pad))}" mass="0.1" {friction}/></body>'
        for side in (1, -1)
    )
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="{step}" cone="elliptic" impratio="100" noslip_iterations="50"
 integrator="Euler" tolerance="1e-12" iterations="200"/>
<worldbody>
<body name="hand" gravcomp="1"><freejoint/>
<inertial pos="0 0 0" mass="{HEAVY}" diaginertia="{HEAVY} {HEAVY} {HEAVY}"/>{fingers}</body>
<body name="part"><freejoint/>
<inertial pos="{" ".join(map(str, offset))}" mass="{mass}" diaginertia="{" ".join(map(str, np.diag(inertia)))}"/>
<geom type="box" size="{" ".join(map(str, half))}" {friction}/></body>
</worldbody>
<equality><joint joint1="slide1" joint2="slide-1" solref="0.002 1"/></equality>
<actuator><motor joint="slide1" ctrlrange="0 1000"/><motor joint="slide-1" ctrlrange="0 1000"/></actuator>
</mujoco>""")
    data = mujoco.MjData(model)
    data.ctrl[:] = motion.force
    arm, trajectory = motion.arm, motion.trajectory
    times = np.arange(0.0, trajectory.duration / faster + step, step) * faster
    tip, hand_from_part = pp.pose(motion.tip), pp.pose(-motion.tip) * motion.tcp_from_part
    hands = [arm.root_from_frame(q, arm.tcp) * tip for q in trajectory(times.clip(0, trajectory.duration))]
    place = np.array([pose.translation for pose in hands])
    turn = np.array([pose.rotation for pose in hands])
    # The simulator moves bodies by the velocity at the end of each step
    velocity = np.diff(place, axis=0, prepend=place[:1]) / step
    spin = np.array([np.zeros(3), *(pin.log3(a.T @ b) for a, b in pairwise(turn))]) / step
    acceleration, growth = (np.diff(rates, axis=0, append=rates[-1:]) / step for rates in (velocity, spin))
    resting = np.zeros(int(SETTLE / step), dtype=int)
    start, moved, turned = None, 0.0, 0.0
    for count, index in enumerate(np.concatenate([resting, np.arange(len(times))])):
        # The motion of the hand, which its contacts do not change
        still = count < len(resting)
        data.qpos[:3], data.qpos[3:7] = place[index], quaternion_of(turn[index])
        data.qvel[:6] = 0.0 if still else np.concatenate([velocity[index], spin[index]])
        data.qfrc_applied[:6] = 0.0 if still else HEAVY * np.concatenate([acceleration[index], growth[index]])
        if count == 0:
            part = hands[0] * hand_from_part
            data.qpos[-7:-4], data.qpos[-4:] = part.translation, quaternion_of(part.rotation)
        mujoco.mj_step(model, data)
        # Where the part is in the hand
        hand, own = (
            SE3(pin.Quaternion(*state[3:]).normalized().matrix(), state[:3])
            for state in (data.qpos[:7].copy(), data.qpos[-7:].copy())
        )
        if count >= len(resting) - 1:
            start = start or hand.actInv(own)
            change = start.actInv(hand.actInv(own))
            moved = max(moved, float(np.linalg.norm(hand.actInv(own).translation - start.translation)))
            turned = max(turned, float(np.linalg.norm(pin.log3(change.rotation))))
    return moved, turned


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """The quaternion (4,) of a rotation, with the real part first."""
    return np.asarray(np.roll(pin.Quaternion(rotation).coeffs(), 1))


TIP, PAD = np.array([0.0, 0.0, 0.12]), np.array([0.02, 0.01, 0.024])
"""Centre of the pads in the frame of the tcp, and the sides of each pad (m)."""


def random_motions(seed: int, count: int) -> Iterator[tuple[Carried, float]]:
    """Motions of good picks of random boxes by an UR5 with the part in the hand, and the reserve of each pick.

    The force of the fingers is 1 to 2.5 times that which carries the weight of the box at its centre.
    """
    rng = np.random.default_rng(seed)
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    table = pp.Obstacle("table", pp.Box(1.6, 1.6, 0.04), pp.pose((0.3, 0, -0.025)))
    found = 0
    while found < count:
        size = np.array([rng.uniform(0.02, 0.08), rng.uniform(0.015, 0.05), rng.uniform(0.03, 0.1)])
        mass, friction = 10 ** rng.uniform(-1.0, 0.2), rng.uniform(0.3, 0.8)
        force = rng.uniform(1.0, 2.5) * mass * 9.81 / (2 * friction)
        inertia = mass / 12 * (np.sum(size**2) - size**2)
        payload = pp.Payload(mass, rng.uniform(-0.2, 0.2, 3) * size, inertia)
        angles, distance = rng.uniform(-2.5, 2.5, 2), rng.uniform(0.35, 0.6, 2)
        here, there = (
            (r * np.cos(a), r * np.sin(a), size[2] / 2 + rise)
            for r, a, rise in zip(distance, angles, (0.0, rng.uniform(0.0, 0.3)), strict=True)
        )
        turns = rng.uniform(-np.pi, np.pi, 2)
        box = pp.Obstacle("part", pp.Box(*size), pp.pose(here, (0, 0, turns[0])))
        down = [pp.pose(at, (np.pi, 0, turn)) for at, turn in zip((here, there), turns, strict=True)]
        low = pp.pose((0, 0, max(0.5 * size[2] - PAD[2] / 2, 0.0)))  # the pads are at the top of the box
        grasp, release = (SE3(pose.rotation, pose.translation + low.translation) for pose in down)
        pads = tuple(
            pp.Obstacle(f"finger_{name}", pp.Box(*PAD), pp.pose((0, side * PAD[1] / 2, TIP[2])))
            for name, side in (("left", 1), ("right", -1))
        )
        place = PlaceTarget(release, approach=0.05, retreat=0.05)
        picks = Picks(
            (Pick("part", grasp, 0.05, 0.05, carried="part", payload=payload, place=place),),
            tip=pp.pose(TIP), fingers=GripperFingers(pads, size[1] + 0.02, size[1]),
            grip_limits=GripLimits(force=force, friction=friction, hold=True),
        )  # fmt: skip
        scene = pp.Scene([table, box], allowed=[("base_link", "table")])
        (verdict,) = pp.validate_picks(arm, scene, picks, budget=PickBudget(compared=1, remedies=0, motion=40)).verdicts
        if not verdict.ok:
            continue
        found += 1
        carried = [part.trajectory for part in verdict.motions if part.name in ("retreat", "transfer", "place")]
        reserve = next(stage.figures["reserve"] for stage in verdict.stages if stage.stage.value == "hold")
        tcp_from_part = pp.pose(TIP) * grasp.actInv(box.pose)
        motion = pp.Trajectory.join(*carried)
        yield Carried(arm, motion, size, tcp_from_part, payload, TIP, PAD, force, friction), reserve


def motion_rows(seed: int, count: int) -> list[Row]:
    """Simulate motions as certified, and as a control with twice the accelerations and with half of the friction."""
    changes = {
        "as certified": {},
        "twice the acceleration": {"faster": 2**0.5},
        "half of the friction": {"slippery": 0.5},
    }
    rows = {name: Row(motion=name, count=0, stay=0, near=0, near_stay=0, moved=[], turned=[]) for name in changes}
    for motion, reserve in random_motions(seed, count):
        for name, change in changes.items():
            moved, turned = simulated(motion, **change)
            row, stays = rows[name], bool(moved <= MOVED and turned <= TURNED)
            row.count, row.stay = row.count + 1, row.stay + stays
            if reserve < NEAR:
                row.near, row.near_stay = row.near + 1, row.near_stay + stays
            row.moved.append(moved)
            row.turned.append(turned)
    for row in rows.values():
        for name in ("moved", "turned"):
            values = getattr(row, name)
            setattr(row, name, {"median": float(np.median(values)), "largest": float(np.max(values))})
    return list(rows.values())


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    grasps = {
        "grasp": "{.grasp}",
        "patches": "{.patch}",
        "grasps": "{.count:,}",
        "hold": "{.holds:,}",
        "slip although they hold": "{.slipping}",
        "off by > 2 %": "{.far}",
        "largest excess": lambda row: f"{100 * row.above:.2f} %",
        "largest deficit": lambda row: f"{100 * row.below:.2f} %",
    }
    motions = {
        "simulated": "{.motion}",
        "motions": "{.count}",
        "stay": "{.stay}",
        "reserve below 10 %": "{.near}",
        "of these stay": "{.near_stay}",
        "median (mm)": lambda row: f"{1e3 * row.moved['median']:.2f}",
        "largest (mm)": lambda row: f"{1e3 * row.moved['largest']:.2f}",
        "largest (deg)": lambda row: f"{np.rad2deg(row.turned['largest']):.2f}",
    }
    return {
        "grasps": row_table(grasps, results["grasps"], text_columns=2),
        "motions": row_table(motions, results["motions"]),
    }


def run(options: Any) -> Results:
    """Both campaigns."""
    origin = provenance(options.seed)
    grasps = [
        *grasp_rows(options.seed, options.grasps, 8, "8 points"),
        *grasp_rows(options.seed, options.grasps // 100, 150, "150 points"),
    ]
    parts = {"grasps": grasps, "motions": motion_rows(options.seed, options.motions)}
    return Results({"grasps": options.grasps, "motions": options.motions}, origin, parts)


BENCHMARK = Benchmark("holding", run, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "holding")
    parser.add_argument("--grasps", type=int, default=GRASPS, help="number of random grasps")
    parser.add_argument("--motions", type=int, default=MOTIONS, help="number of simulated motions")
    BENCHMARK.run(parser)
