# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contact constants of a scene: shells and planes in contact, stiffness and dissipation."""

from dataclasses import dataclass
import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius, inscribed_radius
from icofabric_sim.scene.planes import make_planes
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.contact.conflicts import Prescribed, prescribed_parts
import numpy as np


@dataclass(frozen=True)
class StiffnessSettings:
    """Tunables of the automatic contact stiffness, and the limit of dense weaves."""

    overlap_ratio: float = 0.005  # intended overlap over a
    strain: float = 0.1  # of connectors that load contacts
    connector_stiffness_ratio: float = 20.0  # least stiffness over that of connectors
    # Displacement over a between two outputs, if neither motion nor forces are known.
    output_displacement_ratio: float = 1.0 / 6.0
    # Gap between faces of woven neighbours over a below which a weave is dense. On a floor with
    # friction, contacts of faces in a dense weave open or close nearly all the time.
    dense_gap_ratio: float = 0.05


_SETTINGS = StiffnessSettings()


class ContactSetup(NamedTuple):
    """Constants of contact in a scene."""

    half_edge: float  # a [m]
    stiffness: float  # K [N/m]
    damping: float  # c [s/m]
    friction: float  # mu
    planes: np.ndarray  # (k, 4) unit normals and offsets [m]
    names: tuple[str, ...]  # of the planes
    always: bool  # evaluated even if no pair can touch
    free: bool  # no body is held: common motions have no effect
    fall: np.ndarray  # (3,) common acceleration [m/s^2]
    expected: str  # reason to expect contacts; '': not expected
    gap: float = 0.0  # lower bound of gaps between shells as woven [m]
    is_dense: bool = False  # faces of woven neighbours nearly touch
    half_edges: np.ndarray | None = None  # (n,) [m] of bodies that differ in size
    moving: tuple[bool, ...] = ()  # planes that may move; empty: none
    prescribed: tuple[Prescribed, ...] = ()  # supports and drives

    def edges(self, bodies: np.ndarray) -> np.ndarray:
        """Return the half edges [m] of bodies, in the shape of their numbers."""
        if self.half_edges is None:
            return np.full(bodies.shape, self.half_edge)
        return self.half_edges[bodies]

    @property
    def smallest(self) -> float:
        """Half edge [m] of the smallest body."""
        return self.half_edge if self.half_edges is None else float(self.half_edges.min())

    @property
    def largest(self) -> float:
        """Half edge [m] of the largest body."""
        return self.half_edge if self.half_edges is None else float(self.half_edges.max())

    @property
    def spends(self) -> bool:
        """True if contacts dissipate energy."""
        return self.damping > 0.0 or self.friction > 0.0


def pack_contact(
    scene: Scene, fall: np.ndarray, *, moving: bool = True
) -> ContactSetup | None:
    """
    Return the constants of contact; None if contact is disabled or impossible.

    Unless bodies are `moving`, the automatic stiffness depends on forces alone.
    """
    parameters = scene.parameters
    names = tuple(parameters.names('planes'))
    if parameters['contact.mode'] == 'never' or scene.body_count + len(names) < 2:
        return None
    planes = make_planes(parameters)
    held = scene.supports is not None or scene.drives or scene.anchors or names
    return ContactSetup(
        half_edge=scene.geometry.half_edge,
        stiffness=parameters['contact.stiffness'] or own_stiffness(
            scene, planes, moving=moving),
        damping=parameters['contact.damping'],
        friction=parameters['contact.friction'],
        planes=planes,
        names=names,
        always=parameters['contact.mode'] == 'always',
        free=not held,
        fall=fall,
        expected=_expected(scene),
        gap=_woven_gap(scene),
        is_dense=_is_dense(scene),
        half_edges=scene.half_edges,
        moving=tuple(name in scene.platens for name in names) if scene.platens else (),
        prescribed=prescribed_parts(scene),
    )


def _woven_gap(scene: Scene) -> float:
    """
    Return the gap [m] between the spheres around neighbours in the weave; 0 without neighbours.
    """
    if not len(scene.woven):
        return 0.0
    woven = scene.body_half_edges[:len(scene.weave.position)]
    largest = 2.0 * circumscribed_radius(float(woven.max()))
    return max(math.sqrt(2.0) * scene.geometry.pitch - largest, 0.0)


