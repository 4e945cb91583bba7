import http.client
import socket
import subprocess
import sys

import numpy as np
import pytest

from pinproof.collision import CollisionChecker, Scene
from pinproof.errors import InputError, ViewerError
from pinproof.ik import AnalyticIk
from pinproof.model import load_robot
from pinproof.viewer import show

from .browser import PATIENCE
from .conftest import POST, small_arm, swing


def get(view, path="/", host=None):
    address = view.url.removeprefix("http://").rstrip("/")
    connection = http.client.HTTPConnection(address, timeout=PATIENCE)
    try:
        connection.request("GET", path, headers={"Host": host or address})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def port_of(view):
    return int(view.url.rstrip("/").rsplit(":", 1)[1])


def test_the_page_is_served_on_loopback_only():
    with show(small_arm()) as view:
        assert view._server.socket.getsockname()[0] == "127.0.0.1"
        status, text = get(view)
        assert status == 200
        assert "connect-src 'self'" in text
        assert get(view, "/etc/passwd")[0] == 404
        assert get(view, host="evil.example:80")[0] == 403  # a foreign name that points here
        with pytest.raises(InputError):
            view.move_to([0.0])


def test_two_views_take_two_ports_and_a_taken_port_is_named():
    with show(small_arm()) as one, show(small_arm()) as other:
        assert one.url != other.url
        with pytest.raises(ViewerError, match=str(port_of(one))):
            show(small_arm(), port=port_of(one))


def test_closing_frees_the_port_and_may_be_done_twice():
    view = show(small_arm())
    port = port_of(view)
    assert not view.wait(0)
    view.close()
    view.close()
    assert view.wait(0)
    assert not view._thread.is_alive()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)


@pytest.mark.slow
def test_nothing_is_printed_and_the_program_ends_by_itself():
    script = (
        "import urllib.request; import pinproof as pp; "
        "view = pp.show(pp.load_robot('ur5').arm()); urllib.request.urlopen(view.url).read()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE, check=True)
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.slow
def test_a_view_shows_a_slider_for_the_elbow_until_the_arm_is_moved():
    arm = load_robot("panda").arm()
    motion = AnalyticIk(redundant_steps=12).self_motion(arm, arm.forward_kinematics(arm.home), arm.home)
    with show(arm, elbow=motion.curves[-1]) as view:
        page = get(view)[1]
        assert f'"parameter":{{"name":"panda_joint7","unit":"rad","first":{motion.curves[-1].lower}' in page
        view.move_to(arm.home)
        assert '"parameter":null' in get(view)[1]
        with pytest.raises(InputError, match="elbow and check"):
            view.replace(None, elbow=motion, check=CollisionChecker(arm).check(arm.home))
    with pytest.raises(InputError, match="another arm"):
        show(load_robot("ur5").arm(), elbow=motion)


def test_an_open_page_follows_the_arm_and_shows_the_end_of_the_view(browser):
    arm = small_arm()
    view = show(arm)
    try:
        page = browser.open(view.url)
        at_home = page.canvas()
        view.move_to([1.0, 0.0])
        turned = "pinproof.viewer.scene_tree.find(['robot', 'upper']).object.quaternion.z"
        page.wait_for(f"Math.abs({turned} - {np.sin(0.5)}) < 1e-6")
        assert not np.array_equal(page.canvas(), at_home)
        late = browser.open(view.url)  # a page that comes later sees the arm where it is now
        late.wait_for(f"Math.abs({turned} - {np.sin(0.5)}) < 1e-6")
        late.close()
        view.replace(None, swing(arm))
        page.wait_for("window.pinproof && pinproof.settings.duration === 2")
        view.move_to([0.0, 0.0])  # a still picture again
        page.wait_for("window.pinproof && pinproof.settings.duration === 0")
        page.wait_for(
            "window.pinproof && pinproof.events.readyState === EventSource.OPEN"
        )  # before the view says goodbye
        assert page.complaints == []
    finally:
        view.close()
    page.wait_for("!document.getElementById('away').hidden")
    page.close()


def test_an_open_page_comes_back_when_there_is_a_view_at_its_address_again(browser):
    arm = small_arm()
    with show(arm, title="first") as view:
        port = port_of(view)
        page = browser.open(view.url)
        page.wait_for("pinproof.events.readyState === EventSource.OPEN")
    page.wait_for("!document.getElementById('away').hidden")
    with show(arm, None, swing(arm), title="second", port=port):
        page.wait_for("document.title === 'second' && window.pinproof && pinproof.settings.duration === 2")
        assert page.evaluate("document.getElementById('away').hidden")
        page.close()


def test_a_check_is_shown_no_more_once_the_arm_has_moved_away(browser):
    arm, scene = small_arm(), Scene([POST])
    touching = [1.5, 0.0]
    with show(arm, scene, q=touching, check=CollisionChecker(arm, scene).check(touching)) as view:
        page = browser.open(view.url)
        assert page.text("#verdict") == "IN CONTACT"
        view.move_to([0.0, 0.0])
        page.wait_for("window.pinproof && document.getElementById('verdict').textContent === 'CONFIGURATION'")
        page.wait_for("window.pinproof && pinproof.settings.touching.length === 0")
        page.close()
