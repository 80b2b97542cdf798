# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
A picture of the waves in an endless fabric: band structure, and density of states.
"""

from pathlib import Path

from icofabric_sim.scene import Scene
from icofabric_sim.statics.periodic import (
    band_path,
    sample_zone,
    solve_bands,
    SYMMETRY_PATH,
)
import numpy as np

# Waves along each axis of the zone, and classes of frequencies, of the density of states.
_SAMPLES, _CLASSES = 24, 120


def density_of_states(
    scene: Scene, *, samples: int = _SAMPLES, classes: int = _CLASSES
) -> tuple[np.ndarray, np.ndarray]:
    """
    Edges of classes of frequencies (classes + 1,) [rad/s], and waves of a body in each [s/rad].

    From samples^3 wave vectors spread evenly; its integral is 6, less the waves that cost no
    energy or lower it.
    """
    bands = solve_bands(scene, sample_zone(scene, samples))
    edges = np.linspace(0.0, float(bands.max()) * 1.0001, classes + 1)
    above = bands[bands > 1e-6 * edges[-1]]
    counts, _ = np.histogram(above, edges)
    return edges, counts / (samples**3 * (edges[1] - edges[0]))


def draw_bands(path: Path, title: str, scene: Scene) -> None:
    """
    Draw to a PNG file; no display needed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    wave_vectors, along, stops = band_path(scene)
    bands = solve_bands(scene, wave_vectors)
    figure = Figure(figsize=(10.0, 5.4), dpi=100, facecolor='white')
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    left.plot(along, bands, color='#2c5f8a', linewidth=1.2)
    for stop in stops:
        left.axvline(along[stop], color='0.8', linewidth=0.8)
    left.set_xticks([along[stop] for stop in stops], SYMMETRY_PATH)
    left.set_xlim(along[0], along[-1])
    left.set_ylabel('frequency [rad/s]')
    left.set_title('bands; below 0: rates of growth' if bands.min() < 0.0 else 'bands')
    edges, density = density_of_states(scene)
    right.stairs(density, edges, orientation='horizontal', fill=True, color='#d9b26f')
    right.set_xlabel('states of a body [s/rad]')
    right.set_title('density')
    figure.suptitle(title)
    # The same picture gives the same file.
    figure.savefig(path, format='png', metadata={'Software': None})
