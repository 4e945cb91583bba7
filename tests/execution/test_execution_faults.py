"""Faults of messages and of timing while a motion is executed: each is answered by a stop, or no motion begins.

Every run passes the messages of a simulated robot to a :class:`CertifiedExecution` in the order of their arrival. A
fault changes the messages from a time on; the stop must follow within the timeout.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import pinproof as pp
from pinproof.execution import ros2

TICK, CLOCK, TIMEOUT = 0.01, 0.02, 0.1
"""Seconds between two joint states, between two calls of the clock, and without a state before a stop."""

FAULT = 0.2
"""Seconds after the start of the motion at which a fault begins."""

AFTER = 2.6
"""Seconds after its start at which the motion has ended."""

Arrivals = list[tuple[float, str, Any]]
"""The time of the node, the kind, and the message."""


@dataclass
class Course:
    """The messages of a run without a fault, in the order of their arrival."""

    swing: pp.Trajectory
    velocity: bool = True
    stamped: bool = True
    until: float = 0.6
    off: Callable[[float], Any] = field(default=lambda _: 0.0)

    def state(self, time: float) -> dict[str, Any]:
        at = min(max(time, 0.0), self.swing.duration)
        rate = self.swing.velocity(at).tolist() if self.velocity else []
        stamp = {"sec": int(10 + time), "nanosec": round((10 + time) % 1 * 1e9)} if self.stamped else {}
        position = (self.swing(at) + self.off(time)).tolist()
        names = list(self.swing.joint_names)
        return {"header": {"stamp": stamp}, "name": names, "position": position, "velocity": rate}

    def arrivals(self) -> Arrivals:
        """The node starts at 10 s; the motion is displayed then, after two joint states."""
        ticks = np.arange(-2, round(self.until / TICK) + 1) * TICK
        rows: Arrivals = [(10 + t + 0.001, "state", self.state(t)) for t in ticks]
        rows += [(10 + t, "clock", None) for t in np.arange(0.015, self.until, CLOCK)]
        return sorted([*rows, (10.0, "path", ros2.display_trajectory([self.swing]))], key=lambda row: row[0])


def run(checker: pp.CollisionChecker, arrivals: Arrivals) -> Iterator[tuple[float, str, ros2.Reply]]:
    execution = ros2.CertifiedExecution(checker, timeout=TIMEOUT)
    for time, kind, message in arrivals:
        if kind == "clock":
            yield time, kind, execution.on_clock(time)
        else:
            yield time, kind, getattr(execution, f"on_{kind}")(message, time)


def changed(arrivals: Arrivals, edit: Callable[[float, dict], Any], begin: float = FAULT) -> Arrivals:
    """The arrivals with other joint states from a time on."""
    return [(t, kind, edit(t, deepcopy(m)) if kind == "state" and t >= 10 + begin else m) for t, kind, m in arrivals]


def delayed(arrivals: Arrivals, by: float, count: int | None = None) -> Arrivals:
    """Joint states arrive later from the fault on: all of them, or ``count``."""
    late = [k for k, (t, kind, _) in enumerate(arrivals) if kind == "state" and t >= 10 + FAULT][:count]
    rows = [(t + by if k in late else t, kind, m) for k, (t, kind, m) in enumerate(arrivals)]
    return sorted(rows, key=lambda row: row[0])


def lost(arrivals: Arrivals, count: int) -> Arrivals:
    gone = [k for k, (t, kind, _) in enumerate(arrivals) if kind == "state" and t >= 10 + FAULT][:count]
    return [row for k, row in enumerate(arrivals) if k not in gone]


def repeated(arrivals: Arrivals, count: int, after: float) -> Arrivals:
    """``count`` messages arrive again."""
    again = [row for row in arrivals if row[1] == "state" and row[0] >= 10 + FAULT][:count]
    return sorted([*arrivals, *((t + after, kind, m) for t, kind, m in again)], key=lambda row: row[0])


def swapped(arrivals: Arrivals, distance: int) -> Arrivals:
    """Two messages are exchanged."""
    rows = list(arrivals)
    states = [k for k, (t, kind, _) in enumerate(rows) if kind == "state" and t >= 10 + FAULT]
    i, j = states[0], states[distance]
    rows[i], rows[j] = (rows[i][0], *rows[j][1:]), (rows[j][0], *rows[i][1:])
    return rows


def jumped(arrivals: Arrivals, by: float, *, stamps: bool) -> Arrivals:
    """The clock of the node jumps, with the clock of the stamps or without it."""

    def moved(message: Any) -> Any:
        if isinstance(message, dict) and stamps and message.get("header", {}).get("stamp"):
            message = deepcopy(message)
            stamp = message["header"]["stamp"]
            time = stamp["sec"] + stamp["nanosec"] * 1e-9 + by
            stamp["sec"], stamp["nanosec"] = int(time // 1), round(time % 1 * 1e9)
        return message

    return [(t + by, kind, moved(m)) if t >= 10 + FAULT else (t, kind, m) for t, kind, m in arrivals]


def inserted(arrivals: Arrivals, *messages: tuple[str, Any]) -> Arrivals:
    rows = [(10 + FAULT + 1e-4 * k, *message) for k, message in enumerate(messages)]
    return sorted([*arrivals, *rows], key=lambda row: row[0])


def put(message: dict, key: str, joint: int, value: object) -> dict:
    message[key] = [value if k == joint else old for k, old in enumerate(message[key])]
    return message


def scene(checker: pp.CollisionChecker, *obstacles: pp.Obstacle, diff: bool, **other: Any) -> dict[str, Any]:
    shown = checker.scene if diff is False else pp.Scene()
    message = ros2.planning_scene(pp.Scene([*shown.obstacles, *obstacles], allowed=shown.allowed))
    return {**message, "is_diff": diff, **other}


def faults(checker: pp.CollisionChecker, swing: pp.Trajectory) -> Iterator[tuple[str, Arrivals]]:
    """Runs that must end with a stop."""
    nominal = {
        f"{'' if velocity else 'no '}velocities, {'' if stamped else 'no '}stamps": Course(swing, velocity, stamped)
        for velocity in (True, False) for stamped in (True, False)
    }  # fmt: skip
    ball = pp.Obstacle("ball", pp.Sphere(0.05), checker.arm.forward_kinematics(swing(1.9)))
    far = pp.Obstacle("far", pp.Sphere(0.05), pp.pose((0.0, 0.0, 5.0)))
    shift = {"header": {"frame_id": "world"}, "child_frame_id": "table", "transform": {"translation": {"x": 0.1}}}
    for words, course in nominal.items():
        rows, stamped = course.arrivals(), course.stamped
        yield f"silent ({words})", lost(rows, 10**6)
        for count in (11, 20):
            yield f"{count} lost ({words})", lost(rows, count)
        for by in (0.12, 0.3, 1.0):
            yield f"all {by} s late ({words})", delayed(rows, by)
        for by in (-0.25, -0.15, 0.15, 30.0, -10.0):
            yield f"clock jumps by {by} s ({words})", jumped(rows, by, stamps=True)
            if stamped:
                yield f"clock of the node only jumps by {by} s ({words})", jumped(rows, by, stamps=False)
        for by in (-0.005, -0.015):
            yield f"clock jumps by {by} s ({words})", jumped(rows, by - TICK, stamps=True)
        last = next(m for t, kind, m in rows if kind == "state" and t >= 10 + FAULT)
        for rate in {"the last": last["velocity"], "no": []}.items():
            frozen = {"position": last["position"], "velocity": rate[1]}
            yield f"frozen positions, {rate[0]} velocities ({words})", changed(rows, lambda _, m, f=frozen: {**m, **f})
        slower = [(t + max(t - 10 - FAULT, 0.0) * (kind == "state"), kind, m) for t, kind, m in rows]
        if stamped:
            yield f"later and later ({words})", sorted(slower, key=lambda row: row[0])
            for by in (0.15, 30.0, -0.15):  # only one stamp is wrong
                wrong = next(k for k, (t, kind, _) in enumerate(rows) if kind == "state" and t >= 10 + FAULT)
                yield (
                    f"a stamp off by {by} s ({words})",
                    [
                        (t, kind, course.state(t - 10 + by) | {"position": m["position"]} if k == wrong else m)
                        for k, (t, kind, m) in enumerate(rows)
                    ],
                )
            yield f"one 0.05 s late ({words})", delayed(rows, 0.05, 1)
            yield f"one twice ({words})", repeated(rows, 1, 0.002)
            yield f"one again later ({words})", repeated(rows, 1, 0.055)
            yield f"neighbours exchanged ({words})", swapped(rows, 1)
            yield f"far ones exchanged ({words})", swapped(rows, 5)
            yield f"the same one again and again ({words})", changed(rows, lambda _, m, last=last: last)
        for key, values in {
            "header": ("x", 7, *({"stamp": stamp} for stamp in (5, {"sec": "x"}, {"sec": np.nan}, {"sec": 1}))),
            "name": (None, 7, [], {}, "abc", [[1.0] * 6]), "position": (None, 7, [], {}, [1.0], [[1.0] * 6], [0.0] * 8),
            "velocity": ([1.0], [np.inf] * 6, 7, "abc", [[1.0] * 6]),
        }.items():  # fmt: skip
            for value in values:
                edit = lambda _, m, key=key, value=value: {**m, key: value}  # noqa: E731
                yield f"{key} is {value!r} ({words})", changed(rows, edit)
        for what, edit in {
            "positions in the order of other joints": lambda _, m: {**m, "position": m["position"][::-1]},
            "positions in degrees": lambda _, m: {**m, "position": np.rad2deg(m["position"]).tolist()},
            "no names": lambda _, m: {key: value for key, value in m.items() if key != "name"},
            "no positions": lambda _, m: {key: value for key, value in m.items() if key != "position"},
            "no mapping": lambda _, m: list(m), "no message": lambda *_: None,
            "an unknown joint": lambda _, m: put(m, "name", 4, "finger"),
            **{f"the rate {value!r}": lambda _, m, v=value: {**m, "velocity": [0.0, v, 0.0, 0.0, 0.0, v]}
               for value in (np.nan, -np.inf, "fast", None, [1.0], {})},
        }.items():  # fmt: skip
            yield f"{what} ({words})", changed(rows, edit)
        for time in () if stamped else (np.nan, np.inf, -np.inf):  # of the node
            first = next(k for k, (t, kind, _) in enumerate(rows) if kind == "state" and t >= 10 + FAULT)
            yield f"the time {time} ({words})", [(time if k == first else t, *row) for k, (t, *row) in enumerate(rows)]
        for joint in (0, 3, 5):
            for value in (np.nan, np.inf, -np.inf, None, "x", [1.0], {}, 1e400):
                edit = lambda _, m, j=joint, v=value: put(m, "position", j, v)  # noqa: E731
                yield f"joint {joint} is at {value!r} ({words})", changed(rows, edit)
            for by in (0.05, -1.2, 2 * np.pi):
                edit = lambda _, m, j=joint, by=by: put(m, "position", j, m["position"][j] + by)  # noqa: E731
                yield f"joint {joint} is off by {by:.3g} ({words})", changed(rows, edit)
            twice = lambda _, m, j=joint: put(m, "name", (j + 1) % 6, m["name"][j])  # noqa: E731
            yield f"joint {joint} twice, another missing ({words})", changed(rows, twice)
            more = lambda _, m, j=joint: {  # noqa: E731
                **m, "name": [*m["name"], m["name"][j]], "position": [*m["position"], 0.0], "velocity": []
            }  # fmt: skip
            yield f"joint {joint} twice ({words})", changed(rows, more)
            less = lambda _, m, j=joint: {  # noqa: E731
                **m, **{key: [v for k, v in enumerate(m[key]) if k != j] for key in ("name", "position", "velocity")}
            }  # fmt: skip
            yield f"joint {joint} missing ({words})", changed(rows, less)
            drift = lambda t, m, j=joint: put(m, "position", j, m["position"][j] + 0.6 * (t - 10 - FAULT))  # noqa: E731
            yield f"joint {joint} drifts ({words})", changed(rows, drift)
        yield f"values reversed ({words})", changed(rows, lambda _, m: {**m, "position": m["position"][::-1]})
        for words_of_scene, message in {
            "a ball on the motion": scene(checker, ball, diff=False),
            "a ball as a difference": scene(checker, far, diff=True),
            "an object removed": {"is_diff": True, "world": {"collision_objects": [{"id": "x", "operation": 1}]}},
            "a moved frame": {"is_diff": True, "fixed_frame_transforms": [shift]},
            "a moved base": {"is_diff": True, "robot_state": {"multi_dof_joint_state": {"transforms": [{"x": 1}]}}},
            "an attached object": {"is_diff": True, "robot_state": {"attached_collision_objects": [{"id": "a"}]}},
            "other allowed contacts": {"is_diff": True, "allowed_collision_matrix": {"entry_names": ["a"]}},
            "no scene": None, "a number": 7, "a scene of nonsense": {"is_diff": False, "world": {"unknown": 1}},
            "objects that are a number": {"world": {"collision_objects": 3}},
        }.items():  # fmt: skip
            yield f"{words_of_scene} ({words})", inserted(rows, ("scene", message))
        second = ros2.display_trajectory([swing])
        edit = lambda _, m: put(m, "position", 2, m["position"][2] + 0.05)  # noqa: E731
        yield (
            f"second motion, then joint 2 is off ({words})",
            changed(inserted(rows, ("path", second)), edit, FAULT + 0.05),
        )
        after = Course(swing, course.velocity, stamped, until=AFTER + 0.2)
        edit = lambda _, m: put(m, "position", 1, m["position"][1] + 0.06)  # noqa: E731
        yield f"moved after the end ({words})", changed(after.arrivals(), edit, AFTER)


def harmless(swing: pp.Trajectory, checker: pp.CollisionChecker) -> Iterator[tuple[str, Arrivals]]:
    """Runs without a fault: nothing but the motion is sent."""
    for velocity in (True, False):
        for stamped in (True, False):
            rows = Course(swing, velocity, stamped, until=swing.duration + 0.3).arrivals()
            words = f"velocity {velocity}, stamps {stamped}"
            yield words, rows
            yield f"8 lost, {words}", lost(rows, 8)
            yield f"0.005 s late, {words}", delayed(rows, 0.005)
            other = lambda _, m: {**m, "name": ["x", *m["name"]], "position": [9.0, *m["position"]], "velocity": []}  # noqa: E731
            yield f"another joint, {words}", changed(rows, other) if not velocity else rows
            order = lambda _, m: {**m, **{key: m[key][::-1] for key in ("name", "position", "velocity")}}  # noqa: E731
            yield f"another order, {words}", changed(rows, order)
            yield f"second motion, {words}", inserted(rows, ("path", ros2.display_trajectory([swing])))
            same = {"is_diff": True, "robot_state": {"joint_state": {"name": ["x"], "position": [1.0]}}}
            yield f"a difference without objects, {words}", inserted(rows, ("scene", same))
            yield f"the same scene, {words}", inserted(rows, ("scene", scene(checker, diff=False)))


def test_every_fault_is_answered_by_a_stop_in_time(checker, swing) -> None:
    """The stop is the second command, and not more than 24 events after the fault, which are 0.15 s."""
    wrong, count = [], 0
    before = {end: sum(t < 10 + end for t, *_ in Course(swing, until=9.0).arrivals()) for end in (FAULT, AFTER)}
    for name, arrivals in faults(checker, swing):
        count += 1
        commands = [(k, kind, r) for k, (_, kind, r) in enumerate(run(checker, arrivals)) if r.command is not None]
        first = before[AFTER if name.startswith("moved after") else FAULT]
        if [kind for _, kind, _ in commands[:1]] != ["path"] or len(commands) != 2:
            wrong.append(f"{name}: {len(commands) - 1} stops")
            continue
        event, _, reply = commands[1]
        stop = ros2.read_joint_trajectory(reply.command)
        at_rest = not stop.velocities[-1].any() and np.isfinite(stop.q).all()
        slows = (stop.max_acceleration() <= checker.arm.limits.acceleration * (1 + 1e-9)).all()
        if not (reply.alarm and at_rest and slows and first <= event <= first + 24):
            wrong.append(f"{name}: {event - first} events after the fault, {reply.text}")
    assert wrong == []
    assert count > 400


def test_runs_without_a_fault_are_not_stopped(checker, swing) -> None:
    for name, arrivals in harmless(swing, checker):
        replies = [(kind, r) for _, kind, r in run(checker, arrivals)]
        assert [kind for kind, r in replies if r.command is not None] == ["path"], name
        assert [kind for kind, r in replies if r.alarm] == ["path"] * ("second motion" in name), name
