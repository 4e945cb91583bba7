from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.collision import CertificateStatus, CollisionChecker, LookAt, Scene, Upright, certify
from pinproof.model import JointLimits
from pinproof.viewer.picture import caption_of, proven_millimetres

from .conftest import POST, certified, small_arm, swing

SCENE = Scene([POST])


def test_free_states_the_clearance_and_the_duration() -> None:
    arm = small_arm()
    motion = swing(arm, 0.0, 0.8)
    certificate = certified(arm, SCENE, motion)
    shown = caption_of(arm, SCENE, motion, certificate)
    assert (shown.headline, shown.tone) == ("FREE", "free")
    figures = dict(shown.figures)
    assert figures["Duration"] == "2.00 s"
    assert 0 < float(figures["Proven clearance"].removesuffix(" mm")) <= certificate.clearance * 1e3


def test_pairs_excluded_from_the_proof_are_listed() -> None:
    arm = small_arm()
    motion = swing(arm, 0.0, 0.8)
    scene = Scene([POST], allowed=[("upper", "post")])
    certificate = certified(arm, scene, motion)
    shown = caption_of(arm, scene, motion, certificate)
    ((_, excluded),) = shown.lists
    assert len(excluded) == len(certificate.excluded) > 0
    assert any("upper" in text and "post" in text for text in excluded)


def test_constraints_are_stated_with_their_bound_or_their_violation() -> None:
    arm = small_arm()
    motion = swing(arm, 0.0, 0.8)
    checker = CollisionChecker(arm, SCENE)
    vertical = Upright.keeping(arm, motion.start, tolerance=0.1)
    kept = caption_of(arm, SCENE, motion, certify(motion, checker, constraints=[vertical]))
    level = LookAt(point=arm.forward_kinematics(motion.start).act(np.array([0.3, 0.0, 1.0])), tolerance=1e-3)
    lost = caption_of(arm, SCENE, motion, certify(motion, checker, constraints=[level]))
    assert kept.headline == "FREE"
    assert "upright" in dict(kept.figures)["Constraint"].lower()
    assert (lost.headline, lost.tone) == ("NOT VALIDATED", "open")
    assert "too much" in lost.reason


def test_without_a_certificate_it_is_not_validated() -> None:
    arm = small_arm()
    shown = caption_of(arm, SCENE, swing(arm), None)
    assert (shown.headline, shown.tone) == ("NOT VALIDATED", "open")
    assert "no certificate" in shown.reason


def test_a_free_certificate_of_another_motion_arm_or_scene_does_not_count() -> None:
    arm = small_arm()
    motion = swing(arm, 0.0, 0.8)
    certificate = certified(arm, SCENE, motion)
    assert certificate.status is CertificateStatus.FREE
    nudged = swing(arm, 0.0, np.nextafter(0.8, 1.0))
    elsewhere = SCENE.remove("post")
    other_arm = small_arm().robot.arm("hand")
    for curve, who, scene in (
        (nudged, arm, SCENE),
        (motion, arm, elsewhere),
        (motion, other_arm, SCENE),
        (motion, arm, None),
    ):
        shown = caption_of(who, scene, curve, certificate)
        assert shown.headline == "NOT VALIDATED"
        assert "another motion, arm, scene or tool" in shown.reason


def test_no_scene_and_an_empty_scene_are_the_same() -> None:
    arm = small_arm()
    motion = swing(arm)
    assert caption_of(arm, None, motion, certified(arm, Scene(), motion)).headline == "FREE"


def test_a_collision_is_captioned_with_bodies_and_time() -> None:
    arm = small_arm()
    motion = swing(arm, 0.0, 1.5)
    certificate = certified(arm, SCENE, motion)
    shown = caption_of(arm, SCENE, motion, certificate)
    assert (shown.headline, shown.tone) == ("NOT VALIDATED", "colliding")
    assert {"upper", "post"} <= set(shown.reason.split())
    assert f"at {certificate.first_contact.time:.3f} s" in shown.reason


def test_undecided_is_not_validated() -> None:
    arm = small_arm()
    motion = swing(arm, -1.8, 0.8)
    certificate = certified(arm, SCENE, motion, max_intervals=1)
    assert certificate.status is CertificateStatus.UNDECIDED
    shown = caption_of(arm, SCENE, motion, certificate)
    assert (shown.headline, shown.tone) == ("NOT VALIDATED", "open")
    assert shown.reason.startswith("Undecided")


def test_a_picture_without_a_motion_is_not_validated() -> None:
    shown = caption_of(small_arm(), None, None, None)
    assert shown.headline == "NOT VALIDATED"


def test_every_text_is_escaped() -> None:
    html = caption_of(small_arm(name="&lt;img src=x&gt;"), None, None, None).html(["<b>note</b>"])
    assert "<img" not in html
    assert "&lt;img src=x&gt;" in html
    assert "&lt;b&gt;note" in html


@given(st.floats(0, 10))
def test_a_clearance_is_never_rounded_up(clearance: float) -> None:
    shown = float(proven_millimetres(clearance).removesuffix(" mm"))
    assert shown <= clearance * 1e3 + 1e-9
    assert shown == pytest.approx(clearance * 1e3, abs=0.1001)


def test_a_motion_outside_its_limits_is_not_validated_with_the_joint() -> None:
    arm = small_arm()
    motion = swing(arm, -2.0, 0.8)
    shown = caption_of(arm, Scene(), motion, certify(motion, CollisionChecker(arm, Scene())))
    assert (shown.headline, shown.tone) == ("NOT VALIDATED", "open")
    assert "turn reaches a velocity of" in shown.reason
    left_out = caption_of(arm, Scene(), motion, certify(motion, CollisionChecker(arm, Scene()), limits=None))
    assert left_out.headline == "FREE"
    assert dict(left_out.figures)["Joint limits"].startswith("not compared; turn reaches a velocity of")
    faster = JointLimits(arm.limits.lower, arm.limits.upper, 9 * arm.limits.velocity)
    for_others = caption_of(arm, Scene(), motion, certify(motion, CollisionChecker(arm, Scene()), limits=faster))
    assert dict(for_others.figures)["Joint limits"].startswith("not those of the arm; turn reaches a velocity of")
    slow = motion.slowed(9.0)
    kept = caption_of(arm, Scene(), slow, certify(slow, CollisionChecker(arm, Scene())))
    assert dict(kept.figures)["Joint limits"].startswith("within the limits of position")
