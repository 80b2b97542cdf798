# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A simulation against a plain model of it: random calls in random order, also those it must refuse.

The model keeps the time, the wrenches that act and wait, and the calls that made the run what it
is. What only looks (snapshots, checkpoints, refused calls) is not among them, and pieces of an
advance are one advance: at the end a fresh simulation does these calls, and must show the same
bits in all that is public.
"""
import copy

import pytest

pytest.importorskip('hypothesis', reason='requirements-test.txt lists it')

from hypothesis import strategies as st  # noqa: E402
from hypothesis.stateful import (  # noqa: E402
    initialize,
    invariant,
    precondition,
    rule,
    RuleBasedStateMachine,
    run_state_machine_as_test,
)
import icofabric_sim as ico  # noqa: E402
from icofabric_sim.parameters.validation import ParameterError  # noqa: E402
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint  # noqa: E402
import numpy as np  # noqa: E402
from shown_bits import figures, unlike  # noqa: E402
from state_machines import examples  # noqa: E402

COMMON = {
    'weave': {'size': [2, 2, 2]}, 'contact': {'mode': 'never'}, 'gravity': [0.0, 0.0, -9.81],
    'groups': {'tip': 'ids 1', 'rest': 'ids 2 3', 'moved': 'ids 0'},
    'loads': {'tip': {'group': 'tip'}, 'brief': {'group': 'rest', 'hold': 1.5e-3}},
    'drives': {'moved': {'group': 'moved'}},
    'initial_random': {'velocity_sigma': 0.1, 'spin_sigma': 10.0, 'seed': 3},
}
# One that is solved by steps of one length, and one by steps that adapt, with damping and breaks.
SCENES = {
    'srkn4': {**COMMON, 'solver': {'method': 'srkn4', 'tolerance': 1e-4}},
    'dop8': {**COMMON, 'connector': {'damping': 1e-2, 'break_length_extension': 0.05},
             'solver': {'method': 'dop8', 'tolerance': 1e-4}},
}
HOLD = COMMON['loads']['brief']['hold']
CHANGES = ({'connector.stiffness': 700.0}, {'gravity': [0.0, 0.0, 0.0]},
           {'solver.tolerance': 1e-3}, {'shell.density': 1000.0})
NUMBERS = st.integers(-50, 50)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
# [us]: so that texts of an example are short.
SPANS = st.integers(0, 3000)
NAN, INF = float('nan'), float('inf')


class Call:
    """One call that makes the run what it is."""

    def __init__(self, name, *arguments, **options):
        self.name, self.arguments, self.options = name, arguments, options

    def on(self, simulation):
        getattr(simulation, self.name)(*self.arguments, **self.options)


class Model:
    """What a simulation should be, in words of its callers."""

    def __init__(self):
        self.time, self.order = 0.0, 0
        self.calls = []  # Call, or the changes of another scene with whether the motion goes on
        self.waiting = []  # (time, order, key, force or None: the end of a hold)
        self.acting, self.ends = {}, {}

    def forget(self):
        self.waiting, self.acting, self.ends = [], {}, {}

    def apply(self, key, force, time):
        self._put(time, key, force)
        self.advance(self.time)

    def advance(self, time):
        self.time = time
        while self.waiting and min(self.waiting, key=lambda item: item[:2])[0] <= time:
            first = min(self.waiting, key=lambda item: item[:2])
            self.waiting.remove(first)
            at, _, key, force = first
            if key == 'moved':
                continue  # a twist, which is no load
            if force is None:
                if self.ends.get(key) == at:
                    del self.ends[key]
                    self.acting.pop(key, None)
                continue
            self.ends.pop(key, None)
            if not any(force):
                self.acting.pop(key, None)
                continue
            self.acting[key] = force
            if key == 'brief':
                self.ends[key] = at + HOLD
                self._put(at + HOLD, key, None)

    def _put(self, time, key, force):
        self.order += 1
        self.waiting.append((time, self.order, key, force))


def repeated(kind, calls):
    """Do the calls on a fresh simulation; advances that follow each other are one."""
    simulation = ico.compile_scene(ico.Scene.from_parameters(SCENES[kind]))
    wanted = 0.0
    for call in calls:
        if isinstance(call, Call) and call.name == 'advance_to':
            wanted = call.arguments[0]
            continue
        if wanted > simulation.time:
            simulation.advance_to(wanted)
        if isinstance(call, Call):
            call.on(simulation)
        else:
            changes, keep = call
            other = ico.compile_scene(simulation.scene.with_changes(changes))
            other.continue_from(simulation, keep_motion=keep)
            simulation = other
        wanted = simulation.time
    if wanted > simulation.time:
        simulation.advance_to(wanted)
    return simulation


class SimulationMachine(RuleBasedStateMachine):
    """All that a caller of a simulation may do."""

    @initialize(kind=st.sampled_from(sorted(SCENES)))
    def begin(self, kind):
        self.kind, self.model = kind, Model()
        self.simulation = ico.compile_scene(ico.Scene.from_parameters(SCENES[kind]))
        self.snapshots, self.checkpoints, self.steps = [], [], 0

    def _advance_model(self):
        self.model.advance(self.simulation.time)
        self.model.calls.append(Call('advance_to', self.simulation.time))

    def _do(self, call):
        call.on(self.simulation)
        self.model.calls.append(call)

    @rule(span=SPANS)
    def advance(self, span):
        self._advance(span)

    def _advance(self, span):
        before, goal = self.simulation.status.step_count, self.simulation.time + 1e-6 * span
        self.simulation.advance_to(goal)
        assert self.simulation.time == goal
        assert self.simulation.status.step_count >= before
        self._advance_model()

    @rule(count=st.integers(1, 7))
    def take_steps(self, count):
        before, time = self.simulation.status.step_count, self.simulation.time
        self.simulation.advance_steps(count)
        assert self.simulation.time > time
        assert self.simulation.status.step_count == before + count
        self._advance_model()

    @rule(key=st.sampled_from(['tip', 'brief', 1, 3]), vector=VECTORS, wait=SPANS | st.none(),
          then=SPANS)
    def push(self, key, vector, wait, then):
        force = tuple(0.002 * item for item in vector)
        time = None if wait is None else self.simulation.time + 1e-6 * wait
        name = 'apply_body_wrench' if isinstance(key, int) else 'apply_wrench'
        self._do(Call(name, key, force, time=time))
        self.model.apply(key, force, self.simulation.time if time is None else time)
        self.stands_as_the_model()
        self._advance(then)

    @rule(vector=VECTORS, wait=SPANS, then=SPANS)
    def take_drive_over(self, vector, wait, then):
        twist, time = tuple(1e-3 * item for item in vector), self.simulation.time + 1e-6 * wait
        self._do(Call('apply_twist', 'moved', twist, time=time))
        self.model.apply('moved', twist, time)
        self._advance(then)

    @rule(body=st.integers(1, 3), vector=VECTORS, then=SPANS)
    def put_elsewhere(self, body, vector, then):
        velocity = self.simulation.snapshot().linear_velocity.copy()
        velocity[body] = [2e-3 * item for item in vector]
        self._do(Call('set_state', linear_velocity=velocity))
        self._advance(then)

    @rule()
    def look(self):
        before = figures(self.simulation)
        snapshot = self.simulation.snapshot()
        assert snapshot.time == self.simulation.time == self.model.time
        assert all(not getattr(snapshot, name).flags.writeable for name in (
            'position', 'orientation', 'linear_velocity', 'angular_velocity'))
        energy = snapshot.energy
        assert abs(energy['balance_error']) <= 1e-3 * max(
            energy['kinetic'] + energy['connectors'], abs(energy['work_in']), 1e-4)
        self.simulation.status.fastest_place()
        self.snapshots.append((snapshot, snapshot.position.tobytes(), snapshot.energy.copy()))
        assert unlike(before, figures(self.simulation)) == []

    @rule(later=SPANS)
    def reset(self, later):
        time = self.simulation.time + 1e-6 * later
        self._do(Call('reset', time=time))
        self.model.forget()
        self.model.time = time

    @rule()
    def reset_time(self):
        self.simulation.reset_time()
        self.model.forget()
        self.model.time = 0.0
        # What is as at the start need not be told how it came there, but for the present scene.
        changed = [(call[0], False) for call in self.model.calls if not isinstance(call, Call)]
        self.model.calls = [*changed, Call('reset_time')]

    @rule()
    def save(self):
        before = figures(self.simulation)
        checkpoint = Checkpoint.from_bytes(self.simulation.checkpoint().to_bytes())
        self.checkpoints.append(
            (checkpoint, copy.deepcopy(self.model), self.simulation.scene, figures(
                self.simulation)))
        assert unlike(before, self.checkpoints[-1][-1]) == []

    @precondition(lambda self: self.checkpoints)
    @rule(number=st.integers(0, 20), then=SPANS)
    def restore(self, number, then):
        checkpoint, model, scene, shown = self.checkpoints[number % len(self.checkpoints)]
        if scene.parameters != self.simulation.scene.parameters:
            self._refuses(lambda: self.simulation.restore(checkpoint), 'cannot be restored here')
            return
        self.simulation.restore(checkpoint)
        assert unlike(shown, figures(self.simulation)) == []
        self.model = copy.deepcopy(model)
        self._advance(then)

    @rule(number=st.integers(0, 1000), cut=st.booleans())
    def restore_damaged(self, number, cut):
        data = bytearray(self.simulation.checkpoint().to_bytes())
        place = number * 7919 % len(data)
        if cut:
            del data[place:]
        else:
            data[place] ^= 1 << number % 8
        self._refuses(
            lambda: self.simulation.restore(Checkpoint.from_bytes(bytes(data))),
            'not a checkpoint that can be read')

    @rule(changes=st.sampled_from(CHANGES), keep=st.booleans(), then=SPANS)
    def change(self, changes, keep, then):
        other = ico.compile_scene(self.simulation.scene.with_changes(changes))
        before = figures(self.simulation)
        other.continue_from(self.simulation, keep_motion=keep)
        assert unlike(before, figures(self.simulation)) == []
        assert other.time == self.simulation.time
        if keep:
            there, here = other.snapshot().position, self.simulation.snapshot().position
            # Body 0 is where its drive begins anew, to rounding.
            assert there[1:].tobytes() == here[1:].tobytes()
            assert abs(there[0] - here[0]).max() < 1e-12
        self.model.calls.append((changes, keep))
        self.simulation = other
        self.stands_as_the_model()
        self._advance(then)

    @rule(call=st.sampled_from([
        ('time', Call('advance_to', NAN)), ('time', Call('advance_to', INF)),
        ('time', Call('advance_to', 'now')), ('time', Call('advance_to', -1.0)),
        ('count', Call('advance_steps', 0)), ('count', Call('advance_steps', -3)),
        ('count', Call('advance_steps', 1.5)), ('count', Call('advance_steps', None)),
        ('nowhere', Call('apply_wrench', 'nowhere', (0.0, 0.0, 1.0))),
        ('force', Call('apply_wrench', 'tip', (NAN, 0.0, 1.0))),
        ('torque', Call('apply_wrench', 'tip', torque=(0.0, 1.0))),
        ('time', Call('apply_wrench', 'tip', (0.0, 0.0, 1.0), time=-1.0)),
        ('time', Call('apply_wrench', 'tip', (0.0, 0.0, 1.0), time=NAN)),
        ('body', Call('apply_body_wrench', 4)), ('body', Call('apply_body_wrench', -1)),
        ('body', Call('apply_body_wrench', True)), ('drive', Call('apply_twist', 7)),
        ('linear', Call('apply_twist', 'moved', (INF, 0.0, 0.0))),
        ('position', Call('set_state', position=np.zeros((4, 2)))),
        ('orientation', Call('set_state', orientation=np.zeros((4, 4)))),
        ('linear_velocity', Call('set_state', linear_velocity=np.full((4, 3), NAN))),
        ('time', Call('reset', time=-1.0)), ('checkpoint', Call('restore', b'')),
        ('previous', Call('continue_from', None, keep_motion=True)),
        ('other', Call('copy_breaks', 3)), ('point', Call('pull', 1, (NAN, 0.0, 0.0))),
    ]))
    def refuse(self, call):
        name, wrong = call
        self._refuses(lambda: wrong.on(self.simulation), name)

    @rule(wrong=st.sampled_from([
        ('connector.stiffness', -1.0), ('connector.stiffness', 'stiff'), ('no.such', 1),
        ('weave.size', [0, 1, 1]), ('groups.tip', 'ids 99'), ('solver.tolerance', 0.0)]))
    def refuse_parameters(self, wrong):
        scene, name = self.simulation.scene, wrong[0]
        given = dict(scene.parameters)

        def change():
            with pytest.raises(ParameterError) as caught:
                scene.with_changes({name: wrong[1]})
            raise caught.value

        self._refuses(change, name)
        assert self.simulation.scene is scene and dict(scene.parameters) == given

    def _refuses(self, act, text):
        """A ValueError or TypeError that names what is wrong; nothing changes by it."""
        before = figures(self.simulation)
        with pytest.raises((ValueError, TypeError)) as caught:
            act()
        assert text in str(caught.value)
        assert unlike(before, figures(self.simulation)) == []

    @invariant()
    def stands_as_the_model(self):
        if not hasattr(self, 'model'):
            return
        simulation, model = self.simulation, self.model
        assert simulation.time == model.time
        assert {key: tuple(wrench.force.tolist())
                for key, wrench in simulation.status.active_loads.items()} == model.acting
        assert simulation.status.waiting_loads == len(model.waiting)
        assert simulation.balance.worst <= simulation.balance.limit

    def teardown(self):
        if not hasattr(self, 'model'):
            return
        again = repeated(self.kind, self.model.calls)
        assert unlike(figures(again), figures(self.simulation)) == []
        for snapshot, position, energy in self.snapshots:
            assert snapshot.position.tobytes() == position and snapshot.energy == energy


@pytest.mark.examples
def test_any_calls_in_any_order_do_what_the_model_says():
    run_state_machine_as_test(SimulationMachine, settings=examples(25, 25))


@pytest.mark.parametrize('kind', SCENES)
def test_errors_count_from_zero_after_a_reset_of_the_time(kind):
    simulation = ico.compile_scene(ico.Scene.from_parameters(SCENES[kind]))
    simulation.advance_steps(5)
    assert simulation.error_estimate > 0.0
    simulation.reset_time()
    assert simulation.error_estimate == 0.0
