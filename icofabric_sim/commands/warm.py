# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
`icofabric warm`: compile the kernels of scenes in parallel and store them on disk.

Runs that find their kernels on disk start at once; so do first contacts and common changes of
parameters. Compiled kernels serve every machine of the same level (kernels/runtime/target.py).
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import redirect_stderr, redirect_stdout
import ctypes
import io
import logging
import multiprocessing
import os
import signal
import time
from typing import Any, NamedTuple

import icofabric_sim as ico
from icofabric_sim.parameters.example_scenes import example_scenes, find_scene
from icofabric_sim.terminal import bad_input, CommandFailed, duration_text, InputError, Progress

# Scene for changes of parameters: point springs, without damping, drives or regions.
_CHANGED = 'bias_column'
# The most common changes. A kernel variant depends on the presence of terms, not on their values.
CHANGES: tuple[dict[str, Any], ...] = (
    {'solver.method': 'leapfrog'},
    {'solver.method': 'srkn4'},
    {'solver.method': 'dop8'},
    {'connector.damping': 1e-4},
    {'drag.linear': 1e-4, 'drag.angular': 1e-7},
    {'connector.stiffness_extension': 200.0, 'connector.stiffness_compression': 100.0},
    {'connector.bending_stiffness': 1e-4},
    {'contact.mode': 'always', 'contact.damping': 1.0, 'contact.friction': 0.3},
)
# Verbs besides `run`, each with a scene that it accepts.
VERBS: tuple[tuple[str, ...], ...] = (
    ('statics', 'stiff_cantilever'),
    ('modes', 'stiff_cantilever', '--count', '2'),
    ('elasticity', 'stiff_cantilever'),
)
# A worker keeps its compiled code; after this many variants a new one takes over.
_VARIANTS_PER_WORKER = 12
# Simulated time [s] in which every kind of output occurs at least once.
_TRIAL_S = 1e-3
# PR_SET_PDEATHSIG of prctl(2).
_END_WITH_PARENT = 1


class Variant(NamedTuple):
    """Kernel variant to compile."""

    scene: str
    changes: tuple[tuple[str, Any], ...] = ()
    verb: tuple[str, ...] = ()
    # For a scene whose shells may touch: from the first contact on, or until then; None: both.
    touching: bool | None = None

    def __str__(self) -> str:
        """Return a short description."""
        if self.verb:
            return ' '.join(('icofabric', *self.verb))
        words = [self.scene, *(f'{name} {value}' for name, value in self.changes)]
        if self.touching is not None:
            words.append('touching' if self.touching else 'apart')
        return ', '.join(words)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        'scenes', metavar='SCENE', nargs='*',
        help='example scenes or parameter files (default: all example scenes, variants with '
             'common parameter changes, and the kernels of statics, modes and elasticity)')
    parser.add_argument(
        '-j', '--processes', type=int, metavar='N', default=len(os.sched_getaffinity(0)),
        help='compile in N processes (default: one for each core)')


def main(arguments: argparse.Namespace) -> int:
    """Compile with a progress bar; return 0, or 1 if a variant could not be compiled."""
    if not 1 <= arguments.processes <= 256:
        raise InputError(f'--processes must be from 1 to 256, got {arguments.processes}')
    kinds = list(variants_of(arguments.scenes))
    if len(kinds) < arguments.processes:
        kinds = [part for kind in kinds for part in _parts_of(kind)]
    begun, failed = time.monotonic(), []
    # Kernels with contact are separate variants here.
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'
    with Progress(len(kinds), 'kernel variants') as progress:
        for done, (kind, fault) in enumerate(_compile_all(kinds, arguments.processes), 1):
            if fault:
                failed.append(f'{kind}: {fault}')
            progress.update(done)
    ready = len(kinds) - len(failed)
    print(
        f'{ready} {"kernel variant is" if ready == 1 else "kernel variants are"} ready after '
        f'{duration_text(time.monotonic() - begun)}')
    if failed:
        raise CommandFailed('not compiled: ' + '; '.join(failed))
    return 0


