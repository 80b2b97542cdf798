# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs of small scenes by ranks of MPI, and what is to be the same bits whatever their number.

As a program: started by a launcher, it lets smaller numbers of its processes run every scene,
or with the word `long` those of `make test-long`, or with `ready` files that follow, and prints
what came of it as JSON; `test_ranks.py` compares with one process.
"""

import faulthandler
import hashlib
import json
import math
from pathlib import Path
import sys
import time
import traceback
from types import MappingProxyType

import icofabric_sim as ico
from icofabric_sim.kernels.monitor import CHECK_COUNT
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.pair_leader import SharedPair
from icofabric_sim.simulation.devices.server import Server
from icofabric_sim.simulation.stepping import accuracy_probe
import numpy as np

COMMON = {
    'contact.mode': 'never', 'gravity': [0.0, 0.3, -9.81],
    'groups': {'top': 'z_max', 'tip': 'x_max'}, 'supports': {'s': {'group': 'top', 'fix': 'all'}},
    'initial_random': {'velocity_sigma': 0.02, 'spin_sigma': 1.0, 'seed': 3},
    'loads': {'l': {'group': 'tip', 'force': [0.01, 0.0, 0.02], 'profile': 'half_sine',
                    'duration': 0.004}}}
TOUCHING = {
    'groups': {'tip': 'x_max'}, 'loads': {'l': {'group': 'tip', 'force': [-0.05, 0.0, 0.0]}},
    'initial_random': {'velocity_sigma': 0.3, 'spin_sigma': 20.0, 'seed': 3}}
FLOOR = {
    **TOUCHING, 'weave.size': [5, 5, 5], 'gravity': [0.0, 0.0, -9.81],
    'planes': {
        'floor': {'normal': [0.1, 0.0, 1.0], 'offset': -0.2},
        'wall': {'normal': [1.0, 0.0, 0.0], 'offset': -0.2}},
    'contact': {'stiffness': 3e5, 'friction': 0.4, 'damping': 2.0}}
PILE = {
    'bodies': {
        f'b{k}': {
            'position': [0.033 * (k % 3), 0.033 * (k // 3 % 3), 0.035 + 0.033 * (k // 9)],
            'linear_velocity': [0.02 * (k % 5 - 2), 0.0, -0.6],
            'angular_velocity': [3.0, -2.0, float(k % 4)]}
        for k in range(40)},
    'weave.size': [1, 1, 1], 'gravity': [0.0, 0.0, -9.81],
    'groups': {'tip': 'ids 40'}, 'loads': {'l': {'group': 'tip'}},
    'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.02}},
    'contact': {'friction': 0.5, 'damping': 5.0}}
KINKED = {'connector': {'stiffness_extension': 500.0, 'stiffness_compression': 100.0}}
# Slabs of rows end to end, interleaved grids, rows of a turned fabric, loose bodies; with steps
# given and chosen; laws, moments and an anchor, masses and surface forces, and paths.
SCENES = {
    'slab, leapfrog': {
        **COMMON, 'weave.size': [7, 7, 9], 'solver': {'method': 'leapfrog', 'tolerance': 0.1}},
    'even rows, srkn8': {
        **COMMON, 'weave.size': [8, 8, 8], 'solver': {'method': 'srkn8', 'tolerance': 1e-3}},
    'turned, srkn4': {
        **COMMON, 'weave': {'kind': 'bias', 'size': [6, 6, 6]},
        'solver': {'method': 'srkn4', 'tolerance': 1e-4}},
    'kinks, srkn6': {
        **COMMON, 'weave.size': [5, 7, 9], 'connector': {
            'stiffness_extension': 500.0, 'stiffness_compression': 100.0},
        'solver': {'method': 'srkn6', 'tolerance': 1e-3}},
    'moments and an anchor, leapfrog': {
        **COMMON, 'weave.size': [5, 7, 9], 'connector': {
            'bending_stiffness': 1e-3, 'twisting_stiffness': 1e-3},
        'anchors': {'a': {'body': 0, 'edge': 'west', 'position': [-0.2, 0.0, 0.0]}},
        'solver': {'method': 'leapfrog', 'step': 6e-5}},
    'drives, leapfrog': {
        **COMMON, 'weave.size': [5, 7, 9],
        'groups': {
            'top': 'z_max', 'tip': 'x_max', 'low': 'z_min',
            'side': 'y_min and not z_min and not z_max'},
        'drives': {
            'd': {'group': 'low', 'motion': 'sine', 'linear': [0.002, 0.0, 0.001],
                  'angular': [0.0, 0.05, 0.0], 'frequency': 40.0},
            'e': {'group': 'side', 'motion': 'velocity', 'linear': [0.0, -0.1, 0.0],
                  'freedoms': 'ty', 'duration': 0.004}},
        'solver': {'method': 'leapfrog', 'tolerance': 0.1}},
    # Through contacts that take energy: it falls and slides on planes, and is pushed.
    'a floor with friction, leapfrog': {
        **FLOOR, 'solver': {'method': 'leapfrog', 'tolerance': 0.5}},
    # By steps whose lengths all ranks have to agree on.
    'a damped floor with friction, dop8': {
        **FLOOR, 'connector.damping': 0.02, 'solver': {'tolerance': 1e-2}},
}
# More blocks than groups over which sums are formed.
SCENES['wide, leapfrog'] = {
    **COMMON, 'weave.size': [21, 21, 43], 'solver': {'method': 'leapfrog', 'step': 2e-4}}
# Runs that end by themselves, each at the state that was saved last; the last one takes long.
STOPPING = {
    'leapfrog': {
        **COMMON, 'weave.size': [5, 7, 9], 'connector.obstruction': 'stop',
        'solver': {'method': 'leapfrog', 'step': 4e-4}}}
STOPPING_LONG = {
    'dop8': {
        **COMMON, 'weave.size': [5, 7, 9], 'connector.obstruction': 'stop',
        'connector.damping': 0.02, 'solver.tolerance': 1e-2}}
# For `make test-long`: other methods and terms, and shells that no connector holds.
LONG_SCENES = {
    'own masses and winds, srkn4': {
        **COMMON, 'weave.size': [5, 7, 9],
        'groups': {'top': 'z_max', 'tip': 'x_max', 'low': 'z_min', 'some': 'ids 3 40 77 100'},
        'masses': {'m': {'group': 'some', 'mass': 0.03, 'inertia': 5e-6}},
        'tractions': {
            'wind': {'group': 'tip', 'faces': 'exterior', 'pressure': 20.0, 'direction': 'fixed',
                     'frictionless': True, 'profile': 'half_sine', 'duration': 0.01},
            'jet': {'group': 'low', 'faces': 'toward 0 0 1', 'pressure': 30.0}},
        'solver': {'method': 'srkn4', 'tolerance': 1e-3}},
    'a law by a table, srkn6': {
        **COMMON, 'weave.size': [5, 7, 9],
        'connector.law': str(Path(__file__).with_name('ranks_law.csv')),
        'solver': {'method': 'srkn6', 'tolerance': 1e-2}},
    'kinks and a drive, srkn6': {
        **COMMON, 'weave.size': [5, 7, 9], 'connector': {
            'stiffness_extension': 500.0, 'stiffness_compression': 100.0},
        'groups': {'top': 'z_max', 'tip': 'x_max', 'low': 'z_min'},
        'drives': {'d': {
            'group': 'low', 'motion': 'sine', 'linear': [0.002, 0.0, 0.001],
            'angular': [0.0, 0.05, 0.0], 'frequency': 40.0}},
        'solver': {'method': 'srkn6', 'tolerance': 1e-3}},
    'faces that meet, with kinks, srkn6': {
        **TOUCHING, 'weave': {'size': [5, 5, 5], 'connector_angle': -0.3},
        'connector': {'stiffness_extension': 500.0, 'stiffness_compression': 100.0},
        'solver': {'method': 'srkn6', 'tolerance': 1e-2}},
    'damped, dop8': {
        **COMMON, 'weave.size': [5, 5, 7], 'connector.damping': 0.02, 'drag.linear': 0.01,
        'solver': {'tolerance': 1e-4}},
    'faces that meet, srkn8': {
        **TOUCHING, 'weave': {'size': [5, 5, 5], 'connector_angle': -0.3},
        'solver': {'method': 'srkn8', 'tolerance': 1e-2}},
    'faces that meet, given steps, srkn4': {
        **TOUCHING, 'weave': {'size': [5, 5, 5], 'connector_angle': -0.3},
        'contact.stiffness': 2e4, 'solver': {'method': 'srkn4', 'step': 5e-5}},
    'arms on bodies that tumble, dop8': {
        **COMMON, 'weave.size': [5, 5, 7], 'connector': {
            'maxwell_stiffness': 250.0, 'maxwell_time': 0.01},
        'shell.expression': '900 + 4e6*(x + 0.5*y)**2 + 2e6*(y - 0.3*z)**2',
        'solver': {'tolerance': 1e-4}},
    'torn apart from anchors that break, dop8': {
        'weave': {'size': [5, 5, 6], 'connector_angle': 0.55}, 'contact.mode': 'never',
        'connector.stiffness': 500.0, 'groups': {
            'tip': 'x_max', 'upper': 'level 3 or level 4 or level 5',
            'lower': 'level 0 or level 1 or level 2'},
        'connector_groups': {'seam': {
            'between': 'upper lower', 'break_length_extension': 0.0988}},
        'initial': {
            'upper': {'group': 'upper', 'linear_velocity': [0.02, 0.0, 0.4]},
            'lower': {'group': 'lower', 'linear_velocity': [0.0, 0.02, -0.4]}},
        'anchors': {'a': {
            'body': 0, 'edge': 'down', 'position': [0.0, 0.0, -0.1],
            'natural_length': 0.0838, 'break_length_extension': 0.0845}},
        'loads': {'l': {'group': 'tip', 'force': [-0.05, 0.0, 0.0]}},
        'solver': {'tolerance': 1e-3}},
    'given steps, dop8': {
        **COMMON, 'weave.size': [5, 5, 7], 'connector.damping': 0.02,
        'solver': {'method': 'dop8', 'step': 2e-4}},
    'another method once shells are near, auto': {
        'weave.size': [5, 5, 5], 'groups': {'tip': 'x_max'},
        'loads': {'l': {'group': 'tip', 'force': [-0.05, 0.0, 0.0]}},
        'initial_random': {'velocity_sigma': 1.0, 'spin_sigma': 20.0, 'seed': 3},
        'solver': {'tolerance': 1e-3}},
    'a pile, leapfrog': {**PILE, 'solver': {'method': 'leapfrog', 'tolerance': 0.5}},
    'a pile, dop8': {**PILE, 'solver': {'tolerance': 1e-2}},
}
SCENES_ALL = {**SCENES, **LONG_SCENES}
# How many ranks share each of SCENES; LONG_SCENES are shared by 4, too.
COUNTS = 2, 3
# Up to when shells have to be let fall before they touch [s].
LATE = {
    'a floor with friction, leapfrog': 0.013, 'a damped floor with friction, dop8': 0.013,
    'a pile, leapfrog': 0.009, 'a pile, dop8': 0.009}
# What devices cannot compute yet.
FOR_RANKS_ALONE = {
    'own masses and winds, srkn4', 'a floor with friction, leapfrog',
    'a damped floor with friction, dop8',
    # The same terms as in others; of so many bodies rounding leaves more.
    'wide, leapfrog'}
# Where a hand draws a body, too.
PULLED = {'slab, leapfrog', 'kinks, srkn6', 'own masses and winds, srkn4'}


def run(name, ranks=None):
    """Run a scene in pieces; what came of it, as text that says every bit."""
    simulation = ico.compile_scene(ico.Scene.from_parameters(SCENES_ALL[name]), ranks=ranks)
    assert simulation.status.rank_count == (1 if ranks is None else ranks.size)
    # Between two steps, at a step, behind an input; once shells touch.
    simulation.advance_to(0.0031 if name not in LATE else LATE[name])
    found = [state_of(simulation)]
    simulation.apply_wrench('l', force=(0.0, 0.02, 0.0))
    simulation.advance_steps(5)
    simulation.advance_to(simulation.time + 0.0007)
    found.append(state_of(simulation))
    if name in PULLED:
        # Forces are found anew every few steps, from where the bodies are: of the first rank, and
        # of another one.
        pulled = 5, 2 * simulation.scene.body_count // 3
        for body in pulled:
            simulation.pull(body, simulation.snapshot().position[body] + [0.05, 0.0, 0.02])
        simulation.advance_to(simulation.time + 0.004)
        for body in pulled:
            assert np.linalg.norm(simulation.inputs.pulls.forces[body]) > 0.0
        found.append(state_of(simulation))
    checkpoint = simulation.checkpoint()
    end = simulation.time + 0.0023
    simulation.advance_to(end)
    status, last = simulation.status, state_of(simulation)
    error, balance = simulation.error_estimate, simulation.balance
    step, steps = status.step, status.step_count
    simulation.restore(checkpoint)
    simulation.advance_to(end)
    assert state_of(simulation) == last and status.step_count == steps
    return {
        'states': [*found, last], 'method': status.method_name, 'step': step.hex(),
        'steps': steps, 'error': error.hex(),
        'balance': [float(number).hex() for number in balance],
        'checkpoint': hashlib.sha256(checkpoint.to_bytes()).hexdigest()}


def run_ready(name, ranks=None):
    """Run an example scene for a while; what came of it, or why it is refused."""
    try:
        simulation = ico.compile_scene(ico.load_scene(name), ranks=ranks)
    except ValueError as error:
        return str(error)
    assert simulation.status.rank_count == (1 if ranks is None else ranks.size)
    simulation.advance_to(0.02)
    return [*state_of(simulation), simulation.status.step_count]


def steps_taken(ranks=None):
    """Take some steps, whose end nobody looks at before the ranks have ended."""
    simulation = ico.compile_scene(
        ico.Scene.from_parameters(SCENES['slab, leapfrog']), ranks=ranks)
    simulation.advance_steps(3)
    return simulation


def stop(name, ranks=None):
    """Run a scene until it stops; what it says, the state that is kept and what had flowed."""
    simulation = ico.compile_scene(
        ico.Scene.from_parameters({**STOPPING, **STOPPING_LONG}[name]), ranks=ranks)
    try:
        simulation.advance_to(0.5)
    except ico.SimulationError as error:
        return [str(error), simulation.status.step_count, *state_of(simulation)]
    return ['it went on']


def gathered(ranks, steps, changes=MappingProxyType({}), **solver):
    """
    Count how often all states come to the first rank from the start on, while nobody looks.

    And health checks, measurements of the accuracy and of the largest frequency in that time; then
    numbers of other ranks that the first one has at the end. Last, how often after a reset.
    """
    scene = ico.Scene.from_parameters({
        'weave.size': [15, 15, 15], 'contact.mode': 'never', **changes,
        'initial_random': COMMON['initial_random'], 'solver': solver})
    calls, measured, found = [], [], []
    gather, largest = SharedSteps._gather, SharedSteps.largest_frequency
    # Else none of so few steps would be measured.
    part, accuracy_probe._KINKED_COST_PART = accuracy_probe._KINKED_COST_PART, math.inf
    SharedSteps._gather = lambda self, *words, **named: (
        calls.append(words), gather(self, *words, **named))
    SharedSteps.largest_frequency = lambda self: (found.append(1), largest(self))[1]
    try:
        simulation = ico.compile_scene(scene, ranks=ranks)
        simulation.advance_steps(1)
        driver = simulation._driver
        probe = driver.errors.probe
        measure, probe.measured = probe.measured, lambda *words, **named: (
            measured.append(words), measure(*words, **named))[1]
        looks = driver.trajectory.ledger.numbers[CHECK_COUNT]
        simulation.advance_steps(steps)
        driver.monitor.examine()
        loads, *states, work = driver.trajectory.for_steps()
        # What was saved last is with the ranks: its room here was never written to.
        whole = [*states[0].rows(), work.acceleration, work.points.reshape(18, -1)]
        other = np.delete(
            np.arange(whole[0].shape[1]).reshape(-1, LANES),
            driver.trajectory.executor.slots_of_first, axis=0).ravel()
        there = sum(int(np.count_nonzero(rows[:, other])) for rows in whole)
        counts = [
            len(calls), int(driver.trajectory.ledger.numbers[CHECK_COUNT] - looks), len(measured),
            len(found), len(other), there]
        # Begun again, with a step after which ranks save what they have.
        simulation.reset()
        simulation.advance_steps(1)
        calls.clear()
        simulation.advance_steps(steps)
        driver.monitor.examine()
        return [*counts, len(calls)]
    finally:
        SharedSteps._gather, SharedSteps.largest_frequency = gather, largest
        accuracy_probe._KINKED_COST_PART = part


def pair_gathered(ranks):
    """Count how often steps of dop8 gather the whole state on the first rank."""
    scene = ico.Scene.from_parameters({
        'weave.size': [15, 15, 15], 'contact.mode': 'never',
        'initial_random': COMMON['initial_random'],
        'solver': {'method': 'dop8', 'tolerance': 1e-5}})
    calls, gather = [], SharedPair._gather
    SharedPair._gather = lambda self, *words, **named: (
        calls.append(named), gather(self, *words, **named))
    try:
        simulation = ico.compile_scene(scene, ranks=ranks)
        simulation.advance_steps(1)
        calls.clear()
        for _ in range(5):
            simulation.advance_steps(2)
        counts = [sum(named['whole'] for named in calls)]
        # A state that is read is gathered, which shows that the count works.
        simulation.snapshot()
        return [*counts, sum(named['whole'] for named in calls)]
    finally:
        SharedPair._gather = gather


def frequencies(ranks=None):
    """The largest frequency at the start and in motion, and the steps of its iterations."""
    found = []
    for changes in (
            {**KINKED, 'solver': {'method': 'srkn6', 'tolerance': 1e-3}},
            {'connector': {'bending_stiffness': 1e-3, 'twisting_stiffness': 1e-3},
             'solver': {'method': 'leapfrog', 'step': 6e-5}}):
        simulation = ico.compile_scene(ico.Scene.from_parameters({
            **COMMON, 'weave.size': [9, 7, 15], **changes}), ranks=ranks)
        rates = simulation._driver.rates
        for steps in (0, 40):
            if steps:
                simulation.advance_steps(steps)
                rates.measure()
            found.append([rates.fabric.rate.hex(), rates.fabric.iterations])
    return found


def jumps(ranks=None, contact='never'):
    """States of a run that is put elsewhere, pushed, and begun again."""
    simulation = ico.compile_scene(ico.Scene.from_parameters({
        **COMMON, 'weave.size': [7, 7, 9], 'contact.mode': contact,
        'solver': {'method': 'leapfrog', 'tolerance': 0.1}}), ranks=ranks)
    generator, found = np.random.default_rng(5), []

    def note():
        found.append([
            state_of(simulation), simulation.status.step.hex(),
            simulation.status.largest_frequency.hex(), simulation.error_estimate.hex(),
            simulation.status.step_count])

    note()
    simulation.advance_steps(70)
    simulation.set_state(linear_velocity=0.05 * generator.standard_normal(
        (simulation.scene.body_count, 3)))
    note()
    simulation.advance_steps(70)
    simulation.apply_body_wrench(5, force=(0.1, 0.0, 0.0))
    simulation.advance_steps(70)
    note()
    for begin_again in (simulation.reset, simulation.reset_time):
        begin_again()
        note()
        simulation.advance_steps(70)
        note()
    return found


def state_of(simulation):
    snapshot = simulation.snapshot()
    digest = hashlib.sha256()
    for values in (snapshot.position, snapshot.orientation, snapshot.linear_velocity,
                   snapshot.angular_velocity):
        digest.update(np.ascontiguousarray(values).tobytes())
    return [digest.hexdigest(), {
        name: float(value).hex() for name, value in snapshot.energy.items()}]


# What ranks do with an order.
DO = Server._do


def fail(ranks, victim):
    """
    Let a rank fail many orders after somebody has looked; what the first one says and keeps then.
    """
    if ranks.rank == victim:
        calls = []

        def done(self, *arguments):
            if calls or arguments[0] == 'gather':
                calls.append(arguments)
            if len(calls) > 80:
                raise MemoryError('no room')
            DO(self, *arguments)

        Server._do = done
    said = ''
    try:
        with ranks:
            if ranks.leads:
                simulation = ico.compile_scene(
                    ico.Scene.from_parameters(SCENES['slab, leapfrog']), ranks=ranks)
                try:
                    for end in (0.05, 1.0):
                        simulation.advance_to(end)
                        simulation.snapshot()
                except ico.SimulationError as error:
                    said = str(error)
                state = simulation.snapshot().position
                assert np.isfinite(state).all()
    except ico.RankError as error:
        said = str(error)
    return said


def fail_unseen(ranks, victim, begins_again):
    """
    Let a rank fail before anybody has looked; what the first one says, and whether it is back.

    At the start, or at where the run began again.
    """
    steps = []

    def done(self, *arguments):
        # Steps of the run, not of trials beside it.
        if arguments[0] == 'take' and arguments[2].is_checked:
            steps.append(arguments)
        if ranks.rank == victim and len(steps) > 3:
            raise MemoryError('no room')
        DO(self, *arguments)

    Server._do = done
    said, back = '', False
    try:
        with ranks:
            if ranks.leads:
                # No loads begin, for which the state would come to the first rank.
                scene = ico.Scene.from_parameters({
                    'weave.size': [15, 15, 15], 'contact.mode': 'never',
                    'initial_random': COMMON['initial_random'],
                    'solver': {'method': 'leapfrog', 'step': 2e-4}})
                simulation = ico.compile_scene(scene, ranks=ranks)
                if begins_again:
                    simulation.advance_steps(10)
                    simulation.reset()
                try:
                    simulation.advance_to(1.0)
                except ico.SimulationError as error:
                    said = str(error)
                state = simulation.snapshot()
                back = all(np.array_equal(one, other) for one, other in (
                    (state.position, scene.initial.position),
                    (state.linear_velocity, scene.initial.linear_velocity)))
    except ico.RankError as error:
        said = str(error)
    Server._do = DO
    return [said, back]


def main():
    from mpi4py import MPI
    world, found = MPI.COMM_WORLD, {}
    names, which = (LONG_SCENES, run) if sys.argv[1:] == ['long'] else (SCENES, run)
    if sys.argv[1:2] == ['ready']:
        names, which = sys.argv[2:], run_ready
    groups = {
        count: world.Split(0 if world.rank < count else MPI.UNDEFINED, world.rank)
        for count in (COUNTS if names is SCENES else range(2, world.size + 1))}
    for count, group in sorted(groups.items(), reverse=True):
        if group == MPI.COMM_NULL:
            continue
        with ico.Ranks(group) as ranks:
            if ranks.leads:
                found[count] = {name: which(name, ranks) for name in names}
                if which is run:
                    stopping = STOPPING if names is SCENES else STOPPING_LONG
                    found[count]['stopped'] = {name: stop(name, ranks) for name in stopping}
                if names is SCENES and count == COUNTS[-1]:
                    found[count]['gathered'] = [
                        gathered(ranks, 300, method='leapfrog', step=2e-4),
                        gathered(ranks, 300, method='leapfrog', tolerance=1e-2),
                        gathered(ranks, 40, method='srkn6', tolerance=1e-2),
                        gathered(ranks, 40, method='srkn8', tolerance=1e-4),
                        gathered(ranks, 300, KINKED, method='leapfrog', tolerance=1e-2),
                        gathered(ranks, 40, KINKED, method='srkn4', tolerance=1e-3)]
                    found[count]['pair_gathered'] = pair_gathered(ranks)
                if names is SCENES:
                    found[count]['frequencies'] = frequencies(ranks)
                    found[count]['jumps'] = [jumps(ranks, mode) for mode in ('never', 'auto')]
                left = steps_taken(ranks)
        if ranks.leads:
            found[count]['left'] = state_of(left)
            try:
                left.advance_steps(1)
            except ico.SimulationError as error:
                found[count]['ended'] = str(error)
    heard, unseen = '', []
    if names is SCENES:
        sleep_until_all_are_here(world)
        said = fail(ico.Ranks(groups[3]), 1) if groups[3] != MPI.COMM_NULL else ''
        sleep_until_all_are_here(world)
        heard = world.gather(said, root=0)
        for begins_again in (False, True):
            pair = world.Split(0 if world.rank < 2 else MPI.UNDEFINED)
            found_there = fail_unseen(
                ico.Ranks(pair), 1, begins_again) if pair != MPI.COMM_NULL else None
            sleep_until_all_are_here(world)
            unseen.append(world.gather(found_there, root=0))
    if world.rank == 0:
        print(json.dumps({'found': found, 'heard': heard, 'unseen': unseen}))
    sleep_until_all_are_here(world)


def sleep_until_all_are_here(world):
    """Wait for all ranks without keeping those that compute from their processors."""
    request = world.Ibarrier()
    while not request.Test():
        time.sleep(0.01)


if __name__ == '__main__':
    # A hang says where.
    faulthandler.dump_traceback_later(400.0, exit=True)
    try:
        main()
    except BaseException:
        traceback.print_exc()
        from mpi4py import MPI
        MPI.COMM_WORLD.Abort(1)
