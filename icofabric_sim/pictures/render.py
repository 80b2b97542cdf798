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
"""Pictures of recorded runs: numbered frames, and sheets of several moments."""

from collections.abc import Callable, Sequence
from pathlib import Path

from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import active_inputs, RecordedInput, RecordedRun
from icofabric_sim.pictures.drawing import Moment, Renderer
from icofabric_sim.pictures.fabric_polygons import Bounds, bounds_of, View
from icofabric_sim.simulation.input_types import ChannelTarget
import numpy as np

Progress = Callable[[int], None]  # called with the number of pictures done
DEFAULT_SIZE = (1280, 960)


def draw_sheet(
        bag: str | Path, picture: str | Path, *, moments: int = 8, view: View | None = None,
        size: tuple[int, int] = DEFAULT_SIZE, title: str = '') -> list[float]:
    """
    Draw `moments` evenly spread moments of a recorded run to one PNG; returns their times [s].
    """
    with RecordedRun(bag) as run:
        times = spread_times(run.pose_times(), moments)
        RunPictures(run, view=view, size=size, title=title).sheet(times, picture)
        return [float(time) / 1e9 for time in times]


class RunPictures:
    """Draws moments of one recorded run, all from one side and at one scale."""

    def __init__(
            self, run: RecordedRun, *, view: View | None = None,
            size: tuple[int, int] = DEFAULT_SIZE, title: str = '') -> None:
        """Read all poses once, so that all that moves stays in the picture."""
        self.run = run
        self.view = View() if view is None else view
        self._inputs = run.inputs()
        self._breaks = run.breaks()
        self.renderer = Renderer(
            self._bounds(), title=title or run.path.name, view=self.view, size=size)

    def sheet(self, times: Sequence[int] | np.ndarray, path: str | Path) -> None:
        """Draw the moments at recorded `times` [ns] side by side."""
        self.renderer.sheet(
            [self._moment(time, position, orientation)
             for time, position, orientation in self.run.poses(times)], path)

    def frames(
            self, times: Sequence[int] | np.ndarray, folder: str | Path, *,
            progress: Progress = lambda count: None) -> list[Path]:
        """Draw each of the recorded `times` [ns] to frame_0001.png, ... in a `folder`."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        width = max(4, len(str(len(times))))
        paths = []
        for number, frame in enumerate(self.run.poses(times), start=1):
            path = folder / f'frame_{number:0{width}d}.png'
            self.renderer.frame(self._moment(*frame), path)
            paths.append(path)
            progress(number)
        return paths

    def _bounds(self) -> Bounds:
        bounds: Bounds | None = None
        for frame in self.run.poses():
            if not len(frame.position):
                continue
            scene = self.run.scene_at(frame.nanoseconds)
            own = bounds_of(frame.position, scene.shell.half_edge, self.view)
            bounds = own if bounds is None else bounds.joined(own)
        if bounds is None:
            raise BagError(f'{self.run.path} holds no poses to draw')
        if not (np.isfinite(bounds.low).all() and np.isfinite(bounds.high).all()):
            raise BagError(f'{self.run.path} holds poses that are not finite')
        return bounds

    def _moment(self, time: int, position: np.ndarray, orientation: np.ndarray) -> Moment:
        scene = self.run.scene_at(time)
        if len(position) != scene.body_count:
            raise BagError(
                f'{self.run.path} holds {len(position)} poses at t = {time / 1e9:.6g} s, but its '
                f'scene there has {scene.body_count} bodies')
        note = _note(active_inputs(self._inputs, time))
        broken = None
        for told, breaks in self._breaks:
            if told <= time:
                broken = breaks[:, 0].astype(int)
        if broken is not None and broken.max(initial=0) >= max(scene.connector_count, 1):
            raise BagError(
                f'{self.run.path} holds a broken connector {broken.max()} at t = {time / 1e9:.6g} '
                f's, but its scene there has {scene.connector_count} connectors')
        return Moment(time / 1e9, position, orientation, scene, note, broken)


def spread_times(times: np.ndarray, count: int) -> np.ndarray:
    """Pick `count` of the recorded `times` [ns], spread evenly from the first to the last."""
    if not count >= 1:
        raise ValueError(f'count must be at least 1, got {count!r}')
    if count >= len(times):
        return times
    return nearest_times(times, np.linspace(times[0], times[-1], count) if len(times) else [])


def nearest_times(times: np.ndarray, wanted: Sequence[float] | np.ndarray) -> np.ndarray:
    """Recorded `times` [ns] nearest to the `wanted` ones, each once, ascending."""
    if not len(times):
        return times
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    wanted = np.asarray(wanted, dtype=float)
    nearer = np.where(wanted - times[before] < times[after] - wanted, before, after)
    return np.asarray(times[np.unique(nearer)])


def _note(inputs: Sequence[RecordedInput]) -> str:
    """Channels that push, for a caption."""
    names = []
    for entry in inputs:
        if isinstance(entry.target, ChannelTarget):
            names.append(entry.target.name)
        else:
            names.append(entry.frame_id or entry.topic)
    if not names:
        return ''
    shown = ', '.join(names[:2]) + (f' and {len(names) - 2} more' if len(names) > 2 else '')
    return f'pushed: {shown}'
