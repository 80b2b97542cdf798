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
A pile in this checkout beside another one, in turns: processor time of parts of its fall and rest.

Each run is a process of its own; the least of the rounds counts, which noise of the machine hardly
reaches. Kernels are compiled by a run that does not count.

    .venv/bin/python benchmarks/pile_beside_other.py ../other --size 3 3 6  # 27 bodies
    .venv/bin/python benchmarks/pile_beside_other.py ../other --times 0.1 0.2 0.3  # 216
"""

import argparse
import json
import os
from pathlib import Path
import subprocess
import sys

HERE = Path(__file__).resolve().parents[1]
# What a process does: the folder of benchmarks, method, stiffness, size and times are given.
RUN = """
import json, sys, time
folder, method, stiffness, size, times = json.loads(sys.argv[1])
sys.path.insert(0, folder)
import icofabric_sim as ico
from pile import A, pile
simulation = ico.compile_scene(pile(tuple(size), **{
    'contact.stiffness': stiffness, 'solver.method': method, 'solver.threads': 1}))
simulation.warm_up()
rows = []
for until in times:
    steps, begun = simulation.status.step_count, time.process_time()
    simulation.advance_to(until)
    rows.append((time.process_time() - begun, simulation.status.step_count - steps,
                 simulation.status.deepest_overlap / A))
print(json.dumps(rows))
"""


def run(tree: Path, given: argparse.Namespace, times: list[float]) -> list[list[float]]:
    """Seconds, steps and deepest overlap so far over a, of each part."""
    words = [str(HERE / 'benchmarks'), given.method, given.stiffness, given.size, times]
    done = subprocess.run(
        [sys.executable, '-c', RUN, json.dumps(words)], cwd=tree, check=True,
        stdout=subprocess.PIPE, env={**os.environ, 'PYTHONPATH': str(tree)})
    rows: list[list[float]] = json.loads(done.stdout.splitlines()[-1])
    return rows


def main() -> None:
    """Run both in turns and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('other', type=Path, help='the other checkout')
    parser.add_argument('--size', type=int, nargs=3, default=(6, 6, 12), help='weave.size')
    parser.add_argument('--times', type=float, nargs='+', default=(0.1, 0.2, 0.3, 0.4),
                        help='ends of the parts [s]')
    parser.add_argument('--method', default='leapfrog', help='solver.method')
    parser.add_argument('--stiffness', type=float, default=1e6, help='of contacts [N/m]')
    parser.add_argument('--rounds', type=int, default=3)
    given = parser.parse_args()
    trees = {'other': given.other.resolve(), 'this': HERE}
    for tree in trees.values():
        run(tree, given, [0.2 * given.times[0]])
    rounds = [{name: run(tree, given, list(given.times)) for name, tree in trees.items()}
              for _ in range(given.rounds)]
    print(f'{"until":>8}{"other":>18}{"this":>18}{"ratio":>8}{"in rounds":>16}{"overlap":>16}')
    for part, until in enumerate(given.times):
        least = {name: min(one[name][part] for one in rounds) for name in trees}
        ratios = [one['other'][part][0] / one['this'][part][0] for one in rounds]
        cells = ''.join(f'{seconds:9.2f} s{steps:7d}' for seconds, steps, _ in least.values())
        deep = ' '.join(f'{100.0 * row[2]:.2f} %' for row in least.values())
        print(f'{until:6g} s{cells}{least["other"][0] / least["this"][0]:8.2f}'
              f'{min(ratios):9.2f}-{max(ratios):.2f}{deep:>16}')


if __name__ == '__main__':
    main()
