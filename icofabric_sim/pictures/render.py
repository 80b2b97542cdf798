# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of recorded runs: numbered frames, and sheets of several moments."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import active_inputs, RecordedInput, RecordedRun
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.topics import CONTACTS
from icofabric_sim.pictures.camera import View
from icofabric_sim.pictures.drawing import DEFAULT_SIZE, Framing, Renderer
from icofabric_sim.pictures.measures import fit_scale
from icofabric_sim.pictures.moment import Moment, Push
from icofabric_sim.scene.published import spread
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.selectors import Bodies, select
from icofabric_sim.simulation.inputs.input_types import BodyTarget, ChannelTarget
from icofabric_sim.simulation.reports.load_cells import contact_arrows
import numpy as np

Progress = Callable[[int], None]  # called with the number of pictures done
# Moments from which the scale of colours is found.
_SAMPLED = 24


def draw_sheet(
        bag: str | Path, picture: str | Path, *, moments: int = 8, view: View | None = None,
        size: tuple[int, int] = DEFAULT_SIZE, title: str = '', color: str = 'strain'
) -> list[float]:
    """
    Draw `moments` evenly spread moments of a recorded run to one PNG; returns their times [s].
    """
    with RecordedRun(bag) as run:
        times = spread_times(run.pose_times(), moments)
        RunPictures(run, times, view=view, size=size, title=title, color=color).sheet(picture)
        return [float(time) / 1e9 for time in times]


def chosen_bodies(scene: Scene, name: str, text: str) -> np.ndarray:
    """
    Numbers of the bodies that a group of the scene or a selector names; of `3 5`: of these.

    ValueError, with the `name` of the option, where it names none.
    """
    if text in scene.groups:
        return np.asarray(scene.groups[text])
    words = text.split()
    if words and all(word.isdecimal() for word in words):
        text = f'ids {text}'
    grid = scene.weave.grid
    return select(name, text, Bodies(scene.position, grid, scene.geometry.pitch))


def recorded_bodies(scene: Scene, name: str, text: str) -> np.ndarray:
    """Return the chosen bodies of a recorded run; raise ValueError if it lacks one of them."""
    bodies = chosen_bodies(scene, name, text)
    if scene.published_bodies is not None:
        lacking = np.setdiff1d(bodies, scene.published_bodies)
        if len(lacking):
            raise ValueError(
                f'{name} {text!r}: the record has no poses of body {lacking[0]}, as publish.group '
                'and publish.stride of its scene leave it out')
    return bodies


class RunMoments:
    """Yield states of a recorded run with the loads that act in them."""

    def __init__(self, run: RecordedRun) -> None:
        """Read what was received and what broke."""
        self.run = run
        self._inputs = run.inputs()
        self._breaks = run.breaks()

    def at(
            self, times: Sequence[int] | np.ndarray, *, with_velocity: bool = False,
            with_contacts: bool = False
    ) -> Iterator[Moment]:
        """
        Yield the moments of the recorded `times` [ns], in order of time.

        `with_velocity`: with the velocities since the recorded poses before each of them.
        `with_contacts`: with the forces of contacts, where the run was recorded with them.
        """
        wanted = {int(time) for time in times}
        read = wanted
        if with_velocity and len(times):
            every = self.run.pose_times()
            places = np.searchsorted(every, np.asarray(times))
            read = wanted | {int(every[place - 1]) for place in places if place > 0}
        before: Moment | None = None
        for frame in self.run.poses(sorted(read)):
            moment = self._moment(frame.nanoseconds, frame.position, frame.orientation)
            if with_velocity:
                velocity = np.zeros(moment.position.shape)
                if before is not None and before.scene is moment.scene and (
                        moment.time > before.time):
                    velocity = (moment.position - before.position) / (moment.time - before.time)
                moment = moment._replace(velocity=velocity)
            before = moment
            if frame.nanoseconds in wanted:
                yield moment._replace(contact_forces=self._contact_forces(frame.nanoseconds)) if (
                    with_contacts) else moment

    def _contact_forces(self, time: int) -> np.ndarray | None:
        """Points [m] and forces [N] of the contacts recorded at a `time` [ns], (k, 2, 3)."""
        for _, _, data in self.run.messages(
                start=time, stop=time + 1, names=[CONTACTS.name]):
            rows = self.run.decoded(decode_float64_multi_array, data).values
            return contact_arrows(rows[:, :2], rows[:, 2:5], rows[:, 5:8])
        return None

    def _moment(self, time: int, position: np.ndarray, orientation: np.ndarray) -> Moment:
        scene = self.run.scene_at(time)
        chosen = scene.published_bodies
        try:
            # The others are not drawn.
            position = spread(chosen, position, scene.position)
            orientation = spread(chosen, orientation, scene.orientation)
        except ValueError as error:
            raise BagError(
                f'{self.run.path} holds poses at t = {time / 1e9:.6g} s that are not those of its '
                f'scene there, of {scene.body_count} bodies: {error}') from error
        if not (np.isfinite(position).all() and np.isfinite(orientation).all()):
            raise BagError(f'{self.run.path} holds poses that are not finite')
        active = active_inputs(self._inputs, time)
        broken = torn = None
        for told, breaks in self._breaks:
            if told <= time:
                numbers = breaks[:, 0].astype(int)
                broken, torn = numbers[numbers >= 0], -1 - numbers[numbers < 0]
        if broken is not None and broken.max(initial=0) >= max(scene.connector_count, 1):
            raise BagError(
                f'{self.run.path} holds a broken connector {broken.max()} at t = {time / 1e9:.6g} '
                f's, but its scene there has {scene.connector_count} connectors')
        if torn is not None and torn.max(initial=-1) >= len(scene.anchors):
            raise BagError(
                f'{self.run.path} holds a broken anchor {torn.max()} at t = {time / 1e9:.6g} s, '
                f'but its scene there has {len(scene.anchors)} anchors')
        return Moment(
            time / 1e9, position, orientation, scene, _note(active), broken,
            pushes=tuple(received_pushes(scene, position, orientation, active)
                         + own_pushes(scene, position, orientation, time / 1e9,
                                      {_channel(entry) for entry in active})),
            torn_anchors=torn,
            known=None if chosen is None else np.isin(np.arange(scene.body_count), chosen))


