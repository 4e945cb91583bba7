"""Joint limits of position, velocity, acceleration, jerk and torque.

Files have the format of ``joint_limits.yaml`` of MoveIt; docs/formats/limits.md describes it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common import structs as st
from pinproof.common.files import read_yaml
from pinproof.common.results import Rows, Shown, View
from pinproof.common.validation import named_arguments
from pinproof.errors import FileError, InputError, UnknownNameError
from pinproof.spatial import Array, floats

DEFAULT_RAMP = 0.5
"""Seconds in which a joint reaches its velocity limit if no acceleration limit is known (a URDF has none)."""

GUESSED = "default:"
"""The start of the source of accelerations that follow from :data:`DEFAULT_RAMP`."""

AT_LIMIT = 1e-9
"""Rad or m. Joint values beyond a limit by less than this are set to the limit; rounding by adding 2 pi, by converting
from degrees and in files with 10 digits is smaller."""

DIGITS = 17
"""Significant digits with which two different doubles have different texts."""


def distinct(*values: float) -> list[str]:
    """Format the values with the fewest digits, at least 6, for which different values have different texts."""
    for digits in range(6, DIGITS + 1):
        texts = [f"{value:.{digits}g}" for value in values]
        if len(set(texts)) == len({float(value) for value in values}):
            return texts
    return texts


LIMIT_KINDS = ("lower", "upper", "velocity", "acceleration", "jerk", "torque")
"""The arrays of :class:`JointLimits`, in the order of its fields."""


@named_arguments
@st.described(eq=False)
class JointLimits(Shown):
    """Limits of the n joints of an arm, in joint order.

    Raises
    ------
    InputError
        If shapes differ, lower > upper, or a velocity, acceleration or jerk is not above 0.
    """

    lower: Array = st.key("(n,) positions; -inf for a continuous joint", "rad or m")
    upper: Array = st.key("(n,) positions; inf for a continuous joint", "rad or m")
    velocity: Array = st.key("(n,) above 0; NaN where it is not known (timing then raises an error)", "rad/s or m/s")
    acceleration: Array = st.key(  # filled in below; never None afterwards
        "(n,) above 0. By default the velocity limit reached in :data:`DEFAULT_RAMP`", "rad/s^2 or m/s^2", default=None
    )
    jerk: Array | None = st.key(
        "(n,) above 0, NaN where it is not known; None if it is known for no joint", "rad/s^3 or m/s^3", default=None
    )
    torque: Array | None = st.key(
        "(n,) in N m, or in N for a prismatic joint, above 0, NaN where it is not known; None if it is known for no "
        "joint. A URDF calls it effort. :class:`pinproof.motion.TorqueLimits` applies it",
        default=None,
    )
    acceleration_source: str = st.key(
        "where the accelerations come from, for results that depend on them", default="", kw_only=True
    )
    jerk_source: str = st.key("where the jerks come from", default="", kw_only=True)
    guessed: npt.NDArray[np.bool_] = st.key(  # filled in below
        "(n,) of type bool: whether the acceleration of a joint is such a default value, which is no limit of the "
        "robot",
        default=None,
        kw_only=True,
    )

    def _view(self) -> View:
        known = {kind: value for kind in LIMIT_KINDS if (value := getattr(self, kind)) is not None}
        rows = list(zip(*known.values(), strict=True))
        notes = filter(None, (f"acceleration: {self.acceleration_source}", self.jerk_source))
        lines = (f"{kind}: {', '.join(f'{value:.6g}' for value in values)}" for kind, values in known.items())
        title = f"Limits of {len(self.lower)} joints (rad or m, s, N m)"
        head = f"{len(self.lower)} joints, acceleration: {self.acceleration_source}"
        return View(head, [Rows(tuple(known), rows), notes], lines, title=title)

    def __post_init__(self) -> None:
        # the default accelerations, which are marked as guessed
        acceleration, source = self.acceleration, self.acceleration_source or "given by the caller"
        default = acceleration is None
        if default:
            acceleration = floats("limits.velocity", self.velocity, (None,)) / DEFAULT_RAMP
            source = f"{GUESSED} the velocity limit reached in {DEFAULT_RAMP} s (no acceleration limit is known)"
        object.__setattr__(self, "acceleration", acceleration)
        object.__setattr__(self, "acceleration_source", source)
        # copies of the arrays, of one length
        for name in LIMIT_KINDS:
            if (value := getattr(self, name)) is None:
                continue
            array = floats(f"limits.{name}", value, (None,) if name == "lower" else self.lower.shape)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.jerk is not None:
            object.__setattr__(self, "jerk_source", self.jerk_source or "given by the caller")
        for name in ("jerk", "torque"):
            if getattr(self, name) is not None and (getattr(self, name) <= 0).any():
                raise InputError(f"{name} limits must be above 0 (NaN where not known)")
        if np.isnan(self.lower).any() or np.isnan(self.upper).any() or (self.lower > self.upper).any():
            raise InputError(
                f"limits.lower must be at most limits.upper, without NaN; they are {self.lower} and {self.upper}"
            )
        if (self.velocity <= 0).any() or (self.acceleration <= 0).any():
            raise InputError("velocity and acceleration limits must be above 0 (NaN where not known)")
        guessed = np.full(len(self), default) if self.guessed is None else np.array(self.guessed, dtype=bool)
        if guessed.shape != self.velocity.shape:
            raise InputError(f"limits.guessed must have the shape {self.velocity.shape}, not {guessed.shape}")
        # A value that was replaced since it was guessed is one that the caller states.
        guessed &= (self.acceleration == self.velocity / DEFAULT_RAMP) | np.isnan(self.acceleration)
        guessed.setflags(write=False)
        object.__setattr__(self, "guessed", guessed)

    @staticmethod
    def load(path: str | Path) -> LimitsFile:
        """Read joint limits from a file such as MoveIt's ``joint_limits.yaml``, for ``robot.arm(limits=...)``.

        Raises
        ------
        FileError
            If the file cannot be read or is invalid; the message names the line, the joint and the valid keys.
        """
        path = Path(path)
        content = read_yaml(path, FILE.names, FileError)
        with st.errors_of(path, FileError):
            joints = FILE.parse("the file", content, path)["joint_limits"]
            if not joints:
                raise st.Misread("must be a mapping of joint names to limits", (".joint_limits",))

        def of(kind: str) -> dict[str, float]:
            return {name: used[kind][0] for name, used in joints.items() if kind in used}

        # deceleration has no place of its own: the smaller of both limits holds in both directions
        acceleration, deceleration = of("acceleration"), of("deceleration")
        return LimitsFile(
            path,
            {name: used["position"] for name, used in joints.items() if "position" in used},
            of("velocity"),
            {name: min(value, deceleration.get(name, value)) for name, value in acceleration.items()},
            of("jerk"),
            of("effort"),
            {str(name): content["joint_limits"].place(name, "joint") for name in content["joint_limits"]},
        )

    def __len__(self) -> int:
        return len(self.lower)

    def select(self, joints: Sequence[int] | npt.NDArray[np.int64]) -> JointLimits:
        """Return the limits of the joints with these indices, in this order, or of the joints of a mask.

        Raises
        ------
        InputError
            If the values are not indices of joints, and not a mask with a value for each joint.
        """
        stated = np.asarray(joints) if np.size(joints) else np.empty(0, dtype=int)
        try:
            index = np.arange(len(self))[stated]
        except IndexError as error:
            what = f"indices from 0 to {len(self) - 1} or a mask of {len(self)} values"
            raise InputError(f"joints must be {what}, not {joints!r:.80}") from error
        values = {kind: getattr(self, kind) for kind in LIMIT_KINDS}
        chosen: dict[str, Any] = {kind: None if value is None else value[index] for kind, value in values.items()}
        return dataclasses.replace(self, **chosen, guessed=self.guessed[index])

    @staticmethod
    def join(parts: Sequence[JointLimits]) -> JointLimits:
        """Return the limits of all parts, one part after the other; NaN where a limit is unknown."""

        def joined(kind: str) -> Array | None:
            values = [getattr(part, kind) for part in parts]
            if all(value is None for value in values):
                return None
            return np.concatenate(
                [np.full(len(part), np.nan) if v is None else v for part, v in zip(parts, values, strict=True)]
            )

        def texts(kind: str) -> str:
            distinct = list(dict.fromkeys(text for part in parts if (text := getattr(part, kind))))
            # the text of several sources must not start with "default", which marks limits that are all default values
            return distinct[0] if len(distinct) == 1 else f"several: {'; '.join(distinct)}" if distinct else ""

        sources = {kind: texts(kind) for kind in ("acceleration_source", "jerk_source")}
        guessed = np.concatenate([part.guessed for part in parts])
        return JointLimits(*(joined(kind) for kind in LIMIT_KINDS), guessed=guessed, **sources)  # type: ignore[arg-type]

    def contains(self, q: Array, tolerance: float = 0.0) -> bool:
        """Whether every joint of q (n,) is inside its limits, widened by ``tolerance`` (rad or m)."""
        lower, upper = (self.lower - tolerance, self.upper + tolerance) if tolerance else (self.lower, self.upper)
        inside = (q >= lower) & (q <= upper)  # NaN is not
        return bool(np.count_nonzero(inside) == len(inside))

    def clip(self, q: Array) -> Array:
        """Return the configuration inside the limits closest to q (n,)."""
        return np.clip(q, self.lower, self.upper)

    def snap(self, q: Array) -> Array:
        """Return q (..., n) with values beyond a limit by less than :data:`AT_LIMIT` set to the limit."""
        clipped = np.minimum(np.maximum(q, self.lower), self.upper)  # as clip, in a third of its time
        return np.asarray(np.where(np.abs(q - clipped) < AT_LIMIT, clipped, q))

    def inside(self, q: Array) -> npt.NDArray[np.bool_]:
        """Return (...,) whether q (..., n) is inside the limits after :meth:`snap`."""
        near = self.snap(q)
        return np.asarray(((near >= self.lower) & (near <= self.upper)).all(axis=-1))

    def violations(self, q: Array, joint_names: Sequence[str]) -> list[str]:
        """Return one sentence for each joint of q (n,) outside its limits, without tolerance (see :meth:`snap`)."""
        found: list[str] = []
        if ((self.lower <= q) & (q <= self.upper)).all():
            return found
        for name, value, low, high in zip(joint_names, q, self.lower, self.upper, strict=True):
            if not low <= value <= high:
                value_text, low_text, high_text = distinct(value, low, high)
                found.append(f"{name} = {value_text} is outside [{low_text}, {high_text}]")
        return found

    def replace(self, joint_names: Sequence[str], ranges: Mapping[str, tuple[float, float]]) -> JointLimits:
        """Return these limits with other position ranges for some joints, by joint name."""
        lower, upper = self.lower.copy(), self.upper.copy()
        for name, bounds in ranges.items():
            if name not in joint_names:
                raise UnknownNameError("joint", name, joint_names, "limits")
            index = list(joint_names).index(name)
            lower[index], upper[index] = floats(f"the limits of joint {name!r} (lower, upper)", bounds, (2,))
        return dataclasses.replace(self, lower=lower, upper=upper)

    def sampling_range(self) -> tuple[Array, Array]:
        """Return finite (lower, upper), each (n,); an infinite range is replaced by [-pi, pi], an open end by 2 pi."""
        lower, upper = self.lower.copy(), self.upper.copy()
        open_below, open_above = np.isinf(lower), np.isinf(upper)
        lower[open_below] = np.where(open_above, -np.pi, upper - 2 * np.pi)[open_below]
        upper[open_above] = np.where(open_below, np.pi, lower + 2 * np.pi)[open_above]
        return lower, upper


KINDS = {
    "position": {
        "min_position": ("lower limit of the position", "rad or m"),
        "max_position": ("upper limit of the position", "rad or m"),
    },
    "velocity": {"max_velocity": ("largest velocity, above 0", "rad/s or m/s")},
    "acceleration": {"max_acceleration": ("largest acceleration, above 0", "rad/s² or m/s²")},
    "deceleration": {
        "max_deceleration": (
            "largest deceleration, of either sign; the smaller of it and `max_acceleration` is used for both",
            "rad/s² or m/s²",
        )
    },
    "jerk": {"max_jerk": ("largest jerk, above 0", "rad/s³ or m/s³")},
    "effort": {
        "max_effort": (
            "largest torque, or force of a prismatic joint, above 0; used where torques are limited",
            "N m or N",
        )
    },
}
"""The kinds of limits of a file, each with its keys, their meaning and unit."""


_KEYS: list[st.Key] = []
_RULES: list[dict[str, Any]] = []
for _kind, _values in KINDS.items():
    _flag, _names = f"has_{_kind}_limits", " and ".join(f"`{key}`" for key in _values)
    _KEYS += [
        st.Key(_flag, st.BOOLEAN, f"whether {_names} {'are' if len(_values) > 1 else 'is'} used"),
        *(st.Key(key, st.PLAIN_NUMBER, *meaning) for key, meaning in _values.items()),
    ]
    # A limit has its flag; if the flag is true, its values exist and are above 0.
    _size = {"not": {"const": 0}} if _kind == "deceleration" else {"exclusiveMinimum": 0}
    _used = {"required": [_flag], "properties": {_flag: {"const": True}}}
    _sizes = {} if _kind == "position" else dict.fromkeys(_values, _size)
    _RULES += [
        {"if": {"anyOf": [{"required": [key]} for key in _values]}, "then": {"required": [_flag]}},
        {"if": _used, "then": {"required": list(_values), "properties": _sizes}},
    ]


def used_limits(**stated: Any) -> dict[str, tuple[float, ...]]:
    """The limits of a joint by kind whose flags are true."""
    used: dict[str, tuple[float, ...]] = {}
    for kind, keys in KINDS.items():
        # a value needs its flag, and a true flag its values
        flag = f"has_{kind}_limits"
        if flag not in stated and (given := [key for key in keys if key in stated]):
            raise InputError(f"{given[0]} requires {flag}: true (or false to ignore it)")
        if not stated.get(flag):
            continue
        if missing := [key for key in keys if key not in stated]:
            raise InputError(f"{flag}: true requires {' and '.join(missing)}")
        values = tuple(abs(stated[key]) if kind == "deceleration" else stated[key] for key in keys)
        if kind == "position" and values[0] > values[1]:
            raise InputError(f"min_position {values[0]} is above max_position {values[1]}")
        if kind != "position" and not values[0] > 0.0:
            raise InputError(f"{next(iter(keys))} must be above 0, not {values[0]}")
        used[kind] = values
    if "deceleration" in used and "acceleration" not in used:
        raise InputError("has a deceleration limit but no acceleration limit")
    return used


LIMITS = st.mapping_to(
    st.Table(
        "limits_of_a_joint",
        "The limits of one joint. A limit is used if its `has_...` key is true; limits that are not stated are "
        "unchanged.",
        *_KEYS,
        st.Key("angle_wraparound", st.ANYTHING, "ignored"),
        rules={"allOf": _RULES},
        make=used_limits,
    ),
    "joint names to limits",
)

FILE = st.Table(
    "limits",
    "Joint limits in the format of `joint_limits.yaml` of MoveIt.",
    st.required(
        "joint_limits",
        st.Kind({**LIMITS.schema, "minProperties": 1}, LIMITS.check, LIMITS.parse),
        "the limits by name of the joint",
    ),
    st.Key("default_velocity_scaling_factor", st.ANYTHING, "not a limit; ignored"),
    st.Key("default_acceleration_scaling_factor", st.ANYTHING, "not a limit; ignored"),
)


@st.described()
class LimitsFile:
    """The joint limits of a file, by joint name."""

    path: Path = st.key("the file")
    position: Mapping[str, tuple[float, float]] = st.key("(lower, upper) in rad or m", default_factory=dict)
    velocity: Mapping[str, float] = st.key("largest speeds", "rad/s or m/s", default_factory=dict)
    acceleration: Mapping[str, float] = st.key("largest accelerations", "rad/s^2 or m/s^2", default_factory=dict)
    jerk: Mapping[str, float] = st.key("largest jerks", "rad/s^3 or m/s^3", default_factory=dict)
    torque: Mapping[str, float] = st.key("the file calls it effort", "N m or N", default_factory=dict)
    places: Mapping[str, str] = st.key(
        "the position in the file by joint, for messages; all joints in the file", default_factory=dict
    )

    def over(self, limits: JointLimits, joint_names: Sequence[str], known: Sequence[str]) -> JointLimits:
        """Replace limits of an arm by those of the file.

        Parameters
        ----------
        limits, joint_names
            Limits and joint names of the arm.
        known
            All joints of the robot.

        Raises
        ------
        FileError
            If the file contains a joint that is not in ``known``.
        """
        # a misspelt joint would keep its old limits
        for name, place in self.places.items():
            if name not in known:
                raise FileError(self.path, str(UnknownNameError("joint", name, known)), place)
        arrays: dict[str, Any] = {
            kind: np.full(len(limits), np.nan) if (own := getattr(limits, kind)) is None else own.copy()
            for kind in LIMIT_KINDS
        }
        # what the file states replaces the limits of the arm; guessed accelerations follow the velocity
        for i, name in enumerate(joint_names):
            if name in self.position:
                arrays["lower"][i], arrays["upper"][i] = self.position[name]
            if name in self.velocity and limits.guessed[i]:
                arrays["acceleration"][i] = self.velocity[name] / DEFAULT_RAMP
            for kind in LIMIT_KINDS[2:]:
                arrays[kind][i] = getattr(self, kind).get(name, arrays[kind][i])
        for kind in ("jerk", "torque"):
            arrays[kind] = None if np.isnan(arrays[kind]).all() else arrays[kind]
        return JointLimits(
            **arrays,
            acceleration_source=self._source(self.acceleration, joint_names, limits.acceleration_source),
            jerk_source=self._source(self.jerk, joint_names, limits.jerk_source or "not known"),
            guessed=limits.guessed & np.array([name not in self.acceleration for name in joint_names]),
        )

    def _source(self, stated: Mapping[str, float], joint_names: Sequence[str], others: str) -> str:
        missing = [name for name in joint_names if name not in stated]
        if not missing:
            return self.path.name
        if len(missing) == len(joint_names):
            return others
        # the text must not start with "default", which marks limits that are all default values
        return f"{self.path.name}, but for {', '.join(missing)}: {others}"


def guess_note(source: str) -> str:
    """A sentence for durations if the source of the acceleration limits states a default; otherwise empty."""
    if GUESSED not in source:
        return ""
    return f"Durations follow from guessed acceleration limits: {source.removeprefix(GUESSED).strip()}"


def guess_mark(source: str) -> str:
    """What follows a duration in a text: ", with guessed accelerations" if ``source`` states a default, otherwise ''.

    ``source`` is that of the limits, or the note of a trajectory, which contains it.
    """
    return ", with guessed accelerations" if GUESSED in source else ""
