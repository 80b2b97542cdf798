# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Individually sized shells: a ball that falls on a fabric, or larger shells within the fabric.

The geometry of a weave has one half edge (eqs 50 to 54). A larger or smaller shell does not move
the attachment points of connectors; it changes contacts, pictures, mass and inertia.
"""

from collections.abc import Mapping

from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

# Allowed edge ratios; beyond them an overlap that is small for one shell is large for another.
_MIN_EDGE_RATIO, _MAX_EDGE_RATIO = 0.01, 100.0


def half_edge_of(parameters: Parameters, prefix: str, shell: Shell) -> float:
    """Return the half edge [m] of a `masses.NAME` or `bodies.NAME`, by default the shell's."""
    edge = float(parameters[f'{prefix}.edge_length'])
    return 0.5 * edge if edge else shell.half_edge


def size_parameter_names(
    parameters: Parameters, shell: Shell, families: tuple[str, ...] = ('masses', 'bodies')
) -> list[str]:
    """Return the names of the parameters that give shells a size other than the fabric's."""
    return [
        f'{family}.{name}.edge_length' for family in families for name in parameters.names(family)
        if half_edge_of(parameters, f'{family}.{name}', shell) != shell.half_edge]


def check_sizes(parameters: Parameters, shell: Shell) -> None:
    """Refuse sizes outside the allowed ratios, and sizes that wrapped connectors cannot have."""
    names = size_parameter_names(parameters, shell)
    for name in names:
        ratio = parameters[name] / shell.edge_length
        if not _MIN_EDGE_RATIO <= ratio <= _MAX_EDGE_RATIO:
            nearest = (_MIN_EDGE_RATIO if ratio < 1.0 else _MAX_EDGE_RATIO) * shell.edge_length
            raise ParameterError(
                name, f'{name} {parameters[name]!r} m must be {_MIN_EDGE_RATIO:g} to '
                f'{_MAX_EDGE_RATIO:g} times shell.edge_length {shell.edge_length!r} m; the '
                f'nearest is {nearest:.6g} m')
    woven = [name for name in names if name.startswith('masses.')]
    if woven and parameters['connector.obstruction'] == 'wrap':
        raise ParameterError(
            woven[0], f'{woven[0]} {parameters[woven[0]]!r} m: connectors wrap only over shells '
            f'of shell.edge_length {shell.edge_length!r} m; use that size, or '
            'connector.obstruction warn')


def make_half_edges(
    parameters: Parameters, shell: Shell, members: Mapping[str, np.ndarray], bodies: int
) -> np.ndarray | None:
    """
    Return the half edges [m] of all bodies, (n,), or None if all equal the shell's.

    `members` maps each `masses.NAME` and `bodies.NAME` to its bodies; later entries take
    precedence.
    """
    if not size_parameter_names(parameters, shell):
        return None
    found = np.full(bodies, shell.half_edge)
    for prefix, chosen in members.items():
        if parameters[f'{prefix}.edge_length']:
            found[chosen] = half_edge_of(parameters, prefix, shell)
    return found


def require_shell_size(
    half_edges: np.ndarray | None, bodies: np.ndarray, shell: Shell, what: str
) -> None:
    """Refuse the group of the parameter `what` if one of its `bodies` has an individual size."""
    if half_edges is None:
        return
    other = bodies[half_edges[bodies] != shell.half_edge]
    if len(other):
        raise ParameterError(
            what, f'{what}: surface forces need shells of shell.edge_length, but body {other[0]} '
            'has an individual edge_length; take the body out of the group, or apply a load to it')
