# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A real browser without a window, where Chromium is installed; driven by its DevTools protocol.

That is documented at chromedevtools.github.io/devtools-protocol. It goes through two pipes, so no
package is needed, no port is open, and the browser ends with this process, however that ends.
Playwright and Selenium bring, or fetch, a browser or a driver of their own.

    .venv/bin/python test/browser.py    # says in one line which browser the tests will use
"""

import base64
import json
import os
from pathlib import Path
import shutil
import subprocess
import tempfile
import threading
import time

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable', 'chrome')
PATIENCE = 60.0  # s
_FLAGS = (
    '--headless=new', '--remote-debugging-pipe', '--force-device-scale-factor=1',
    # Draws on the processor, so the same on every machine.
    '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-dev-shm-usage',
    # Nothing of its own goes to the network, and no other name than this machine's is found.
    '--no-first-run', '--no-default-browser-check', '--disable-background-networking',
    '--disable-component-update', '--disable-default-apps', '--disable-extensions',
    '--disable-sync', '--no-proxy-server', '--password-store=basic',
    '--host-resolver-rules=MAP evil.example 127.0.0.1, MAP * ~NOTFOUND, EXCLUDE localhost, '
    'EXCLUDE 127.0.0.1')


def find_browser():
    """Path of a Chromium, '' where there is none; ICOFABRIC_BROWSER names another, or none."""
    given = os.environ.get('ICOFABRIC_BROWSER')
    if given is not None:
        return shutil.which(given) or ''
    return next(filter(None, map(shutil.which, NAMES)), '')


class Browser:
    """A browser with one tab."""

    def __init__(self, *, width=1280, height=800):
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._log = Path(self._folder.name) / 'log'
        self._numbers, self._answers, self._arrived = 0, {}, threading.Condition()
        self.requests, self.console = [], []
        root = ['--no-sandbox'] if os.geteuid() == 0 else []  # refuses to start else
        theirs, mine = os.pipe()
        answers, theirs_out = os.pipe()
        with open(self._log, 'wb') as log:
            # The browser's ends are 3 and 4.
            self.process = subprocess.Popen(
                ['bash', '-c', f'exec "$0" "$@" 3<&{theirs} 4>&{theirs_out}', find_browser(),
                 *_FLAGS, *root, f'--window-size={width},{height}',
                 f'--user-data-dir={Path(self._folder.name) / "profile"}', 'about:blank'],
                stdout=subprocess.DEVNULL, stderr=log, pass_fds=(theirs, theirs_out),
                start_new_session=True)
        os.close(theirs)
        os.close(theirs_out)
        self._commands, self._replies = open(mine, 'wb', buffering=0), open(answers, 'rb')
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        try:
            self._session = None
            tab = self.send('Target.createTarget', url='about:blank')['targetId']
            self._session = self.send(
                'Target.attachToTarget', targetId=tab, flatten=True)['sessionId']
            for domain in ('Page', 'Network', 'Runtime', 'Log'):
                self.send(f'{domain}.enable')
            # The page speaks to its server from a worker.
            self.send('Target.setAutoAttach', autoAttach=True, waitForDebuggerOnStart=True,
                      flatten=True)
            self.send('Emulation.setDeviceMetricsOverride', width=width, height=height,
                      deviceScaleFactor=1, mobile=False)
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, kind, error, traceback):
        self.close()

    def close(self):
        try:
            self.send('Browser.close')
            self.process.wait(10.0)
        except Exception:  # noqa: BLE001 - it is ended in any case
            self.process.kill()
            self.process.wait(PATIENCE)
        self._commands.close()
        self._listener.join(PATIENCE)
        self._replies.close()
        self._folder.cleanup()

    def send(self, method, **words):
        """The result of a command of the protocol."""
        number = self._post(method, self._session, words)
        with self._arrived:
            assert self._arrived.wait_for(lambda: number in self._answers, PATIENCE), (
                f'{method}; {find_browser()} says {self._log.read_text()[-1000:]}')
            answer = self._answers.pop(number)
        assert 'error' not in answer, f'{method}: {answer.get("error")}'
        return answer['result']

    def open(self, address):
        self.send('Page.navigate', url=address)

    def ask(self, expression):
        """The value of an expression of JavaScript in the page, awaited."""
        found = self.send(
            'Runtime.evaluate', expression=expression, awaitPromise=True, returnByValue=True)
        assert 'exceptionDetails' not in found, f'{expression}: {found["exceptionDetails"]}'
        return found['result'].get('value')

    def wait_for(self, condition, what):
        """The first value of an expression, or of a function, that is true."""
        deadline = time.monotonic() + PATIENCE
        while True:
            found = condition() if callable(condition) else self.ask(condition)
            if found:
                return found
            assert time.monotonic() < deadline, f'{what}; the page said {self.console[-5:]}'
            time.sleep(0.05)

    def mouse(self, kind, place, buttons=0):
        """Do `pressed`, `moved`, `released` at a place (x, y) [pixels]."""
        self.send(
            'Input.dispatchMouseEvent', type=f'mouse{kind.capitalize()}', x=float(place[0]),
            y=float(place[1]), button='left' if buttons or kind == 'released' else 'none',
            buttons=buttons, clickCount=int(kind != 'moved'))

    def click(self, place):
        self.mouse('moved', place)
        self.mouse('pressed', place, 1)
        self.mouse('released', place)

    def type_in(self, text):
        """Replace what stands in the field that has the focus, and press Enter."""
        self.send('Input.dispatchKeyEvent', type='keyDown', key='a', modifiers=2,
                  commands=['selectAll'])
        self.send('Input.insertText', text=text)
        for kind in ('keyDown', 'keyUp'):
            self.send('Input.dispatchKeyEvent', type=kind, key='Enter', code='Enter',
                      windowsVirtualKeyCode=13)

    def screenshot(self):
        """The page as it is drawn, the bytes of a PNG."""
        return base64.b64decode(self.send('Page.captureScreenshot', format='png')['data'])

    def _post(self, method, session, words):
        of_session = {} if session is None else {'sessionId': session}
        with self._arrived:
            self._numbers += 1
            self._commands.write(json.dumps({
                'id': self._numbers, 'method': method, 'params': words,
                **of_session}).encode() + b'\0')
            return self._numbers

    def _listen(self):
        data = bytearray()
        while chunk := self._replies.read1(1 << 20):
            *whole, rest = (data + chunk).split(b'\0')
            data = bytearray(rest)
            for text in whole:
                self._take(json.loads(text))

    def _take(self, message):
        if 'id' in message:
            with self._arrived:
                self._answers[message['id']] = message
                self._arrived.notify_all()
            return
        method, words = message['method'], message['params']
        if method == 'Target.attachedToTarget':
            for command in ('Network.enable', 'Runtime.runIfWaitingForDebugger'):
                self._post(command, words['sessionId'], {})
        elif method == 'Network.requestWillBeSent':
            self.requests.append(words['request']['url'])
        elif method == 'Network.webSocketCreated':
            self.requests.append(words['url'])
        elif method == 'Runtime.exceptionThrown':
            self.console.append(words['exceptionDetails'].get('exception', {}).get(
                'description', words['exceptionDetails']['text']))
        elif method == 'Log.entryAdded' and words['entry']['level'] == 'error':
            self.console.append(words['entry']['text'])
        elif method == 'Runtime.consoleAPICalled' and words['type'] in ('error', 'warning'):
            self.console.append(' '.join(
                str(part.get('value', part.get('description'))) for part in words['args']))


if __name__ == '__main__':
    found = find_browser()
    print(f'browser for the tests of the viewer: {found}' if found else (
        'no Chromium: the page of the viewer is not tested in a browser (apt install chromium)'))
