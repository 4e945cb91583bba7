"""Test arms: catalogue robots, and small arms with known analytic solutions."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import pinproof as pp
from pinproof.model import load_robot

Planar = Callable[..., pp.Arm]


@pytest.fixture(scope="session")
def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm()


@pytest.fixture(scope="session")
def panda() -> pp.Arm:
    return pp.load_robot("panda").arm()


@pytest.fixture(scope="session")
def generic() -> pp.Arm:
    return pp.load_robot("generic_6dof").arm()


@pytest.fixture(scope="session")
def planar() -> Planar:
    """``planar("-3 3", "")``: links of 1 m in the xy plane; each joint turns about z within limits, "" is continuous.

    ``mimic="j1 0.5"`` hangs one more, unseen joint on the base that follows j1 by half.
    """

    def make(*limits: str, mimic: str = "") -> pp.Arm:
        parts = ['<robot name="planar"><link name="l0"/>']
        for i, bounds in enumerate(limits, 1):
            limit = '<limit lower="{}" upper="{}" velocity="1" effort="1"/>'.format(*bounds.split()) if bounds else ""
            parts.append(
                f'<link name="l{i}"/><joint name="j{i}" type="{"revolute" if bounds else "continuous"}">'
                f'<parent link="l{i - 1}"/><child link="l{i}"/><origin xyz="{min(i - 1, 1)} 0 0"/><axis xyz="0 0 1"/>'
                f"{limit}</joint>"
            )
        parts.append(
            f'<link name="tool"/><joint name="tool_joint" type="fixed"><parent link="l{len(limits)}"/>'
            '<child link="tool"/><origin xyz="1 0 0"/></joint>'
        )
        if mimic:
            leader, multiplier = mimic.split()
            parts.append(
                '<link name="side"/><joint name="follower" type="continuous"><parent link="l0"/><child link="side"/>'
                f'<axis xyz="0 0 1"/><mimic joint="{leader}" multiplier="{multiplier}"/></joint>'
            )
        return load_robot("".join([*parts, "</robot>"])).arm(tcp="tool")

    return make
