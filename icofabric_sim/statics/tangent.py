# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Connector laws in the neighbourhood of a configuration: each a spring of its own.

A connector of length l, tension f and slope k = df/dl has the same force and the same second
derivative as a linear spring with stiffness k and natural length l - f / k. So the Hessian product
of the kernels (kernels/hessian.py), which takes the larger of k_e and k_c because a step has to be
stable on either side, gives the exact tangent when it is handed these springs.
"""

from icofabric_sim.kernels.records import Model, Variety
from icofabric_sim.layout import aligned_empty
from icofabric_sim.link_places import link_places, LinkPlaces
from icofabric_sim.model import PackedScene
import numpy as np

# Where a table is flat, of the largest slope: the tension decides there, not the slope.
_FLAT = 1e-12


class TangentLaws:
    """
    Tensions and slopes of all connectors of a scene.
    """

    def __init__(self, packed: PackedScene) -> None:
        """
        Find the places of the connectors where their laws differ with their length.
        """
        self._packed = packed
        connectors = packed.connectors
        self._plain = connectors is None or (
            not packed.tables.tables and len(connectors.extension) == 1
            and bool(connectors.extension[0] == connectors.compression[0]))
        self._places: LinkPlaces | None = None
        if not self._plain:
            assert connectors is not None and packed.model.links is not None
            self._places = link_places(
                packed.layout, packed.model.links, connectors, slice(None))

    def evaluate(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Tension [N], positive where it pulls, and slope [N/m] at lengths [m], (c,) each.

        At the natural length of a spring with two stiffnesses the slope is that in compression.
        """
        connectors, tables = self._packed.connectors, self._packed.tables
        if connectors is None:
            return np.zeros(0), np.zeros(0)
        stretch = length - connectors.natural_length
        slope = np.where(stretch > 0.0, connectors.extension, connectors.compression)
        tension = slope * stretch
        for number, table in enumerate(tables.tables):
            chosen = tables.of == number
            tension[chosen] = table.evaluate(length[chosen])[0]
            slope[chosen] = table.slope(length[chosen])
        return tension, slope

    def model(self, length: np.ndarray) -> Model:
        """
        The model with the springs that the connectors are at lengths [m], (c,).
        """
        model, layout = self._packed.model, self._packed.layout
        if self._places is None or model.links is None:
            return model
        tension, slope = self.evaluate(length)
        least = _FLAT * float(np.abs(slope).max(initial=0.0))
        flat = (np.abs(slope) <= least) & (tension != 0.0)
        slope = np.where(flat, least or 1.0, slope)
        with np.errstate(divide='ignore', invalid='ignore'):
            rest = np.where(slope != 0.0, length - tension / slope, length)

        def rows(values: np.ndarray) -> np.ndarray:
            assert self._places is not None
            array = aligned_empty((12, layout.slot_count))
            array[:] = 0.0
            array[self._places.link, self._places.slot] = values
            return array

        stiffness = rows(slope)
        links = model.links._replace(
            variety=Variety(stiffness, stiffness, rows(rest)), tables=None)
        return model._replace(links=links)
