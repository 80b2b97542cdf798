# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Text summary of a scene: shell, weave, bodies, supports, drives and loads."""

from collections.abc import Iterable, Sequence
import math

from icofabric_sim.checks import counted
from icofabric_sim.parameters.named_files import use_recorded_files
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.densities import make_density
from icofabric_sim.scene.expression_loads import SurfaceLoad
from icofabric_sim.scene.masses import individual_masses
from icofabric_sim.scene.region import make_region, sides_text
from icofabric_sim.scene.scene import BYTES_PER_BODY, Scene, weave_choices
from icofabric_sim.scene.weave import estimate_weave
from icofabric_sim.scene.weave_geometry import slab_depth
import numpy as np

Row = tuple[str, str]


def size_text(scene: Scene) -> str:
    """Return the numbers of bodies and connectors of a scene as text."""
    return f'{counted(scene.body_count, "body")}, {counted(scene.connector_count, "connector")}'


def as_lines(rows: Iterable[Row]) -> list[str]:
    """Return lines of two columns; a row without a label continues the row above."""
    table = list(rows)
    width = max((len(label) for label, _ in table), default=0)
    return [f'{label:<{width}}  {text}'.rstrip() for label, text in table]


def vector(values: Sequence[float] | np.ndarray, unit: str) -> str:
    """Return a vector with its unit as text."""
    return f'[{", ".join(f"{value:.6g}" for value in values)}] {unit}'


def evaluations_text(
    taken: float, others: float, shown: float, *, is_estimated: bool
) -> str:
    """
    Return the numbers of force evaluations of a run as text: for integration, and for other uses.

    `shown` of the `others` are for outputs; the rest estimate errors, or only choose steps.
    """
    purpose = 'estimate errors' if is_estimated else 'choose and judge steps'
    beside = ' and '.join(
        f'{count:,.0f}' + (f' ({100.0 * count / taken:,.1f} %)' if taken > 0.0 else '')
        + f' to {what}' for count, what in ((others - shown, purpose), (shown, 'show states'))
        if count > 0.0)
    return f'{taken:,.0f} evaluations of the forces' + (beside and f'; beside them {beside}')


def amplification_text(growth: float, at_least: bool = False) -> str:
    """Return an error amplification as text."""
    if growth == math.inf:
        return 'more than 1e308 times'
    return f'{"at least " if at_least else ""}{growth:.3g} times'


def describe_scene(scene: Scene) -> list[Row]:
    """Return labels and texts that describe a scene before compilation."""
    shell, geometry, weave = scene.shell, scene.geometry, scene.weave
    parameters = scene.parameters
    angle = geometry.connector_angle
    rows = [
        ('shell', f'mass {shell.mass:.6g} kg, {_inertia(scene, "shell", shell.inertia)}'),
        (
            '',
            f'edge 2a = {shell.edge_length:.6g} m, inner edge 2b = '
            f'{shell.inner_edge_length:.6g} m, thickness T = {shell.thickness:.6g} m',
        ),
        ('weave', f'{weave.kind}, variant {weave.variant}, {_times(weave.size)} grid positions'),
        *_region(scene),
        (
            '',
            f'cube width w = {geometry.cube_width:.6g} m, connector length L = '
            f'{geometry.connector_length:.6g} m',
        ),
        (
            '',
            f'connector angle theta = {angle:.6g} rad = {math.degrees(angle):.6g} degrees, '
            f'pitch W = {geometry.pitch:.6g} m',
        ),
        ('size', _size(scene)),
        ('bodies', f'{scene.body_count:,}' + _loose(scene)),
        ('connectors', f'{scene.connector_count:,}, {_springs(scene)}' + _custom(scene)),
        ('mass', f'{scene.masses.total(scene.body_count):.6g} kg in total' + _own_masses(scene)),
        ('gravity', vector(parameters['gravity'], 'm/s^2')),
    ]
    rows += _several('groups', (
        f'{name}: {counted(len(scene.groups[name]), "body")} ({parameters[f"groups.{name}"]})'
        for name in parameters.names('groups')
    ))  # fmt: skip
    rows += _several('supports', (
        f'{name}: {parameters[f"supports.{name}.fix"]} of {_group(scene, f"supports.{name}")}'
        for name in parameters.names('supports')
    ))  # fmt: skip
    rows += _several('loads', (_load(scene, name) for name in scene.loads))
    if scene.drives:
        rows += _several('drives', (_drive(scene, name) for name in scene.drives))
    if scene.platens:
        rows += _several('planes', (_motion(scene, f'planes.{name}') for name in scene.platens))
    if scene.anchors:
        rows += _several('anchors', (_anchor(scene, name) for name in scene.anchors))
    if parameters.names('tractions'):
        rows += _several(
            'tractions', (_traction(scene, name) for name in parameters.names('tractions')))
    if parameters.names('line_loads'):
        rows += _several(
            'line loads', (_line_load(scene, name) for name in parameters.names('line_loads')))
    if parameters['field.electric_expression']:
        rows.append(('field', f'{parameters["field.electric_expression"]} V/m'))
    rows += _several('charges', (
        f'{prefix}: {found.charge:.6g} C, dipole {vector(found.dipole, "C m")}, relative error '
        f'{found.error:.1e}' for prefix, found in scene.electric.distributions.items()))
    rows += _several('initial', (
        f'{name}: {_group(scene, f"initial.{name}")}{_initial(scene, name)}'
        for name in parameters.names('initial')
    ))  # fmt: skip
    memory = scene.body_count * BYTES_PER_BODY
    rows.append(('memory', f'about {_bytes(max(memory, _weaving(scene)))}'))
    return rows


