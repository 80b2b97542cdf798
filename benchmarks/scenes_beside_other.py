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
"""
Scenes in this checkout beside another one, in turns: processor time of parts of their motion.

Both run the scene files of the other checkout, one thread, each run in a process of its own; the
least of the rounds counts. Kernels are compiled by a run that does not count.

    .venv/bin/python benchmarks/scenes_beside_other.py ../other

How many steps a fabric takes that folds changes by a tenth with the last bits of its motion. With
`--spread` the gravity of each round is another one, by 1e-10, and the mean of the rounds counts.
"""

import argparse
import json
import os
from pathlib import Path
import subprocess
import sys

from machine import describe_machine

HERE = Path(__file__).resolve().parents[1]
SCENES = ('folded_slab', 'dropped_slab', 'draped_slab')
# What a process does: the file of the scene, its changes and the ends of the parts are given.
RUN = """
import json, sys, time
import icofabric_sim as ico
path, changes, times, nudge = json.loads(sys.argv[1])
scene = ico.load_scene(path)
changes['gravity'] = [(1.0 + nudge) * part for part in scene.parameters['gravity']]
scene = ico.Scene.from_parameters({**scene.parameters, **changes})
simulation = ico.compile_scene(scene)
simulation.warm_up()
# Checkouts of before December 2026 have all of it on the simulation itself.
status, rows = getattr(simulation, 'status', simulation), []
for until in times:
    steps, begun = status.step_count, time.process_time()
    simulation.advance_to(until)
    rows.append((time.process_time() - begun, status.step_count - steps,
                 status.deepest_overlap / scene.geometry.half_edge,
                 status.contact_count, status.error_estimate))
print(json.dumps(rows))
"""


def run(
    tree: Path, path: Path, changes: dict[str, object], times: list[float], nudge: float = 0.0
) -> list[list[float]]:
    """
    Seconds, steps, deepest overlap so far over a, contacts and error, of each part.

    Gravity is longer by the part `nudge`.
    """
    python = tree / '.venv/bin/python'
    done = subprocess.run(
        [str(python) if python.exists() else sys.executable, '-c', RUN,
         json.dumps([str(path), changes, times, nudge])],
        cwd=tree, check=True, stdout=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': str(tree)})
    rows: list[list[float]] = json.loads(done.stdout.splitlines()[-1])
    return rows


def main() -> None:
    """Run both in turns and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('other', type=Path, help='the other checkout')
    parser.add_argument('--scenes', nargs='+', default=SCENES, help='ready scenes of the other')
    parser.add_argument('--times', type=float, nargs='+', default=(0.5, 1.0, 2.0),
                        help='ends of the parts [s]')
    parser.add_argument('--tolerance', type=float, default=1e-6, help='solver.tolerance [1/s]')
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--spread', action='store_true',
                        help='the gravity of each round is another one; means count')
    given = parser.parse_args()
    trees = {'other': given.other.resolve(), 'this': HERE}
    changes = {'solver.threads': 1, 'solver.tolerance': given.tolerance}
    print(describe_machine())
    print(f'{"scene, until":>22}{"other":>20}{"this":>20}{"ratio":>8}{"in rounds":>14}'
          f'{"overlap / a":>18}{"contacts":>10}{"errors":>20}')
    for scene in given.scenes:
        path = trees['other'] / 'config' / f'{scene}.yaml'
        times = list(given.times)
        for tree in trees.values():
            run(tree, path, changes, times)
        rounds = [{name: run(tree, path, changes, times, 1e-10 * number if given.spread else 0.0)
                   for name, tree in trees.items()} for number in range(given.rounds)]
        for part, until in enumerate(times):
            least = {name: min(one[name][part] for one in rounds) for name in trees}
            if given.spread:
                least = {name: [sum(numbers) / given.rounds for numbers in zip(
                    *(one[name][part] for one in rounds))] for name in trees}
            ratios = [one['other'][part][0] / one['this'][part][0] for one in rounds]
            cells = ''.join(f'{row[0]:11.3f} s{row[1]:7.0f}' for row in least.values())
            deep = ' '.join(f'{100.0 * row[2]:.2f} %' for row in least.values())
            touch = ' '.join(f'{row[3]:.0f}' for row in least.values())
            errors = ' '.join(f'{row[4]:.1e}' for row in least.values())
            label = f'{scene}, {until:g} s'
            print(f'{label:>22}{cells}{least["other"][0] / least["this"][0]:8.2f}'
                  f'{min(ratios):8.2f}-{max(ratios):.2f}{deep:>18}{touch:>10}{errors:>20}',
                  flush=True)


if __name__ == '__main__':
    main()
