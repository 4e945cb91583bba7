"""Durations of robot programs by stepping through their texts, independently of pinproof.

python scripts/program_simulator.py robots/ur5/ur5.urdf tool0 PROGRAM ...

The texts are read by regular expressions of this file, the kinematics are those of Pinocchio. The rules are those that
docs/programs.md states: joints of a joint move begin and end together, with a trapezoidal speed; so does the tcp of a
linear move. Where a text states neither a time nor an acceleration, joints use their limits. A blend begins when the
tcp enters the zone and decelerates: the next move begins, its displacement is added, and it leaves the zone no earlier
than the move before ends. In LS, `CNT` has no zone. The motion is stepped in milliseconds, and the speed of each joint
is compared with its limit.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

STEP = 1e-3
"""s"""

RAMP = 0.5
"""s: in which a joint without a stated acceleration limit reaches its velocity limit."""

FLOAT = r"-?\d+(?:\.\d+)?"


@dataclass
class Move:
    """A move to joint values, or to the pose of a linear one, with what its text states."""

    target: np.ndarray
    linear: bool
    time: float | None = None
    speed: float | None = None  # of the tcp, or the share of the velocities
    gain: float | None = None  # of the tcp, or the share of the accelerations
    radius: float | None = None  # m; infinite for a zone of half of the moves, None for a stop
    half: bool = True


Step = Move | float
"""A move, or a waiting time (s)."""


def floats(text: str) -> np.ndarray:
    """The numbers of a text."""
    return np.array([float(x) for x in re.findall(FLOAT, text)])


def read_urscript(text: str) -> list[Step]:
    """Moves with ``t`` and ``r``; those with ``a`` and ``v`` are slow ones to the first point."""
    steps: list[Step] = []
    for line in text.split("\n"):
        if m := re.match(r"\s*(move[jl])\(\[([^]]*)\], (?:t=([\d.]+)|a=[\d.]+, v=[\d.]+)(?:, r=([\d.]+))?\)$", line):
            radius = float(m[4]) if m[4] else None
            steps.append(Move(floats(m[2]), m[1] == "movel", m[3] and float(m[3]), radius=radius, half=False))
        elif m := re.match(r"\s*sleep\(([\d.]+)\)$", line):
            steps.append(float(m[1]))
        elif not re.match(r"\s*(#.*|def \w+\(\):|end|set_\w+\(.*\)|)$", line):
            raise ValueError(line)
    return steps


def read_rapid(text: str) -> list[Step]:
    """``MoveAbsJ`` and ``MoveL CalcRobT`` with their times; a zone has the radius of its number."""
    steps: list[Step] = []
    for line in text.split("\n"):
        target = r"\s*Move(?:AbsJ |L CalcRobT\()\[\[([^]]*)\],\[[^]]*\]\](.*)"
        if m := re.match(target + r", v\d+(?:\\T:=([\d.]+))?, (fine|z\d+), \w+;$", line):
            radius = None if m[4] == "fine" else max(float(m[4][1:]), 0.3) / 1e3
            steps.append(Move(np.deg2rad(floats(m[1])), "MoveL" in line, m[3] and float(m[3]), radius=radius))
        elif m := re.match(r"\s*WaitTime ([\d.]+);$", line):
            steps.append(float(m[1]))
        elif not re.match(
            r"\s*(!.*|(END)?(MODULE|PROC)\b.*|LOCAL PERS .*|AccSet 100, 100;|SetDO .*|GripLoad .*|)$", line
        ):
            raise ValueError(line)
    return steps


def read_krl(text: str) -> list[Step]:
    """``PTP`` and ``LIN`` with the speeds, accelerations and distances that were stated last."""
    steps: list[Step] = []
    state: dict[str, float] = {}
    for line in text.split("\n"):
        if m := re.match(r"\s*BAS\(#(\w+),([\d.]+)\)$", line):
            state[m[1]] = float(m[2])
        elif m := re.match(r"\s*\$APO\.CDIS=([\d.]+)$", line):
            state["CDIS"] = float(m[1])
        elif m := re.match(r"\s*(PTP|LIN) \{([^}]*)\}( C_DIS)?$", line):
            values = np.array([float(part.split()[1]) for part in m[2].split(",")])
            radius = state["CDIS"] / 1e3 if m[3] else None
            if m[1] == "PTP":
                shares = state["VEL_PTP"] / 100, state["ACC_PTP"] / 100
                steps.append(Move(np.deg2rad(values), False, None, *shares, radius))
            else:
                turn = pin.rpy.rpyToMatrix(*np.deg2rad(values[:2:-1]))
                steps.append(
                    Move(pin.SE3(turn, values[:3] / 1e3), True, None, state["VEL_CP"], state["ACC_CP"], radius)
                )
        elif m := re.match(r"\s*WAIT SEC ([\d.]+)$", line):
            steps.append(float(m[1]))
        elif not re.match(r"\s*(;.*|DEF \w+\(\)|END|\$(TOOL|BASE|LOAD|OUT\[\d+\])=.*|)$", line):
            raise ValueError(line)
    return steps


def read_fanuc(text: str) -> list[Step]:
    """``J`` and ``L`` with ``msec``, and the positions of /POS."""
    steps: list[Step] = []
    body, _, positions = text.partition("/POS\n")
    places = {
        m[1]: np.deg2rad(floats(re.sub(r"J\d =", "", m[2])))
        for m in re.finditer(r"P\[(\d+)\]\{[^=]*((?:J\d = [^}]*))\}", positions)
    }
    for line in body.partition("/MN\n")[2].split("\n"):
        words = re.sub(r"^\s*\d+:\s*", "", line)
        if m := re.match(r"([JL]) P\[(\d+)\] (?:\d+%|(\d+)msec) (?:FINE|CNT(\d+)) ;$", words):
            # Half of each move at most, in which the move before decelerates
            radius = None if m[4] is None else np.inf if int(m[4]) == 100 else 0.0
            steps.append(Move(places[m[2]], m[1] == "L", m[3] and float(m[3]) / 1e3, radius=radius))
        elif m := re.match(r"WAIT ([\d.]+)\(sec\) ;$", words):
            steps.append(float(m[1]))
        elif not re.match(r"(!.*|U(FRAME|TOOL)_NUM=\d+ ;|DO\[\d+\]=(ON|OFF) ;|PAYLOAD\[\d+\] ;|)$", words):
            raise ValueError(line)
    return steps


READERS = {".script": read_urscript, ".mod": read_rapid, ".src": read_krl, ".ls": read_fanuc}


class Simulator:
    """Programs of an arm of six revolute joints by the file of its URDF and the name of its tcp."""

    def __init__(self, urdf: str | Path, tcp: str) -> None:
        text = re.sub(r"<(visual|collision)>.*?</\1>", "", Path(urdf).read_text(encoding="utf-8"), flags=re.DOTALL)
        self.model = pin.buildModelFromXML(text)
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(tcp)
        self.velocity = self.model.velocityLimit
        self.acceleration = self.velocity / RAMP

    def pose(self, q: np.ndarray) -> pin.SE3:
        """Pose of the tcp."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.frame].copy()

    def path(self, move: Move, start: np.ndarray) -> np.ndarray:
        """The joint values at 257 equal shares of a move."""
        shares = np.linspace(0.0, 1.0, 257)
        if not move.linear:
            return start + shares[:, None] * (move.target - start)
        first = self.pose(start)
        last = move.target if isinstance(move.target, pin.SE3) else self.pose(move.target)
        turn = pin.log3(first.rotation.T @ last.rotation)
        q, rows = start.copy(), []
        for share in shares:
            place = first.translation + share * (last.translation - first.translation)
            goal = pin.SE3(first.rotation @ pin.exp3(share * turn), place)
            for _ in range(20):
                error = pin.log6(self.pose(q).actInv(goal)).vector
                if np.abs(error).max() < 1e-10:
                    break
                q = q + np.linalg.solve(pin.computeFrameJacobian(self.model, self.data, q, self.frame), error)
            else:
                raise ValueError("a linear move cannot be followed")
            rows.append(q)
        if not isinstance(move.target, pin.SE3) and np.abs(rows[-1] - move.target).max() > 1e-3:
            raise ValueError("a linear move ends at another configuration")
        return np.array(rows)

    def profile(self, move: Move, path: np.ndarray) -> tuple[float, float]:
        """Duration (s) and time of the ramps of a trapezoidal speed along a move."""
        slope = np.abs(np.diff(path, axis=0)).max(axis=0) * (len(path) - 1) + 1e-12
        top, gain = (self.velocity / slope).min(), (self.acceleration / slope).min()
        if move.linear and move.speed is not None:
            length = np.linalg.norm(self.pose(path[-1]).translation - self.pose(path[0]).translation)
            top, gain = move.speed / length, move.gain / length
        elif move.speed is not None:
            top, gain = move.speed * top, move.gain * gain
        if move.time is None:
            peak = min(top, np.sqrt(gain))
            return 1.0 / peak + peak / gain, peak / gain
        # Of a stated time: at the acceleration of the joints, or as it needs at their velocity
        peak = (gain * move.time - np.sqrt(max((gain * move.time) ** 2 - 4.0 * gain, 0.0))) / 2.0
        if gain * move.time**2 >= 4.0 and peak <= top:
            return move.time, peak / gain
        return move.time, max(move.time - 1.0 / top, 0.0)

    def stretch(self, moves: list[Move], paths: list[np.ndarray]) -> float:
        """Seconds from one stop to the next."""
        times, shares, zones = [], [], []
        for move, path in zip(moves, paths, strict=True):
            total, ramp = self.profile(move, path)
            t = np.arange(0.0, total + STEP, STEP).clip(max=total)
            speed = np.minimum(1.0, np.minimum(t, total - t) / max(ramp, 1e-9))
            passed = np.concatenate([[0.0], np.cumsum(np.diff(t) * (speed[1:] + speed[:-1]) / 2.0)])
            times.append((total, ramp))
            shares.append(passed / passed[-1])
        starts = [0.0]
        for k, move in enumerate(moves[:-1]):
            together = 0.0
            if move.radius is not None:
                for number, at in ((k, -1), (k + 1, 0)):
                    tcp = np.array([self.pose(q).translation for q in paths[number]])
                    apart = np.linalg.norm(tcp - tcp[at], axis=1)
                    inside = np.argmax(np.append(apart[:: 1 if at == 0 else -1] > move.radius, True)) / len(tcp)
                    zones.append(min(inside, 0.5) if move.half else inside)
                before, after = zones[-2:]
                together = min(
                    times[k][1], times[k + 1][1],
                    STEP * np.count_nonzero(shares[k] > 1.0 - before), STEP * np.count_nonzero(shares[k + 1] < after),
                )  # fmt: skip
            starts.append(starts[-1] + times[k][0] - together)
        # The sum of the displacements, whose speeds are compared with the limits
        end = starts[-1] + times[-1][0]
        clock = np.arange(0.0, end + STEP, STEP)
        q = np.tile(paths[0][0], (len(clock), 1))
        for path, share, start in zip(paths, shares, starts, strict=True):
            at = np.interp(clock - start, STEP * np.arange(len(share)), share)
            q += np.stack([np.interp(at, np.linspace(0, 1, len(path)), column) for column in path.T], axis=1) - path[0]
        self.fastest = max(self.fastest, float((np.abs(np.diff(q, axis=0)) / STEP / self.velocity).max()))
        return end

    def run(self, text: str, ending: str) -> tuple[float, float, int]:
        """Seconds from the first point to the end, the largest share of a velocity limit, and the number of moves."""
        steps = READERS[ending](text)
        moves = [step for step in steps if isinstance(step, Move)]
        self.fastest, seconds = 0.0, sum(step for step in steps if not isinstance(step, Move))
        here = moves[0].target
        stretch: list[Move] = []
        paths: list[np.ndarray] = []
        for move in moves[1:]:
            stretch.append(move)
            paths.append(self.path(move, here))
            here = paths[-1][-1]
            if move.radius is None:
                seconds += self.stretch(stretch, paths)
                stretch, paths = [], []
        if stretch:
            raise ValueError("the program ends in a blend")
        return seconds, self.fastest, len(moves)


if __name__ == "__main__":
    simulator = Simulator(*sys.argv[1:3])
    for name in sys.argv[3:]:
        duration, share, count = simulator.run(Path(name).read_text(encoding="utf-8"), Path(name).suffix)
        print(f"{name}: {count} moves, {duration:.2f} s, at most {100 * share:.1f} % of the velocity of a joint")
