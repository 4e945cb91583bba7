"""Bodies that the arm carries at its tcp, and their files.

::

    attached:                              # bodies that move with the tcp; poses are tcp_from_body
      - {name: picker, cylinder: {radius: 0.02, length: 0.1}, xyz: [0, 0, 0.05]}
      - {name: part, mesh: {path: part.stl, scale: 0.001}, xyz: [0, 0, 0.12], rpy: [0, 0, pi/2]}
    allowed_contacts:                      # optional: pairs of bodies that are meant to touch
      - [picker, part]
    held: {rail: 0.5}                      # optional: joints outside the arm, rad or m
    tip: {xyz: [0, 0, 0.105]}              # optional: tcp_from_tip, the point of the tool that is put onto a target

Each body is stated as an obstacle of a scene is (:mod:`pinproof.collision.scene_file`). Unknown keys are refused with
their line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pinproof.collision.scene import Obstacle
from pinproof.common.files import write_text_whole
from pinproof.errors import FileError, InputError, SceneError
from pinproof.spatial import SE3, finite, rigid

if TYPE_CHECKING:
    from pinproof.common.yaml_file import LinedMapping

__all__ = ["Attachments"]

KEYS = ("attached", "allowed_contacts", "held", "tip")
TIP_KEYS = ("xyz", "rpy", "quat_xyzw")

Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class Attachments:
    """What the arm carries: a tool, a part, or both.

    Parameters
    ----------
    bodies
        Bodies that move with the tcp; their pose is ``tcp_from_body``.
    allowed
        Pairs of names (links, attached bodies, obstacles) that are meant to touch. A certificate lists them as not
        checked.
    held
        Values (rad or m) of joints outside the arm by name, such as those of the robot's own fingers.
    tip
        ``tcp_from_tip``: the point of the tool that is put onto a target.
    """

    bodies: tuple[Obstacle, ...] = ()
    allowed: tuple[tuple[str, str], ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    tip: SE3 = field(default_factory=SE3.Identity)

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", tuple(self.bodies))
        object.__setattr__(self, "allowed", tuple((str(a), str(b)) for a, b in self.allowed))
        object.__setattr__(self, "tip", rigid("tip", self.tip))
        names = [body.name for body in self.bodies]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"names of attached bodies must differ; {', '.join(doubled)} appear more than once")

    @classmethod
    def load(cls, path: str | Path) -> Attachments:
        """Read a YAML file of the format above.

        Raises
        ------
        SceneError
            If the file cannot be read or states something without meaning; names file, line and key.
        """
        from pinproof.collision.scene_file import pairs_of, read_obstacle
        from pinproof.common.yaml_file import LinedMapping, read_yaml, refuse_unknown, require_list

        path = Path(path)
        content = read_yaml(path, KEYS, SceneError)
        refuse_unknown(SceneError, path, "key", content, KEYS, "")
        if "attached" not in content:
            raise SceneError(path, "states no attached bodies; list them under 'attached:'")
        bodies: list[Obstacle] = []
        for number, stated in enumerate(require_list(SceneError, path, "attached", content["attached"]), start=1):
            if not isinstance(stated, LinedMapping):
                raise SceneError(path, f"{stated!r} is not a body", f"key attached, #{number}")
            bodies.append(read_obstacle(path, number, stated))
            if any(bodies[-1].name == other.name for other in bodies[:-1]):
                raise SceneError(path, f"a second body is named {bodies[-1].name!r}", f"line {stated.line}")
        return cls(
            tuple(bodies),
            tuple(pairs_of(path, content, "allowed_contacts", "of names")),
            _value(path, content, "held", _held),
            _value(path, content, "tip", _tip),
        )

    def save(self, path: str | Path) -> None:
        """Write a file that :meth:`load` reads, whole or not at all; meshes are named as in :meth:`Scene.save`.

        Raises
        ------
        SceneError
            For another ending than ``.yaml`` or ``.yml``, or a place that cannot be written to.
        """
        import yaml

        from pinproof.collision.scene_file import stated_obstacle, stated_pose
        from pinproof.common.yaml_file import YAML_SUFFIXES

        path = Path(path)
        if path.suffix.lower() not in YAML_SUFFIXES:
            raise SceneError(path, f"unknown kind of file {path.suffix!r}; valid: {', '.join(YAML_SUFFIXES)}")
        folder = path.resolve().parent
        content: dict[str, Any] = {"attached": [stated_obstacle(body, folder) for body in self.bodies]}
        if self.allowed:
            content["allowed_contacts"] = [list(pair) for pair in self.allowed]
        if self.held:
            content["held"] = {name: float(value) for name, value in self.held.items()}
        if not self.tip.isIdentity():
            content["tip"] = stated_pose(self.tip)
        try:
            write_text_whole(
                path, yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)
            )
        except FileError as error:
            raise SceneError(path, error.reason) from error


def _value(path: Path, content: LinedMapping, key: str, read: Callable[[Any], Value]) -> Value:
    from pinproof.common.yaml_file import LinedMapping

    stated = content.get(key, {})
    try:
        return read(stated)
    except InputError as error:
        line = f"line {stated.line}, " if isinstance(stated, LinedMapping) else ""
        raise SceneError(path, str(error), f"{line}key {key}") from error


def _held(stated: object) -> dict[str, float]:
    from pinproof.collision.shape_file import numbers_of

    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of joint names to values")
    return {str(name): float(finite(str(name), [numbers_of(str(name), v)], (1,))[0]) for name, v in stated.items()}


def _tip(stated: object) -> SE3:
    from pinproof.collision.shape_file import pose_of

    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping with the keys {', '.join(TIP_KEYS)}")
    if unknown := [key for key in stated if key not in TIP_KEYS]:
        raise InputError(f"unknown key {unknown[0]!r}; valid: {', '.join(TIP_KEYS)}")
    return pose_of(stated)
