"""The goal of a FollowJointTrajectory action of ROS 2, as YAML for ``ros2 action send_goal``."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from pinproof.common.files import parse_json
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.dialects.dialect import Body, Dialect, Heading, Step, StreamedTrajectory
from pinproof.motion.trajectory_files import from_message, to_message


class Ros2(Dialect):
    """The joint_trajectory_controller interpolates between the points exactly as :class:`~pinproof.Trajectory`."""

    name = "ros2"
    endings = (".goal.yaml", ".goal.yml")
    joints = None
    comment_mark = "# pinproof:"
    exact = True
    opened = 0

    def comment(self, words: str) -> str:
        """See :meth:`Dialect.comment`."""
        return f"{self.comment_mark} {words}"

    def write(
        self,
        heading: Heading,  # noqa: ARG002
        steps: Sequence[Step],
    ) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        if len(steps) != 1 or not isinstance(steps[0], StreamedTrajectory):
            raise InputError("a goal of ros2 contains exactly one trajectory, and no outputs or waiting times")
        # The goal as JSON, which is YAML too, with one point per line.
        message = to_message(steps[0].record)
        points = ",\n".join(f"    {json.dumps(point, allow_nan=False)}" for point in message["points"])
        # In YAML 1.1 a number with an exponent needs a point; without one it is a text.
        points = re.sub(r"([\[ ]-?\d+)(e[-+]\d+)", r"\1.0\2", points)
        names = json.dumps(message["joint_names"])
        return [], ['{"trajectory": {', f'  "joint_names": {names},', '  "points": [', *points.split("\n"), "  ]}}"], []

    def read(self, source: str, body: Body, heading: Heading) -> list[Step]:
        """See :meth:`Dialect.read`."""
        try:
            data = parse_json("\n".join(line for _, line in body))
        except ValueError as error:
            raise TrajectoryError(source, str(error)) from error
        if not isinstance(data, dict) or set(data) != {"trajectory"}:
            raise TrajectoryError(source, "must contain the key trajectory and no other")
        # The stamp of a header would start the motion at another time, without the points before it.
        if not isinstance(data["trajectory"], dict) or set(data["trajectory"]) != {"joint_names", "points"}:
            raise TrajectoryError(source, "must contain the keys joint_names and points and no other", "trajectory")
        record = from_message(data["trajectory"], source)
        if record.joint_names != heading.joints:
            raise TrajectoryError(source, f"its joints are not {', '.join(heading.joints)}, as its comments state")
        return [StreamedTrajectory(record, body[0][0])]
