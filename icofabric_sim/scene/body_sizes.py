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
Shells of loose bodies that have a size of their own, as a ball that is dropped on a fabric.

The shells of a weave are alike, as its geometry has one half edge (eqs 50 to 54); bodies that no
connector holds may be larger or smaller.
"""

from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

# Sizes that are meant: beyond them the overlap that is small for one shell is large for another.
_SMALLEST, _LARGEST = 0.01, 100.0


def own_half_edge(parameters: Parameters, name: str, shell: Shell) -> float:
    """Half edge [m] of the loose body `bodies.NAME`: its own, or that of the shell."""
    edge = float(parameters[f'bodies.{name}.edge_length'])
    return 0.5 * edge if edge else shell.half_edge


def make_half_edges(parameters: Parameters, shell: Shell, bodies: int) -> np.ndarray | None:
    """Half edges [m] of so many bodies, (n,), loose ones last; None where they are alike."""
    loose = parameters.names('bodies')
    own = [own_half_edge(parameters, name, shell) for name in loose]
    if all(each == shell.half_edge for each in own):
        return None
    return np.concatenate([np.full(bodies - len(loose), shell.half_edge), own])


def check_sizes(parameters: Parameters, shell: Shell) -> None:
    """Refuse bodies that are larger or smaller than the shell by so much that nothing is right."""
    for name in parameters.names('bodies'):
        key = f'bodies.{name}.edge_length'
        ratio = own_half_edge(parameters, name, shell) / shell.half_edge
        if not _SMALLEST <= ratio <= _LARGEST:
            nearest = (_SMALLEST if ratio < 1.0 else _LARGEST) * shell.edge_length
            raise ParameterError(
                key, f'{key} {parameters[key]!r} m must be {_SMALLEST:g} to {_LARGEST:g} times '
                f'shell.edge_length {shell.edge_length!r} m; the nearest is {nearest:.6g} m')


def sized_bodies(parameters: Parameters, shell: Shell) -> list[str]:
    """Names of the `bodies.NAME.edge_length` that give another size than the shell's."""
    return [
        f'bodies.{name}.edge_length' for name in parameters.names('bodies')
        if own_half_edge(parameters, name, shell) != shell.half_edge]


def require_alike(
    parameters: Parameters, half_edges: np.ndarray | None, bodies: np.ndarray, what: str
) -> None:
    """Refuse a group `what` that has some of the `bodies` whose size is their own."""
    if half_edges is None:
        return
    names = parameters.names('bodies')
    for body in bodies.tolist():
        loose = body - (len(half_edges) - len(names))
        if loose >= 0 and half_edges[body] != 0.5 * parameters['shell.edge_length']:
            raise ParameterError(
                what, f'{what}: surface forces are those of shells of shell.edge_length, and '
                f'bodies.{names[loose]} has an edge_length of its own; take it out of the group, '
                'or push it by a load')
