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
"""The pictures of runs in the documents have the colours that their legends explain."""

from pathlib import Path
import re

from icofabric_sim.messages.markers import STRAIN_CLASSES
from icofabric_sim.pictures.fabric_polygons import FREE_COLOR
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SHEET = re.compile(r'!\[\w+: six moments[^\]]*\]\(([\w/]+\.png)\)')
SHEETS = sorted({
    path.parent / name for path in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md'))
    for name in SHEET.findall(path.read_text('utf-8'))})


def pixels(path: Path) -> np.ndarray:
    """Colours (n, 3) of all pixels, 0 to 255."""
    from matplotlib.image import imread
    picture = np.asarray(imread(path))
    assert picture.ndim == 3, f'{path.name} has no colours'
    return np.rint(255.0 * picture[..., :3]).reshape(-1, 3)


@pytest.mark.parametrize('path', SHEETS, ids=lambda path: path.stem)
def test_the_colours_of_the_legend_are_in_the_picture(path):
    found = pixels(path)
    for entry in STRAIN_CLASSES:
        near = np.abs(found - np.rint(255.0 * np.array(entry.color[:3]))).max(axis=1) <= 1.0
        # The line in the legend is longer than that.
        assert near.sum() > 20, f'{path.name} does not show {entry.name}'
    assert (np.abs(found - 255.0 * FREE_COLOR[:3]).max(axis=1) <= 1.0).any()


def test_the_pictures_are_found():
    assert {'hanging_slab', 'torn_slab', 'woven_ball'} <= {path.stem for path in SHEETS}
    assert len(SHEETS) >= 14
