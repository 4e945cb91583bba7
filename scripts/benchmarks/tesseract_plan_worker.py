"""Plans with Tesseract for the planning benchmark, in an environment of its own that needs nothing of pinproof.

worker_peers.py starts it with the name of a pipeline. The protocol is that of mplib_worker.py. Bullet checks the
convex hulls of the meshes, which the URDF has to ask for.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

GROUP = "arm"
"""The group of the SRDF."""

KINEMATICS = """
kinematic_plugins:
  search_libraries:
    - tesseract_kinematics_kdl_factories
  fwd_kin_plugins:
    {group}:
      default: KDLFwdKinChain
      plugins:
        KDLFwdKinChain:
          class: KDLFwdKinChainFactory
          config: {{base_link: {base}, tip_link: {tip}}}
  inv_kin_plugins:
    {group}:
      default: KDLInvKinChainLMA
      plugins:
        KDLInvKinChainLMA:
          class: KDLInvKinChainLMAFactory
          config: {{base_link: {base}, tip_link: {tip}}}
"""


def _robot(job: dict[str, Any]) -> Any:
    """The robot among the obstacles. The SRDF names the plugins that Tesseract loads."""
    from tesseract_robotics.planning import Pose, Robot, box, create_obstacle, cylinder, sphere
    from tesseract_robotics.tesseract_common import GeneralResourceLocator

    srdf = Path(job["srdf"])
    plugins = srdf.with_name("kinematics.yaml")
    plugins.write_text(KINEMATICS.format(group=GROUP, base=job["base"], tip=job["tcp"]), encoding="utf-8")
    contact = GeneralResourceLocator().locateResource("package://tesseract/support/urdf/contact_manager_plugins.yaml")
    configs = (
        f'<kinematics_plugin_config filename="file://{plugins}"/>'
        f'<contact_managers_plugin_config filename="file://{contact.getFilePath()}"/></robot>'
    )
    srdf.write_text(srdf.read_text(encoding="utf-8").replace("</robot>", configs), encoding="utf-8")
    # Tesseract finds meshes by URLs only, and would read those of the pictures too
    urdf = Path(job["urdf"])
    tree = ElementTree.parse(urdf)
    tree.getroot().set("tesseract:make_convex", "true")
    tree.getroot().set("xmlns:tesseract", "https://tesseract")
    for link in tree.iter("link"):
        for picture in link.findall("visual"):
            link.remove(picture)
    for mesh in tree.iter("mesh"):
        mesh.set("filename", f"file://{(urdf.parent / mesh.get('filename')).resolve()}")
    tree.write(urdf)
    robot = Robot.from_files(urdf, srdf)
    shapes = {"Box": box, "Sphere": sphere, "Cylinder": cylinder}
    for name, kind, sizes, pose in job["obstacles"]:
        at = np.array(pose)
        placed = Pose.from_matrix_position(at[:3, :3], at[:3, 3])
        create_obstacle(robot, name, shapes[kind](*sizes), placed, parent_link=job["root"])
    for one, other in job["allowed"]:
        robot.add_allowed_collision(one, other, "stated")
    if job["held"]:
        robot.set_joints(job["held"])
    return robot


def _main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(content: dict[str, Any]) -> None:
        print(json.dumps(content), file=answers, flush=True)

    try:
        from tesseract_robotics.planning import JointTarget, MotionProgram, TaskComposer
        from tesseract_robotics.planning.profiles import (
            create_freespace_pipeline_profiles,
            create_trajopt_default_profiles,
        )

        pipeline = sys.argv[1]
        job = json.loads(sys.stdin.readline())
        names, robot, composer = job["joints"], _robot(job), TaskComposer.from_config()
        if pipeline == "TrajOptPipeline":
            profiles = create_trajopt_default_profiles()
        else:
            profiles = create_freespace_pipeline_profiles(
                num_planners=1, planning_time=job["time_limit"], optimize=False, max_solutions=1
            )
        composer.warmup([pipeline])
        answer({})
        for _ in sys.stdin:
            robot.set_joints(np.array(job["start"]), joint_names=names)
            program = MotionProgram(GROUP, tcp_frame=job["tcp"], working_frame=job["root"]).set_joint_names(names)
            for q in (job["start"], job["goals"][0]):
                program.move_to(JointTarget(np.array(q)))
            began = time.process_time()
            # OMPL knows a limit of elapsed time only: the system ends a process that works for longer
            resource.setrlimit(resource.RLIMIT_CPU, (int(began + job["processor_limit"]) + 1, resource.RLIM_INFINITY))
            result = composer.plan(robot, program, pipeline=pipeline, profiles=profiles)
            ms = {"plan": 1e3 * (time.process_time() - began)}
            path = None
            if result.successful:
                path = [[point.as_dict()[name] for name in names] for point in result.trajectory]
            answer({"path": path, "ms": ms, "message": "" if path else str(result.message)})
    except Exception as error:  # noqa: BLE001  # reported to the benchmark
        answer({"error": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    _main()
