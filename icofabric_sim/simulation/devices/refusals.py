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
"""What ranks cannot share yet, refused by its name before anything is divided."""

from collections.abc import Iterator

from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.stepping.method_needs import required_method
from icofabric_sim.simulation.stepping.methods import METHODS

_ONE = 'or run it in one process'


def require_shareable(scene: Scene, *, cosines: bool, body_force: bool) -> None:
    """Raise ParameterError, or ValueError for what is no parameter, where ranks cannot share."""
    if cosines:
        raise ValueError(
            "rotation 'direction_cosines' is not shared by ranks: take 'quaternion', " + _ONE)
    if body_force:
        raise ValueError(f'a body_force is not shared by ranks: leave it out, {_ONE}')
    for name, what, way_out in _lacking(scene):
        raise ParameterError(
            name, f'{name} {what} is not shared by ranks yet: {way_out}, {_ONE}')
    choice = required_method(scene)
    if choice is not None:
        raise ParameterError(
            'solver.method',
            f'solver.method {choice.name} is not shared by ranks yet, and this scene needs it: '
            f'{choice.reason}; leave that out, {_ONE}')


def require_shareable_method(name: str) -> None:
    """Raise ParameterError where ranks cannot take the steps of the method `name`."""
    if not METHODS[name].symplectic:
        shared = ', '.join(other for other, method in METHODS.items() if method.symplectic)
        raise ParameterError(
            'solver.method',
            f'solver.method {name} is not shared by ranks yet: take one of {shared}, {_ONE}')


def _lacking(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Yield parameters with what they ask for, and the way out."""
    parameters = scene.parameters
    if scene.body_count + len(parameters.names('planes')) > 1 and (
            parameters['contact.mode'] != 'never'):
        yield 'contact.mode', str(parameters['contact.mode']), 'take never'
    if parameters['charge.mutual']:
        yield 'charge.mutual', 'true', 'take false'
    if parameters['connector.obstruction'] == 'wrap':
        yield 'connector.obstruction', 'wrap', 'take warn or stop'
    if scene.connector_count and scene.connectors.tables.tables:
        yield 'connector.law', 'by a table', 'take connector.stiffness'
    for section, what in (('drives', 'with a drive'), ('tractions', 'with a surface force')):
        for name in parameters.names(section):
            yield f'{section}.{name}', what, 'leave it out'
