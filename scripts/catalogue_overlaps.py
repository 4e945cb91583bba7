"""Which pairs of links overlap in every configuration: src/pinproof/description/catalogue_overlaps.yaml.

Collision models are often made larger than the robot. Two links that overlap however every joint of the robot is set
can tell nothing about a configuration; without leaving them out, no configuration would be free. A pair that is free in
one single sample is kept.

    python scripts/catalogue_overlaps.py NAME ...     prints the pairs as that file has them
"""

from __future__ import annotations

import argparse

import numpy as np

import pinproof as pp
from pinproof.description import find_robot

HELD_SAMPLES = 25
"""Ways of setting the joints outside the arm."""

ARM_SAMPLES = 40
"""Configurations of the arm for each."""


def overlaps(name: str, seed: int = 0) -> set[tuple[str, str]]:
    """The pairs of links of a catalogue robot in contact in every sample, of all its joints."""
    rng = np.random.default_rng(seed)
    entry = find_robot(name)
    robot = pp.load_robot(entry.urdf, srdf=entry.srdf)  # by its files: without the overlaps that are known already
    moving = [j for j in robot.urdf.joints.values() if j.type in ("revolute", "prismatic") and j.mimic is None]
    own = robot.arm(entry.tcp, base=entry.base).joint_names
    always: set[tuple[str, str]] | None = None
    for _ in range(HELD_SAMPLES):
        held = {j.name: rng.uniform(j.lower, j.upper) for j in moving if j.name not in own and j.lower is not None}
        arm = robot.arm(entry.tcp, base=entry.base, held=held)
        checker = pp.CollisionChecker(arm)
        for q in rng.uniform(*arm.limits.sampling_range(), size=(ARM_SAMPLES, arm.dof)):
            touching = {tuple(sorted(contact.bodies)) for contact in checker.check(q).contacts}
            always = touching if always is None else always & touching
    return always or set()


def main() -> None:
    """Print the pairs of each robot that is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+")
    for name in parser.parse_args().names:
        print(f"{find_robot(name).urdf.as_posix().rpartition('/example-robot-data/robots/')[2]}:")
        for first, second in sorted(overlaps(name)):
            print(f"  - [{first}, {second}]")


if __name__ == "__main__":
    main()
