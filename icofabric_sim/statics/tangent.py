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
"""
Connector laws in the neighbourhood of a configuration: each a spring of its own.

A connector of length l, tension f and slope k = df/dl has the same force and the same second
derivative as a linear spring with stiffness k and natural length l - f / k. So the Hessian product
of the kernels (kernels/hessian.py), which takes the larger of k_e and k_c because a step has to be
stable on either side, gives the exact tangent when it is handed these springs.
"""

from typing import NamedTuple

from icofabric_sim.kernels.records import Model, Variety
from icofabric_sim.simulation.model.layout import aligned_zeros
from icofabric_sim.simulation.model.link_places import link_places, LinkPlaces
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.statics.sides import ACTUAL, kink_width, rounding_of, slopes_on
import numpy as np

# Where a law is flat, of the largest slope or of the largest tension over its length: the tension
# decides there, not the slope.
_FLAT = 1e-12


class Stretched(NamedTuple):
    """Connectors, or anchors, in a configuration, and which are at their kinks; all (c,)."""

    length: np.ndarray  # [m]
    stretch: np.ndarray  # [m] less their natural lengths
    at_kink: np.ndarray  # bool
    rounded: np.ndarray  # bool, of them those whose side is rounding


def find_kinks(
    length: np.ndarray, natural_length: np.ndarray | float, place: np.ndarray, lever: float,
    kinked: np.ndarray
) -> Stretched:
    """
    Those at their natural length [m] whose law has a kink there, `kinked` (c,) bool.

    `place` [m]: how far their ends are from the origin; `lever`: see lever_of.
    """
    stretch = length - natural_length
    size = np.abs(stretch)
    return Stretched(
        length, stretch, kinked & (size <= kink_width(length, place, lever)),
        kinked & (size <= rounding_of(length, place)))


def as_springs(
    tension: np.ndarray, slope: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Stiffnesses [N/m] and natural lengths [m] of springs with these tensions and slopes, (c,).
    """
    with np.errstate(divide='ignore', invalid='ignore'):
        secant = np.where(tension != 0.0, np.abs(tension) / length, 0.0)
    secant = secant[np.isfinite(secant)]
    least = _FLAT * max(
        float(np.abs(slope).max(initial=0.0)), float(secant.max(initial=0.0)))
    slope = np.where((np.abs(slope) <= least) & (tension != 0.0), least, slope)
    with np.errstate(divide='ignore', invalid='ignore'):
        return slope, np.where(slope != 0.0, length - tension / slope, length)


class TangentLaws:
    """Tensions and slopes of all connectors of a scene."""

    def __init__(self, packed: PackedScene) -> None:
        """Find the places of the connectors where their laws differ with their length."""
        self._packed = packed
        connectors = packed.connectors
        # Of connectors around shells this is the model without them, see wrapped.py.
        self.is_plain = connectors is None or (
            packed.model.wrapping is None and not packed.tables.tables
            and len(connectors.extension) == 1
            and bool(connectors.extension[0] == connectors.compression[0]))
        self._places: LinkPlaces | None = None
        # Laws by table have no kink: their slope is continuous.
        self.kinked = np.zeros(0 if connectors is None else len(connectors.first), bool)
        if not self.is_plain:
            assert connectors is not None and packed.model.links is not None
            self._places = link_places(
                packed.layout, packed.model.links, connectors, slice(None))
            self.kinked[:] = connectors.extension != connectors.compression
            if packed.tables.tables:
                self.kinked &= packed.tables.of < 0

    def stretched(self, length: np.ndarray, ends: np.ndarray, lever: float) -> Stretched:
        """Connectors of lengths [m], (c,), between `ends` (c, 2, 3) [m]."""
        rest = self.natural_length
        if not self.kinked.any():
            no = np.zeros(len(length), bool)
            return Stretched(length, length - rest, no, no)
        return find_kinks(length, rest, np.abs(ends).max(axis=(1, 2)), lever, self.kinked)

    def tension(self, length: np.ndarray) -> np.ndarray:
        """Tension [N], positive where it pulls, at lengths [m], (c,) both."""
        connectors, tables = self._packed.connectors, self._packed.tables
        if connectors is None:
            return np.zeros(0)
        stretch = length - connectors.natural_length
        tension = stretch * np.where(
            stretch > 0.0, connectors.extension, connectors.compression)
        for number, table in enumerate(tables.tables):
            chosen = tables.of == number
            tension[chosen] = table.evaluate(length[chosen])[0]
        return np.asarray(tension)

    def slope(self, here: Stretched, side: str = ACTUAL) -> np.ndarray:
        """Slope of the tension [N/m], (c,), by the `side` of connectors that are at their kink."""
        connectors, tables = self._packed.connectors, self._packed.tables
        if connectors is None:
            return np.zeros(0)
        slope = slopes_on(
            side, connectors.extension, connectors.compression, here.stretch, here.at_kink,
            here.rounded)
        for number, table in enumerate(tables.tables):
            chosen = tables.of == number
            slope[chosen] = table.slope(here.length[chosen])
        return slope

    def jump(self, chosen: np.ndarray) -> np.ndarray:
        """k_e - k_c [N/m] of the `chosen` connectors, by number."""
        connectors = self._packed.connectors
        if connectors is None:
            return np.zeros(0)
        jump = connectors.extension - connectors.compression
        return np.broadcast_to(jump, self.kinked.shape)[chosen]

    @property
    def natural_length(self) -> np.ndarray:
        """[m], (c,)."""
        connectors = self._packed.connectors
        rest = np.zeros(0) if connectors is None else connectors.natural_length
        return np.broadcast_to(rest, self.kinked.shape)

    def stiffnesses(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """k_e and k_c [N/m] of the `chosen` connectors, by number."""
        connectors = self._packed.connectors
        if connectors is None:
            return np.zeros(0), np.zeros(0)
        both = connectors.extension, connectors.compression
        pull, push = (np.broadcast_to(values, self.kinked.shape)[chosen] for values in both)
        return pull, push

    def model(self, here: Stretched, slope: np.ndarray, without: np.ndarray) -> Model:
        """
        The model with the springs that the connectors are, of slopes [N/m], (c,).

        `without`: numbers of connectors that are left out of it.
        """
        model, layout = self._packed.model, self._packed.layout
        if self._places is None or model.links is None:
            return model
        stiffness, rest = as_springs(
            np.where(here.rounded, 0.0, self.tension(here.length)), slope, here.length)
        stiffness[without] = 0.0

        def rows(values: np.ndarray) -> np.ndarray:
            assert self._places is not None
            array = aligned_zeros((12, layout.slot_count))
            array[self._places.link, self._places.slot] = values
            return array

        slopes = rows(stiffness)
        links = model.links._replace(
            variety=Variety(slopes, slopes, rows(rest)), tables=None)
        return model._replace(links=links)
