# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: what it loads and draws, and what mouse and keyboard do there."""

from functools import partial
import http.server
import io
import signal
import threading

from browser import Browser, find_browser
import pytest

if not find_browser():
    pytest.skip('no Chromium on this machine', allow_module_level=True)
pytest.importorskip('viser', reason='viser (extra `viewer`) is not installed')

from icofabric_sim.messages import decode_point_stamped  # noqa: E402, I100 - after what skips
from icofabric_sim.viewer import flow  # noqa: E402 - after what skips
import numpy as np  # noqa: E402 - after what skips
from PIL import Image  # noqa: E402 - viser brings it
from shown_page import Shown  # noqa: E402 - needs viser

# On the page, of shells whose edge is 0.02 m.
METRE = 10.0
# Of each shell: where the scene graph has it (3) [m], and where the camera sees it (2) [pixels].
SHELLS = """(() => {
    let mesh = null;
    const node = window.__viserMutable?.nodeRefFromName['/shells'];
    node?.traverse(item => { if (item.isInstancedMesh2) mesh = item; });
    if (!mesh) return null;
    mesh.updateWorldMatrix(true, false);
    const {camera, canvas} = window.__viserMutable, box = canvas.getBoundingClientRect();
    return [...Array(mesh.instancesCount).keys()].map(body => {
        const place = mesh.getPositionAt(body).clone();
        const seen = place.clone().applyMatrix4(mesh.matrixWorld).project(camera);
        return [...place.divideScalar(METRE).toArray(), box.left + box.width * (1 + seen.x) / 2,
                box.top + box.height * (1 - seen.y) / 2];
    });
})()""".replace('METRE', str(METRE))
# Middle of the control [pixels] whose label is TEXT: a button, or the field beside it.
CONTROL = """(() => {
    const named = [...document.querySelectorAll('label, button')].filter(
        item => item.textContent.trim() === TEXT)[0];
    let item = named;
    while (item && item.tagName !== 'BUTTON' && !item.querySelector('input:not([type=hidden])'))
        item = item.parentElement;
    if (!item) return null;
    if (item.tagName !== 'BUTTON') item = item.querySelector('input:not([type=hidden])');
    item.scrollIntoView({block: 'center'});
    const box = item.getBoundingClientRect();
    return [box.left + box.width / 2, box.top + box.height / 2];
})()"""


@pytest.fixture(scope='module')
def shown():
    with Shown(
            start_paused=True, weave={'size': [3, 3, 3], 'connector_angle': 0.25},
            groups={'top': 'z_max', 'tip': 'ids 1'},
            supports={'top': {'group': 'top', 'fix': 'all'}}) as found:
        yield found


@pytest.fixture(scope='module')
def browser():
    with Browser(width=900, height=640) as found:
        yield found


@pytest.fixture(scope='module')
def page(shown, browser):
    """The page in the browser, with its shells drawn."""
    browser.open(shown.page.address)
    browser.wait_for(SHELLS, 'no shells')
    browser.wait_for(
        'window.__viserTestpoints?.rendererInfo.render.frame > 3', 'nothing is drawn')
    return browser


def poses(shown):
    return shown.runner.post(
        lambda: shown.runner.simulation.snapshot().position.copy()).result(60.0)


def pixels(browser):
    return np.asarray(Image.open(io.BytesIO(browser.screenshot())).convert('RGB'), float)


def control(browser, label):
    return browser.wait_for(CONTROL.replace('TEXT', repr(label)), f'no control {label!r}')


def nearest_free_shell(shown, page):
    """Number of the free shell that the camera has nothing before, and where it is seen."""
    seen = np.array(page.ask(SHELLS))
    camera = np.array(list(shown.page.server.get_clients().values())[-1].camera.position) / METRE
    held = shown.sight.fabric.held
    away = np.where(held, np.inf, np.linalg.norm(seen[:, :3] - camera, axis=1))
    body = int(np.argmin(away))
    return body, seen[body, 3:]


def test_nothing_is_fetched_from_elsewhere_and_no_script_fails(shown, page):
    own = (f'http://localhost:{shown.port}/', f'ws://localhost:{shown.port}/')
    for start in own:
        assert any(address.startswith(start) for address in page.requests)
    assert not [
        address for address in page.requests if not address.startswith((*own, 'data:', 'blob:'))]
    assert not [text for text in page.console if 'deprecated' not in text]


def test_shells_are_drawn_where_the_poses_say(shown, page):
    expected = poses(shown)
    page.wait_for(
        lambda: np.allclose(np.array(page.ask(SHELLS))[:, :3], expected, atol=1e-6),
        'shells are elsewhere')
    body, (column, row) = nearest_free_shell(shown, page)
    picture = pixels(page)
    high, wide, _ = picture.shape
    assert 0.1 * wide < column < 0.9 * wide and 0.1 * high < row < 0.9 * high
    row, column = round(row), round(column)
    red, green, blue = picture[row - 2:row + 3, column - 2:column + 3].mean(axis=(0, 1))
    assert 245.0 > red > green > blue + 3.0, 'no sand-coloured shell'
    # Around it as much is drawn as a shell takes, and there is nothing at the rim.
    window = picture[row - 40:row + 41, column - 40:column + 41]
    assert (window.min(axis=2) < 245.0).mean() > 0.2
    assert (picture[-10:, :10] > 250.0).all()


