# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the waves in a periodic fabric: band structure, and density of states."""

from pathlib import Path

from icofabric_sim.libraries import require_library
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.periodic import (
    band_path,
    make_cell,
    sample_zone,
    solve_bands,
    SYMMETRY_PATH,
)
from icofabric_sim.statics.sides import BRANCHES
import numpy as np

# Waves along each axis of the zone, and classes of frequencies, of the density of states.
_SAMPLES, _CLASSES = 24, 120
_LINES = {'pull': '#2c5f8a', 'push': '#b3541e', None: '#2c5f8a'}


def density_of_states(
    scene: Scene, *, samples: int = _SAMPLES, classes: int = _CLASSES, branch: str | None = None,
    relaxed: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """
    Edges of classes of frequencies (classes + 1,) [rad/s], and waves of a body in each [s/rad].

    From samples^3 wave vectors spread evenly; its integral is 6, less the waves that cost no
    energy or lower it. `branch` and `relaxed` as in solve_bands.
    """
    bands = solve_bands(scene, sample_zone(scene, samples), branch=branch, relaxed=relaxed)
    edges = np.linspace(0.0, float(bands.max()) * 1.0001, classes + 1)
    above = bands[bands > 1e-6 * edges[-1]]
    counts, _ = np.histogram(above, edges)
    return edges, counts / (samples**3 * (edges[1] - edges[0]))


def draw_bands(
    path: Path, title: str, scene: Scene, *, branch: str | None = None, relaxed: bool = False
) -> None:
    """
    Draw to a PNG file; no display needed. Of a fabric at its kink a branch, or both (None).

    `relaxed` as in solve_bands.
    """
    require_library('matplotlib', 'a picture')
    from matplotlib.figure import Figure

    wave_vectors, along, stops = band_path(scene)
    drawn: tuple[str | None, ...] = (branch,)
    if branch is None and make_cell(scene, relaxed=relaxed).at_kink:
        drawn = BRANCHES
    figure = Figure(figsize=(10.0, 5.4), dpi=100, facecolor='white')
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    lowest = 0.0
    for name in drawn:
        bands = solve_bands(scene, wave_vectors, branch=name, relaxed=relaxed)
        lowest = min(lowest, float(bands.min()))
        lines = left.plot(along, bands, color=_LINES[name], linewidth=1.2)
        edges, density = density_of_states(scene, branch=name, relaxed=relaxed)
        if len(drawn) > 1:
            lines[0].set_label(f'all connectors {name}')
            right.stairs(density, edges, orientation='horizontal', color=_LINES[name])
        else:
            right.stairs(density, edges, orientation='horizontal', fill=True, color='#d9b26f')
    if len(drawn) > 1:
        left.legend(title='at the kink, bounds', loc='lower right')
    for stop in stops:
        left.axvline(along[stop], color='0.8', linewidth=0.8)
    left.set_xticks([along[stop] for stop in stops], SYMMETRY_PATH)
    left.set(
        xlim=(along[0], along[-1]), ylabel='frequency [rad/s]',
        title='bands; below 0: rates of growth' if lowest < 0.0 else 'bands')
    right.set(xlabel='states of a body [s/rad]', title='density')
    figure.suptitle(title)
    # The same picture gives the same file.
    figure.savefig(path, format='png', metadata={'Software': None})
