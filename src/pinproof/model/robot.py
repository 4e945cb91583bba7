"""A robot that moves: its description and its Pinocchio model, from which arms are taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pinocchio as pin

from pinproof.description import CatalogueEntry, Srdf, Urdf, find_robot, read_srdf, read_urdf, read_urdf_text
from pinproof.errors import InputError, UnknownNameError, UrdfError
from pinproof.model.arm import Arm
from pinproof.model.chain import find_chain, held_values
from pinproof.model.limits import JointLimits

__all__ = ["Robot", "load_robot", "load_robot_from_text"]

URDF_SUFFIXES = (".urdf", ".xml")


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as described, with its kinematic model.

    Parameters
    ----------
    urdf, srdf
        The description.
    model
        The :class:`pinocchio.Model` of all its joints: continuous joints are one angle, mimic followers free (an
        :class:`Arm` ties them to their leaders).
    default_tcp
        The frame meant when :meth:`arm` names none.
    home
        A comfortable configuration, joint name to rad or m; may be empty.
    """

    urdf: Urdf
    srdf: Srdf
    model: Any
    default_tcp: str | None = None
    home: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The robot's name in its URDF."""
        return self.urdf.name

    def arm(
        self,
        tcp: str | None = None,
        *,
        base: str | None = None,
        group: str | None = None,
        limits: JointLimits | Mapping[str, tuple[float, float]] | None = None,
        held: Mapping[str, float] | None = None,
    ) -> Arm:
        """The chain from a base link to a tcp frame.

        Parameters
        ----------
        tcp
            A link of the robot. Without it: the one the group, the catalogue or the SRDF declares, or the only leaf
            when that hangs on a fixed joint.
        base
            A link between the root and the tcp; poses of the tcp are given in it. By default the group's, else the
            root.
        group
            A group of the SRDF, which names base and tcp.
        limits
            New limits of all joints, or new (lower, upper) by joint name, to tighten or extend those of the URDF.
        held
            Values (rad or m) of joints outside the arm; by default 0, or the bound nearest to it.

        Raises
        ------
        UnknownNameError
            For a frame, group or joint that does not exist; names those that do.
        InputError
            If no tcp is declared and more than one is possible, or a joint of the chain has no limits.
        """
        if group is not None:
            group_base, group_tcp = self._group_ends(group)
            base, tcp = base or group_base, tcp or group_tcp
        base, tcp = base or self.urdf.root, tcp or self._declared_tcp()
        for name in (base, tcp):
            if name not in self.urdf.links:
                raise UnknownNameError("frame", name, self.urdf.links, f"robot {self.name!r}")
        chain = find_chain(self.urdf, base, tcp)
        if isinstance(limits, JointLimits):
            if len(limits) != len(chain.joint_names):
                raise InputError(
                    f"limits hold {len(limits)} joints; the arm has {len(chain.joint_names)}: {chain.joint_names}"
                )
            new_limits = limits
        else:
            new_limits = chain.limits.replace(chain.joint_names, limits or {})
            told = limits or {}
            for name in chain.joint_names:
                joint = self.urdf.joints[name]
                if joint.type != "continuous" and (joint.lower is None or joint.upper is None) and name not in told:
                    raise InputError(
                        f"{joint.type} joint {name!r} states no lower and upper limit; "
                        f"pass limits={{{name!r}: (lower, upper)}}"
                    )
        return Arm(self, base, tcp, chain, new_limits, held_values(self.urdf, chain, held or {}))

    def _group_ends(self, name: str) -> tuple[str | None, str]:
        """Base and tcp link of an SRDF group; an end effector declared for the group wins over the chain's tip."""
        group = self.srdf.groups.get(name)
        if group is None:
            raise UnknownNameError("group", name, self.srdf.groups, f"the SRDF of robot {self.name!r}")
        declared = next((e.parent_link for e in self.srdf.end_effectors if e.group == name), None)
        if group.chain is not None:
            return group.chain[0], declared or group.chain[1]
        unknown = [j for j in group.joints if j not in self.urdf.joints]
        if unknown:
            raise UnknownNameError("joint", unknown[0], self.urdf.joints, f"group {name!r}")
        if not group.joints:
            raise InputError(f"group {name!r} names neither a chain nor joints; give tcp=")
        return self.urdf.joints[group.joints[0]].parent, declared or self.urdf.joints[group.joints[-1]].child

    def _declared_tcp(self) -> str:
        if self.default_tcp is not None:
            return self.default_tcp
        declared = sorted({effector.parent_link for effector in self.srdf.end_effectors})
        if len(declared) == 1:
            return declared[0]
        parents = {joint.parent for joint in self.urdf.joints.values()}
        leaves = [link for link in self.urdf.links if link not in parents]
        if not declared and len(leaves) == 1:
            joint = self.urdf.parent_joint(leaves[0])
            if joint is not None and joint.type == "fixed":
                return leaves[0]
        raise InputError(
            f"robot {self.name!r} declares no single tcp; name one with tcp=. "
            f"Candidates: {', '.join(declared or leaves)}"
        )


def load_robot(source: str | Path, *, srdf: str | Path | None = None, package_dirs: Sequence[str | Path] = ()) -> Robot:
    """A robot by catalogue name or from a URDF file.

    Parameters
    ----------
    source
        A name such as ``"ur5"``, or a path that ends in ``.urdf``.
    srdf
        An SRDF file; by default the catalogue's, for a path none.
    package_dirs
        Folders searched first for ``package://`` meshes.

    Raises
    ------
    UnknownNameError
        For a name that is not in the catalogue.
    UrdfError
        For a file that cannot be used, with its line.
    """
    entry: CatalogueEntry | None = None
    if isinstance(source, str) and not source.endswith(URDF_SUFFIXES) and "/" not in source:
        entry = find_robot(source)
        source, srdf = entry.urdf, srdf or entry.srdf
    path = Path(source)
    if path.suffix not in URDF_SUFFIXES:
        raise UrdfError(path, f"is not a robot description: its name must end in one of {', '.join(URDF_SUFFIXES)}")
    urdf = read_urdf(path, package_dirs=package_dirs)
    words = Srdf() if srdf is None else read_srdf(srdf)
    return _robot(urdf, words, entry)


def load_robot_from_text(text: str, *, name: str = "URDF text", package_dirs: Sequence[str | Path] = ()) -> Robot:
    """A robot from URDF text; ``name`` stands for the file in errors."""
    return _robot(read_urdf_text(text, name=name, package_dirs=package_dirs), Srdf(), None)


def _robot(urdf: Urdf, srdf: Srdf, entry: CatalogueEntry | None) -> Robot:
    try:
        model = pin.buildModelFromXML(urdf.kinematics)
    except (ValueError, RuntimeError) as error:
        raise UrdfError(urdf.path or urdf.name, f"Pinocchio refuses it: {error}") from error
    missing = [name for name in urdf.links if not model.existFrame(name, pin.FrameType.BODY)]
    if missing:
        raise UrdfError(urdf.path or urdf.name, f"Pinocchio dropped the links {missing}")
    if entry is None:
        return Robot(urdf, srdf, model)
    return Robot(urdf, srdf, model, entry.tcp, entry.home)