def test_a_drag_pulls_a_shell_and_moves_the_fabric(shown, page):
    body, place = nearest_free_shell(shown, page)
    before = poses(shown)
    background = pixels(page)
    shown.inputs.messages.clear()
    shown.runner.set_paused(False).result(60.0)
    try:
        page.mouse('moved', place)
        page.mouse('pressed', place, 1)
        for part in range(1, 6):
            page.mouse('moved', place + [0.0, 24.0 * part], 1)
        page.wait_for(
            lambda: shown.runner.simulation.inputs.pulls.bodies == [body], 'nothing is pulled')
        # Down on the page is down in the world, and the others come along.
        page.wait_for(lambda: poses(shown)[body, 2] < before[body, 2] - 0.01, 'it stays')
        free = ~shown.sight.fabric.held
        assert np.linalg.norm(poses(shown) - before, axis=1)[free].min() > 1e-6
        page.wait_for(
            lambda: page.ask(SHELLS)[body][4] > place[1] + 5.0, 'the page does not follow')
        assert (np.abs(pixels(page) - background).max(axis=2) > 20.0).sum() > 200
        targets = [
            decode_point_stamped(data) for topic, _, data in shown.inputs.messages
            if topic == '~/pull']
        assert targets[-1].frame_id == f'icosahedron_{body}'
        assert targets[-1].point[2] < before[body, 2] - 0.01
    finally:
        page.mouse('released', place + [0.0, 120.0])
    page.wait_for(lambda: not shown.runner.simulation.inputs.pulls.bodies, 'it is not let go')
    shown.runner.reset().result(60.0)
    shown.runner.set_paused(True).result(60.0)


def test_a_browser_that_is_stopped_lets_go(shown, page, monkeypatch):
    """Its main process alone: the page draws on then, but no mouse reaches the page."""
    def pulled():
        return shown.runner.simulation.inputs.pulls.bodies

    body, place = nearest_free_shell(shown, page)
    shown.runner.set_paused(False).result(60.0)
    page.mouse('moved', place)
    page.mouse('pressed', place, 1)
    page.mouse('moved', place + [0.0, 12.0], 1)
    page.wait_for(lambda: pulled() == [body], 'nothing is pulled')
    monkeypatch.setattr(flow, '_SILENCE_S', 3.0)
    page.process.send_signal(signal.SIGSTOP)
    try:
        page.wait_for(lambda: not pulled(), 'it is held on')
    finally:
        page.process.send_signal(signal.SIGCONT)
        page.mouse('released', place + [0.0, 12.0])
    shown.runner.reset().result(60.0)
    shown.runner.set_paused(True).result(60.0)


def test_a_field_changes_a_parameter_and_the_answer_is_shown(shown, page):
    page.click(control(page, 'Stiffness [N/m]'))
    page.type_in('350')
    page.wait_for(
        lambda: shown.runner.parameters['connector.stiffness'] == 350.0, 'stiffness stays')
    page.wait_for("document.body.innerText.includes('connector.stiffness is set')", 'no answer')


def test_a_slider_changes_a_parameter(shown, page):
    control(page, 'Gravity z [m/s^2]')
    left, top, width = page.ask("""(() => {
        const id = [...document.querySelectorAll('label')].filter(
            item => item.textContent === 'Gravity z [m/s^2]')[0].htmlFor;
        const box = document.getElementById(id).getBoundingClientRect();
        return [box.left, box.top + 0.4 * box.height, box.width];
    })()""")
    start = (left + 0.5 * width, top)
    page.mouse('moved', start)
    page.mouse('pressed', start, 1)

    def follows():
        # The slider looks at the mouse once a frame, and frames are slow here: it moves on until
        # it is seen, as a hand would.
        for part in (0.24, 0.25):
            page.mouse('moved', (left + part * width, top), 1)
        return shown.runner.parameters['gravity'][2] == pytest.approx(-10.0, abs=2.0)

    page.wait_for(follows, 'gravity stays')
    page.mouse('released', (left + 0.25 * width, top))
    assert shown.runner.parameters['gravity'][:2] == [0.0, 0.0]


def test_a_refusal_is_shown_in_words(shown, page):
    page.click(control(page, 'Start recording'))
    page.wait_for("document.body.innerText.includes('recording is not available')", 'no refusal')
    page.wait_for("document.body.innerText.includes('refused')", 'it does not say so')


class _Blank(http.server.BaseHTTPRequestHandler):
    """A page of somebody else."""

    def do_GET(self):  # noqa: N802 - as http.server wants it
        self.send_response(200)
        self.send_header('Content-Type', 'text/html')
        self.end_headers()
        self.wfile.write(b'<html><body>elsewhere</body></html>')

    def log_message(self, *words):
        """Say nothing."""


def test_another_page_gets_no_socket_and_no_other_name_leads_here(shown, page):
    socket = f"""new Promise(done => {{
        const socket = new WebSocket(
            'ws://localhost:{shown.port}/', 'viser-v' + {page_version()!r});
        socket.onopen = () => done('open');
        socket.onerror = () => done('refused');
    }})"""
    assert page.ask(socket) == 'open'  # from its own page
    server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), _Blank)
    thread = threading.Thread(target=partial(server.serve_forever, 0.05), daemon=True)
    thread.start()
    try:
        for host in ('localhost', 'evil.example'):
            page.console.clear()
            page.open(f'http://{host}:{server.server_port}/')
            page.wait_for("document.body?.innerText === 'elsewhere'", 'no other page')
            assert page.ask(socket) == 'refused'
            page.wait_for(lambda: any('403' in text for text in page.console), 'not by us')
    finally:
        server.shutdown()
        thread.join(60.0)
        server.server_close()
    # A name of another owner that leads to this machine, as in DNS rebinding.
    page.open(f'http://evil.example:{shown.port}/')
    page.wait_for("document.body?.innerText.includes('is not this machine')", 'it is let in')


def page_version():
    import viser
    return viser.__version__
