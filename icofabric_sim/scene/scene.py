# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Scene: complete description of a fabric and of everything that acts on it, from parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from icofabric_sim import checks
from icofabric_sim.checks import counted
from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.parameters.named_files import NamedFile, use_recorded_files
from icofabric_sim.parameters.table import BY_NAME, OF_KIND
from icofabric_sim.parameters.text import flatten_parameters
from icofabric_sim.parameters.validation import make_parameters, ParameterError, Parameters
from icofabric_sim.scene import initial, selectors
from icofabric_sim.scene.anchors import Anchor, make_anchors, refuse_broken_anchors
from icofabric_sim.scene.attachments import attachment_points, check_attachments, woven_lengths
from icofabric_sim.scene.available_memory import available_memory, processes_sharing
from icofabric_sim.scene.body_sizes import check_sizes, make_half_edges, require_shell_size
from icofabric_sim.scene.breakage import BreakLimits, make_limits
from icofabric_sim.scene.connector_groups import (
    check_connector_groups,
    chosen_connectors,
    grouped_connectors,
)
from icofabric_sim.scene.connector_laws import (
    ConnectorCurves,
    ConnectorLaws,
    make_laws,
    property_by_connector,
    table_of_law,
)
from icofabric_sim.scene.custom_connectors import CustomConnectors, make_custom_connectors
from icofabric_sim.scene.densities import make_density
from icofabric_sim.scene.drives import Drive, make_drives, make_path, moved_freedoms
from icofabric_sim.scene.electric import check_electric, Electric, make_electric
from icofabric_sim.scene.expression_loads import (
    check_point_loads,
    make_point_loads,
    PointLoad,
    SurfaceLoad,
)
from icofabric_sim.scene.expressions import check_constants
from icofabric_sim.scene.faces import check_faces
from icofabric_sim.scene.line_loads import line_expression, make_line_load, select_edges
from icofabric_sim.scene.load_channels import LoadChannel, make_channels
from icofabric_sim.scene.masses import (
    all_members,
    BodyMasses,
    individual_masses,
    make_masses,
    make_moments,
    make_principal_axes,
    require_isotropic,
)
from icofabric_sim.scene.maxwell import make_arms, MaxwellArms
from icofabric_sim.scene.notebook import html_of
from icofabric_sim.scene.paths import Path as MotionPath
from icofabric_sim.scene.planes import make_planes, make_platens
from icofabric_sim.scene.profiles import check_profile
from icofabric_sim.scene.published import check_frame, framed_bodies, published_bodies
from icofabric_sim.scene.radial import bend, check_radius
from icofabric_sim.scene.rates import check_rates
from icofabric_sim.scene.region import make_region
from icofabric_sim.scene.supports import fixed_freedoms, make_supports, Supports
from icofabric_sim.scene.tables import read_numeric_table
from icofabric_sim.scene.tractions import make_traction, polynomial, Traction, traction_expression
from icofabric_sim.scene.weave import build_weave, estimate_weave, Weave
from icofabric_sim.scene.weave_connect import Connections, Connectors
from icofabric_sim.scene.weave_geometry import (
    geometry_from_angle,
    geometry_from_length,
    WeaveGeometry,
)
from icofabric_sim.scene.wrapping import check_wrapping
import numpy as np

# Memory to build, run and record; about 1,000 without a bag (`icofabric benchmark scaling`).
# Scenes that exceed the free memory are refused before they are built.
BYTES_PER_BODY = 1500
# With several ranks: bytes on the first rank for every body, and on each rank for its own bodies.
_SHARED_BYTES_PER_BODY, _OWN_BYTES_PER_BODY = 100, 1100
_UNCHECKED_BYTES = 2**27  # a need below which the free memory is not read


@dataclass(frozen=True)
class _Joined:
    """Connectors of a weave and custom ones, in the form of `Connections`."""

    whole: Connectors
    count: int


