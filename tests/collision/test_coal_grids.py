"""Why height maps and point clouds are triangles here: defects of coal's height fields and octrees."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from pinproof import PointCloud
from pinproof.collision.geometry.bodies import shape_body


def test_height_fields_of_coal_know_no_distance():
    field = coal.HeightFieldOBBRSS(1.0, 1.0, np.zeros((3, 3)), -0.1)
    with pytest.raises(ValueError, match="not implemented"):
        apart(field, coal.Sphere(0.1), 1.0)


def test_octrees_of_coal_cannot_be_relied_on():
    """Two of them always touch, one order of an ellipsoid and one is unknown, and what lies far out is dropped."""
    cell = coal.makeOctree(np.array([[0.05, 0.05, 0.05]]), 0.1)
    assert touching(cell, cell, 3.0)
    assert apart(cell, cell, 3.0) == pytest.approx(2.9)
    with pytest.raises(ValueError, match="not yet supported"):
        apart(coal.Ellipsoid(0.1, 0.1, 0.1), cell, 1.0)
    wide = coal.makeOctree(np.array([[0.0, 0.0, 0.0], [40_000.5, 0.5, 0.5]]), 1.0)
    assert not touching(wide, coal.Sphere(0.1), 40_000.5)
    cloud = PointCloud([[0, 0, 0], [9_000.5, 0.5, 0.5]], 0.1)
    body = shape_body("wide", "wide", None, cloud, pin.SE3.Identity())
    assert touching(body.geometry, coal.Sphere(1.0), 9_000.5)


def apart(a, b, x) -> float:
    places = coal.Transform3s(), coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0]))
    return float(coal.distance(a, places[0], b, places[1], coal.DistanceRequest(), coal.DistanceResult()))


def touching(a, b, x) -> bool:
    places = coal.Transform3s(), coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0]))
    return bool(coal.collide(a, places[0], b, places[1], coal.CollisionRequest(), coal.CollisionResult()))
