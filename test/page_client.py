# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A page without a browser: what a client of viser is sent, and what its hands send back."""

import threading
import time

import numpy as np
import pytest

viser = pytest.importorskip('viser', reason='viser (extra `viewer`) is not installed')

import msgspec  # noqa: E402, I100 - viser brings it
from websockets.exceptions import ConnectionClosed  # noqa: E402
from websockets.sync.client import connect  # noqa: E402
import zstandard  # noqa: E402

PATIENCE = 60.0  # s
METRE = 10.0  # on the page, of shells whose edge is 0.02 m


class PageClient:
    """Holds the scene graph and the controls as a browser would."""

    def __init__(self, port, **words):
        self.socket = connect(
            f'ws://localhost:{port}/', subprotocols=[f'viser-v{viser.__version__}'],
            max_size=None, compression=None, **words)
        self.nodes, self.controls, self.notices = {}, {}, []
        self.frames = self.bytes = 0
        self.draws = True  # and says so: else no more frames come than can be under way
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        # A page counts once it has said where its camera stands.
        self._say_camera(1.0)

    def __enter__(self):
        return self

    def __exit__(self, kind, error, traceback):
        self.socket.close()
        self._thread.join(PATIENCE)

    def wait_for(self, condition, what):
        deadline = time.monotonic() + PATIENCE
        while True:
            found = condition()
            if found:
                return found
            assert time.monotonic() < deadline, what
            time.sleep(0.01)

    def send(self, kind, **fields):
        self.socket.send(msgspec.msgpack.encode({'type': kind, **fields}))

    def drag(self, phase, body, grasp, point):
        self.send(
            'SceneNodeDragMessage', phase=phase, name='/shells', instance_index=body,
            start_position=[METRE * float(part) for part in grasp],
            start_screen_pos=[0.5, 0.5], end_position=[METRE * float(part) for part in point],
            end_screen_pos=[0.5, 0.5], button='left', modifier=None, owner='')

    def control(self, label):
        """Number of a control; waits until it is there."""
        return self.wait_for(lambda: next(
            (key for key, item in list(self.controls.items()) if item.get('label') == label),
            None), label)

    def set(self, label, value):
        self.send('GuiUpdateMessage', uuid=self.control(label), updates={'value': value})

    def button(self, label):
        """Number of the row of buttons that has this one; waits until it is there."""
        return self.wait_for(lambda: next(
            (key for key, item in list(self.controls.items())
             if 'ButtonGroup' in item.get('kind', '') and label in item['options']), None), label)

    def press(self, label):
        self.send('GuiUpdateMessage', uuid=self.button(label), updates={'value': label})

    def shown(self, text):
        """Whether a text stands on the page."""
        return any(text in str(item) for item in list(self.controls.values()))

    def shells(self):
        """Positions (n, 3) of the shells [m], None before they are there."""
        node = self.nodes.get('/shells')
        return None if node is None else np.frombuffer(
            node['batched_positions'], np.float32).reshape(-1, 3) / METRE

    def _say_camera(self, fov):
        self.send(
            'ViewerCameraMessage', wxyz=[1.0, 0.0, 0.0, 0.0], position=[1.0, 1.0, 1.0], fov=fov,
            near=0.01, far=100.0, image_height=600, image_width=800, look_at=[0.0, 0.0, 0.0],
            up_direction=[0.0, 0.0, 1.0])

    def _listen(self):
        try:
            while True:
                self._take(self.socket.recv())
        except (ConnectionClosed, OSError):
            pass

    def _take(self, data):
        size = int.from_bytes(data[8:16], 'little')
        whole = msgspec.msgpack.decode(
            zstandard.ZstdDecompressor().decompress(data[16:16 + size]))
        place, buffers = 16 + size, []
        for length in whole['binaryBufferLengths']:
            place += -place % 8
            buffers.append(data[place:place + length])
            place += length
        self.bytes += len(data)
        for message in whole['messages']:
            self._note(message, buffers)

    def _note(self, message, buffers):
        def filled(values):
            return {
                name: buffers[value['__binary_index']]
                if isinstance(value, dict) and '__binary_index' in value else value
                for name, value in values.items()}

        kind = message['type']
        if kind == 'SceneNodeUpdateMessage':
            self.frames += 'batched_positions' in message['updates'] and (
                message['name'] == '/shells')
            self.nodes.setdefault(message['name'], {}).update(filled(message['updates']))
        elif kind == 'SetCameraFovMessage' and not message['initial'] and self.draws:
            self._say_camera(message['fov'])
        elif kind == 'RemoveSceneNodeMessage':
            self.nodes.pop(message['name'], None)
        elif kind == 'GuiUpdateMessage':
            self.controls.setdefault(message['uuid'], {}).update(message['updates'])
        elif kind == 'NotificationShowMessage':
            self.notices.append(str(message))
        elif 'uuid' in message and 'props' in message:
            self.controls[message['uuid']] = {
                **message['props'], 'value': message.get('value'), 'kind': kind}
        elif 'name' in message and 'props' in message:
            self.nodes[message['name']] = {**filled(message['props']), 'kind': kind}
