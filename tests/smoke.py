"""The installed package works: its core, and the robots of its wheel. cibuildwheel runs this on each wheel."""

from __future__ import annotations

import pathlib
import sys

import pinproof as pp
from pinproof.description import catalogue_names

assert pathlib.Path(pp.__file__).is_relative_to(sys.prefix), pp.__file__
arm = pp.load_robot("ur5").arm(tcp="tool0")
q = [0.3, -1.2, 1.4, -0.5, 0.7, 0.2]
found = pp.Clik().solve(arm, arm.forward_kinematics(q), rng=0).or_raise()
assert found.position_error < 1e-5, found
for name in catalogue_names():  # some from the folder robots/ of the wheel
    assert pp.load_robot(name).arm().dof >= 2, name
sys.stdout.write(f"{pp.__version__}\n")
