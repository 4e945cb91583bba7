"""Files of attached bodies: every key has a meaning, and what is written is read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.certificate import body_digest
from pinproof.errors import SceneError

ROD = pp.Obstacle("rod", pp.Cylinder(radius=0.02, length=0.1), pp.pose((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))


def test_a_saved_file_is_read_back(tmp_path: Path) -> None:
    corners = np.vstack([np.zeros(3), np.eye(3)])
    block = pp.Obstacle("block", pp.Mesh.from_arrays(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    given = pp.collision.Attachments(
        (ROD, block), (("rod", "block"),), {"rail": 0.5}, pp.pose((0, 0, 0.1), (0.1, 0.2, 0.3))
    )
    given.save(tmp_path / "tool.yaml")
    found = pp.collision.Attachments.load(tmp_path / "tool.yaml")
    assert [(b.name, b.shape) for b in found.bodies] == [(b.name, b.shape) for b in given.bodies]
    for one, other in zip(found.bodies, given.bodies, strict=True):
        np.testing.assert_allclose(one.pose.homogeneous, other.pose.homogeneous, atol=1e-15)
        assert body_digest(one) == body_digest(other)
    assert (found.allowed, found.held) == (given.allowed, given.held)
    np.testing.assert_allclose(found.tip.homogeneous, given.tip.homogeneous, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tool: []", ("'tool'", "allowed_contacts, attached, held, tip")),
        ("held: {}", ("does not state attached",)),
        ("attached: {}", ("key attached", "list")),
        ("attached: [rod]", ("attached[0]", "'rod'")),
        ("attached:\n  - {name: rod, sphere: {radius: 0.1}, colour: red}", ("line 2", "'colour'", "rgba")),
        ("attached:\n  - {name: rod, sphere: {radius: -1}}", ("line 2", "radius")),
        ("attached:\n  - {name: a, sphere: {radius: 1}}\n  - {name: a, sphere: {radius: 1}}", ("line 3", "'a'")),
        ("attached: []\nallowed_contacts: [[a]]", ("key allowed_contacts",)),
        ("attached: []\nheld: [1]", ("key held",)),
        ("attached: []\nheld: {rail: fast}", ("line 2", "key held", "rail")),
        ("attached: []\nheld: {rail: .nan}", ("line 2", "key held", "rail")),
        ("attached: []\ntip: {xyz: [0, 0, 0], spin: 1}", ("line 2", "key tip", "'spin'")),
        ("attached: []\ntip: [0, 0, 0]", ("key tip",)),
        ("attached: []\ntip: {xyz: [0, 0]}", ("line 2", "key tip")),
    ],
)
def test_meaningless_values_are_refused_with_their_location(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    file = tmp_path / "tool.yaml"
    file.write_text(text)
    with pytest.raises(SceneError) as caught:
        pp.collision.Attachments.load(file)
    assert str(caught.value).startswith(str(file))
    for word in words:
        assert word in str(caught.value)


def test_a_digest_follows_name_shape_pose_and_the_content_of_meshes(tmp_path: Path) -> None:
    other = (
        pp.Obstacle("rod2", ROD.shape, ROD.pose),
        pp.Obstacle("rod", pp.Cylinder(radius=0.02, length=0.1000001), ROD.pose),
        pp.Obstacle("rod", ROD.shape, pp.pose((0.1, 0.2, 0.3 + 1e-8), (0.4, 0.5, 0.6))),
    )
    assert len({body_digest(body) for body in (ROD, *other)}) == 4
    digests = []
    for name, width in (("a", 1), ("b", 1), ("c", 2)):
        file = tmp_path / f"{name}.obj"
        file.write_text(f"v 0 0 0\nv {width} 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
        digests.append(body_digest(pp.Obstacle("part", pp.Mesh(file))))
    assert digests[0] == digests[1] != digests[2]
