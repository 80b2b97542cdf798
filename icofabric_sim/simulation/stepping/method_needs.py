# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Terms of a scene that only an adaptive method can integrate."""

from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.electric import is_charged
from icofabric_sim.scene.maxwell import arm_parameter_name
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.stepping.events import why_events
from icofabric_sim.simulation.stepping.method_selection import Choice
from icofabric_sim.simulation.stepping.methods import ADAPTIVE, facts_of, IMPLICIT, METHODS
import numpy as np

# Largest gap between the stages of a pair, as a fraction of the step, for which the speeds at the
# stages bound the motion between them (terms/contacts/clearance.py).
_LARGEST_STAGE_GAP_RATIO = 0.28
# Methods up to this order lose least where forces jump.
_LOW_ORDER = 2


def required_method(scene: Scene, *, outside: bool = False) -> Choice | None:
    """
    Return the only method that can integrate the scene, and the reason; None with a choice.

    Dissipation by contacts is considered in method_selection.py. `outside` means that the scene
    has a body force. Raises ParameterError if another method is given.
    """
    reason = _reason(scene)
    if outside and not scene.expression_loads:
        reason = 'a body force may depend on velocities'
    given, others = scene.parameters['solver.method'], ''
    if given in IMPLICIT:
        lacks = why_not_implicit(scene, outside=outside)
        if lacks:
            raise ParameterError(
                'solver.method',
                f'solver.method {given} cannot integrate this scene yet: {lacks}; take '
                f'{ADAPTIVE} or auto')
        return None
    if given != 'auto' and not follows_contacts(given) and may_touch(scene):
        raise ParameterError(
            'solver.method',
            f'solver.method {given} cannot integrate this scene: shells may touch, and its stages '
            f'are too far apart to see contacts; take contact.mode never, {ADAPTIVE} or auto')
    if not reason and given != 'auto' and not facts_of(given).runs_through_contacts:
        reason = contact_losses(scene)
        others = ', '.join(
            ['', *(name for name, method in METHODS.items() if method.runs_through_contacts)])
    if not reason:
        _refuse_blind_steps(scene)
        return None
    if given != 'auto' and facts_of(given).symplectic:
        raise ParameterError(
            'solver.method',
            f'solver.method {given} cannot integrate this scene: {reason}; take '
            f'{ADAPTIVE}{others} or auto')
    return Choice(ADAPTIVE, reason)


def why_not_implicit(scene: Scene, *, outside: bool = False) -> str:
    """Return what implicit steps of a scene cannot resolve, and a remedy; empty if nothing."""
    parameters = scene.parameters
    if scene.expression_loads:
        return f'it has {scene.expression_loads[0].expression.name}'
    if outside:
        return 'it has a body force, whose derivative is not known'
    losses = contact_losses(scene)
    if losses:
        return losses
    if parameters['connector.obstruction'] == 'wrap':
        return 'connector.obstruction is wrap, where warn or stop would do'
    arm = arm_parameter_name(parameters)
    if arm:
        return f'{arm} gives connectors Maxwell arms'
    if scene.custom is not None:
        return f'it has custom connectors (connectors.{scene.custom.names[0]})'
    if scene.principal_inertia is not None:
        return 'inertias are not isotropic (principal_inertia)'
    if scene.anchors:
        return f'it has anchors ({next(iter(scene.anchors))})'
    for name in scene.platens:
        return f'planes.{name} moves'
    for name, drive in scene.drives.items():
        if not drive.moves.all():
            return f'drives.{name} leaves freedoms of its bodies free'
    if is_charged(parameters):
        return 'bodies are charged (charge.per_body, charge.dipole, charges.NAME)'
    return why_events(scene)


def is_damped(scene: Scene) -> bool:
    """Return True if connectors or anchors are damped."""
    return scene.anchors_damped or bool(
        scene.connector_count and scene.connectors.damping.any())


def _refuse_blind_steps(scene: Scene) -> None:
    """Raise ParameterError if neither steps nor estimate can comply with the tolerance."""
    parameters = scene.parameters
    given = parameters['solver.method']
    if (scene.connector_count and parameters['connector.obstruction'] == 'wrap'
            and not parameters['solver.step'] > 0.0 and given != 'auto'
            and facts_of(given).symplectic and facts_of(given).order > _LOW_ORDER):
        raise ParameterError(
            'solver.method',
            f'solver.method {given} cannot choose its steps with connector.obstruction wrap: '
            'forces jump where connectors change to another geodesic, and steps of one length '
            'become hundreds of times as short there and err by more than solver.tolerance all '
            f'the same; take {ADAPTIVE}, auto or leapfrog, or give solver.step')


def _reason(scene: Scene) -> str:
    """Return the first term that requires an adaptive method, if any."""
    # Forces that depend on velocities are named here; events within a step name themselves.
    if is_damped(scene):
        return 'connectors or anchors are damped, by forces that depend on velocities'
    for name in ('drag.linear', 'drag.angular'):
        if scene.parameters[name] > 0.0:
            return f'{name} is a force that depends on velocities'
    return beyond_losses(scene)


def beyond_losses(scene: Scene) -> str:
    """
    Return a term other than damping and drag that requires an adaptive method; empty if none.
    """
    parameters = scene.parameters
    arm = arm_parameter_name(parameters)
    if scene.expression_loads:
        return f'{scene.expression_loads[0].expression.name} depends on place or time'
    if len(scene.woven) and arm:
        return f'{arm} gives connectors Maxwell arms, which creep'
    if scene.principal_inertia is not None:
        return 'inertias are not isotropic (principal_inertia), so free bodies tumble'
    if is_charged(parameters) and any(parameters['field.magnetic']):
        return 'field.magnetic acts on charges by their velocities'
    return why_events(scene)


def may_touch(scene: Scene) -> bool:
    """Return True if contacts are computed and there are at least two shells or planes."""
    parameters = scene.parameters
    return scene.body_count + len(parameters.names('planes')) > 1 and (
        parameters['contact.mode'] != 'never')


def follows_contacts(name: str) -> bool:
    """Return True if the stages of the method `name` are close enough to see contacts."""
    embedded = facts_of(name).embedded
    if embedded is None or embedded.pair is None:
        return True
    nodes = np.sort([*embedded.pair.nodes[:embedded.pair.stage_count], 1.0])
    return bool(np.diff(nodes).max() < _LARGEST_STAGE_GAP_RATIO)


def contact_losses(scene: Scene) -> str:
    """Return the dissipation by contacts, which only some methods resolve; empty if none."""
    parameters = scene.parameters
    if scene.body_count + len(parameters.names('planes')) > 1 and (
            parameters['contact.mode'] != 'never'):
        if parameters['contact.damping'] > 0.0:
            return 'contact.damping is a force that depends on velocities'
        if parameters['contact.friction'] > 0.0:
            return 'contact.friction follows the slip of shells in contact'
    return ''