@dataclass(frozen=True)
class SceneConnectors:
    """
    Connectors of a scene: woven ones, sorted by (lower body, its edge, other body), custom ones.

    The points of custom connector k have the edge codes 6 + 2 k and 7 + 2 k.
    """

    # Bodies that they join, computed when first used unless there are custom connectors.
    connections: Connections | _Joined
    attachment: np.ndarray  # (6 + 2 m, 3) points in body axes [m], by edge code
    woven_length: float | np.ndarray  # [m] of all, or of each, (c,)
    laws: ConnectorLaws
    curves: ConnectorCurves  # that replace springs
    bending_stiffness: np.ndarray  # [N m/rad], (c,), or (1,) if all are equal
    twisting_stiffness: np.ndarray
    damping: np.ndarray  # (c,) or (1,) [N s/m]
    arms: MaxwellArms | None  # None: no connector has a Maxwell arm
    limits: BreakLimits | None  # lengths at which they break; None: no connector can

    @property
    def bodies(self) -> np.ndarray:
        """Bodies that they join, (c, 2) int32."""
        return self.connections.whole.bodies

    @property
    def edges(self) -> np.ndarray:
        """Codes of the edges that they join, (c, 2), see icosahedron.NAMED_EDGES."""
        return self.connections.whole.edges

    @property
    def stiffness(self) -> float | np.ndarray:
        """Stiffness k [N/m] of all, or k_e of each, (c,)."""
        return _of_all(self.laws.extension)

    @property
    def natural_length(self) -> float | np.ndarray:
        """Natural length D [m] of all, or of each, (c,)."""
        return _of_all(self.laws.natural_length)

    def __len__(self) -> int:
        """Count the connectors."""
        return self.connections.count

    def joined(self, custom: CustomConnectors | None) -> 'SceneConnectors':
        """Return these connectors with custom ones, which have no moments and no Maxwell arms."""
        if custom is None:
            return self
        woven, count = len(self), len(custom.bodies)
        total, edges = woven + count, self.attachment.shape[0]

        def add(values: np.ndarray, more: np.ndarray | float) -> np.ndarray:
            return np.concatenate([
                np.broadcast_to(values, woven), np.broadcast_to(more, count)])

        def least(values: np.ndarray) -> np.ndarray:
            return values[:1] if (values == values[0]).all() else values

        never, arms, limits = BreakLimits(np.array([np.inf]), np.zeros(1)), self.arms, None
        if self.limits is not None or (custom.limits != [[np.inf], [0.0]]).any():
            limits = BreakLimits(*map(add, self.limits or never, custom.limits))
        return SceneConnectors(
            _Joined(Connectors(
                np.concatenate([self.bodies, custom.bodies]),
                np.concatenate([
                    self.edges, edges + np.arange(2 * count).reshape(-1, 2)]).astype(np.int32)),
                total),
            np.concatenate([self.attachment, custom.points.reshape(-1, 3)]),
            add(np.atleast_1d(self.woven_length), custom.length),
            ConnectorLaws(*(
                least(add(*pair)) if not self.curves.curves else add(*pair)
                for pair in zip(self.laws, custom.laws))),
            self.curves if not self.curves.curves else self.curves._replace(
                of=add(self.curves.of, -1), stops=add(self.curves.stops, False)),
            add(self.bending_stiffness, 0.0), add(self.twisting_stiffness, 0.0),
            least(add(self.damping, custom.damping)),
            None if arms is None else MaxwellArms(
                add(arms.stiffness, 0.0), add(arms.time, 0.0)),
            limits)

    @cached_property
    def points_body(self) -> np.ndarray:
        """Attachment points [m], (c, 2, 3), each in the axes of its body."""
        return self.attachment[self.edges]


