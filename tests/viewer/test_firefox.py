"""A page that computes in Firefox, with real keys and a real mouse: the same answers as in Python and in Chromium."""

import json

import numpy as np
import pytest

from pinproof.collision import CollisionChecker, certify
from pinproof.verifier import verify
from pinproof.viewer import write_html

from .conftest import certified, turn
from .firefox import Firefox, find_firefox
from .test_live_page import PLACE, agrees

RIGHT = "\ue014"
"""The code of the right arrow key."""


@pytest.fixture(scope="module")
def firefox(tmp_path_factory):
    executable = find_firefox()
    if executable is None:
        pytest.skip("Firefox or Xvfb is not installed")
    browser = Firefox(executable, tmp_path_factory.mktemp("firefox") / "profile")
    yield browser
    browser.close()


@pytest.mark.slow
def test_a_page_that_computes_has_the_same_answers_in_firefox(firefox, pages, ur5, cell):
    motion, checker = turn(ur5), CollisionChecker(ur5, cell)
    write_html(pages("fox"), ur5, cell, motion, certificate=certified(ur5, cell, motion), checker=checker)
    firefox.open(pages("fox").as_uri() + "#t=1.0")
    firefox.wait_for("pinproof.model")
    firefox.wait_for(f"Math.abs(pinproof.model.now().q[0] - {motion(1.0)[0]}) < 1e-3")
    # The motion, and the proof that the page verifies again
    assert np.allclose(agrees(firefox, checker), motion(1.0), atol=1e-3)
    firefox.click("#verify")
    firefox.wait_for(
        "document.querySelector('#proof .state').textContent && !document.getElementById('verify').disabled"
    )
    verdict = verify(json.loads(certify(motion, checker, record=True).proof_text()))
    words = firefox.evaluate("document.querySelector('#proof .state').textContent")
    assert words.startswith(f"The proof holds: all {verdict.pairs} checked pairs of bodies")
    # Keys move a joint
    firefox.click("#live summary")
    firefox.wait_for("document.querySelector('#live details').open")
    firefox.evaluate("document.querySelector('#live input[type=range]').focus()")
    firefox.keys(RIGHT)
    firefox.wait_for("pinproof.model.now().trying")
    q = agrees(firefox, checker)
    assert q[0] > motion(1.0)[0] + 0.01
    assert np.allclose(q[1:], motion(1.0)[1:], atol=1e-3)
    # The mouse drags the target, and the arm follows
    before = ur5.forward_kinematics(q)
    for _ in range(5):  # a press that comes while the page is laid out again turns the camera instead
        start = firefox.evaluate(PLACE % tuple(before.translation))
        firefox.drag(start, (start[0] - 50, start[1] - 30))
        if not np.array_equal(agrees(firefox, checker), q):
            break
    after = ur5.forward_kinematics(agrees(firefox, checker))
    assert np.linalg.norm(after.translation - before.translation) > 0.03
    assert np.allclose(after.rotation, before.rotation, atol=1e-6)
    assert np.allclose(firefox.evaluate(PLACE % tuple(after.translation)), (start[0] - 50, start[1] - 30), atol=8)
