# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Tangent springs: connector laws linearised about a configuration.

A connector of length l, tension f and slope k = df/dl has the same force and second derivative as
a linear spring with stiffness k and natural length l - f / k. The Hessian product of the kernels
(kernels/hessian.py) uses the larger of k_e and k_c, because a step has to be stable on either
side. With these springs as input it gives the exact tangent.
"""

from typing import NamedTuple

from icofabric_sim.kernels.records import Model
from icofabric_sim.simulation.model.layout import aligned_zeros
from icofabric_sim.simulation.model.link_places import link_places, LinkPlaces
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.statics.sides import ACTUAL, kink_width, rounding_of, slopes_on
from icofabric_sim.terms.shared import Variety
import numpy as np

# Slopes below this ratio to the largest slope, or to the largest tension over length, are flat;
# there the tension determines the spring.
_FLAT_RATIO = 1e-12


class Stretched(NamedTuple):
    """Lengths and kinks of connectors or anchors in a configuration; all (c,)."""

    length: np.ndarray  # [m]
    stretch: np.ndarray  # [m] length less natural length
    at_kink: np.ndarray  # bool
    rounded: np.ndarray  # bool, at their kink within round-off


def find_kinks(
    length: np.ndarray, natural_length: np.ndarray | float, place: np.ndarray, lever: float,
    kinked: np.ndarray
) -> Stretched:
    """
    Find the connectors at their natural length [m]; `kinked` (c,) is the mask of kinked laws.

    `place` [m] is the distance of their ends from the origin; `lever`: see `lever_of`.
    """
    stretch = length - natural_length
    size = np.abs(stretch)
    return Stretched(
        length, stretch, kinked & (size <= kink_width(length, place, lever)),
        kinked & (size <= rounding_of(length, place)))


def as_springs(
    tension: np.ndarray, slope: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffnesses [N/m] and natural lengths [m] of springs with given tensions, slopes."""
    with np.errstate(divide='ignore', invalid='ignore'):
        secant = np.where(tension != 0.0, np.abs(tension) / length, 0.0)
    secant = secant[np.isfinite(secant)]
    least = _FLAT_RATIO * max(
        float(np.abs(slope).max(initial=0.0)), float(secant.max(initial=0.0)))
    slope = np.where((np.abs(slope) <= least) & (tension != 0.0), least, slope)
    with np.errstate(divide='ignore', invalid='ignore'):
        return slope, np.where(slope != 0.0, length - tension / slope, length)


class TangentLaws:
    """Tensions and slopes of all connectors of a scene."""

    def __init__(self, packed: PackedScene) -> None:
        """Find the connectors in the packed layout, unless their laws are plain springs."""
        self._packed = packed
        connectors = packed.connectors
        # With wrapped connectors the model leaves them out, see wrapped.py.
        self.is_plain = connectors is None or (
            packed.model.wrapping is None and not packed.curves.curves
            and len(connectors.extension) == 1
            and bool(connectors.extension[0] == connectors.compression[0]))
        self._places: LinkPlaces | None = None
        # Laws that replace springs have no kink, because their slope is continuous.
        self.kinked = np.zeros(0 if connectors is None else len(connectors.first), bool)
        if not self.is_plain:
            assert connectors is not None
            if packed.model.links is not None:
                self._places = link_places(
                    packed.layout, packed.model.links, connectors, packed.woven)
            self.kinked[:] = connectors.extension != connectors.compression
            if packed.curves.curves:
                self.kinked &= packed.curves.of < 0

    def stretched(self, length: np.ndarray, ends: np.ndarray, lever: float) -> Stretched:
        """Return stretches and kinks for lengths [m], (c,), between `ends` (c, 2, 3) [m]."""
        rest = self.natural_length
        if not self.kinked.any():
            no = np.zeros(len(length), bool)
            return Stretched(length, length - rest, no, no)
        return find_kinks(length, rest, np.abs(ends).max(axis=(1, 2)), lever, self.kinked)

    def tension(self, length: np.ndarray) -> np.ndarray:
        """Return tensions [N], positive in extension, at lengths [m], (c,) both."""
        connectors = self._packed.connectors
        if connectors is None:
            return np.zeros(0)
        stretch = length - connectors.natural_length
        tension = stretch * np.where(
            stretch > 0.0, connectors.extension, connectors.compression)
        return self._packed.curves.replace('tension', tension, length, connectors.extension,
            connectors.natural_length)

    def slope(self, here: Stretched, side: str = ACTUAL) -> np.ndarray:
        """Return tangent stiffnesses [N/m], (c,), with the `side` of connectors at their kink."""
        connectors = self._packed.connectors
        if connectors is None:
            return np.zeros(0)
        slope = slopes_on(
            side, connectors.extension, connectors.compression, here.stretch, here.at_kink,
            here.rounded)
        return self._packed.curves.replace('slope', slope, here.length, connectors.extension,
            connectors.natural_length)

    def jump(self, chosen: np.ndarray) -> np.ndarray:
        """Return k_e - k_c [N/m] of the `chosen` connectors, by number."""
        connectors = self._packed.connectors
        if connectors is None:
            return np.zeros(0)
        jump = connectors.extension - connectors.compression
        return np.broadcast_to(jump, self.kinked.shape)[chosen]

    @property
    def natural_length(self) -> np.ndarray:
        """Natural lengths [m], (c,)."""
        connectors = self._packed.connectors
        rest = np.zeros(0) if connectors is None else connectors.natural_length
        return np.broadcast_to(rest, self.kinked.shape)

    def stiffnesses(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return k_e and k_c [N/m] of the `chosen` connectors, by number."""
        connectors = self._packed.connectors
        if connectors is None:
            return np.zeros(0), np.zeros(0)
        both = connectors.extension, connectors.compression
        pull, push = (np.broadcast_to(values, self.kinked.shape)[chosen] for values in both)
        return pull, push

    def model(self, here: Stretched, slope: np.ndarray, without: np.ndarray) -> Model:
        """
        Return the model with tangent springs of stiffness `slope` [N/m], (c,).

        `without` are numbers of connectors to leave out.
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
            array[self._places.link, self._places.slot] = values[self._packed.woven]
            return array

        slopes = rows(stiffness)
        links = model.links._replace(
            variety=Variety(slopes, slopes, rows(rest)), laws=None)
        return model._replace(links=links)