def variants_of(scenes: Sequence[str]) -> Iterator[Variant]:
    """Yield the kernel variants of these scenes, or of all common cases without scenes."""
    with bad_input():
        for scene in scenes:
            find_scene(scene)
    for scene in scenes or example_scenes():
        yield Variant(scene)
    if not scenes:
        for change in CHANGES:
            yield Variant(_CHANGED, tuple(change.items()))
        for verb in VERBS:
            yield Variant(verb[1], verb=verb)


def _parts_of(kind: Variant) -> list[Variant]:
    """Return both parts of a variant for two processes; some kernels are shared."""
    from icofabric_sim.parameters.file import load_parameter_file
    with bad_input():
        given = load_parameter_file(find_scene(kind.scene))
    if kind.verb or given.get('contact.mode', 'auto') != 'auto':
        return [kind]
    # The slower one first.
    return [kind._replace(touching=touching) for touching in (True, False)]


def _compile_all(kinds: Sequence[Variant], processes: int) -> Iterator[tuple[Variant, str]]:
    """Yield each variant once it is compiled, with the error if there was one."""
    # max_tasks_per_child of Python 3.11 can wait for ever after workers have ended.
    batch = _VARIANTS_PER_WORKER * processes
    for first in range(0, len(kinds), batch):
        yield from _compile_batch(kinds[first:first + batch], processes)


def _compile_batch(kinds: Sequence[Variant], processes: int) -> Iterator[tuple[Variant, str]]:
    with ProcessPoolExecutor(
        min(processes, len(kinds)), multiprocessing.get_context('spawn'), _leave_signals
    ) as pool:
        waiting = {pool.submit(compile_variant, kind): kind for kind in kinds}
        try:
            for finished in as_completed(waiting):
                try:
                    yield waiting[finished], finished.result()
                except BrokenProcessPool as error:
                    raise CommandFailed(
                        'a compiling process was killed, e.g. for lack of memory; '
                        'try --processes 1') from error
        except BaseException:
            # Files in the cache are always complete; one variant takes a minute or two.
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _leave_signals() -> None:
    """Ignore interrupts, which the parent process handles; end with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGTERM)


def compile_variant(kind: Variant) -> str:
    """Compile one variant in this process; return an error message, '' for success."""
    logging.getLogger('icofabric_sim').addHandler(logging.NullHandler())
    try:
        if kind.verb:
            from icofabric_sim.commands.main import main as run_verb
            said = io.StringIO()
            with redirect_stdout(io.StringIO()), redirect_stderr(said):
                status = run_verb(list(kind.verb))
            return said.getvalue().strip() if status else ''
        _run(kind)
    except Exception as error:  # reported with the name of the variant; others continue
        return ' '.join(str(error).split()) or type(error).__name__
    return ''


def _run(kind: Variant) -> None:
    from icofabric_sim.parameters.file import load_parameter_file
    from icofabric_sim.parameters.validation import make_parameters
    from icofabric_sim.simulation.precompile import kinds_of_steps
    from icofabric_sim.simulation.stepping.method_needs import required_method

    given = {**load_parameter_file(find_scene(kind.scene)), **dict(kind.changes)}
    scene = ico.Scene.from_parameters(make_parameters(given))
    needed = required_method(scene) if kind.touching else None
    method = present = '' if needed is None else needed.name
    if not method:
        simulation = ico.compile_scene(scene)
        method, present = simulation.status.touching_method, simulation.status.method_name
        if not kind.touching:
            _ready(simulation)
    if scene.parameters['contact.mode'] == 'auto' and kind.touching is not False:
        _, *later = kinds_of_steps(method, present=present, may_touch=True)
        for changes in later:
            _ready(ico.compile_scene(ico.Scene.from_parameters(make_parameters(
                {**scene.parameters.given(), **changes}))))


def _ready(simulation: 'ico.Simulation') -> 'ico.Simulation':
    """Compile steps, outputs, and the end of a step at an input."""
    from icofabric_sim.messages.topics import Outputs
    from icofabric_sim.simulation.simulation import use_all_kernels
    use_all_kernels(simulation)
    simulation.advance_to(max(_TRIAL_S, simulation.time))
    snapshot, outputs = simulation.snapshot(), Outputs(simulation.scene)
    outputs.energy(snapshot)
    for messages in (outputs.connectors(snapshot, 0), outputs.icosahedra(snapshot, 0)):
        list(messages)
    return simulation
