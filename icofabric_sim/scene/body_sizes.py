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
Shells of bodies that have a size of their own: a ball that falls on a fabric, or larger shells.

The geometry of a weave has one half edge (eqs 50 to 54). Where shells of some of its bodies are
larger or smaller than that, connectors stay attached to the bodies where they are: the shell is
what others touch, what is seen, and what weighs.
"""

from collections.abc import Mapping

from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

# Sizes that are meant: beyond them the overlap that is small for one shell is large for another.
_SMALLEST, _LARGEST = 0.01, 100.0


def own_half_edge(parameters: Parameters, prefix: str, shell: Shell) -> float:
    """Half edge [m] of a `masses.NAME` or `bodies.NAME`: its own, or that of the shell."""
    edge = float(parameters[f'{prefix}.edge_length'])
    return 0.5 * edge if edge else shell.half_edge


def names_of_sizes(
    parameters: Parameters, shell: Shell, families: tuple[str, ...] = ('masses', 'bodies')
) -> list[str]:
    """Names of the parameters that give shells another size than that of the fabric."""
    return [
        f'{family}.{name}.edge_length' for family in families for name in parameters.names(family)
        if own_half_edge(parameters, f'{family}.{name}', shell) != shell.half_edge]


def check_sizes(parameters: Parameters, shell: Shell) -> None:
    """Refuse shells that are so much larger or smaller that nothing is right, or cannot be."""
    names = names_of_sizes(parameters, shell)
    for name in names:
        ratio = parameters[name] / shell.edge_length
        if not _SMALLEST <= ratio <= _LARGEST:
            nearest = (_SMALLEST if ratio < 1.0 else _LARGEST) * shell.edge_length
            raise ParameterError(
                name, f'{name} {parameters[name]!r} m must be {_SMALLEST:g} to {_LARGEST:g} times '
                f'shell.edge_length {shell.edge_length!r} m; the nearest is {nearest:.6g} m')
    woven = [name for name in names if name.startswith('masses.')]
    if woven and parameters['connector.obstruction'] == 'wrap':
        raise ParameterError(
            woven[0], f'{woven[0]} {parameters[woven[0]]!r} m: connectors lie around shells of '
            f'shell.edge_length {shell.edge_length!r} m only; take that, or connector.obstruction '
            'warn')


def make_half_edges(
    parameters: Parameters, shell: Shell, members: Mapping[str, np.ndarray], bodies: int
) -> np.ndarray | None:
    """
    Half edges [m] of so many bodies, (n,); None where all are that of the shell.

    `members`: the bodies of each `masses.NAME` and `bodies.NAME`; of several the last counts.
    """
    if not names_of_sizes(parameters, shell):
        return None
    found = np.full(bodies, shell.half_edge)
    for prefix, chosen in members.items():
        if parameters[f'{prefix}.edge_length']:
            found[chosen] = own_half_edge(parameters, prefix, shell)
    return found


def require_alike(
    half_edges: np.ndarray | None, bodies: np.ndarray, shell: Shell, what: str
) -> None:
    """Refuse a group `what` that has some of the `bodies` whose size is their own."""
    if half_edges is None:
        return
    other = bodies[half_edges[bodies] != shell.half_edge]
    if len(other):
        raise ParameterError(
            what, f'{what}: surface forces are those of shells of shell.edge_length, and body '
            f'{other[0]} has an edge_length of its own; take it out of the group, or push it by a '
            'load')
