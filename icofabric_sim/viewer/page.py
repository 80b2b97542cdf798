# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The page: a viser server, the thread that sends frames, and dragging with the mouse.

The client of viser is part of its wheel, so that nothing is downloaded.
"""

from contextlib import redirect_stdout
from importlib import import_module
import io
import logging
import socket
import threading
import time
from typing import Any

from icofabric_sim.libraries import require_library
from icofabric_sim.viewer.actions import Actions, MouseDrags
from icofabric_sim.viewer.flow import Flow
from icofabric_sim.viewer.guard import Guard
from icofabric_sim.viewer.panel import Panel
from icofabric_sim.viewer.sight import Sight
from icofabric_sim.viewer.stage import Stage
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
# Intervals between updates of the panel's texts and samples of its plots [s].
_TEXT_INTERVAL_S, _SAMPLE_INTERVAL_S = 0.5, 0.1
# Time for pages to confirm that they are closed [s].
_CLOSING_S = 0.3
# Angle of view of a new page [rad], and its distance as a multiple of the fabric's size.
_VIEW_ANGLE, _DISTANCE_RATIO = 0.6, 1.9


def require_viser() -> None:
    """Raise MissingLibrary if viser is not installed."""
    require_library('viser', 'the viewer')


def require_address(host: str) -> None:
    """Raise ValueError if `host` is not a local address; viser would wait for ever."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            host, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        with socket.socket(family, kind, protocol) as trial:
            trial.bind(place)
    except (OSError, UnicodeError) as error:
        raise ValueError(f'host {host!r} is not an address of this machine: {error}') from error


