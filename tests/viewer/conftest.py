"""Arms, scenes and motions for the tests of the viewer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pinproof.collision import Box, CollisionChecker, Cylinder, Obstacle, Scene, certify
from pinproof.model import Arm, load_robot
from pinproof.motion import Trajectory
from pinproof.spatial import pose

from .browser import Browser, Page

LINKS = """<robot name="{name}">
  <link name="base">{base}</link>
  <link name="upper">{upper}</link>
  <link name="hand"/>
  <link name="tip"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="roll" type="revolute"><parent link="upper"/><child link="hand"/>
    <origin xyz="0.5 0 0"/><axis xyz="1 0 0"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="hand"/><child link="tip"/></joint>
</robot>"""
BASE = '<visual><geometry><cylinder radius="0.1" length="0.1"/></geometry><origin xyz="0 0 0.05"/></visual>'
UPPER = '<{kind}><geometry><box size="0.5 0.08 0.08"/></geometry><origin xyz="0.25 0 0.05"/></{kind}>'


def small_arm(*, name: str = "swing", base: str = BASE, upper: str | None = None) -> Arm:
    """A link of 0.5 m that turns about z and carries a hand that rolls about x."""
    upper = UPPER.format(kind="visual") + UPPER.format(kind="collision") if upper is None else upper
    return load_robot(LINKS.format(name=name, base=base, upper=upper)).arm("tip")


def swing(arm: Arm, start: float = 0.0, end: float = 1.0, duration: float = 2.0) -> Trajectory:
    """The first joint from start to end."""
    return Trajectory([0.0, duration], [[start, 0.0], [end, 0.0]], np.zeros((2, 2)), arm.joint_names)


POST = Obstacle("post", Cylinder(radius=0.05, length=1.0), pose(xyz=(0.0, 0.4, 0.5)))


@pytest.fixture(scope="session")
def ur5() -> Arm:
    return load_robot("ur5").arm(tcp="tool0")


@pytest.fixture(scope="session")
def panda() -> Arm:
    return load_robot("panda").arm()


@pytest.fixture(scope="session")
def cell() -> Scene:
    """A table and a bin beside the robot."""
    walls = {"left": (0.35, 0.3), "right": (0.75, 0.3)}
    blue = (0.25, 0.45, 0.70, 1.0)
    return Scene(
        [
            Obstacle("table", Box(1.2, 1.6, 0.05), pose(xyz=(0.35, 0.0, -0.03))),
            *(
                Obstacle(f"{k} wall", Box(0.02, 0.4, 0.18), pose(xyz=(x, y, 0.085)), blue)
                for k, (x, y) in walls.items()
            ),
            Obstacle("back wall", Box(0.38, 0.02, 0.18), pose(xyz=(0.55, 0.49, 0.085)), blue),
        ]
    )


def turn(arm: Arm, share: float = 1.0) -> Trajectory:
    """From home to the bin and down, or a share of it, in 2.2 s."""
    step = np.zeros(arm.dof)
    step[[0, 1, 3]] = share * 0.9, share * 0.5, share * -0.4
    q = arm.home + np.outer((0.0, 0.5, 1.0), step)
    return Trajectory([0.0, 1.0, 2.2], q, np.outer((0.0, 0.5, 0.0), step), arm.joint_names)


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("pages")
    return lambda name: folder / f"{name}.html"


def certified(arm: Arm, scene: Scene, motion: Trajectory, **settings: float) -> object:
    return certify(motion, CollisionChecker(arm, scene), **settings)


@pytest.fixture
def visit(browser: Browser, pages: Callable[[str], Path]) -> Iterator[Callable[..., Page]]:
    """Open a page by its name; at the end of the test it has no complaints and asked no network for anything."""
    opened = []

    def open_page(name: str, *size: int, at: str = "") -> Page:
        opened.append(browser.open(pages(name).as_uri() + at, *size))
        return opened[-1]

    yield open_page
    for page in opened:
        assert_quiet(page)


def assert_quiet(page: Page) -> None:
    """Close a page that complained about nothing and asked no network for anything."""
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    page.close()
