# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Control panel of the page: status of the run, commands, parameters, legend and plots.

Sliders follow the values in force, so that changes from other clients are shown too. A rejected
change shows the reason, and the slider returns.
"""

from collections.abc import Callable
from concurrent.futures import Future
from importlib import import_module
import threading
import time
from typing import Any, NamedTuple

from icofabric_sim.checks import counted
from icofabric_sim.messages.markers import STRAIN_CLASSES
from icofabric_sim.viewer.actions import Actions
from icofabric_sim.viewer.sight import Curve, Fabric, Sight
from icofabric_sim.viewer.stage import rgb, Stage
import numpy as np

LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')
# Time after the last input for which the user owns the time slider of a replay [s].
_USER_HOLD_S = 1.5
# Colours of Okabe and Ito, distinguishable with colour blindness, and dash patterns of plots.
_LINE_STYLES: tuple[tuple[str, tuple[float, ...]], ...] = (
    ('#0072b2', ()), ('#d55e00', (6, 4)), ('#009e73', (2, 3)), ('#cc79a7', (8, 3, 2, 3)))


class Slider(NamedTuple):
    """Slider of a numeric parameter."""

    name: str
    label: str
    low: float
    high: float
    step: float
    part: int | None = None  # of a parameter that is a list


SLIDERS = (
    Slider('pull.strength', 'Drag force scale', 0.1, 100.0, 0.1),
    Slider('gravity', 'Gravity z [m/s^2]', -20.0, 20.0, 0.01, 2),
    Slider('connector.stiffness', 'Stiffness [N/m]', 0.0, 5000.0, 1.0),
    Slider('connector.damping', 'Damping [N s/m]', 0.0, 2.0, 0.01),
    Slider('real_time_factor', 'Real-time factor', 0.0, 4.0, 0.05),
)
MENUS = {'weave.kind': ('orthogonal', 'bias', 'radial'), 'weave.variant': ('0', '1', '2', '3')}


class PendingChanges:
    """Pending changes: one at a time for each parameter, then the latest requested value."""

    def __init__(
        self, change: 'Callable[[str, Any], Future[str]]', answer: Callable[[str, str, bool], None]
    ) -> None:
        """Send changes through `change`; `answer` receives name, message and success."""
        self._change, self._answer = change, answer
        self._lock = threading.Lock()
        self._under_way: set[str] = set()
        self._waiting: dict[str, Any] = {}

    def request(self, name: str, value: Any) -> None:
        """Request a value now, or after the pending request is answered."""
        with self._lock:
            if name in self._under_way:
                self._waiting[name] = value
                return
            self._under_way.add(name)
        self._send(name, value)

    def is_open(self, name: str) -> bool:
        """Return whether a request for the parameter is pending."""
        return name in self._under_way

    def _send(self, name: str, value: Any) -> None:
        try:
            future = self._change(name, value)
        except Exception as error:  # noqa: BLE001 - shown on the page
            future = Future()
            future.set_exception(error)
        future.add_done_callback(lambda done: self._done(name, done))

    def _done(self, name: str, future: 'Future[str]') -> None:
        error = future.exception()
        if error is None:
            self._answer(name, future.result(), True)
        else:
            self._answer(name, str(error) or type(error).__name__, False)
        with self._lock:
            if name not in self._waiting:
                self._under_way.discard(name)
                return
            value = self._waiting.pop(name)
        self._send(name, value)


def _as_code(text: str) -> str:
    """Return external text as inline code, because other text would be rendered as HTML."""
    plain = ' '.join(text.replace('`', "'").split())
    return f'`{plain or "-"}`'


class Panel:
    """Controls shared by all pages."""

    def __init__(self, server: Any, sight: Sight, stage: Stage, actions: Actions | None) -> None:
        """Create the panel on a viser server; read-only without `actions`."""
        self._server, self._sight, self._stage, self._hands = server, sight, stage, actions
        self.answer = ''
        self.follow = -1
        self._controls: dict[str, tuple[Any, Callable[[Any], Any]]] = {}
        self._set_values: dict[str, Any] = {}  # values that were last set on the controls
        self._spanned_fabric = -1  # number of the fabric that the clip plane's slider spans
        self._seek: Any = None  # time slider of a replay
        self._sought_at = 0.0  # when the user last moved it, on the monotonic clock
        self._groups: tuple[str, ...] = ()  # of the plot of displacements
        self._pending = None if actions is None else PendingChanges(actions.change, self._answered)
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        self.state = gui.add_markdown('Waiting for a fabric')
        self.words = gui.add_markdown('')
        self._lay_out_legend()
        if actions is None:
            gui.add_markdown('*Read only: this page cannot change the run.*')
        else:
            self._lay_out_run(actions)
            self._lay_out_parameters(actions)
        self._lay_out_view()
        self._lay_out_plots()
        with gui.add_folder('Diagnostics', expand_by_default=False):
            self.report = gui.add_markdown('No diagnostics received')

    def show_answer(self, text: str, *, good: bool = True) -> None:
        """Show an answer; show a rejection also as a notification."""
        self.answer = text
        self.words.content = _as_code(text) if good else f'**refused:** {_as_code(text)}'
        if not good:
            for client in self._server.get_clients().values():
                client.add_notification('refused', text, color='red', auto_close_seconds=8.0)

    def update(self) -> None:
        """Show the state of the run; called a few times a second."""
        sight = self._sight
        fabric, figures = sight.fabric, sight.figures
        if fabric is not None:
            level = LEVELS[min(sight.status, 3)]
            # Negative numbers stand for anchors.
            broken = int((sight.broken >= 0).sum())
            lines = [
                f't = {sight.time * 1e-9:.3f} s, {counted(fabric.scene.body_count, "shell")}, '
                f'{counted(fabric.scene.connector_count, "connector")}, {broken:,} broken']
            if figures:
                factor = figures.get('real-time factor', '?')
                # Only the first part: a longer text would move the controls below it under the
                # mouse.
                message = sight.message.partition(';')[0]
                lines.append(_as_code(f'real-time factor {factor}; {level}: {message}'))
                reasons = figures.get('reasons', 'none')
                self._set(self.report, 'content', _as_code(
                    sight.message if reasons == 'none' else reasons))
            self._set(self.state, 'content', '\n\n'.join(lines))
            for name, (handle, shown) in self._controls.items():
                if name in fabric.parameters and (
                        self._pending is None or not self._pending.is_open(name)):
                    # Only changed values: others would undo an input that a page has not sent yet.
                    value = shown(fabric.parameters[name])
                    if self._set_values.get(name) != value:
                        self._set_values[name] = handle.value = value
            self._span_clip_plane(fabric)
        self._show_time()
        if len(sight.curves) > 1:
            self._show_curves(list(sight.curves), () if fabric is None else tuple(fabric.groups))

    def _span_clip_plane(self, fabric: Fabric) -> None:
        """Extend the clip plane's slider beyond the woven fabric by half its size."""
        if self._spanned_fabric == self._sight.fabric_number:
            return
        self._spanned_fabric = self._sight.fabric_number
        low, high = fabric.scene.position.min(), fabric.scene.position.max()
        beyond = 0.5 * (high - low) + fabric.scene.geometry.pitch
        self._set(self._cut, 'min', round(float(low - beyond), 3))
        self._set(self._cut, 'max', round(float(high + beyond), 3))

    def _show_time(self) -> None:
        """Move the time slider of a replay, unless the user is moving it."""
        span, slider = self._sight.span, self._seek
        if span is None or slider is None or time.monotonic() - self._sought_at < _USER_HOLD_S:
            return
        start, end = span
        # A slider needs a length.
        self._set(slider, 'min', start)
        self._set(slider, 'max', max(end, start + 0.001))
        now = float(np.clip(self._sight.time * 1e-9, start, end))
        self._set(slider, 'value', round(now, 3))

    def _show_curves(self, curves: list[Curve], groups: tuple[str, ...]) -> None:
        curves = [item for item in curves if len(item.groups) == len(groups)]
        if len(curves) < 2:
            return
        if groups != self._groups:
            self._groups = groups
            handle, _ = self._plots[-1]
            handle.series = self._series(('largest', *(f'of {name}' for name in groups)))
        columns = dict(zip(Curve._fields, zip(*curves)))
        for handle, names in self._plots:
            lines = [np.array(columns[name]) for name in names]
            if handle is self._plots[-1][0]:
                lines += list(np.array(columns['groups']).reshape(len(curves), -1).T)
            handle.data = (np.array(columns['time']), *lines)

    def request(self, name: str, value: Any) -> None:
        """Request a parameter value; the answer is shown."""
        if self._pending is not None:
            self._pending.request(name, value)

    def _lay_out_legend(self) -> None:
        rows = ''.join(
            f'<div><span style="color:rgb{rgb(item.color)}">&#9644;&#9644;</span> '
            f'{item.name}</div>' for item in STRAIN_CLASSES)
        self._server.gui.add_html(
            '<div style="padding:0 1em 0.5em;font-size:0.8em;line-height:1.35"><b>connectors by '
            f'strain (l - D) / D</b>{rows}<div>black: broken; green: anchors; purple: crosses '
            'its own shell. Grey-blue shells are supported. Lines from shells: forces (red) and '
            'torques (yellow), the largest two edges long; purple marks: contacts.</div></div>')

    def _lay_out_run(self, actions: Actions) -> None:
        gui = self._server.gui
        motion: dict[str, tuple[str, bool | None]] = {
            'Pause': ('pause', True), 'Resume': ('pause', False), 'Step': ('step', None)}
        start: dict[str, tuple[str, bool | None]] = {'Reset': ('reset', None)}
        groups = [motion, start]
        if actions.is_replay:
            start['Simulate from here'] = ('continue', None)
        else:
            motion['Advance'] = ('advance', None)
            start['Clear loads'] = ('clear_loads', None)
            groups.append(
                {'Start recording': ('record', True), 'Stop recording': ('record', False)})
        with gui.add_folder('Run'):
            for label, calls in zip(('Motion', 'State', 'Bag'), groups):
                group = gui.add_button_group(label, tuple(calls))
                group.on_click(
                    lambda event, calls=calls: self._call(actions, *calls[event.target.value]))

    def _lay_out_parameters(self, actions: Actions) -> None:
        gui = self._server.gui
        if actions.is_replay:
            with gui.add_folder('Replay'):
                self._control('rate', gui.add_slider('Rate', 0.0, 10.0, 0.05, 1.0), float)
                self._control('loop', gui.add_checkbox('Loop', False), bool)
                self._seek = gui.add_slider('Time [s]', 0.0, 1.0, 0.001, 0.0)

                @self._seek.on_update
                def _(event: Any) -> None:
                    # Not if the slider moves with the time.
                    if event.client is not None:
                        self._sought_at = time.monotonic()
                        self.request('seek', float(event.target.value))
            return
        with gui.add_folder('Fabric'):
            for item in SLIDERS:
                handle = gui.add_slider(item.label, item.low, item.high, item.step, max(
                    item.low, min(item.high, 1.0)))
                self._control(item.name, handle, self._shown(item), self._changed(item))
            for name, words in MENUS.items():
                self._control(name, gui.add_dropdown(name, words), str, (
                    int if name == 'weave.variant' else str))
            self._control('weave.size', gui.add_vector3(
                'weave.size', (5.0, 5.0, 5.0), min=(1.0,) * 3, step=1.0),
                lambda value: tuple(float(part) for part in value),
                lambda value: [round(part) for part in value])

    def _lay_out_view(self) -> None:
        gui, section = self._server.gui, self._stage.section
        with gui.add_folder('View'):
            follow = gui.add_number(
                'Follow body', -1, min=-1, step=1, hint='body number; -1: none')
            axis = gui.add_dropdown('Clip plane normal', ('off', 'x', 'y', 'z'))
            place = self._cut = gui.add_slider('Clip plane position [m]', -2.0, 2.0, 0.001, 0.0)

            @follow.on_update
            def _(_: Any) -> None:
                self.follow = int(follow.value)

            @axis.on_update
            @place.on_update
            def _(_: Any) -> None:
                section.set(axis.value, place.value)

    def _lay_out_plots(self) -> None:
        uplot = import_module('viser.uplot')
        self._plots: list[tuple[Any, tuple[str, ...]]] = []
        with self._server.gui.add_folder('Plots', expand_by_default=False):
            for title, names in (
                    ('energy [J]', ('kinetic', 'connectors', 'balance_error')),
                    ('real-time factor', ('real_time_factor',)),
                    ('displacement [m]', ('displacement',))):
                labels = ('largest',) if names == ('displacement',) else names
                handle = self._server.gui.add_uplot(
                    (np.array([0.0, 1.0]), *(np.zeros(2) for _ in names)), self._series(labels),
                    title=title, scales={'x': uplot.Scale(time=False)}, aspect=1.8)
                self._plots.append((handle, names))

    @staticmethod
    def _series(labels: tuple[str, ...]) -> tuple[Any, ...]:
        """Return the series of a plot: time, and lines with distinct colours and dashes."""
        uplot = import_module('viser.uplot')
        return (uplot.Series(label='t [s]'), *(
            uplot.Series(label=label.replace('_', ' '), stroke=color, width=2, dash=dash)
            for label, (color, dash) in zip(labels, _LINE_STYLES)))

    def _control(
        self, name: str, handle: Any, shown: Callable[[Any], Any],
        given: Callable[[Any], Any] | None = None,
    ) -> None:
        """Connect a control to a parameter, with the conversions from and to its value."""
        self._controls[name] = (handle, shown)

        def changed(event: Any) -> None:
            # Only inputs of a page; updates that follow the run also arrive here.
            if event.client is not None:
                self.request(name, (given or shown)(handle.value))

        handle.on_update(changed)

    def _shown(self, item: Slider) -> Callable[[Any], float]:
        return lambda value: float(np.clip(
            value if item.part is None else value[item.part], item.low, item.high))

    def _changed(self, item: Slider) -> Callable[[float], Any]:
        def given(value: float) -> Any:
            if item.part is None:
                return float(value)
            fabric = self._sight.fabric
            whole = [0.0, 0.0, 0.0] if fabric is None else list(fabric.parameters[item.name])
            whole[item.part] = float(value)
            return whole

        return given

    def _call(self, actions: Actions, name: str, on: bool | None) -> None:
        def answered(done: 'Future[str]') -> None:
            error = done.exception()
            self.show_answer(
                done.result() if error is None else f'{name}: {error}', good=error is None)

        try:
            actions.command(name, on).add_done_callback(answered)
        except Exception as error:  # noqa: BLE001 - shown on the page
            self.show_answer(f'{name}: {error}', good=False)

    def _answered(self, name: str, words: str, good: bool) -> None:
        self._set_values.pop(name, None)  # so that the control of a rejected value returns
        self.show_answer(f'{name}: {words}' if words else f'{name} is set', good=good)

    @staticmethod
    def _set(handle: Any, name: str, value: Any) -> None:
        if getattr(handle, name) != value:
            setattr(handle, name, value)