def _bytes(count: float) -> str:
    for unit in ('B', 'KiB', 'MiB'):
        if count < 1024:
            return f'{count:.3g} {unit}'
        count /= 1024
    return f'{count:.3g} GiB'


def _weaving(scene: Scene) -> int:
    return estimate_weave(**weave_choices(scene.parameters, scene.geometry)).memory


def _times(numbers: Sequence[int]) -> str:
    return ' x '.join(str(number) for number in numbers)


def _region(scene: Scene) -> list[Row]:
    text = scene.parameters['weave.region']
    with use_recorded_files(scene.files):
        region = make_region(text)
    return [] if region is None else [(
        '', f'cut to {text.strip()}, {sides_text(2.0 * region.half_extent)} m')]


def _size(scene: Scene) -> str:
    if scene.weave.kind == 'orthogonal' and not scene.parameters['weave.region']:
        depth = slab_depth(scene.weave.size, scene.geometry)
        return ' x '.join(f'{value:.6g}' for value in depth) + (
            ' m between outer faces of the cubes around shells')
    woven = scene.weave.position
    spread = woven.max(axis=0) - woven.min(axis=0)
    return ' x '.join(f'{value:.6g}' for value in spread) + ' m between outer centres'


def _loose(scene: Scene) -> str:
    loose = scene.body_count - scene.weave.body_count
    if not loose:
        return ''
    return f', the last {loose} of them loose: {", ".join(scene.parameters.names("bodies"))}'


def _custom(scene: Scene) -> str:
    if scene.custom is None:
        return ''
    names = ', '.join(dict.fromkeys(scene.custom.names))
    return f', the last {len(scene.custom.names):,} of them custom: {names}'


def _springs(scene: Scene) -> str:
    laws, length = scene.woven.laws, scene.woven.woven_length
    curves = scene.woven.curves.curves
    if curves:
        text = f'by {", ".join(curve.text for curve in curves)}'
    elif laws.is_single_linear_spring:
        text = f'stiffness {_range(laws.extension)} N/m'
    else:
        text = (
            f'stiffness {_range(laws.extension)} N/m in extension, '
            f'{_range(laws.compression)} N/m in compression')
    text += f', natural length {_range(laws.natural_length)} m'
    strain = length / laws.natural_length - 1.0
    if strain.any():
        text += f' (woven at a strain of {_range(100.0 * strain)} %)'
    for name in ('bending', 'twisting'):
        stiffness = getattr(scene.woven, f'{name}_stiffness')
        if stiffness.any():
            text += f', {name} stiffness {_range(stiffness)} N m/rad'
    arms = scene.woven.arms
    if arms is not None:
        text += (f', Maxwell arms of {_range(arms.stiffness)} N/m that relax in '
                 f'{_range(arms.time[arms.time > 0.0])} s')
    limits = scene.woven.limits
    for word, values in () if limits is None else (
            ('longer', limits.longest), ('shorter', limits.shortest)):
        given = values[np.isfinite(values) & (values > 0.0)]
        if len(given):
            text += f', broken when {word} than {_range(given)} m'
    return text


