# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of elastic constants: no label lies over another."""

from itertools import combinations
from types import SimpleNamespace

import icofabric_sim as ico
from icofabric_sim.pictures.elastic_picture import draw_elasticity
import pytest

pytest.importorskip('matplotlib')


def test_labels_do_not_overlap(tmp_path, monkeypatch):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    shown = []

    def save(figure, *arguments, **named):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        for item in figure.findobj(Text):
            box = item.get_window_extent(renderer)
            if item.get_text() and item.get_visible() and box.width and (
                    figure.bbox.contains(box.x0, box.y0)):
                shown.append((item.get_text(), box))

    monkeypatch.setattr(Figure, 'savefig', save)
    curves = {
        kind: [SimpleNamespace(strain=0.01 * k, stress=rate * k) for k in range(1, 11)]
        for kind, rate in (('pull', 130.0), ('push', 110.0))}
    draw_elasticity(
        tmp_path / 'e.png', 'stiff_cantilever',
        ico.homogenise(ico.load_scene('stiff_cantilever')), curves, {})
    texts = {text for text, _ in shown}
    assert {'stiff_cantilever', 'stress [Pa]', 'x', 'y', 'z', 'pull'} <= texts
    over = [(one, other) for (one, first), (other, second) in combinations(shown, 2)
            if first.overlaps(second)]
    assert not over
