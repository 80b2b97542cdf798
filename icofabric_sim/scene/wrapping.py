# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""What goes with connectors that lie around their shells."""

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.attachments import are_given

# It restores the angle at which a connector leaves its body, which a shell decides here.
_UNFIT = 'bending_stiffness'


def check_wrapping(parameters: Parameters) -> None:
    """Refuse what a connector around a shell cannot do."""
    name = 'connector.obstruction'
    if parameters[name] != 'wrap':
        return
    if are_given(parameters) or parameters['connector.attachment_scale'] != 1.0:
        raise ParameterError(
            name, f'{name} wrap has geodesics from edge midpoints only: leave out '
            'connector.attachment_scale and connector.attachment.*, or take warn')
    prefixes = ['connector'] + [
        f'connector_groups.{group}' for group in parameters.names('connector_groups')]
    for prefix in prefixes:
        own = f'{prefix}.{_UNFIT}'
        if parameters[own] > 0.0:
            raise ParameterError(
                name, f'{name} wrap does not go with {own} {parameters[own]!r}: bending restores '
                'the angle between connector and body, and around a shell that is the angle of '
                'the shell; set it to 0 (twisting_stiffness can stay), or take warn')