def _range(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f'{low:.6g}' if low == high else f'{low:.6g} to {high:.6g}'


def _several(label: str, texts: Iterable[str]) -> list[Row]:
    rows = [('', text) for text in texts]
    return [(label, rows[0][1]), *rows[1:]] if rows else [(label, 'none')]


def _group(scene: Scene, prefix: str) -> str:
    name = scene.parameters[f'{prefix}.group']
    return f'{name} ({counted(len(scene.groups[name]), "body")})'


def _load(scene: Scene, name: str) -> str:
    load = scene.loads[name]
    frame = 'the axes of each body' if load.in_body_axes else 'world axes'
    share = 'divided among them' if load.is_divided else 'on each body'
    text = f'{name}: ~/loads/{name} on {_group(scene, f"loads.{name}")}, {frame}, {share}'
    if load.force.any() or load.torque.any():
        text += (
            f'; {_profile(scene, f"loads.{name}")} {vector(load.force, "N")}, '
            f'{vector(load.torque, "N m")}')
    expression = scene.parameters[f'loads.{name}.expression']
    return f'{text}; {expression} N' if expression else text


def _own_masses(scene: Scene) -> str:
    own = individual_masses(scene.parameters, scene.shell)
    parts = [
        f'{prefix}: {_edge(scene.parameters, prefix)}{mass:.6g} kg, '
        f'{_inertia(scene, prefix, inertia)}'
        for prefix, (mass, inertia) in own.items()]
    return f' ({"; ".join(parts)})' if parts else ''


def _edge(parameters: Parameters, prefix: str) -> str:
    edge = parameters[f'{prefix}.edge_length']
    return f'edge 2a = {edge:.6g} m, ' if edge else ''


def _inertia(scene: Scene, prefix: str, inertia: float) -> str:
    moments = scene.parameters[f'{prefix}.principal_inertia']
    density = make_density(scene.parameters, prefix, scene.shell)
    if density is not None:
        moments = density.moments * (inertia / density.moments.min())
        if density.axes is not None:
            return f'inertia {vector(moments, "kg m^2")} about tilted axes'
    if np.any(moments):
        return f'inertia {vector(moments, "kg m^2")} about the body axes'
    return f'inertia {inertia:.6g} kg m^2'


def _profile(scene: Scene, prefix: str) -> str:
    kind, start, duration = (
        scene.parameters[f'{prefix}.{field}'] for field in ('profile', 'start', 'duration'))
    begin = f'from {start:g} s on' if start > 0.0 else 'from the start'
    text = begin if kind == 'steady' else f'{begin} as {kind}'
    return f'{text}, for {duration:g} s,' if duration > 0.0 else text


def _anchor(scene: Scene, name: str) -> str:
    prefix = f'anchors.{name}'
    body, edge, point, position, velocity, file, motion, damping = (
        scene.parameters[f'{prefix}.{field}'] for field in (
            'body', 'edge', 'point', 'position', 'velocity', 'file', 'motion', 'damping'))
    end = f'point {vector(np.array(point), "m")}' if any(point) else f'edge {edge}'
    text = f'{name}: body {body}, {end}, to {vector(np.array(position), "m")}'
    if any(scene.parameters[f'{prefix}.{field}'] > 0.0 for field in (
            'stiffness', 'stiffness_extension', 'stiffness_compression', 'natural_length')):
        extension, compression, rest = scene.anchors[name].law
        stiffness = f'{extension:g}' if extension == compression else (
            f'k_e / k_c = {extension:g} / {compression:g}')
        text += f', {stiffness} N/m, natural length {rest:g} m'
    longest, shortest = scene.anchors[name].limits
    limits = [f'above {longest:g} m'] * math.isfinite(longest) + [
        f'below {shortest:g} m'] * (shortest > 0.0)
    if limits:
        text += f', breaks {" and ".join(limits)}'
    if damping:
        text += f', damping {damping:g} N s/m'
    if motion:
        text += f', which moves as a {motion}'
    if any(velocity):
        text += f', which moves with {vector(np.array(velocity), "m/s")}'
    return f'{text}, which moves as {file} says' if file else text


def _drive(scene: Scene, name: str) -> str:
    return _motion(scene, f'drives.{name}', f' on {_group(scene, f"drives.{name}")}')


def _motion(scene: Scene, prefix: str, bodies: str = '') -> str:
    motion, linear, start = (
        scene.parameters[f'{prefix}.{field}'] for field in ('motion', 'linear', 'start'))
    angular = scene.parameters[f'{prefix}.angular'] if bodies else ()
    text = f'{prefix.partition(".")[2]}: ~/{prefix.replace(".", "/")}{bodies}, {motion}'
    units = ('m', 'rad') if motion == 'sine' else ('m/s', 'rad/s')
    for value, unit in zip((linear, angular), units):
        if any(value):
            text += f', {vector(np.array(value), unit)}'
    if motion == 'sine':
        text += f', {scene.parameters[f"{prefix}.frequency"]:g} Hz'
    if motion.endswith('table'):
        text += f' {scene.parameters[f"{prefix}.file"]}'
    return f'{text}, from {start:g} s on' if start > 0.0 else text


def _traction(scene: Scene, name: str) -> str:
    prefix = f'tractions.{name}'
    pressure, shear, faces, direction = (
        scene.parameters[f'{prefix}.{field}']
        for field in ('pressure', 'shear', 'faces', 'direction'))
    text = f'{name}: on {_group(scene, prefix)}, faces {faces}, {pressure:g} Pa'
    if any(shear):
        text += f', shear {vector(np.array(shear), "Pa")}'
    if scene.parameters[f'{prefix}.variation'].strip():
        text += ', varying over each face'
    text += _quadrature(scene, name, prefix)
    if scene.parameters[f'{prefix}.frictionless']:
        text += ', frictionless'
    return f'{text}, {direction}; {_profile(scene, prefix)}'


def _line_load(scene: Scene, name: str) -> str:
    prefix = f'line_loads.{name}'
    edges, force, frame = (
        scene.parameters[f'{prefix}.{field}'] for field in ('edges', 'force', 'frame'))
    text = f'{name}: on {_group(scene, prefix)}, edges {edges}, {vector(force, "N/m")}'
    return f'{text}{_quadrature(scene, prefix, prefix)}, {frame} axes; {_profile(scene, prefix)}'


def _quadrature(scene: Scene, name: str, prefix: str) -> str:
    """Return the expression of a load over faces or edges, its Gauss rule and error, as text."""
    expression = scene.parameters[f'{prefix}.expression']
    if not expression:
        return ''
    kept = scene.tractions.get(name)
    rule = next(
        load.quadrature for load in scene.expression_loads
        if isinstance(load, SurfaceLoad) and load.expression.name == f'{prefix}.expression'
    ) if kept is None else kept.quadrature
    assert rule is not None
    return (
        f', {expression} (Gauss rule of degree {rule.degree}, relative error {rule.error:.1e})')


def _initial(scene: Scene, name: str) -> str:
    parts = []
    for field, unit in (
        ('displacement', 'm'),
        ('rotation', 'rad'),
        ('linear_velocity', 'm/s'),
        ('angular_velocity', 'rad/s'),
    ):
        value = scene.parameters[f'initial.{name}.{field}']
        if any(value):
            parts.append(f', {field.replace("_", " ")} {vector(value, unit)}')
    return ''.join(parts)