@dataclass(frozen=True, repr=False)
class Scene:
    """
    Description of a fabric and of everything that acts on it; input of `compile_scene`.

    Arrays are shared and must not be written to.
    """

    parameters: Parameters
    shell: Shell
    masses: BodyMasses
    half_edges: np.ndarray | None  # (n,) [m]; None: all equal the shell's
    principal_inertia: np.ndarray | None  # (n, 3) [kg m^2], if any differ
    # (n, 3, 3) axes of these in body axes, by rows; None: the body axes
    principal_axes: np.ndarray | None
    geometry: WeaveGeometry
    weave: Weave
    position: np.ndarray  # (n, 3) [m] woven rest positions, loose bodies last
    orientation: np.ndarray  # (n, 4) x y z w at rest
    connectors: SceneConnectors
    woven: SceneConnectors  # those of the weave alone, the first ones
    custom: CustomConnectors | None
    groups: Mapping[str, np.ndarray]
    supports: Supports | None
    loads: Mapping[str, LoadChannel]
    tractions: Mapping[str, Traction]  # by NAME, those on edges by line_loads.NAME
    # Loads by expressions of place and time.
    expression_loads: tuple[PointLoad | SurfaceLoad, ...]
    drives: Mapping[str, Drive]
    anchors: Mapping[str, Anchor]
    platens: Mapping[str, MotionPath]  # of the planes that may move, from the start of the motion
    initial: initial.InitialState
    electric: Electric
    published_bodies: np.ndarray | None  # (m,) body numbers in `~/poses`; None: all
    framed_bodies: np.ndarray | None  # (m,) body numbers that are frames on /tf; None: none
    published_connectors: np.ndarray | None  # (m,) connector numbers in `~/tensions`; None: all
    files: Mapping[str, NamedFile]  # files that were read, by their names in parameters

    @classmethod
    def from_parameters(
        cls, parameters: Mapping[str, Any], *, shell: Shell | None = None
    ) -> 'Scene':
        """
        Build a scene from parameters.

        Parameters
        ----------
        parameters
            Nested or dotted dictionary, the dictionary of a whole parameter file, or `Parameters`.
            Missing parameters have their defaults.
        shell
            Shell that replaces the one of `shell.*`; its edge length must agree.

        Returns
        -------
        Scene
            Scene ready for `compile_scene`.

        Raises
        ------
        ValueError
            If a parameter is invalid: mostly ParameterError, which names the parameter and the
            remedy.
        """
        checked = as_parameters(parameters)
        if shell is not None:
            checks.instance('shell', shell, Shell, 'Shell.from_thickness(...) makes one')
        with use_recorded_files(checked.files) as files:
            return cls._build(checked, shell, files)

    @property
    def can_break(self) -> bool:
        """True if any connector or anchor can break."""
        return self.connectors.limits is not None or self.anchors_break

    @property
    def anchors_break(self) -> bool:
        """True if any anchor can break."""
        return any(anchor.limits.breaks for anchor in self.anchors.values())

    @property
    def anchors_damped(self) -> bool:
        """True if any anchor is damped."""
        return any(anchor.damping for anchor in self.anchors.values())

    def with_changes(self, changes: Mapping[str, Any]) -> 'Scene':
        """
        Build a copy of this scene with some parameters changed.

        Parameters
        ----------
        changes
            Nested or dotted dictionary of the parameters to change.

        Returns
        -------
        Scene
            New scene; a shell passed to `from_parameters` is kept.

        Raises
        ------
        ValueError
            If a parameter is invalid, as in `from_parameters`.
        """
        checks.mapping('changes', changes)
        own_shell, _ = check_parameters(self.parameters)
        return Scene.from_parameters(
            self.parameters.with_changes(flatten_parameters(changes)),
            shell=None if own_shell == self.shell else self.shell)

    @classmethod
    def _build(
        cls, checked: Parameters, shell: Shell | None, files: Mapping[str, NamedFile]
    ) -> 'Scene':
        """Build a scene from valid parameters; adds the files that it reads to `files`."""
        own_shell, geometry = _check_together(checked)
        if shell is None:
            shell = own_shell
        elif shell.half_edge != own_shell.half_edge:
            raise ParameterError(
                'shell.edge_length',
                f'shell.edge_length {own_shell.edge_length!r} m disagrees with the given shell, '
                f'whose edge is {shell.edge_length!r} m; use the same length',
            )
        weave = build_weave(**weave_choices(checked, geometry))
        if checked['weave.kind'] == 'radial':
            weave = bend(weave, check_radius(checked, geometry))
        loose = checked.names('bodies')
        position = weave.position if not loose else np.vstack(
            [weave.position] + [[checked[f'bodies.{name}.position']] for name in loose]
        )
        orientation = np.broadcast_to(weave.orientation, (len(weave.position), 4))
        if loose:
            orientation = np.vstack([orientation] + [
                [initial.unit_quaternion(f'bodies.{name}.orientation', checked)]
                for name in loose])
        length = woven_lengths(checked, weave)
        groups = _groups(checked, selectors.Bodies(position, weave.grid, geometry.pitch))
        supports = make_supports(checked, groups, len(position))
        masses = make_masses(checked, shell, groups, len(position))
        half_edges = make_half_edges(
            checked, shell, all_members(checked, groups, len(position)), len(position))
        for group in (
                f'{family}.{name}.group' for family in ('tractions', 'line_loads')
                for name in checked.names(family)):
            require_shell_size(half_edges, groups[checked[group]], shell, group)
        members = grouped_connectors(checked, groups, weave)
        own = members, weave.connector_count
        laws = make_laws(checked, length, *own)
        moments = make_moments(checked, shell, groups, len(position))
        if any(checked['field.magnetic']):
            require_isotropic(checked, moments, 'field.magnetic and the charges')
        start = initial.make_initial_state(checked, position, orientation, groups, supports)
        drives = make_drives(checked, groups, start, supports)
        anchors = make_anchors(checked, len(position), drives, geometry, half_edges)
        refuse_broken_anchors(anchors, start.position, start.orientation)
        electric = make_electric(
            checked, groups, len(position), shell, equal_masses=masses.all_equal)
        surfaces = {
            name: make_traction(
                checked, name, groups[checked[f'tractions.{name}.group']], position, orientation,
                geometry, start)
            for name in checked.names('tractions')}
        surfaces |= {
            f'line_loads.{name}': make_line_load(
                checked, name, groups[checked[f'line_loads.{name}.group']], geometry.half_edge,
                start)
            for name in checked.names('line_loads')}
        custom = make_custom_connectors(checked, position, orientation, geometry)
        woven = SceneConnectors(
            weave.connections,
            attachment_points(checked, geometry.half_edge),
            length,
            *laws,
            property_by_connector(checked, 'bending_stiffness', *own),
            property_by_connector(checked, 'twisting_stiffness', *own),
            property_by_connector(checked, 'damping', *own),
            make_arms(checked, *own),
            make_limits(checked, length, *own, laws[0]),
        )
        connectors = woven.joined(custom)
        return cls(
            parameters=checked,
            shell=shell,
            masses=masses,
            half_edges=half_edges,
            principal_inertia=moments,
            principal_axes=make_principal_axes(checked, shell, groups, len(position)),
            geometry=geometry,
            weave=weave,
            position=position,
            orientation=orientation,
            connectors=connectors,
            woven=woven,
            custom=custom,
            groups=groups,
            supports=supports,
            loads=make_channels(checked, groups),
            tractions={
                name: part for name, part in surfaces.items() if isinstance(part, Traction)},
            expression_loads=(
                *make_point_loads(checked, groups, electric, geometry.half_edge),
                *(part for part in surfaces.values() if isinstance(part, SurfaceLoad))),
            electric=electric,
            drives=drives,
            anchors=anchors,
            platens=make_platens(checked),
            initial=start,
            published_bodies=published_bodies(checked, groups),
            framed_bodies=framed_bodies(checked, groups),
            published_connectors=chosen_connectors(
                checked, 'publish.connectors', groups, connectors.connections),
            files=files,
        )

    def __repr__(self) -> str:
        """Return the kind and size of the scene."""
        size = ' x '.join(str(count) for count in self.weave.size)
        return (f'<Scene: {self.weave.kind} weave of {size} grid positions, '
                f'{counted(self.body_count, "body")}, '
                f'{counted(self.connector_count, "connector")}>')

    def _repr_html_(self) -> str:
        """Return a summary for notebooks."""
        weave, geometry = self.weave, self.geometry
        return html_of('Scene', {
            'weave': f'{weave.kind}, variant {weave.variant}, '
                     f'{" x ".join(map(str, weave.size))} grid positions',
            'bodies': f'{self.body_count:,}, {self.masses.total(self.body_count):.6g} kg in total',
            'connectors': f'{self.connector_count:,}, {geometry.connector_length:.6g} m',
            'connector angle': f'{geometry.connector_angle:.6g} rad',
            'pitch': f'{geometry.pitch:.6g} m',
            'groups': ', '.join(
                f'{name} ({len(members):,})' for name, members in self.groups.items()) or 'none',
            'loads': ', '.join(self.loads) or 'none',
            'gravity': f'{self.parameters["gravity"]} m/s^2'})

    @property
    def body_half_edges(self) -> np.ndarray:
        """Half edges a [m] of all bodies, (n,)."""
        if self.half_edges is None:
            return np.full(self.body_count, self.geometry.half_edge)
        return self.half_edges

    @property
    def body_count(self) -> int:
        """Count the bodies, loose ones included."""
        return len(self.position)

    @property
    def connector_count(self) -> int:
        """Count the connectors."""
        return len(self.connectors)


