"""Certificates of random edges in random scenes, and an independent check of every verdict.

FREE is checked at dense samples by Pinocchio and coal: the distances on the convex hulls of the links must not be below
the proven clearance, and the exact meshes must not collide (:func:`pinproof.collision.checking.audit`). COLLIDING must
name a configuration at which coal finds a distance not larger than the margin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import process_time

import numpy as np
import numpy.typing as npt

from benchmarks.plain_coal import PlainCoal
from benchmarks.planning_problems import own_reach
from benchmarks.tables import Row, report, row_table
from pinproof.collision import (
    Box,
    Capsule,
    Certificate,
    CertificateStatus,
    CollisionChecker,
    Cone,
    ConvexShape,
    Cylinder,
    Ellipsoid,
    Obstacle,
    Scene,
    Shape,
    Sphere,
    audit,
    certify,
)
from pinproof.model import JointGroup, load_robot
from pinproof.motion import JointPath
from pinproof.spatial import SE3, pose

Array = npt.NDArray[np.float64]

ROBOTS = ("ur5", "panda", "generic_6dof", "xarm7", "stanford")

EDGES_PER_SCENE = 12

MOST_OBSTACLES = 8
"""Largest number of obstacles in a random scene."""

SMALLEST, LARGEST = 0.002, 0.3
"""Dimensions of random obstacles in m, distributed log-uniformly."""

NEAR, FAR = 0.25, 0.8
"""Smallest and largest distance of obstacles from the base axis, as shares of the reach."""

MARGINS = (0.0, 0.0, 0.003, 0.02)
"""Margins in m, one of which is drawn for each scene."""

EDGE_LENGTHS = (0.05, 0.3, 1.0)
"""Standard deviations in rad or m of the joint motions along an edge, one of which is drawn for each edge."""

TRIES = 8
"""Random configurations among which an edge selects a free start, if there is one."""

TOLERANCE = 1e-4
"""Tolerance of the certificates in m."""

SAMPLES = 60
"""Samples per edge at which distances are measured."""

AUDIT_STEP = 0.01
"""Largest joint motion in rad or m between samples at which the exact meshes are checked."""

DISTANCE_ERROR = 3e-6
"""Largest error in m of coal's distances."""


def distributed(edges: int, robots: Sequence[str]) -> dict[str, int]:
    """Return the number of edges of each robot that has some, as equal as possible."""
    each, rest = divmod(edges, len(robots))
    counts = {robot: each + (i < rest) for i, robot in enumerate(robots)}
    return {robot: count for robot, count in counts.items() if count}


def edge_rows(edges: int, seed: int) -> list[Row]:
    """Check this number of edges, distributed over :data:`ROBOTS`."""
    return [check_edges(robot, count, seed) for robot, count in distributed(edges, ROBOTS).items()]


def check_edges(
    robot: str,
    edges: int,
    seed: int = 0,
    *,
    checkers: tuple[CollisionChecker, CollisionChecker] | None = None,
    reach: float | None = None,
    samples: int = SAMPLES,
    step: float = AUDIT_STEP,
) -> Row:
    """Certify random edges of a robot and check the verdicts; each scene depends only on the seed and its number.

    ``robot`` is a name of the catalogue, or that of the joint group of ``checkers``, which have no obstacles and check
    hulls and exact meshes. Obstacles are placed within ``reach`` (m) of the root. ``samples`` and ``step`` are as
    :data:`SAMPLES` and :data:`AUDIT_STEP`.
    """
    if checkers is None:
        arm = load_robot(robot).arm()
        checkers = CollisionChecker(arm), CollisionChecker(arm, link_meshes="surface")
    hulls, exact = checkers
    reach = own_reach(hulls.arm) if reach is None else reach

    def edges_of_scene(rng: np.random.Generator) -> EdgeCase:
        scene, margin = random_scene(rng, reach), float(rng.choice(MARGINS))
        checker, mesh_checker = hulls.with_scene(scene).with_margin(margin), exact.with_scene(scene)

        def case() -> tuple[Certificate, float, int, str]:
            path = random_edge(checker, rng)
            begin = process_time()
            certificate = certify(path, checker, tolerance=TOLERANCE)
            seconds = process_time() - begin
            return (
                certificate,
                seconds,
                *check_verdict(path, certificate, checker, mesh_checker, samples=samples, step=step),
            )

        return case

    return count_verdicts(robot, edges, (seed,), edges_of_scene)


EdgeCase = Callable[[], tuple[Certificate, float, int, str]]
"""Certifies another edge of a scene: the certificate, its processor time (s), the number of configurations at which it
was checked, and how they contradict it."""