def _is_dense(scene: Scene) -> bool:
    """Return True if faces of neighbours in the weave are closer than in a sparse weave."""
    if not len(scene.woven):
        return False
    # Normal of opposite faces (eq 54) times the vector between the centres of neighbours.
    largest = float(scene.body_half_edges[:len(scene.weave.position)].max())
    gap = math.sqrt(5.0 / 3.0) * scene.geometry.pitch - 2.0 * inscribed_radius(largest)
    return gap < _SETTINGS.dense_gap_ratio * largest


def _expected(scene: Scene) -> str:
    """Return the reason why contacts are likely; an empty text if they are not."""
    if scene.parameters.names('planes'):
        return 'shells may fall on planes'
    if not len(scene.woven):
        return 'loose shells may meet'
    if scene.parameters['contact.mode'] == 'always':
        return 'contact.mode is always'
    # Gaps between neighbours are smaller than the bodies, and a cause of motion exists.
    spacing = math.sqrt(2.0) * scene.geometry.pitch
    driven = any(scene.parameters['gravity']) or scene.drives
    if driven and _woven_gap(scene) < 0.5 * spacing:
        return 'shells of neighbours are close to each other, and driven'
    return ''


def own_stiffness(scene: Scene, planes: np.ndarray, *, moving: bool = True) -> float:
    """
    Return the stiffness [N/m] with which shells are expected to overlap by less than 1 % of a.

    Two bodies that collide at the largest expected speed v each have the energy M v^2 = K delta^2
    / 2, which requires K = 2 M v^2 / delta^2. A normal force f requires K = f / delta. Speeds
    follow from the initial state, the drives, and the work of weight and loads over the height of
    the scene. Forces follow from weight, loads and strained connectors. Unless bodies are
    `moving`, only forces count.
    """
    # The smallest body has the largest relative overlap.
    parameters, a = scene.parameters, float(scene.body_half_edges.min(initial=math.inf))
    largest = float(scene.body_half_edges.max(initial=0.0))
    # The heaviest body has the largest weight.
    mass = float(scene.masses.mass.max())
    initial, electric = scene.initial, scene.electric
    speed = float(np.sqrt((initial.linear_velocity**2).sum(axis=1).max(initial=0.0)))
    speed += largest * float(np.sqrt((initial.angular_velocity**2).sum(axis=1).max(initial=0.0)))
    for drive in scene.drives.values():
        fastest, turning = drive.path.fastest
        speed = max(speed, fastest + largest * turning)
    speed = max([speed, *(float(path.fastest[0]) for path in scene.platens.values())])
    height = _height(initial.position, planes) + 2.0 * inscribed_radius(a)
    force = mass * math.hypot(*parameters['gravity']) + math.hypot(*electric.force)
    for name in parameters.names('loads'):
        share = len(scene.groups[parameters[f'loads.{name}.group']])
        part = 1.0 / max(share, 1) if parameters[f'loads.{name}.share'] == 'total' else 1.0
        force += part * math.hypot(*parameters[f'loads.{name}.force'])
    square = speed * speed + 2.0 * force * height / mass
    # One body carries a column of bodies as high as the scene.
    pressed = force * max(height / (2.0 * inscribed_radius(a)), 1.0)
    stiffness = 2.0 * mass * square / (_SETTINGS.overlap_ratio * a) ** 2 if moving else 0.0
    if scene.connector_count:
        laws = scene.connectors.laws
        k = float(max(laws.extension.max(), laws.compression.max()))
        # Drives and planes may compress connectors by their whole length.
        strain = 1.0 if scene.drives or scene.platens else _SETTINGS.strain
        pressed += k * strain * float(laws.natural_length.max())
        stiffness = max(stiffness, _SETTINGS.connector_stiffness_ratio * k)
    # Without known speeds and forces, inputs cause the motion.
    speed_ratio = _SETTINGS.output_displacement_ratio * parameters['publish_rate']
    return max(stiffness, pressed / (_SETTINGS.overlap_ratio * a)) or (
        2.0 * mass * (speed_ratio / _SETTINGS.overlap_ratio) ** 2)


def _height(position: np.ndarray, planes: np.ndarray) -> float:
    """
    Return the height [m] of a possible fall: the extent of the scene or distance from a plane.
    """
    height = float(np.ptp(position, axis=0).max(initial=0.0)) if len(position) else 0.0
    for plane in planes:
        height = max(height, float(np.abs(position @ plane[:3] - plane[3]).max(initial=0.0)))
    return height
