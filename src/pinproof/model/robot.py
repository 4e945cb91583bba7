"""A robot that moves: its description and its Pinocchio model, from which arms are taken."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinproof.description import CatalogueEntry, Srdf, Urdf, find_robot, read_description, read_srdf, read_urdf_text
from pinproof.description.sources import notes
from pinproof.description.srdf import DisabledPair
from pinproof.errors import FileError, InputError, UnknownNameError, UrdfError
from pinproof.model.arm import Arm
from pinproof.model.chain import find_chain, group_ends, held_values, link_path
from pinproof.model.limits import JointLimits, LimitsFile

if TYPE_CHECKING:
    from pinproof.model.info import RobotInfo

__all__ = ["Robot", "load_robot", "load_robot_from_text"]

DH_FRAME = re.compile(r"dh_\d+")
SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf")


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
    default_base
        The link meant as base when :meth:`arm` names none and the tcp hangs on it.
    """

    urdf: Urdf
    srdf: Srdf
    model: Any
    default_tcp: str | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    default_base: str | None = None

    @property
    def size(self) -> float:
        """Metres: the largest length of a line of joints and links from the root to a link.

        How far the robot reaches when it is stretched, without the travel of joints that slide.
        """
        model = self.model
        reach = np.zeros(model.njoints)
        for joint in range(1, model.njoints):
            step = np.linalg.norm(model.jointPlacements[joint].translation)
            reach[joint] = reach[model.parents[joint]] + step
        return float(max(reach[f.parentJoint] + np.linalg.norm(f.placement.translation) for f in model.frames))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the description, in sentences: meshes not found, names in the SRDF that do not exist."""
        return notes(self.urdf, self.srdf)

    @property
    def name(self) -> str:
        """The robot's name in its URDF."""
        return self.urdf.name

    def info(self, arm: Arm | None = None) -> RobotInfo:
        """The properties of the robot and of one of its arms, by default of :meth:`arm` without arguments.

        Raises
        ------
        InputError
            If no arm is given and the robot declares no tcp.
        """
        from pinproof.model.info import robot_info

        return robot_info(self, self.arm() if arm is None else arm)

    def arm(
        self,
        tcp: str | None = None,
        *,
        base: str | None = None,
        group: str | None = None,
        limits: JointLimits | LimitsFile | Mapping[str, tuple[float, float]] | None = None,
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
            catalogue's where the tcp hangs on it, else the root.
        group
            A group of the SRDF, which names base and tcp.
        limits
            New limits of all joints, those of a file (:meth:`JointLimits.load`), or new (lower, upper) by joint name,
            to tighten or extend those of the URDF.
        held
            Values (rad or m) of joints outside the arm; by default those of :attr:`home`, else 0 or the bound nearest
            to it. A floating or planar joint stands at its neutral place.

        Raises
        ------
        UnknownNameError
            For a frame, group or joint that does not exist; names those that do.
        InputError
            If no tcp is declared and more than one is possible, or a joint of the chain has no limits.
        """
        if group is not None:
            group_base, group_tcp = group_ends(self.urdf, self.srdf, group)
            base, tcp = base or group_base, tcp or group_tcp
        tcp = tcp or self._declared_tcp()
        self._known_frame(tcp)
        base = base or self._base_of(tcp)
        self._known_frame(base)
        chain = find_chain(self.urdf, base, tcp)
        if isinstance(limits, JointLimits):
            if len(limits) != len(chain.joint_names):
                raise InputError(
                    f"limits hold {len(limits)} joints; the arm has {len(chain.joint_names)}: {chain.joint_names}"
                )
            new_limits = limits
        else:
            if isinstance(limits, LimitsFile):
                new_limits = limits.over(chain.limits, chain.joint_names, list(self.urdf.joints))
                told: Mapping[str, tuple[float, float]] = limits.position
            else:
                told = limits or {}
                new_limits = chain.limits.replace(chain.joint_names, told)
            for name in chain.joint_names:
                joint = self.urdf.joints[name]
                if joint.type != "continuous" and (joint.lower is None or joint.upper is None) and name not in told:
                    raise InputError(
                        f"{joint.type} joint {name!r} states no lower and upper limit; "
                        f"pass limits={{{name!r}: (lower, upper)}}"
                    )
        return Arm(self, base, tcp, chain, new_limits, held_values(self.urdf, chain, held or {}, self.home))

    def state(self, name: str, *, group: str | None = None) -> dict[str, float]:
        """A named state of the SRDF, joint name to rad or m; of all groups that have one of that name, or of one group.

        Joints of the state that the robot does not have are left out (:attr:`notes` names them), and so is a virtual
        joint that places the robot in the world.

        Raises
        ------
        UnknownNameError
            If there is no such state; names those that exist.
        InputError
            If groups give one joint different values under this name, or a joint several numbers.
        """
        found = [s for s in self.srdf.states if s.name == name and group in (None, s.group)]
        if not found:
            names = {s.name for s in self.srdf.states if group in (None, s.group)}
            raise UnknownNameError("state", name, names, f"the SRDF of robot {self.name!r}")
        values: dict[str, float] = {}
        for state in found:
            for joint, numbers in state.joints.items():
                if joint not in self.urdf.joints:
                    continue
                if len(numbers) != 1:
                    raise InputError(
                        f"state {name!r} gives joint {joint!r} {len(numbers)} numbers; an arm joint has one"
                    )
                if values.setdefault(joint, numbers[0]) != numbers[0]:
                    raise InputError(f"state {name!r} gives joint {joint!r} different values; name its group=")
        return values

    def _known_frame(self, name: str) -> None:
        if name not in self.urdf.links:
            raise UnknownNameError("frame", name, self.urdf.links, f"robot {self.name!r}")

    def _base_of(self, tcp: str) -> str:
        if self.default_base is not None and self.default_base != tcp:
            try:
                link_path(self.urdf, self.default_base, tcp)
            except InputError:
                return self.urdf.root
            return self.default_base
        return self.urdf.root

    def _declared_tcp(self) -> str:
        if self.default_tcp is not None:
            return self.default_tcp
        declared = sorted({effector.parent_link for effector in self.srdf.end_effectors})
        if len(declared) == 1:
            return declared[0]
        parents = {joint.parent for joint in self.urdf.joints.values()}
        leaves = [link for link in self.urdf.links if link not in parents]
        # The frames of a DH table, as our own URDFs bear them, mark places; what else hangs there is the tool.
        leaves = [link for link in leaves if not DH_FRAME.fullmatch(link)] or leaves
        if not declared and len(leaves) == 1:
            joint = self.urdf.parent_joint(leaves[0])
            if joint is not None and joint.type == "fixed":
                return leaves[0]
        raise InputError(
            f"robot {self.name!r} declares no single tcp; name one with tcp=. "
            f"Candidates: {', '.join(declared or leaves)}"
        )


def load_robot(
    source: str | Path,
    *,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> Robot:
    """A robot by catalogue name or from a URDF, xacro or MJCF file.

    Parameters
    ----------
    source
        A name such as ``"ur5"``, or a path that ends in ``.urdf``, ``.xacro``, ``.xml`` or ``.mjcf``.
    srdf
        An SRDF file; by default the catalogue's, for a path none.
    package_dirs
        Folders searched first for ``package://`` meshes and for ``$(find ...)`` in xacro.
    xacro_args
        What a xacro file is told for its ``<xacro:arg>``.

    Raises
    ------
    UnknownNameError
        For a name that is not in the catalogue.
    UrdfError
        For a file that cannot be used, with its line.
    FileError
        For one of ``package_dirs`` that is no folder.
    InputError
        For a xacro file where the extra ``xacro`` is not installed.
    """
    entry: CatalogueEntry | None = None
    if isinstance(source, str) and not source.endswith(SUFFIXES) and "/" not in source:
        entry = find_robot(source)
        source, srdf = entry.urdf, srdf or entry.srdf
    path = Path(source)
    if path.suffix not in SUFFIXES:
        raise UrdfError(path, f"is not a robot description: its name must end in one of {', '.join(SUFFIXES)}")
    for folder in package_dirs:
        if not Path(folder).is_dir():
            raise FileError(folder, "is no folder; package_dirs holds folders with ROS packages in them")
    urdf, words = read_description(path, package_dirs=package_dirs, xacro_args=xacro_args)
    if srdf is not None:
        words = read_srdf(srdf)
    if entry is not None:
        overlaps = tuple(DisabledPair(pair, "overlaps in every sampled configuration") for pair in entry.overlaps)
        words = replace(words, disabled=(*words.disabled, *overlaps))
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
    return Robot(urdf, srdf, model, entry.tcp, entry.home, entry.base)
