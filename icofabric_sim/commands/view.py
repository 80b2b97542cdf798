# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric view`: show a scene or a recorded run in a browser, and drag its shells."""

import argparse
from collections.abc import Callable
from pathlib import Path
import threading
import time
from typing import TYPE_CHECKING
import webbrowser

import icofabric_sim as ico
from icofabric_sim.commands.bags import bag_errors, bag_path, is_bag
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.terminal import bad_input, InputError

if TYPE_CHECKING:
    from icofabric_sim.parameters.validation import Parameters
    from icofabric_sim.viewer.actions import Actions
    from icofabric_sim.viewer.page import Page
    from icofabric_sim.viewer.sight import Sight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser, 'SCENE|BAG', 'the folder of a bag')
    parser.add_argument(
        '--host', default='127.0.0.1',
        help='address to serve at; for other machines the printed address contains a token, '
             'which the page requires (%(default)s)')
    parser.add_argument(
        '--port', type=int, default=8080,
        help='port, or the next free one (%(default)s)')
    parser.add_argument('--rate', type=float, default=60.0, help='frames a second (%(default)s)')
    parser.add_argument('--read-only', action='store_true', help='disable all controls of the run')
    parser.add_argument('--open', action='store_true', help='open the page in a browser')


def main(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted."""
    from icofabric_sim.viewer.page import require_viser
    if not 0 <= arguments.port < 65536:
        raise InputError(f'--port must lie in 0 to 65535, got {arguments.port}')
    if not 0.0 < arguments.rate <= 240.0:
        raise InputError(f'--rate must lie above 0 and up to 240 Hz, got {arguments.rate:g}')
    with bad_input():
        require_viser()
    path = bag_path(arguments.scene)
    if arguments.scene not in example_scenes() and is_bag(path):
        if arguments.parameter:
            raise InputError('-p applies to scenes; a recorded run cannot be changed')
        return _show_bag(arguments, path)
    return _show_scene(arguments)


def _show_scene(arguments: argparse.Namespace) -> int:
    from icofabric_sim.viewer.sight import Sight
    _, parameters = read_parameters(arguments)
    with bad_input():
        scene = ico.Scene.from_parameters(parameters)
        simulation = ico.compile_scene(scene)
        simulation.warm_up()
    return _show_run(arguments, Sight(), simulation, parameters)


def _show_run(
    arguments: argparse.Namespace, sight: 'Sight', simulation: 'ico.Simulation',
    parameters: 'Parameters', before: 'Page | None' = None
) -> int:
    """Run and show a simulation, at the address of the earlier page `before`, if any."""
    from icofabric_sim.running.diagnostics import HealthReport
    from icofabric_sim.running.recording import BagSink, summarise_run
    from icofabric_sim.running.runner import Runner
    from icofabric_sim.viewer.local import RunActions, SightSink
    with bad_input():
        bag = BagSink(parameters['record.path'], simulation, live=True, parameters=parameters)
    report = HealthReport('/icofabric')
    runner = Runner(
        simulation, [bag, SightSink(sight, is_run=True)], parameters=parameters,
        report=lambda status: report.bytes(status, {}, {}, {}))
    thread = threading.Thread(target=runner.run, name='simulation', daemon=True)
    try:
        _serve(arguments, sight, RunActions(runner), thread, before=before)
    finally:
        runner.stop()
        if thread.ident is not None:
            thread.join()
        bag.close(summary=summarise_run(runner.status()))
    return 1 if runner.failure else 0


def _show_bag(arguments: argparse.Namespace, path: Path) -> int:
    from icofabric_sim.running.replay.player import Player
    from icofabric_sim.running.replay.report import ReplayReport
    from icofabric_sim.running.replay.source import ReplaySource
    from icofabric_sim.viewer.local import ReplayActions, SightSink
    from icofabric_sim.viewer.sight import Sight
    with bag_errors(path):
        source = ReplaySource(path)
        if source.lacks:
            source.close()
            raise InputError(source.lacks)
    sight, report = Sight(), ReplayReport('/icofabric', source)
    with source:
        player = Player(source, SightSink(sight), stay=True, report=report.message)
        actions = ReplayActions(player)
        thread = threading.Thread(target=player.run, name='replay', daemon=True)
        try:
            page = _serve(
                arguments, sight, actions, thread, until=lambda: actions.continued_run is not None)
        finally:
            player.stop()
            if thread.ident is not None:
                thread.join()
    if actions.continued_run is None:
        return 0
    return _show_run(arguments, sight, *actions.continued_run, before=page)


def _serve(
    arguments: argparse.Namespace, sight: 'Sight', actions: 'Actions', thread: threading.Thread, *,
    until: Callable[[], bool] = lambda: False, before: 'Page | None' = None
) -> 'Page':
    """Serve a page until interrupted, or until `until` returns True; close it at the end."""
    from icofabric_sim.viewer.page import Page
    port = arguments.port if before is None else before.port
    with bad_input():
        page = Page(
            sight, None if arguments.read_only else actions, host=arguments.host, port=port,
            rate=arguments.rate, token='' if before is None else before.token)
    try:
        if before is None or page.address != before.address:
            print(page.address, flush=True)
        if arguments.open and before is None:
            webbrowser.open(page.address)
        thread.start()
        # The page stays open after the end of the run.
        while not until():
            time.sleep(0.2)
    except KeyboardInterrupt:
        print('the page is closed', flush=True)
    finally:
        page.close()
    return page