def count_verdicts(
    name: str,
    edges: int,
    seeds: tuple[int, ...],
    edges_of_scene: Callable[[np.random.Generator], EdgeCase],
) -> Row:
    """Certify this number of edges, a few in each scene; each scene depends only on the seeds and its number."""
    counts = dict.fromkeys(CertificateStatus, 0)
    wrong: list[str] = []
    checked, seconds, scenes = 0, 0.0, -(-edges // EDGES_PER_SCENE)
    for number in range(scenes):
        case = edges_of_scene(np.random.default_rng([*seeds, number]))
        for edge in range(min(EDGES_PER_SCENE, edges - number * EDGES_PER_SCENE)):
            certificate, duration, count, error = case()
            seconds, checked = seconds + duration, checked + count
            counts[certificate.status] += 1
            if error:
                wrong.append(f"{name}, seed {seeds[0]}, scene {number}, edge {edge}: {error}")
        if number % 10 == 9:
            report(f"{name}: {min((number + 1) * EDGES_PER_SCENE, edges)} of {edges} edges, {len(wrong)} wrong")
    return Row(
        robot=name,
        scenes=scenes,
        edges=edges,
        free=counts[CertificateStatus.FREE],
        colliding=counts[CertificateStatus.COLLIDING],
        undecided=counts[CertificateStatus.UNDECIDED],
        checked=checked,
        mean_ms=1e3 * seconds / max(edges, 1),
        wrong=wrong,
    )


def edge_table(name: str, rows: Sequence[Row]) -> list[str]:
    """Return the lines of a table of edges; ``name`` is the title of the first column."""
    columns = {
        name: "{.robot}",
        "edges": "{.edges:,}",
        "FREE": "{.free:,}",
        "COLLIDING": "{.colliding:,}",
        "UNDECIDED": "{.undecided:,}",
        "configurations checked": "{.checked:,}",
        "mean, ms": "{.mean_ms:.2f}",
        "wrong": lambda row: str(len(row.wrong)),
    }
    return row_table(columns, rows)


def total_row(rows: Sequence[Row]) -> Row:
    """Return the row of all edges."""
    counts = ("scenes", "edges", "free", "colliding", "undecided", "checked")
    sums = {each: sum(getattr(row, each) for row in rows) for each in counts}
    mean = sum(row.edges * row.mean_ms for row in rows) / max(sums["edges"], 1)
    return Row(robot="all", **sums, mean_ms=mean, wrong=[text for row in rows for text in row.wrong])


def check_verdict(
    path: JointPath,
    certificate: Certificate,
    checker: CollisionChecker,
    mesh_checker: CollisionChecker,
    *,
    samples: int = SAMPLES,
    step: float = AUDIT_STEP,
) -> tuple[int, str]:
    """Return the number of configurations checked, and how they contradict the verdict (empty if they do not).

    ``checker`` is the one of the certificate; ``mesh_checker`` has the same arm and scene, and exact meshes.
    """
    if certificate.status is CertificateStatus.UNDECIDED:
        return 0, ""
    contact = certificate.first_contact
    if certificate.status is CertificateStatus.COLLIDING:
        no_contact = contact is None or contact.distance > checker.margin
        distance = np.inf if no_contact else _smallest_distance(checker, contact.q[None])
        return 1, contradiction(certificate, checker.margin, distance)
    distance = _smallest_distance(checker, path(np.linspace(*path.domain, samples)))
    if error := contradiction(certificate, checker.margin, distance):
        return samples, error
    result = audit(path, mesh_checker, step=step, measure=False)
    return samples + result.samples, "" if result.clean else f"FREE, but on exact meshes {result.message}"


def contradiction(certificate: Certificate, margin: float, distance: float) -> str:
    """Return how a distance (m), at the contact or the smallest along the edge, contradicts a verdict; empty if not."""
    if certificate.status is CertificateStatus.COLLIDING and distance > margin + DISTANCE_ERROR:
        return f"COLLIDING, but the distance at the contact is {distance:.6g} m (margin {margin:g} m)"
    if certificate.free and distance < max(margin, certificate.clearance) - DISTANCE_ERROR:
        return f"FREE with a proven clearance of {certificate.clearance:.6g} m, but {distance:.6g} m measured"
    return ""


def _smallest_distance(checker: CollisionChecker, configurations: Array) -> float:
    """The smallest distance (m) over all pairs and configurations (N, n), by Pinocchio and coal."""
    plain = PlainCoal(checker)
    return min(map(plain.clearance, plain.configurations(configurations)))


def random_scene(rng: np.random.Generator, reach: float) -> Scene:
    """Return one to eight obstacles of any convex shape at random poses around an arm with this reach (m)."""
    obstacles = []
    for i in range(int(rng.integers(1, MOST_OBSTACLES + 1))):
        position = rng.uniform(-FAR, FAR, 3) * reach
        position[2] = abs(position[2])
        if np.hypot(position[0], position[1]) < NEAR * reach:
            position[0] += 2 * NEAR * reach
        obstacles.append(Obstacle(f"thing_{i}", _random_shape(rng), random_orientation(position, rng)))
    return Scene(obstacles)


def random_orientation(position: Array, rng: np.random.Generator) -> SE3:
    """Return a pose at a position with random roll, pitch and yaw."""
    return pose(position.tolist(), rng.uniform(-np.pi, np.pi, 3).tolist())


def _random_shape(rng: np.random.Generator) -> Shape:
    a, b, c = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST), 3)).tolist()
    return (
        lambda: Box(a, b, c),
        lambda: Sphere(a),
        lambda: Cylinder(a, b),
        lambda: Capsule(a / 2, b),
        lambda: Cone(a, b),
        lambda: Ellipsoid(a, b, c),
        lambda: ConvexShape(rng.normal(size=(8, 3)) * LARGEST / 3),
    )[int(rng.integers(7))]()


def random_configurations(arm: JointGroup, count: int, rng: np.random.Generator) -> Array:
    """Return configurations (N, n) drawn uniformly within the limits (+-pi for a joint without limits)."""
    lower, upper = arm.limits.sampling_range()
    return rng.uniform(lower, upper, (count, arm.dof))


def random_edge(checker: CollisionChecker, rng: np.random.Generator) -> JointPath:
    """Return a straight edge within the limits that starts, if possible, at a free configuration."""
    arm = checker.group
    tried = random_configurations(arm, TRIES, rng)
    free = np.flatnonzero(checker.is_free_batch(tried))
    start = tried[free[0] if len(free) else 0]
    end = arm.limits.clip(start + rng.normal(size=arm.dof) * rng.choice(EDGE_LENGTHS))
    return JointPath(np.stack([start, end]), arm.joint_names)