def require_scene(scene: Any, name: str = 'scene') -> Scene:
    """Return `scene` if it is one; otherwise raise TypeError about the argument `name`."""
    return checks.instance(
        name, scene, Scene,
        'load_scene(path) reads one from a parameter file, Scene.from_parameters({...}) makes one')


def _of_all(values: np.ndarray) -> float | np.ndarray:
    return float(values[0]) if len(values) == 1 else values


def load_scene(path: str | Path) -> Scene:
    """
    Read a scene from a ROS 2 parameter file; `fabric_node --params-file` runs the same scene.

    Parameters
    ----------
    path
        Parameter file, or the name of an example scene, which takes precedence over a file of
        that name.

    Returns
    -------
    Scene
        Scene ready for `compile_scene`.

    Raises
    ------
    ValueError
        If the file is missing or invalid; the message states the line, the parameter and the
        remedy.
    """
    given = checks.path(
        'path', path, 'the path of a parameter file, or the name of an example scene')
    return Scene.from_parameters(make_parameters(load_parameter_file(
        example_scenes().get(str(given), given))))


def as_parameters(parameters: Mapping[str, Any]) -> Parameters:
    """Convert a nested or dotted dictionary to Parameters; return Parameters unchanged."""
    if isinstance(parameters, Parameters):
        return parameters
    return make_parameters(flatten_parameters(parameters))