class RunPictures:
    """Draws moments of one recorded run, all from one side and at one scale."""

    def __init__(
            self, run: RecordedRun, times: Sequence[int] | np.ndarray | None = None, *,
            view: View | None = None, size: tuple[int, int] = DEFAULT_SIZE, title: str = '',
            color: str = 'strain', bodies: str = '', follow: str = '') -> None:
        """
        Read the poses of the recorded `times` [ns]: all that is shown stays in the picture.

        All times by default. `bodies` and `follow` name groups, body numbers or selectors: what is
        drawn, and what the camera moves with. `color`: a name of `measures.QUANTITIES`.
        """
        self.run = run
        self.times = run.pose_times() if times is None else np.asarray(times)
        self._moments = RunMoments(run)
        scene = run.scene_at(int(self.times[0])) if len(self.times) else None
        shown = scene.published_bodies if scene else None
        framing = Framing(
            view,
            bodies=recorded_bodies(scene, 'bodies', bodies) if scene and bodies else shown,
            follow=recorded_bodies(scene, 'follow', follow) if scene and follow else None)
        found = False
        for moment in self._moments.at(self.times):
            framing.add(moment)
            found = found or len(moment.position) > 0
        if not found:
            raise BagError(f'{run.path} holds no poses to draw')
        self._with_velocity = color == 'speed'
        sampled = spread_times(self.times, _SAMPLED)
        self.renderer = Renderer(
            framing, title=title or run.path.name, size=size, color=color,
            scale=fit_scale(color, self._moments.at(sampled, with_velocity=self._with_velocity)))

    def moments(self) -> Iterable[Moment]:
        """Return the drawn moments in order of time."""
        return self.moments_at(self.times)

    def moments_at(self, times: Sequence[int] | np.ndarray) -> Iterable[Moment]:
        """Moments at recorded times [ns]."""
        return self._moments.at(
            times, with_velocity=self._with_velocity,
            with_contacts=self.renderer.color == 'contact')

    def sheet(self, path: str | Path) -> None:
        """Draw the moments side by side."""
        self.renderer.sheet(list(self.moments()), path)

    def frames(
            self, folder: str | Path, *, progress: Progress = lambda count: None) -> list[Path]:
        """Draw each moment to frame_0001.png, ... in a `folder`."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        width = max(4, len(str(len(self.times))))
        paths = []
        for number, moment in enumerate(self.moments(), start=1):
            path = folder / f'frame_{number:0{width}d}.png'
            self.renderer.frame(moment, path)
            paths.append(path)
            progress(number)
        return paths


def received_pushes(
        scene: Scene, position: np.ndarray, orientation: np.ndarray,
        active: Sequence[RecordedInput]) -> list[Push]:
    """Return received forces, for arrows."""
    pushes = []
    for entry in active:
        if isinstance(entry.target, ChannelTarget) and entry.target.name in scene.loads:
            pushes.append(push_of_channel(
                scene, entry.target.name, position, orientation, entry.force))
        elif isinstance(entry.target, BodyTarget) and entry.target.number < scene.body_count:
            body = entry.target.number
            turned = entry.force @ cosines_from_quaternions(orientation[body:body + 1])[0]
            pushes.append(Push(f'body {body}', position[body], turned))
    return [push for push in pushes if push.force.any()]


def own_pushes(
        scene: Scene, position: np.ndarray, orientation: np.ndarray, time: float,
        replaced: set[str]) -> list[Push]:
    """Return forces of the scene's loads at a time [s] after the start, for arrows."""
    pushes = []
    for name, channel in scene.loads.items():
        force = channel.force * channel.profile.at(max(time, 0.0))
        if name not in replaced and force.any():
            pushes.append(push_of_channel(scene, name, position, orientation, force))
    return pushes


def push_of_channel(
        scene: Scene, name: str, position: np.ndarray, orientation: np.ndarray, force: np.ndarray
) -> Push:
    """Return the total force [N] of a load channel at the centroid of its bodies."""
    channel = scene.loads[name]
    whole = force if channel.is_divided else len(channel.bodies) * force
    if channel.in_body_axes:
        axes = cosines_from_quaternions(orientation[channel.bodies])
        whole = np.einsum('a,nai->i', whole / len(channel.bodies), axes)
    return Push(name, position[channel.bodies].mean(axis=0), whole)


def spread_times(times: np.ndarray, count: int) -> np.ndarray:
    """Pick `count` of the recorded `times` [ns], spread evenly from the first to the last."""
    if not count >= 1:
        raise ValueError(f'count must be at least 1, got {count!r}')
    if count >= len(times):
        return times
    return nearest_times(times, np.linspace(times[0], times[-1], count) if len(times) else [])


def nearest_times(times: np.ndarray, wanted: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the recorded `times` [ns] nearest to the `wanted` ones, each once, ascending."""
    if not len(times):
        return times
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    wanted = np.asarray(wanted, dtype=float)
    nearer = np.where(wanted - times[before] < times[after] - wanted, before, after)
    return np.asarray(times[np.unique(nearer)])


def _channel(entry: RecordedInput) -> str:
    return entry.target.name if isinstance(entry.target, ChannelTarget) else ''


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