class Page:
    """Server of one address for any number of browsers."""

    def __init__(
        self, sight: Sight, actions: Actions | None, *, host: str = '127.0.0.1', port: int = 8080,
        rate: float = 60.0, token: str = '',
    ) -> None:
        """
        Serve the data of `sight` at up to `rate` [Hz]; read-only without `actions`.

        If the port is taken, the next free one is used. `token` is that of an earlier page.
        """
        require_viser()
        require_address(host)
        # An extra: no dependency of the package.
        viser = import_module('viser')
        self._sight, self._rate = sight, rate
        self._guard = Guard(host, token)
        # The caller prints the address; viser must not print another one.
        with self._guard.installed(), redirect_stdout(io.StringIO()):
            self.server: Any = viser.ViserServer(
                host=host, port=port, label='icofabric', verbose=False)
        self._close_tunnels()
        self._flow = Flow(_VIEW_ANGLE)
        self._flow.pace(self.server._websock_server.get_message_buffer())
        # Pages that were open on the same address reconnect.
        self.server._websock_server.disconnect_all_clients()
        self._host, self.port = host, int(self.server.get_port())
        self.stage = Stage(self.server.scene, sight)
        self.grip = None if actions is None or actions.is_replay else MouseDrags(
            actions.pull, self._flow.is_silent)
        self.panel = Panel(self.server, sight, self.stage, actions)
        self._followed: np.ndarray | None = None
        self._poses, self._shift = np.zeros((0, 7)), 1e-6
        self._seen = self._aimed = -1
        self._stopping = threading.Event()
        self.server.on_client_disconnect(self._remove_client)
        self.server.on_client_connect(self._add_client)
        self._thread = threading.Thread(target=self._serve, name='page', daemon=True)
        self._thread.start()

    @property
    def token(self) -> str:
        """Return the token of a page for other machines."""
        return self._guard.token

    @property
    def address(self) -> str:
        """Return the address to open."""
        host = 'localhost' if self._guard.is_local else self._host
        token = f'/?token={self._guard.token}' if self._guard.token else '/'
        return f'http://{host}:{self.port}{token}'

    def close(self) -> None:
        """Close all pages and release the shells that they hold."""
        self._stopping.set()
        self._thread.join(5.0)
        if self.grip is not None:
            for page in list(self.server.get_clients()):
                self.grip.release(page)
        loop = self.server.get_event_loop()
        loop.call_soon_threadsafe(loop.call_later, _CLOSING_S, self._guard.abort_connections)
        with redirect_stdout(io.StringIO()):
            self.server.stop()

    def frame(self) -> None:
        """Send changed data if a page has drawn the frames sent before."""
        sight = self._sight
        if self.grip is not None:
            self.grip.repeat()
        if not self._flow.is_free():
            return
        if sight.pose_number != self._seen:
            self._seen, self._poses = sight.pose_number, sight.poses()
        lines = np.zeros((0, 2, 3))
        if self.grip is not None:
            lines = self.grip.lines(self._poses)
            # Changes in each frame, so that a page that holds a shell has something to answer.
            self._shift = -self._shift
            lines[:, 1] *= 1.0 + self._shift
        sent = self.stage.frames
        with self.server.atomic():
            if self.stage.update(lines, self._poses):
                self._connect_drags()
                # Keep the cameras if only a parameter of the same bodies has changed.
                if len(self._poses) != self._aimed:
                    self._aimed = len(self._poses)
                    self._point_cameras(self.server.get_clients().values())
        if self.stage.frames != sent or len(lines):
            # Otherwise viser waits for the duration of a frame and a little more.
            self.server.flush()
        self._follow()

    def _close_tunnels(self) -> None:
        """Disable requests of a page for a public address through viser's share service."""
        request = import_module('viser._messages').ShareUrlRequest
        server = self.server._websock_server
        server.unregister_handler(request)
        server.register_handler(request, lambda client, message: None)

    def _serve(self) -> None:
        words = samples = 0.0
        period, due = 1.0 / self._rate, time.monotonic()
        while not self._stopping.is_set():
            began = time.monotonic()
            try:
                self.frame()
                if began - samples > _SAMPLE_INTERVAL_S:
                    samples = began
                    self._sight.sample()
                if began - words > _TEXT_INTERVAL_S and self._flow.is_free():
                    words = began
                    self.panel.update()
            except Exception:  # logged with traceback; the pages continue with later frames
                _LOGGER.exception('the viewer could not draw a frame')
                self._stopping.wait(1.0)
            # A wait ends slightly late; the next one compensates.
            due = max(due + period, time.monotonic() - period)
            self._stopping.wait(max(due - time.monotonic(), 0.001))
            # Poses that arrive at the frame rate arrive at other times within a frame.
            self._sight.news.wait(period)
            self._sight.news.clear()

    def _connect_drags(self) -> None:
        """Connect mouse drags to the new shells."""
        if self.grip is None:
            return
        grip = self.grip

        @self.stage.shells.on_drag('left')  # type: ignore[untyped-decorator]
        async def _(event: Any) -> None:
            body, page, metre = event.instance_index, event.client_id, self.stage.scale
            self._flow.hear(page)
            if event.phase == 'end' or body is None:
                grip.release(page)
            elif event.phase == 'start' and body < len(self._poses):
                grip.take(
                    page, body, self._poses[body, :3], np.array(event.start_position) / metre,
                    np.array(event.end_position) / metre)
            else:
                grip.move(page, np.array(event.end_position) / metre)

    def _add_client(self, client: Any) -> None:
        self._flow.begin(client)
        self._point_cameras([client])

    def _remove_client(self, client: Any) -> None:
        self._flow.end(client.client_id)
        if self.grip is not None:
            self.grip.release(client.client_id)

    def _point_cameras(self, clients: Any) -> None:
        """Point the cameras of `clients` at the whole fabric."""
        poses, fabric = self._poses, self._sight.fabric
        if fabric is None or not len(poses):
            return
        seen = poses[fabric.seen, :3]
        low, high = seen.min(axis=0), seen.max(axis=0)
        half_edge = float(fabric.scene.body_half_edges.max())
        middle = self.stage.scale * 0.5 * (low + high)
        size = self.stage.scale * (float(np.linalg.norm(high - low)) + 5.0 * half_edge)
        place = middle + _DISTANCE_RATIO * size * np.array([0.5, -0.8, 0.35])
        for camera in (self.server.initial_camera, *(client.camera for client in clients)):
            # In this order: a new position shifts the look-at point along.
            camera.position = place
            camera.look_at = middle
            camera.fov = _VIEW_ANGLE

    def _follow(self) -> None:
        """Move the cameras with the followed body."""
        body = self.panel.follow
        if not 0 <= body < len(self._poses):
            self._followed = None
            return
        place = self.stage.scale * self._poses[body, :3]
        before = self._followed
        if before is None:
            self._followed = place
            return
        shift = place - before
        # viser ignores changes that are small compared with the camera's position.
        if not np.linalg.norm(shift) > 0.01:
            return
        self._followed = place
        for client in self.server.get_clients().values():
            # Shifts the look-at point as well.
            client.camera.position = np.asarray(client.camera.position) + shift