def check_parameters(parameters: Parameters) -> tuple[Shell, WeaveGeometry]:
    """
    Check combinations of parameters without building the scene; fast for any size.

    Returns the shell and the weave geometry.
    """
    with use_recorded_files(parameters.files):
        return _check_together(parameters)


def _check_together(parameters: Parameters) -> tuple[Shell, WeaveGeometry]:
    for name, kind in OF_KIND.items():
        value, default = parameters[name], BY_NAME[name].default
        if value != default and parameters['weave.kind'] != kind:
            raise ParameterError(
                name, f'{name} {value!r} is for weave.kind {kind} only, and weave.kind is '
                f'{parameters["weave.kind"]}: leave it at {default!r}, or choose {kind}')
    shell = _shell(parameters)
    geometry = _geometry(parameters, shell.half_edge)
    bodies = _estimate(parameters, geometry)
    _require_memory(parameters, bodies)
    if not parameters['weave.region']:
        check_electric(parameters, bodies)
    for name in parameters.names('groups'):
        if name in ('all', 'not', 'and', 'or'):
            raise ParameterError(
                f'groups.{name}',
                f'groups.{name}: {name!r} is a keyword of selectors; choose another name',
            )
        selectors.check_syntax(f'groups.{name}', parameters[f'groups.{name}'])
    check_sizes(parameters, shell)
    individual_masses(parameters, shell)
    check_rates(parameters, shell)
    check_attachments(parameters, geometry)
    check_wrapping(parameters, shell.half_edge)
    if parameters['weave.kind'] == 'radial':
        check_radius(parameters, geometry)
    check_connector_groups(parameters)
    for name in parameters.names('connector_groups'):
        table_of_law(parameters, f'connector_groups.{name}')
    table_of_law(parameters, 'connector')
    for family in ('charges', 'masses', 'supports', 'loads', 'tractions', 'line_loads', 'drives',
                   'initial'):
        for name in parameters.names(family):
            _check_group(parameters, f'{family}.{name}.group')
    check_frame(parameters)
    for name in ('publish.group', 'tf.group'):
        if parameters[name]:
            _check_group(parameters, name)
    for name in parameters.names('supports'):
        fixed_freedoms(parameters, name)
    make_planes(parameters)
    make_platens(parameters)
    for family in ('loads', 'tractions', 'line_loads'):
        for name in parameters.names(family):
            check_profile(parameters, f'{family}.{name}')
    for name in parameters.names('drives'):
        make_path(parameters, f'drives.{name}')
        moved_freedoms(parameters, name)
    for name in parameters.names('tractions'):
        check_faces(f'tractions.{name}.faces', parameters[f'tractions.{name}.faces'])
        key = f'tractions.{name}.variation'
        polynomial(key, parameters[key])
        traction_expression(parameters, name)
    for name in parameters.names('line_loads'):
        select_edges(f'line_loads.{name}.edges', parameters[f'line_loads.{name}.edges'])
        line_expression(parameters, name)
    check_constants(parameters)
    check_point_loads(parameters)
    for name in parameters.names('bodies'):
        initial.unit_quaternion(f'bodies.{name}.orientation', parameters)
    return shell, geometry


