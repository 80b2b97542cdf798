# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Estimate the fastest rates of a scene from its parameters, and refuse unresolvable ones.

The estimate considers a single body: a spring of stiffness k moves a mass m at the rate
sqrt(k / m), a damper c at c / m, a speed v at v / a. Rates of the assembled fabric are at most a
few times larger.
"""

from collections.abc import Iterator
import math

from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.masses import smallest_mass_and_inertia

# [1/s]; at this rate a second of simulated time takes about 1e9 steps.
MAX_RATE_PER_S = 1e9
_SPRINGS = ('stiffness', 'stiffness_extension', 'stiffness_compression')
_CONNECTOR_STIFFNESSES = (*_SPRINGS, 'maxwell_stiffness')


def check_rates(parameters: Parameters, shell: Shell) -> None:
    """Raise ParameterError for parameters that move a single body faster than steps resolve."""
    for name, size, unit in _motions(parameters, shell):
        value = parameters[name]
        limit, single = MAX_RATE_PER_S * size, not isinstance(value, list)
        if not max(map(abs, [value] if single else value)) <= limit:
            raise ParameterError(
                name, f'{name} {value!r} {unit}: time steps resolve {limit:g} {unit} at most; '
                'choose a smaller one')
    mass, _ = smallest_mass_and_inertia(parameters, shell)
    for name, rate in _rates(parameters, shell):
        if not rate <= MAX_RATE_PER_S:
            raise ParameterError(
                name,
                f'{name} {parameters[name]!r} would move a body of {mass:.3g} kg at a rate '
                f'of {rate:.3g} 1/s, but steps resolve at most {MAX_RATE_PER_S:g} 1/s; choose a '
                'smaller value, or heavier shells',
            )


def _motions(parameters: Parameters, shell: Shell) -> Iterator[tuple[str, float, str]]:
    """Name what moves, with the speed, spin or amplitude that has the rate 1/s, and its unit."""
    a = shell.half_edge
    for family in ('bodies', 'initial'):
        for name in parameters.names(family):
            yield f'{family}.{name}.linear_velocity', a, 'm/s'
            yield f'{family}.{name}.angular_velocity', 1.0, 'rad/s'
    yield 'initial_random.velocity_sigma', a, 'm/s'
    yield 'initial_random.spin_sigma', 1.0, 'rad/s'
    for name in parameters.names('anchors'):
        yield f'anchors.{name}.velocity', a, 'm/s'
    for prefix in (
            f'{family}.{name}' for family in ('anchors', 'drives', 'planes')
            for name in parameters.names(family)):
        rate, per = 1.0, '/s'
        if parameters[f'{prefix}.motion'] == 'sine':
            yield f'{prefix}.frequency', 0.5 / math.pi, 'Hz'
            rate, per = 2.0 * math.pi * parameters[f'{prefix}.frequency'] or 1.0, ''
        yield f'{prefix}.linear', a / rate, f'm{per}'
        if prefix.startswith('drives'):
            yield f'{prefix}.angular', 1.0 / rate, f'rad{per}'


def _rates(parameters: Parameters, shell: Shell) -> Iterator[tuple[str, float]]:
    mass, inertia = smallest_mass_and_inertia(parameters, shell)
    for family in ('connector', *(
            f'connector_groups.{name}' for name in parameters.names('connector_groups'))):
        for field in _CONNECTOR_STIFFNESSES:
            yield f'{family}.{field}', _spring_rate(parameters[f'{family}.{field}'], mass)
        for field in ('bending_stiffness', 'twisting_stiffness'):
            yield f'{family}.{field}', _spring_rate(parameters[f'{family}.{field}'], inertia)
        yield f'{family}.damping', parameters[f'{family}.damping'] / mass
    for prefix in (
            f'{family}.{name}' for family in ('anchors', 'connectors')
            for name in parameters.names(family)):
        for field in _SPRINGS:
            yield f'{prefix}.{field}', _spring_rate(parameters[f'{prefix}.{field}'], mass)
        yield f'{prefix}.damping', parameters[f'{prefix}.damping'] / mass
    yield 'contact.stiffness', _spring_rate(parameters['contact.stiffness'], mass)
    yield 'drag.linear', parameters['drag.linear'] / mass
    yield 'drag.angular', parameters['drag.angular'] / inertia
    yield 'gravity', _spring_rate(math.hypot(*parameters['gravity']), shell.edge_length)


def _spring_rate(stiffness: float, mass: float) -> float:
    return math.sqrt(max(stiffness, 0.0) / mass)
