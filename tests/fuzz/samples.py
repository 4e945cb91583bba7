"""Files that are right, each with as much of its format in it as a small file holds, and the readers they are for."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

import pinproof as pp
from pinproof.description import read_calibration, read_srdf
from pinproof.model import JointLimits

from ..model import calibrations

__all__ = ["MJCF", "READERS", "SRDF", "TABLES", "TREES", "URDF", "write_parts"]

DH = {
    "name": "arm",
    "convention": "standard",
    "base": {"xyz": [0, 0, 0.1], "rpy": [0, 0, "pi/2"]},
    "tool": {"xyz": [0, 0, 0.1], "quat_xyzw": [0, 0, 0, 1]},
    "rows": [
        {
            "name": "j1",
            "type": "revolute",
            "theta": 0,
            "d": 0.33,
            "a": 0,
            "alpha": "pi/2",
            "lower": "-pi",
            "upper": "pi",
        },
        {"name": "j2", "theta": "-pi/2", "d": 0, "a": 0.4, "alpha": 0, "velocity": 2.5},
        {"name": "j3", "type": "prismatic", "theta": 0, "d": 0.1, "a": 0, "alpha": 0, "lower": 0, "upper": 0.3},
    ],
}
TETRAHEDRON = {
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "triangles": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
}
SCENE = {
    "obstacles": [
        {
            "name": "table",
            "box": [1.6, 1.2, 0.04],
            "xyz": [0.4, 0, -0.025],
            "rpy": [0, 0, "pi/2"],
            "rgba": [0, 0, 1, 1],
        },
        {"name": "ball", "sphere": {"radius": 0.1}, "quat_xyzw": [0, 0, 0, 1]},
        {"name": "pipe", "capsule": {"radius": 0.02, "length": 0.3}},
        {"name": "bolt", "cylinder": {"radius": 0.008, "length": 0.04}},
        {"name": "egg", "ellipsoid": {"rx": 0.1, "ry": 0.1, "rz": 0.2}},
        {"name": "floor", "half_space": {}, "xyz": [0, 0, -0.1]},
        {"name": "hull", "convex_shape": {"points": TETRAHEDRON["vertices"], "radius": 0.01}},
        {"name": "file", "mesh": {"path": "part.stl", "scale": 0.001, "hull": True, "hollow": False}},
        {"name": "mesh", "mesh": {**TETRAHEDRON, "hull": False}},
        {"name": "cloud", "point_cloud": {"points": [[0, 0, 0], [0.1, 0, 0]], "resolution": 0.01}},
        {
            "name": "camera",
            "occupancy_grid": {
                "voxel": 0.1,
                "unknown": "free",
                "bounds": [[0, 0, 0], [0.2, 0.2, 0.2]],
                "views": [
                    {
                        "image": "view.npy",
                        "intrinsics": {"fx": 4, "fy": 4, "cx": 1.5, "cy": 1, "width": 4, "height": 3},
                        "camera": {"xyz": [0.1, 0.1, 0.8], "rpy": ["pi", 0, 0]},
                        "depth_scale": 1.0,
                        "depth_uncertainty": 0.01,
                        "pixel_margin": 0,
                    },
                    {
                        "points": "cloud.npy",
                        "intrinsics": {"fx": 4, "fy": 4, "cx": 1.5, "cy": 1, "width": 4, "height": 3},
                        "camera": {"xyz": [0.1, 0.1, 0.8], "rpy": ["pi", 0, 0]},
                    },
                ],
            },
        },
        {
            "name": "map",
            "occupancy_grid": {
                "voxel": 0.1,
                "low": [0, 0, -1],
                "count": [1, 1, 3],
                "cells": "eNpjYGQCAAAHAAQ=",
                "record": ["a map"],
            },
        },
        {
            "name": "octree",
            "occupancy_grid": {"octomap": "map.ot", "bounds": [[0, 0, 0], [0.2, 0.2, 0.2]], "threshold": 0.6},
        },
        {"name": "ground", "height_map": {"heights": [[0, 0.1], [0, 0]], "x": 2, "y": 2, "bottom": -0.1}},
    ],
    "allowed_contacts": [["base_link", "table"]],
    "disabled_pairs": [["a", "b"]],
    "frame": "base_link",
}
POSE = {"position": {"x": 0, "y": 0, "z": 1.0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
MOVEIT = {
    "name": "cell",
    "robot_state": {"multi_dof_joint_state": {"transforms": [{"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}]}},
    "fixed_frame_transforms": [
        {
            "header": {"frame_id": "world"},
            "child_frame_id": "cell",
            "transform": {"translation": {"x": 1.0}, "rotation": {"w": 1}},
        }
    ],
    "allowed_collision_matrix": {
        "entry_names": ["a", "table", "b"],
        "entry_values": [{"enabled": [True, True, False]}, [True, True, True], [False, True, True]],
        "default_entry_names": ["mesh"],
        "default_entry_values": [False],
    },
    "link_padding": [{"link_name": "a", "padding": 0.0}],
    "object_colors": [{"id": "table", "color": {"r": 0.1, "g": 0.2, "b": 0.3, "a": 1.0}}],
    "world": {
        "collision_objects": [
            {
                "id": "table",
                "header": {"frame_id": "cell"},
                "pose": POSE,
                "primitives": [{"type": 1, "dimensions": [1, 1, 0.1]}, {"type": "cylinder", "dimensions": [1.0, 0.1]}],
                "primitive_poses": [POSE, {"position": [0, 0, 1], "orientation": [0, 0, 0, 1]}],
                "operation": 0,
            },
            {
                "id": "mesh",
                "meshes": [{**TETRAHEDRON, "triangles": [{"vertex_indices": t} for t in TETRAHEDRON["triangles"]]}],
                "mesh_poses": [POSE],
            },
            {"id": "file", "meshes": [{"resource": "package://parts/part.stl", "dimensions": [0.001] * 3}]},
            {"id": "plane", "planes": [{"coef": [0, 0, 1, 0.5]}], "plane_poses": [POSE]},
        ]
    },
}
PICKS = {
    "robot": "ur5",
    "tcp": "tool0",
    "held": {"finger": 0.04},
    "scene": "scene.yaml",
    "margin": 0.002,
    "home": {"shoulder_pan_joint": 0, "elbow_joint": "pi/2"},
    "tip": {"xyz": [0, 0, 0.105]},
    "tool": [{"name": "picker", "cylinder": {"radius": 0.02, "length": 0.1}, "xyz": [0, 0, 0.05]}],
    "fingers": {
        "opening": 0.08,
        "grip": 0.04,
        "axis": [0, 1, 0],
        "bodies": [{"name": "left", "box": [0.01, 0.01, 0.05]}, {"name": "right", "box": [0.01, 0.01, 0.05]}],
    },
    "gripper": ["panda_leftfinger"],
    "frames": {"tray": {"xyz": [0.4, 0, 0], "rpy": [0, 0, "pi/2"], "frame": "table"}},
    "defaults": {"rpy": ["pi", 0, 0], "approach": 0.1, "retreat": 0.1},
    "picks": [
        {"name": "bolt_1", "xyz": [0.46, 0.15, 0.035]},
        {"name": "turned", "frame": "tray", "xyz": [0, 0, 0.02], "spin": "free", "quat_xyzw": [1, 0, 0, 0]},
        {
            "name": "part",
            "xyz": [0, 0, 0.02],
            "spin": {"range": ["-pi", "pi"], "steps": 12},
            "tolerance": {"position": [0.005, 0.005, 0], "tilt": 0.1},
            "approach_direction": [0, 0, 1],
            "approach_frame": "tip",
            "retreat_frame": "root",
            "object": "part_{i}_{j}",
            "support": "tray_floor",
            "place": {"frame": "tray", "xyz": [0, 0.3, 0.02], "rpy": ["pi", 0, 0], "approach": 0.1, "support": "bin"},
            "pattern": {"grid": {"counts": [4, 3, 1], "step": [0.05, 0.05, 0]}},
        },
        {"name": "own", "xyz": [0, 0, 0], "object": {"box": [0.1, 0.1, 0.1], "xyz": [0, 0, 0.1]}, "spin": [0, "pi/2"]},
    ],
}
MESSAGE = {
    "joint_names": ["a", "b"],
    "points": [
        {
            "positions": [0.0, 1.0],
            "velocities": [0.0, 0.0],
            "accelerations": [0, 0],
            "time_from_start": {"sec": 0, "nanosec": 0},
        },
        {
            "positions": [0.5, 1.5],
            "velocities": [1, 0.1],
            "accelerations": [0, 0],
            "time_from_start": {"sec": 1, "nanosec": 5},
        },
        {"positions": [1.0, 2.0], "velocities": [0.0, 0.0], "accelerations": [1, 0], "time_from_start": 2.5},
    ],
}
LIMITS = {
    "joint_limits": {
        "j1": {
            "has_velocity_limits": True,
            "max_velocity": 3.15,
            "has_acceleration_limits": True,
            "max_acceleration": 5.0,
        },
        "j2": {"has_position_limits": True, "min_position": -3.1, "max_position": 3.1, "has_jerk_limits": False},
        "j3": {
            "has_acceleration_limits": True,
            "max_acceleration": 5,
            "has_deceleration_limits": True,
            "max_deceleration": -4,
        },
    },
    "default_velocity_scaling_factor": 0.1,
}

URDF = """<robot name="two">
<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
<link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link>
<link name="arm"><visual><origin xyz="0 0 1" rpy="0 0 1.57"/><geometry><box size="1 2 3"/></geometry>
<material name="grey"/></visual><collision><geometry><cylinder radius="0.1" length="0.4"/></geometry></collision>
</link>
<link name="slide"><collision><geometry><mesh filename="package://parts/part.stl" scale="0.001 0.001 0.001"/>
</geometry>
</collision><collision><geometry><sphere radius="0.1"/></geometry></collision></link><link name="finger"/>
<link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 1" rpy="0 1 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
<joint name="out" type="prismatic"><parent link="arm"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" velocity="2" effort="1"/></joint>
<joint name="grip" type="prismatic"><parent link="slide"/><child link="finger"/>
<mimic joint="out" multiplier="-1" offset="0"/>
<limit lower="0" upper="1" velocity="2" effort="1"/></joint>
<joint name="roll" type="continuous"><parent link="slide"/><child link="tip"/></joint></robot>"""
SRDF = """<robot name="two"><group name="all"><joint name="turn"/><chain base_link="base" tip_link="tip"/>
<group name="hand"/>
</group><group name="hand"><link name="finger"/></group><group_state name="home" group="all">
<joint name="turn" value="0.5"/>
<joint name="roll" value="1 0"/></group_state>
<end_effector name="hand" parent_link="tip" group="hand" parent_group="all"/>
<disable_collisions link1="base" link2="arm" reason="Adjacent"/><disable_default_collisions link="tip"/>
<enable_collisions link1="arm" link2="tip"/></robot>"""
MJCF = """<mujoco model="two"><compiler angle="radian" eulerseq="xyz" meshdir="." autolimits="true"/>
<default><joint axis="0 1 0"/><default class="big"><geom size="0.1 0.2" rgba="1 0 0 1"/></default></default>
<asset><mesh name="part" file="part.stl" scale="0.001 0.001 0.001"/></asset>
<worldbody><body name="base" pos="0 0 1" quat="1 0 0 0" childclass="big"><geom type="capsule" fromto="0 0 0 0 0 1"/>
<joint name="turn" type="hinge" range="-1 1"/><site name="eye" pos="0 0 0.1" axisangle="0 0 1 1.57"/>
<body name="arm" euler="0 0 1"><joint name="out" type="slide" axis="1 0 0" pos="0 0 0.1" range="0 1"/>
<joint name="roll" ref="0"/><geom type="mesh" mesh="part" contype="1" group="3"/>
<geom type="box" size="1 1 1" xyaxes="1 0 0 0 1 0"/>
<body name="tip" zaxis="0 1 1"><joint name="grip" type="slide"/></body></body></body></worldbody>
<equality><joint joint1="grip" joint2="out" polycoef="0 1 0 0 0"/></equality>
<contact><exclude body1="base" body2="arm"/></contact>
<keyframe><key name="home" qpos="0 0.1 0.2 0"/></keyframe></mujoco>"""

DH_CSV = """# convention: standard
name,type,theta,d,a,alpha,lower,upper,velocity
j1,revolute,0,0.33,0,pi/2,-pi,pi,3
j2,prismatic,0,0.1,0,-pi/2,0,0.5,
"""
PICKS_CSV = """name,x,y,z,roll,pitch,yaw,frame,spin,object,place_x,place_y,place_z,place_roll,place_pitch,place_yaw
a,0.46,0.15,0.035,pi,0,0,tray,free,part,0.1,0.2,0.3,pi,0,0
b,0.46,0.15,0.035,pi,0,0,,0.5,,,,,,,
"""


def _trajectory_csv() -> str:
    from pinproof.motion.trajectory_files import Record, to_csv

    clock = np.array([0, 10**9, 2 * 10**9])
    return to_csv(Record(("a", "b"), clock, np.eye(3, 2), np.zeros((3, 2)), np.zeros((3, 2)), "as given"))


def _robot(path: Path) -> object:
    robot = pp.load_robot(path)
    arm = robot.arm(tcp=robot.urdf.links[-1])
    return arm.forward_kinematics(arm.home)


def _picks(path: Path) -> object:
    picks = pp.read_picks(path)
    return [pick.before(pick.pose) for pick in picks]


def yaml_text(tree: Any) -> str:
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # ten times faster, if PyYAML contains libyaml
    return yaml.dump(tree, Dumper=dumper, sort_keys=False, allow_unicode=True, default_flow_style=None)


READERS: dict[str, Callable[[Path], object]] = {
    "dh.yaml": pp.DhTable.load,
    "scene.yaml": pp.Scene.load,
    "moveit.yaml": pp.Scene.load,
    "picks.yaml": _picks,
    "picks.json": _picks,
    "message.yaml": pp.Trajectory.load,
    "message.json": pp.Trajectory.load,
    "limits.yaml": JointLimits.load,
    "proof.json": pp.verify_proof,
    "dh.csv": pp.DhTable.load,
    "calibration.conf": read_calibration,
    "kinematics.yaml": read_calibration,
    "deltas.csv": read_calibration,
    "picks.csv": _picks,
    "trajectory.csv": pp.Trajectory.load,
    "robot.urdf": _robot,
    "robot.xml": _robot,
    "robot.srdf": read_srdf,
}
"""By the name of the file."""

_PERTURBED = calibrations.perturbed("ur5", 1)
KINEMATICS = yaml.safe_load(calibrations.kinematics_text(_PERTURBED))
TREES = {
    "kinematics.yaml": (KINEMATICS, yaml_text),
    "dh.yaml": (DH, yaml_text),
    "scene.yaml": (SCENE, yaml_text),
    "moveit.yaml": (MOVEIT, yaml_text),
    "picks.yaml": (PICKS, yaml_text),
    "picks.json": (PICKS, json.dumps),
    "message.yaml": (MESSAGE, yaml_text),
    "message.json": (MESSAGE, json.dumps),
    "limits.yaml": (LIMITS, yaml_text),
}
"""What stands in a file, and how it is written."""

TABLES = {
    "dh.csv": DH_CSV,
    "picks.csv": PICKS_CSV,
    "trajectory.csv": _trajectory_csv(),
    "calibration.conf": calibrations.conf_text("ur5", _PERTURBED),
    "deltas.csv": calibrations.csv_text("ur5", _PERTURBED),
}


def write_parts(folder: Path) -> None:
    """Write the files that the samples name."""
    trimesh.creation.box((100, 100, 100)).export(folder / "part.stl")
    np.save(folder / "view.npy", np.full((3, 4), 0.8))
    np.save(folder / "cloud.npy", np.array([[0.1, 0.1, 0.0]]))
    free_root = struct.pack("<fB", -1.0, 0)
    (folder / "map.ot").write_bytes(b"# Octomap OcTree file\nid OcTree\nsize 1\nres 0.1\ndata\n" + free_root)
