# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a scene says of contact: between which shells and planes, and how stiff it is."""

import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius, inscribed_radius
from icofabric_sim.scene.planes import make_planes
from icofabric_sim.scene.scene import Scene
import numpy as np

# The overlap, in parts of a, that the own stiffness is meant for.
_OVERLAP = 0.005
# Strain of connectors that press shells together; stiffness beside that of the connectors; way
# between two outputs, in parts of a, where neither motion nor forces are known.
_STRAIN, _BESIDE_CONNECTORS, _WAY = 0.1, 20.0, 1.0 / 6.0
# Gap between faces of neighbours as woven, over a, below which a weave is dense: where it lies on
# a floor with friction some faces begin or cease to touch at nearly every moment.
_DENSE_GAP_RATIO = 0.05


class ContactSetup(NamedTuple):
    """Constants of contact in a scene."""

    half_edge: float  # a [m]
    stiffness: float  # K [N/m]
    damping: float  # c [s/m]
    friction: float  # mu
    planes: np.ndarray  # (k, 4) unit normals and offsets [m]
    names: tuple[str, ...]  # of the planes
    always: bool  # computed also where nothing can touch
    free: bool  # nothing is held: a motion that all have in common counts for nothing
    fall: np.ndarray  # (3,) acceleration that all have in common [m/s^2]
    expected: str  # why contacts are expected; '': they need not happen
    gap: float = 0.0  # between shells as woven [m], or less
    is_dense: bool = False  # faces of neighbours all but touch as woven
    half_edges: np.ndarray | None = None  # (n,) [m], of each body, where they differ

    def edges(self, bodies: np.ndarray) -> np.ndarray:
        """Half edges [m] of bodies, in the shape of their numbers."""
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
        """Whether contacts take energy from the motion."""
        return self.damping > 0.0 or self.friction > 0.0


def pack_contact(
    scene: Scene, fall: np.ndarray, *, moving: bool = True
) -> ContactSetup | None:
    """
    Constants of contact; None where it is switched off, or nothing is there to touch.

    Where nothing is `moving` the own stiffness is for forces alone.
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
    )


def _woven_gap(scene: Scene) -> float:
    """Gap [m] between the spheres around neighbours in the weave, 0 where there are none."""
    if not scene.connector_count:
        return 0.0
    woven = scene.body_half_edges[:len(scene.weave.position)]
    largest = 2.0 * circumscribed_radius(float(woven.max()))
    return max(math.sqrt(2.0) * scene.geometry.pitch - largest, 0.0)


def _is_dense(scene: Scene) -> bool:
    """Return True if faces of neighbours in the weave are closer than _DENSE_GAP_RATIO."""
    if not scene.connector_count:
        return False
    # The normal of the faces that meet (eq 54) times the way between the centres of neighbours.
    largest = float(scene.body_half_edges[:len(scene.weave.position)].max())
    gap = math.sqrt(5.0 / 3.0) * scene.geometry.pitch - 2.0 * inscribed_radius(largest)
    return gap < _DENSE_GAP_RATIO * largest


def _expected(scene: Scene) -> str:
    """Name what makes contacts likely."""
    if scene.parameters.names('planes'):
        return 'shells may fall on planes'
    if not scene.connector_count:
        return 'loose shells may meet'
    if scene.parameters['contact.mode'] == 'always':
        return 'contact.mode is always'
    # Between neighbours there is less room than they take up themselves, and something moves them.
    spacing = math.sqrt(2.0) * scene.geometry.pitch
    driven = any(scene.parameters['gravity']) or scene.drives
    if driven and _woven_gap(scene) < 0.5 * spacing:
        return 'shells of neighbours are close to each other, and driven'
    return ''


def own_stiffness(scene: Scene, planes: np.ndarray, *, moving: bool = True) -> float:
    """
    Stiffness [N/m] with which shells are expected to overlap by less than 1 % of a.

    Where two bodies meet with the largest speed that is expected, each with v, their energy
    M v^2 = K delta^2 / 2 asks for K = 2 M v^2 / delta^2; what presses them together with a force f
    for K = f / delta. Speeds come from the start, the drives, and what weight and loads give a
    body over the height of the scene; forces from weight, loads and strained connectors. Where
    nothing is `moving` only these count.
    """
    # Of several sizes the smallest overlaps by the largest part of itself.
    parameters, a = scene.parameters, float(scene.body_half_edges.min(initial=math.inf))
    largest = float(scene.body_half_edges.max(initial=0.0))
    # The heaviest presses hardest.
    mass = float(scene.masses.mass.max())
    initial, electric = scene.initial, scene.electric
    speed = float(np.sqrt((initial.linear_velocity**2).sum(axis=1).max(initial=0.0)))
    speed += largest * float(np.sqrt((initial.angular_velocity**2).sum(axis=1).max(initial=0.0)))
    for drive in scene.drives.values():
        fastest, turning = drive.path.fastest
        speed = max(speed, fastest + largest * turning)
    height = _height(initial.position, planes) + 2.0 * inscribed_radius(a)
    force = mass * math.hypot(*parameters['gravity']) + math.hypot(*electric.force)
    for name in parameters.names('loads'):
        share = len(scene.groups[parameters[f'loads.{name}.group']])
        part = 1.0 / max(share, 1) if parameters[f'loads.{name}.share'] == 'total' else 1.0
        force += part * math.hypot(*parameters[f'loads.{name}.force'])
    square = speed * speed + 2.0 * force * height / mass
    # A column of bodies as high as the scene rests on one.
    pressed = force * max(height / (2.0 * inscribed_radius(a)), 1.0)
    stiffness = 2.0 * mass * square / (_OVERLAP * a) ** 2 if moving else 0.0
    if scene.connector_count:
        laws = scene.connectors.laws
        k = float(max(laws.extension.max(), laws.compression.max()))
        # A press may take up all of their length.
        strain = 1.0 if scene.drives else _STRAIN
        pressed += k * strain * float(laws.natural_length.max())
        stiffness = max(stiffness, _BESIDE_CONNECTORS * k)
    # Where nothing says how fast or how hard, inputs will.
    return max(stiffness, pressed / (_OVERLAP * a)) or (
        2.0 * mass * (_WAY * parameters['publish_rate'] / _OVERLAP) ** 2)


def _height(position: np.ndarray, planes: np.ndarray) -> float:
    """How far a body can fall [m]: the largest extent of the scene, or distance from a plane."""
    height = float(np.ptp(position, axis=0).max(initial=0.0)) if len(position) else 0.0
    for plane in planes:
        height = max(height, float(np.abs(position @ plane[:3] - plane[3]).max(initial=0.0)))
    return height
