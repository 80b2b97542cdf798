# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Random scenes in MuJoCo under the same judge, and that its scenes are ours."""

from importlib.util import find_spec

from icofabric_sim.commands.main import main
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.divergence import distance_between
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_sim.studies.stress import mujoco_run
from icofabric_sim.studies.stress.kinds import Kind, KINDS
from icofabric_sim.studies.stress.mujoco_run import MuJoCoRun
from icofabric_sim.studies.stress.peers import is_expressible, judge_mujoco
from icofabric_sim.studies.stress.scenes import draw_scene, seeds_of, StressScene
from icofabric_sim.studies.stress.verdict import Verdict
import pytest

needs_mujoco = pytest.mark.skipif(find_spec('mujoco') is None, reason='needs MuJoCo')

WOVEN = {
    'weave.size': [3, 2, 2], 'weave.connector_angle': 0.3, 'contact.mode': 'never',
    'connector.natural_length': 0.03, 'initial_random.velocity_sigma': 0.1,
    'initial_random.spin_sigma': 6.0, 'initial_random.seed': 3, 'solver.method': 'dop8',
    'solver.threads': 1, 'solver.tolerance': 1e-8}


@needs_mujoco
@pytest.mark.parametrize('changes', [
    {}, {'connector.damping': 0.01, 'gravity': [0.3, 0.1, -2.0]},
    *({'connector.damping': 0.01, 'gravity': [0.3, 0.1, -2.0], 'groups.top': 'z_max',
       'supports.top.group': 'top', 'supports.top.fix': fix}
      for fix in ('all', 'tx ty tz', 'rotation', 'tz', 'tx rotation'))])
def test_the_same_motion_follows_there_to_the_order_of_its_method(changes):
    """Two programs of two makers: each is an oracle of the other."""
    scene = Scene.from_parameters(WOVEN | changes)
    own = compile_scene(scene)
    rate, errors = own.status.largest_frequency, []
    for radians in (0.2, 0.1):
        run = MuJoCoRun(scene, radians / rate, rate)
        run.advance_to(0.02)
        beside = compile_scene(scene)
        beside.advance_to(run.time)
        errors.append(distance_between(
            run.snapshot(), beside.snapshot(), scene.geometry.half_edge))
    assert 1e-7 < errors[1] < 1e-5 and 10.0 < errors[0] / errors[1] < 30.0, errors


@needs_mujoco
def test_scenes_are_judged_there():
    scene = StressScene(0, KINDS.index(Kind('dop8')), {
        **WOVEN, 'weave.size': [2, 2, 2], 'solver.tolerance': 1e-2, 'duration': 0.02}, {})
    finding = judge_mujoco(scene)
    assert finding.verdict is Verdict.WITHIN and finding.compared, finding
    assert 0.0 < finding.added < finding.promised and finding.windows > 0 == finding.unjudged
    # It says nothing of what a given step errs by.
    scene.parameters.update({'solver.step': 2e-4, 'solver.tolerance': 1e-6})
    finding = judge_mujoco(scene)
    assert finding.verdict is Verdict.SILENT and finding.added > 3.0 * finding.promised, finding


@needs_mujoco
def test_a_step_beyond_its_limit_is_seen():
    scene = StressScene(0, KINDS.index(Kind('dop8')), {
        **WOVEN, 'weave.size': [2, 2, 2], 'duration': 1.0, 'solver.step': 1e-2}, {})
    finding = judge_mujoco(scene, seconds=1.0)
    assert finding.verdict is Verdict.STOPPED and 'MuJoCo' in finding.detail, finding


def test_only_what_both_can_express_is_drawn():
    some = [seed for seed in seeds_of(0, 300, range(len(KINDS))) if is_expressible(seed)]
    assert len(some) > 20
    known = {*mujoco_run.TERMS, *mujoco_run.LEFT_OUT}
    for seed in some:
        scene = draw_scene(seed)
        assert {*KINDS[scene.kind].terms} <= known and not scene.spoiled


def test_words_that_do_not_go_with_a_peer(capsys, monkeypatch):
    unknown = next(seed for seed in range(100) if not is_expressible(seed))
    monkeypatch.setattr(mujoco_run, 'find_spec', lambda name: object())
    for words, said in ((['--seed', '3', '--shrink'], '--shrink'),
                        (['--seed', str(unknown)], 'cannot express')):
        assert main(['stress', '--peer', 'mujoco', *words]) == 2
        assert said in capsys.readouterr().err
    monkeypatch.setattr(mujoco_run, 'find_spec', lambda name: None)
    assert main(['stress', '--peer', 'mujoco']) == 2
    assert 'pip install mujoco' in capsys.readouterr().err
