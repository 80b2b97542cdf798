# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What bodies and connectors are coloured by: strain, force, speed, or overlap of shells.

The scales can be told apart by people who confuse red and green: blue to orange around zero, and
light to dark from zero on.
"""

from collections.abc import Iterable
import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.scene.connector_laws import strain_of
from icofabric_sim.scene.planes import planes_at
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.shell_gaps import find_contacts
from icofabric_sim.simulation.model.wrapped_paths import Segments, straight_segments, trace_scene
import numpy as np

# From the least to the largest value.
_DIVERGING = np.array([
    [0.09, 0.22, 0.55], [0.16, 0.42, 0.78], [0.42, 0.65, 0.88], [0.64, 0.64, 0.62],
    [0.95, 0.62, 0.27], [0.85, 0.33, 0.12], [0.58, 0.09, 0.08]])
_SEQUENTIAL = np.array([
    [0.95, 0.92, 0.82], [0.99, 0.83, 0.53], [0.97, 0.63, 0.34], [0.87, 0.40, 0.33],
    [0.68, 0.21, 0.40], [0.45, 0.10, 0.42], [0.24, 0.05, 0.34]])
# The part of the values that the scale covers; beyond it the colours of its ends stand.
_COVERED = 0.98
_MOST_VALUES = 2_000_000


class Quantity(NamedTuple):
    """Something that colours show."""

    label: str
    unit: str
    factor: float  # from SI to the unit
    of_bodies: bool  # else of connectors
    signed: bool
    least: float  # [unit] ends of scales are not nearer to 0


QUANTITIES = {
    'strain': Quantity('strain of connectors', '%', 100.0, False, True, 0.1),
    'force': Quantity('tension of connectors', 'N', 1.0, False, True, 0.01),
    'speed': Quantity('speed of bodies', 'm/s', 1.0, True, False, 0.01),
    'contact': Quantity('overlap of shells', 'mm', 1e3, True, False, 0.01),
}


class Scale(NamedTuple):
    """Colours of the values of a quantity."""

    quantity: Quantity
    largest: float  # [SI] at the end of the scale

    @property
    def least(self) -> float:
        """Value [SI] at the beginning of the scale."""
        return -self.largest if self.quantity.signed else 0.0

    def colors(self, values: np.ndarray) -> np.ndarray:
        """Colours (m, 3) of values (m,) [SI]."""
        table = _DIVERGING if self.quantity.signed else _SEQUENTIAL
        part = (np.asarray(values) - self.least) / (self.largest - self.least)
        places = np.clip(part, 0.0, 1.0) * (len(table) - 1)
        below = np.minimum(places.astype(int), len(table) - 2)
        rest = (places - below)[:, None]
        return np.asarray((1.0 - rest) * table[below] + rest * table[below + 1])

    def text(self, value: float) -> str:
        """Return a value [SI] in the unit of the scale."""
        shown = value * self.quantity.factor
        return f'{shown:+g}' if self.quantity.signed and value else f'{shown:g}'


def connector_ends(scene: Scene, position: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """World positions [m] of the ends of all connectors, (c, 2, 3)."""
    bodies = scene.connectors.bodies
    cosines = cosines_from_quaternions(orientation)[bodies]
    arms = np.einsum('cea,ceai->cei', scene.connectors.points_body, cosines)
    return np.asarray(position[bodies] + arms)


def connector_segments(
    scene: Scene, position: np.ndarray, orientation: np.ndarray
) -> Segments:
    """Straight parts of all connectors, along their whole ways around shells."""
    ends = connector_ends(scene, position, orientation)
    if scene.parameters['connector.obstruction'] != 'wrap':
        return straight_segments(ends)
    return trace_scene(scene, ends, position, orientation)


def strains(scene: Scene, length: np.ndarray) -> np.ndarray:
    """Strain (l - D) / D of connectors of given lengths [m], (c,)."""
    return strain_of(length, scene.connectors.natural_length)


def tensions(scene: Scene, length: np.ndarray) -> np.ndarray:
    """Tension [N] of connectors of given lengths [m] by their laws, without damping, (c,)."""
    laws = scene.connectors.laws
    stretch = length - laws.natural_length
    return scene.connectors.curves.replace(
        'tension', np.where(stretch > 0.0, laws.extension, laws.compression) * stretch, length,
        laws.extension, laws.natural_length)


def overlaps(
    scene: Scene, position: np.ndarray, orientation: np.ndarray, time: float = 0.0
) -> np.ndarray:
    """Deepest overlap [m] of each shell with another or a plane at a `time` [s], (n,); 0: none."""
    deepest = np.zeros(len(position))
    contacts = find_contacts(scene.body_half_edges, position, orientation)
    for side in contacts.bodies.T:
        np.maximum.at(deepest, side, contacts.depth)
    planes = planes_at(scene.parameters, scene.platens, time)
    if len(planes):
        corners = np.einsum(
            'n,va,nai->nvi', scene.body_half_edges, vertices(1.0),
            cosines_from_quaternions(orientation))
        for row in planes:
            lowest = position @ row[:3] + (corners @ row[:3]).min(axis=1)
            np.maximum(deepest, row[3] - lowest, out=deepest)
    return deepest


def values_of(name: str, moment: Moment) -> np.ndarray:
    """Return a quantity of a moment [SI] by name, for each body or each connector."""
    scene = moment.scene
    if name == 'speed':
        if moment.velocity is None:
            return np.zeros(scene.body_count)
        return np.asarray(np.linalg.norm(moment.velocity, axis=1))
    if name == 'contact':
        return overlaps(scene, moment.position, moment.orientation, moment.time)
    if not scene.connector_count:
        return np.zeros(0)
    length = connector_segments(
        scene, moment.position, moment.orientation).lengths(scene.connector_count)
    values = strains(scene, length) if name == 'strain' else tensions(scene, length)
    if moment.broken is not None and len(moment.broken):
        values = values.copy()
        values[moment.broken] = 0.0
    if moment.known is not None:
        values = np.where(moment.known[scene.connectors.bodies].all(axis=1), values, 0.0)
    return values


def fit_scale(name: str, moments: Iterable[Moment]) -> Scale:
    """Return a scale with round limits that covers all but the most extreme values."""
    found = []
    count = 0
    for moment in moments:
        values = np.abs(values_of(name, moment))
        values = values[np.isfinite(values)]
        found.append(values)
        count += len(values)
        if count > _MOST_VALUES:
            break
    sizes = np.concatenate(found) if found else np.zeros(0)
    # Values at rest would pull the end of the scale down to them.
    sizes = sizes[sizes > 1e-3 * sizes.max(initial=0.0)]
    largest = float(np.quantile(sizes, _COVERED)) if len(sizes) else 0.0
    quantity = QUANTITIES[name]
    shown = max(largest * quantity.factor, quantity.least)
    return Scale(quantity, _round_up(shown) / quantity.factor)


def _round_up(value: float) -> float:
    power = 10.0 ** math.floor(math.log10(value))
    steps = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return float(f'{next(step for step in steps if step * power >= value * (1 - 1e-9)) * power:g}')
