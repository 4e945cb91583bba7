"""What an MJCF element says once the file's compiler settings and default classes are counted in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.description.xml_reader import Element, numbers, place, required
from pinproof.errors import UnknownNameError, UrdfError

__all__ = ["Words"]

Array = npt.NDArray[np.float64]
Attributes = dict[str, dict[str, str]]

LARGEST = 1e100
"""Of any number: the squares of larger ones overflow."""

ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")


@dataclass(frozen=True)
class Words:
    """The compiler settings and default classes of one MJCF file.

    ``classes`` maps class to tag to attributes, with those of its parents; ``degrees`` says that angles are written in
    degrees; ``auto_limits`` that a joint with a range is limited.
    """

    path: Path
    classes: Mapping[str, Attributes]
    degrees: bool
    euler: str
    auto_limits: bool
    mesh_folder: Path

    @classmethod
    def of(cls, root: Element, path: Path) -> Words:
        """Read them from the ``<mujoco>`` element."""
        settings: dict[str, str] = {}
        for compiler in root.findall("compiler"):
            settings.update(compiler.attrib)
        if settings.get("coordinate", "local") != "local":
            raise UrdfError(path, "uses global coordinates, which MuJoCo itself has given up")
        if settings.get("angle", "degree") not in ("degree", "radian"):
            raise UrdfError(path, f"measures angles in {settings['angle']!r}; valid: degree, radian")
        euler = settings.get("eulerseq", "xyz")
        if len(euler) != 3 or not set(euler.lower()) <= set("xyz") or not (euler.islower() or euler.isupper()):
            raise UrdfError(path, f"has the eulerseq {euler!r}, which is none of the kind 'xyz' or 'XYZ' that is read")
        classes: dict[str, Attributes] = {"main": {}}
        for default in root.findall("default"):
            _read_class(default, "main", {}, classes, path)
        folder = settings.get("meshdir", settings.get("assetdir", ""))
        limits = settings.get("autolimits", "true") == "true"
        return cls(
            path, classes, settings.get("angle", "degree") == "degree", euler, limits, path.resolve().parent / folder
        )

    def attributes(self, element: Element, inherited: str | None) -> dict[str, str]:
        """An element's own attributes over those of its class, or of the class its body hands down."""
        name = element.get("class", inherited or "main")
        if name not in self.classes:
            raise UrdfError(self.path, str(UnknownNameError("default class", name, self.classes)), place(element))
        return {**self.classes[name].get(str(element.tag), {}), **element.attrib}

    def angle(self, value: float) -> float:
        """Radians."""
        return float(np.deg2rad(value)) if self.degrees else value

    def numbers(self, element: Element, words: Mapping[str, str], name: str, count: int, default: str = "") -> Array:
        """``count`` numbers of an attribute that may come from a class; errors name the element's line."""
        stand_in = element.makeelement(element.tag, {name: words.get(name, default)})
        stand_in.sourceline = element.sourceline
        values = np.array(numbers(stand_in, name, count, self.path))
        if np.abs(values).max(initial=0.0) > LARGEST:
            raise UrdfError(self.path, f"<{element.tag} {name}> is beyond {LARGEST:g}", place(element))
        return values

    def pose(self, element: Element, words: Mapping[str, str]) -> Array:
        """(4, 4) of ``pos`` (metres) and of whichever orientation is given."""
        from scipy.spatial.transform import Rotation

        out = np.eye(4)
        out[:3, 3] = self.numbers(element, words, "pos", 3, "0 0 0")
        given = [name for name in ORIENTATIONS if name in words]
        if len(given) > 1:
            raise UrdfError(self.path, f"<{element.tag}> has several orientations: {', '.join(given)}", place(element))
        if not given:
            return out
        count = {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(given[0], 3)
        values = self.numbers(element, words, given[0], count)
        if given[0] == "euler":
            # Lower case turns about the moving axes: the case that SciPy writes in capitals.
            angles = np.deg2rad(values) if self.degrees else values
            out[:3, :3] = Rotation.from_euler(self.euler.swapcase(), angles).as_matrix()
            return out
        if (np.linalg.norm(values[:3]) < 1e-9 and given[0] != "quat") or np.linalg.norm(values) < 1e-9:
            raise UrdfError(
                self.path, f"<{element.tag}> has the {given[0]} {list(values)}: no rotation", place(element)
            )
        if given[0] == "quat":
            out[:3, :3] = Rotation.from_quat([*values[1:], values[0]]).as_matrix()
        elif given[0] == "axisangle":
            axis = values[:3] / np.linalg.norm(values[:3])
            out[:3, :3] = Rotation.from_rotvec(axis * self.angle(values[3])).as_matrix()
        elif given[0] == "zaxis":
            out[:3, :3] = z_to(values)
        else:
            x = values[:3] / np.linalg.norm(values[:3])
            y = values[3:] - (values[3:] @ x) * x
            if np.linalg.norm(y) < 1e-9:
                raise UrdfError(self.path, f"<{element.tag}> has parallel xyaxes", place(element))
            y /= np.linalg.norm(y)
            out[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
        return out


def z_to(direction: Array) -> Array:
    """The smallest rotation (3, 3) that turns z to a direction (3,)."""
    from scipy.spatial.transform import Rotation

    unit = direction / np.linalg.norm(direction)
    across = np.cross([0.0, 0.0, 1.0], unit)
    sine = float(np.linalg.norm(across))
    axis = across / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
    return np.asarray(Rotation.from_rotvec(axis * np.arctan2(sine, unit[2])).as_matrix())


def _read_class(default: Element, name: str, above: Attributes, classes: dict[str, Attributes], path: Path) -> None:
    """Enter a ``<default>`` and those inside it; each takes over its parent's attributes."""
    own = {tag: dict(words) for tag, words in above.items()}
    for element in default:
        if element.tag != "default":
            own.setdefault(str(element.tag), {}).update(element.attrib)
    classes[name] = own
    for inner in default.findall("default"):
        _read_class(inner, required(inner, "class", path), own, classes, path)
