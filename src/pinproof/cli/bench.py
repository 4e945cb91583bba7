"""``pinproof bench``: the textbook's table of IK methods for any arm, measured on this machine."""

from __future__ import annotations

from dataclasses import asdict

from pinproof.cli.console import print_result, progress_status
from pinproof.cli.options import ChainOptions, Json, Robot, Seed, option


def bench(
    robot: Robot,
    points: int = option("Number of random poses.", 10_000, min=1),
    methods: str | None = option(
        'Methods to run, for example "clik pseudo_inverse". Default: all.', None, metavar="METHODS"
    ),
    *,
    chain: ChainOptions,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compare the IK methods on random poses of an arm: time, success rate, largest error.

    Every answer is checked by forward kinematics and the limits. The textbook's figures are beside those measured.

    Example: pinproof bench ur5 --points 200
    """
    from pinproof.ik.bench import bench
    from pinproof.ik.methods import IK_METHODS

    arm = chain.arm(robot)
    selected = tuple(IK_METHODS) if methods is None else methods.replace(",", " ").split()
    with progress_status("running the IK benchmark") as report:
        rows, left_out = bench(arm, points=points, methods=selected, rng=seed, on_progress=report)
    lines = ["| method | task | restarts | mean, ms | median, ms | success | false positives | largest error |"]
    lines[0] += " textbook |"
    lines += ["|---" * 9 + "|"]
    for row in rows:
        solved = f"{100 * row.success:.2f} % within {row.tolerance:g}"
        error = f"{row.position_error:.1e} m" + (f", {row.orientation_error:.1e} rad" if row.task == "pose" else "")
        textbook = "" if row.textbook_ms is None else f"{row.textbook_ms:g} ms, {100 * (row.textbook_success or 0):g} %"
        times = f"{row.mean_ms:.4f} | {row.median_ms:.4f}"
        cells = (row.method, row.task, row.restarts, times, solved, row.false_positives, error, textbook)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [f"not applicable: {name}: {reason}" for name, reason in left_out.items()]
    data = {"robot": arm.robot.name, "points": points, "seed": seed, "rows": [asdict(row) for row in rows]}
    print_result({**data, "left_out": left_out}, lines, as_json=as_json)