class InsufficientMemoryError(ParameterError, MemoryError):
    """Parameter of a scene that needs more memory than is free on this machine."""


def _require_memory(parameters: Parameters, bodies: int) -> None:
    need, processes, of, way = bodies * BYTES_PER_BODY, processes_sharing(), '', ''
    if processes > 1:
        need = bodies * (_SHARED_BYTES_PER_BODY + _OWN_BYTES_PER_BODY // processes)
        of, way = f' on the first of {processes} ranks', ', or take more ranks'
    if need < _UNCHECKED_BYTES or need <= (left := available_memory()):
        return
    name = 'weave.box' if any(parameters['weave.box']) else 'weave.size'
    if parameters['weave.region']:
        name = 'weave.region'
    raise InsufficientMemoryError(
        name,
        f'{name} {parameters[name]} means {bodies:,} bodies, about {need / 2**30:.3g} GiB of '
        f'memory{of}, but {left / 2**30:.3g} GiB are free here; choose a smaller one{way}',
    )


def estimate_bodies(parameters: Parameters) -> int:
    """Count the bodies of a scene without building it, as exactly as `estimate_weave`."""
    return _estimate(parameters, _geometry(parameters, _shell(parameters).half_edge))


def _estimate(parameters: Parameters, geometry: WeaveGeometry) -> int:
    woven = estimate_weave(**weave_choices(parameters, geometry)).bodies
    return woven + len(parameters.names('bodies'))


def _shell(parameters: Parameters) -> Shell:
    shell = _uniform_shell(parameters)
    density = make_density(parameters, 'shell', shell)
    if density is not None:
        mass = parameters['shell.mass'] or density.mass
        return replace(
            shell, density=mass / shell.volume, mass=mass, relative_error=density.error,
            inertia=float(density.moments.min()) * (mass / density.mass))
    file = parameters['shell.layers'].strip()
    if not file:
        return shell
    table = read_numeric_table(
        'shell.layers', file, {2: 'distance from the centre [m] and density [kg/m^3]'},
        first='distances', unit='m')
    try:
        return Shell.from_layers(
            shell.edge_length, shell.thickness, table[:, 0], table[:, 1],
            mass=parameters['shell.mass'] or None, inertia=parameters['shell.inertia'] or None)
    except ValueError as error:
        raise ParameterError('shell.layers', f'shell.layers: {file}: {error}') from None


def _uniform_shell(parameters: Parameters) -> Shell:
    edge, inner = parameters['shell.edge_length'], parameters['shell.inner_edge_length']
    override = {
        'density': parameters['shell.density'],
        'mass': parameters['shell.mass'] or None,
        'inertia': parameters['shell.inertia'] or None,
    }
    if not inner > 0.0:
        return Shell.from_thickness(edge, parameters['shell.thickness'], **override)
    shell = Shell.from_inner_edge_length(edge, inner, **override)
    given = parameters['shell.thickness']
    if (
        'shell.thickness' in parameters.explicit
        and not abs(given - shell.thickness) <= 1e-9 * shell.thickness
    ):
        raise ParameterError(
            'shell.thickness',
            f'shell.thickness {given!r} m disagrees with '
            f'shell.inner_edge_length {inner!r} m, which means a thickness of '
            f'{shell.thickness!r} m; give one of them',
        )
    return shell


def _geometry(parameters: Parameters, half_edge: float) -> WeaveGeometry:
    length, angle = parameters['weave.connector_length'], parameters['weave.connector_angle']
    if not length > 0.0:
        return geometry_from_angle(half_edge, angle)
    geometry = geometry_from_length(half_edge, length)
    if angle != 0.0 and not abs(angle - geometry.connector_angle) <= 1e-9:
        raise ParameterError(
            'weave.connector_angle',
            f'weave.connector_angle {angle!r} rad disagrees with '
            f'weave.connector_length {length!r} m, which means an angle of '
            f'{geometry.connector_angle!r} rad; give one of them',
        )
    return geometry


def weave_choices(parameters: Parameters, geometry: WeaveGeometry) -> dict[str, Any]:
    """Return the arguments of `build_weave` and `estimate_weave`."""
    box = parameters['weave.box']
    return {
        'geometry': geometry,
        'box': box if any(box) else None,
        'region': make_region(parameters['weave.region']),
        # A radial weave is an orthogonal weave, bent after it is built.
        'kind': parameters['weave.kind'].replace('radial', 'orthogonal'),
        **{
            name: parameters[f'weave.{name}']
            for name in ('variant', 'size', 'azimuth', 'boundary', 'connected')
        },
    }


def _check_group(parameters: Parameters, name: str) -> None:
    group = parameters[name]
    if group != 'all' and f'groups.{group}' not in parameters:
        known = ', '.join(['all', *parameters.names('groups')])
        raise ParameterError(
            name,
            f'{name}: there is no group {group!r}; known: {known}. '
            f'Define it with groups.{group or "NAME"}',
        )


def _groups(parameters: Parameters, bodies: selectors.Bodies) -> dict[str, np.ndarray]:
    groups = {'all': np.arange(len(bodies.position), dtype=np.int32)}
    for name in parameters.names('groups'):
        groups[name] = selectors.select(f'groups.{name}', parameters[f'groups.{name}'], bodies)
    return groups
