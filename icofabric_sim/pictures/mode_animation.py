# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A mode in motion: as a picture that moves (GIF), or as a bag that `replay_node` plays.

Modes of thousands of hertz and mechanisms without any frequency are shown alike: a swing takes
PERIOD seconds, and its largest rotation is 1 rad, or its largest displacement a.
"""

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path

from icofabric_sim.bag import BagRecorder
from icofabric_sim.geometry.rotations import rotate_quaternions
from icofabric_sim.messages.topics import CLOCK, CONNECTORS, Outputs, POSES, Topic, WEAVE
from icofabric_sim.parameters.named_files import append_files
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.pictures.drawing import frame_moments, Renderer
from icofabric_sim.pictures.measures import fit_scale
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np

PERIOD = 2.0  # [s]
# Pictures of half a swing, from one end to the other; the way back shows the same ones.
HALF = 24
# Swings in a bag, and moments of each.
_SWINGS, _RATE = 5, 60
_NODE = '/icofabric'
_SIZE = (800, 600)

Progress = Callable[[int], None]  # called with the number of moments done


def scaled_shape(scene: Scene, shape: np.ndarray) -> np.ndarray:
    """Return the motion (n, 6) scaled to a largest rotation of 1 rad or displacement of a."""
    largest = max(
        float(np.abs(shape[:, :3]).max()) / scene.geometry.half_edge,
        float(np.abs(shape[:, 3:]).max()))
    return np.asarray(shape / largest)


def displaced(rest: Snapshot, motion: np.ndarray) -> Snapshot:
    """Return the configuration moved by (n, 6) displacements [m] and rotation vectors [rad]."""
    return replace(
        rest, position=rest.position + motion[:, :3],
        orientation=rotate_quaternions(motion[:, 3:], rest.orientation))


def write_gif(
    path: Path, title: str, scene: Scene, rest: Snapshot, shape: np.ndarray, *,
    progress: Progress = lambda count: None
) -> None:
    """
    Draw a period of a motion (n, 6) to a GIF that repeats; HALF + 1 states are drawn.
    """
    from PIL import Image

    shape = scaled_shape(scene, shape)
    moments = []
    for number in range(HALF + 1):
        here = displaced(rest, math.cos(math.pi * number / HALF) * shape)
        moments.append(Moment(math.nan, here.position, here.orientation, scene))
    renderer = Renderer(
        frame_moments(moments), title=title, size=_SIZE, color='strain',
        scale=fit_scale('strain', moments))
    frames = []
    for number, moment in enumerate(moments, start=1):
        frames.append(renderer.picture(moment).convert('P', palette=Image.Palette.ADAPTIVE))
        progress(number)
    path.parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(
        path, save_all=True, append_images=frames[1:] + frames[-2:0:-1], loop=0,
        duration=round(1000.0 * PERIOD / (2 * HALF)))


def write_bag(
    path: Path, said: str, scene: Scene, rest: Snapshot, shape: np.ndarray
) -> None:
    """
    Record periods of a motion (n, 6) to a bag, with the texts of `said` as custom data.

    Poses, connectors and the clock, as of a run; nothing was simulated, and nothing says so.
    """
    from icofabric_sim.version import __version__

    shape = scaled_shape(scene, shape)
    text = dump_parameters(scene.parameters.complete())
    recorder = BagRecorder(
        path, storage=str(scene.parameters['record.storage']),
        custom={'scene': append_files(text, scene.files), 'version': __version__,
                'animation': said},
        custom_topic=f'{_NODE}/recording')
    outputs = Outputs(scene)

    def send(topic: Topic, time: int, data: bytes) -> None:
        name = _NODE + topic.name[1:] if topic.name.startswith('~') else topic.name
        recorder.add_topic(name, topic.type, latched=topic.latched, depth=topic.depth)
        recorder.write(name, time, data, essential=topic is WEAVE)

    try:
        send(WEAVE, 0, outputs.weave(scene.parameters))
        for number in range(_SWINGS * _RATE + 1):
            phase = 2.0 * math.pi * number / _RATE
            time = round(1e9 * PERIOD * number / _RATE)
            here = replace(displaced(rest, math.cos(phase) * shape), time=time / 1e9)
            send(CLOCK, time, outputs.clock(time))
            send(POSES, time, outputs.poses(here, time))
            for message in outputs.connectors(here, time):
                send(CONNECTORS, time, message)
    finally:
        recorder.close()
    if recorder.error is not None:
        raise recorder.error
