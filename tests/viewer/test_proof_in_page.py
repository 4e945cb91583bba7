"""A page verifies the proof of its motion on request, in a real browser."""

import base64
import json
import zlib

from pinproof.collision import CollisionChecker, Scene, certify
from pinproof.verifier import verify
from pinproof.viewer import web_cell, write_html

from .conftest import POST, certified, small_arm, swing, turn


def test_a_page_verifies_its_proof_on_request(visit, pages, ur5, cell):
    motion = turn(ur5, 0.3)
    certificate = certified(ur5, cell, motion)
    assert certificate.free
    write_html(pages("proven"), ur5, cell, motion, certificate=certificate)
    words = verified(visit("proven", 1000, 700, at="#t=0"))
    recorded = certify(motion, CollisionChecker(ur5, cell), record=True)
    verdict = verify(json.loads(recorded.proof_text()))
    assert words.startswith(f"The proof holds: all {verdict.pairs} checked pairs of bodies stay more than ")
    shown = float(words.split("more than ")[1].split(" mm")[0])  # rounded down
    assert 1e3 * verdict.clearance - 0.0011 < shown <= 1e3 * verdict.clearance + 1e-9
    assert f"({verdict.intervals} inequalities" in words


def test_a_page_refuses_a_proof_that_was_tampered_with_damaged_or_of_another_motion(visit, pages):
    arm, checker = small_arm(), CollisionChecker(small_arm(), Scene([POST]))
    motion = swing(arm, end=0.8)
    recorded = certify(motion, checker, record=True)
    assert recorded.free
    write_html(pages("doubtful"), arm, Scene([POST]), motion, certificate=recorded)
    page = visit("doubtful", 1000, 700, at="#t=0")
    assert verified(page).startswith("The proof holds")
    tampered = json.loads(recorded.proof_text())
    tampered["settings"]["margin"] = 0.5
    slower = certify(swing(arm, end=0.8, duration=3.0), checker, record=True).proof_text()
    packed = packed_text(recorded.proof_text())
    for text, words in (
        (packed_text(json.dumps(tampered)), "does NOT hold"),
        (packed_text(slower), "for another motion"),
        (packed_text(recorded.proof_text()[:-40]), "could not be verified"),
        (packed[:400] + "AAAA" + packed[404:], "could not be verified"),
        (packed[:400], "could not be verified"),
        ("\u20ac", "could not be verified"),
    ):
        page.evaluate(f"document.getElementById('proof-file').textContent = {json.dumps(text)}")
        assert words in verified(page)


def verified(page):
    """What the page states after it has verified its proof."""
    page.wait_for("pinproof.model", 60)
    page.click("#verify")
    page.wait_for("!document.getElementById('verify').disabled", 60)
    return page.text("#proof .state")


def packed_text(document):
    return base64.b64encode(zlib.compress(document.encode())).decode()


def test_a_page_with_too_large_a_proof_states_how_python_verifies_it(visit, pages, ur5, cell, monkeypatch):
    monkeypatch.setattr(web_cell, "MOST_BYTES", 20_000)
    motion = turn(ur5)
    write_html(pages("large"), ur5, cell, motion, certificate=certified(ur5, cell, motion), live=True)
    page = visit("large", 1000, 700)
    assert "python -m pinproof.verifier proof.json" in page.text("#proof")
    assert page.evaluate("document.getElementById('verify')") is None
    assert 'id="proof-file"' not in pages("large").read_text(encoding="utf-8")
