# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A packet of Bloch waves in a fabric, compared with phase and group velocities of the bands."""

from collections.abc import Iterator
import math
from typing import Any, NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.statics.periodic import make_cell, solve_bands
from icofabric_validation.named.problem import Curve, Point, Problem
import numpy as np

# The third of six bands, which is far from the others; wave number along x over pi / pitch.
_BAND, _WAVE_NUMBER_RATIO = 2, 0.3
# Largest displacement over a, so small that forces are linear to the same accuracy.
_AMPLITUDE_RATIO = 1e-7
# Half the width of the block over that of the packet.
_HALF_BLOCK_RATIO = 4.0


def _scene(size: list[int]) -> Scene:
    parameters: dict[str, Any] = {
        'weave.size': size, 'weave.connector_angle': 0.3, 'contact.mode': 'never',
        'solver.method': 'srkn6', 'solver.tolerance': 1e-9}
    return Scene.from_parameters(parameters)


class _Wave(NamedTuple):
    """A Bloch wave of the band, with derivatives by the wave vector."""

    frequency: float  # [rad/s]
    wave: np.ndarray  # (6,), complex: polarisation times square roots of mass and inertia
    frequency_slope: np.ndarray  # (3,) [m/s]
    wave_slope: np.ndarray  # (3, 6) [m]


def _wave(scene: Scene, wave_vector: np.ndarray) -> _Wave:
    """Return the wave, by perturbation theory of the matrix of the unit cell."""
    cell = make_cell(scene)
    phase = np.exp(1j * cell.offsets @ wave_vector)
    blocks = cell.stiffness / np.outer(cell.sqrt_mass, cell.sqrt_mass)
    matrix = np.einsum('r,rij->ij', phase, blocks)
    slopes = np.einsum('rk,r,rij->kij', 1j * cell.offsets, phase, blocks)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.conj().T))
    frequency, wave = float(np.sqrt(values[_BAND])), vectors[:, _BAND]
    # (3, 6): components of the derivative of the matrix on all bands.
    change = 0.5 * (slopes + slopes.conj().swapaxes(1, 2)) @ wave @ vectors.conj()
    frequency_slope = change[:, _BAND].real / (2.0 * frequency)
    change[:, _BAND] = 0.0
    gaps = np.where(np.arange(6) == _BAND, 1.0, values[_BAND] - values)
    return _Wave(frequency, wave, frequency_slope, change / gaps @ vectors.T)


def _speeds(scene: Scene, wave_vector: np.ndarray) -> tuple[float, float]:
    """Return frequency [rad/s] and group velocity along x [m/s] of the band."""
    change = 1e-4 * np.linalg.norm(wave_vector) * np.array([1.0, 0.0, 0.0])
    bands = solve_bands(scene, np.array([
        wave_vector - change, wave_vector, wave_vector + change]))[:, _BAND]
    return float(bands[1]), float((bands[2] - bands[0]) / (2.0 * change[0]))


def _amplitudes(
    simulation: Simulation, frequency: float, wave: np.ndarray, wave_vector: np.ndarray
) -> np.ndarray:
    """Return the complex amplitude of the wave at each body, (n,)."""
    scene, snapshot = simulation.scene, simulation.snapshot()
    root = np.sqrt(np.repeat([scene.shell.mass, scene.shell.inertia], 3))
    # Small rotations are twice the vector part of the relative quaternion.
    turn = 2.0 * snapshot.orientation[:, :3] * np.sign(snapshot.orientation[:, 3:])
    moved = np.hstack([snapshot.position - scene.position, turn]) * root
    rate = np.hstack([snapshot.linear_velocity, snapshot.angular_velocity]) * root
    amplitude: np.ndarray = (moved + 1j * rate / frequency) @ wave.conj() * np.exp(
        -1j * scene.position @ wave_vector)
    return amplitude


def _errors(width: float) -> tuple[float, float, int]:
    """Return errors of phase and group velocity of a packet of `width` pitches, and steps."""
    side = 2 * math.ceil(_HALF_BLOCK_RATIO * width) + 1
    scene = _scene([side + 2 * math.ceil(width), side, side])
    pitch, a = float(scene.geometry.pitch), 0.5 * scene.shell.edge_length
    wave_vector = np.array([_WAVE_NUMBER_RATIO * math.pi / pitch, 0.0, 0.0])
    packet = _wave(scene, wave_vector)
    frequency, wave = packet.frequency, packet.wave
    known, group = _speeds(scene, wave_vector)
    simulation = compile_scene(scene)
    place = scene.position - scene.position.mean(axis=0)
    envelope = np.exp(-(place**2).sum(axis=1) / (2.0 * (width * pitch) ** 2))
    root = np.sqrt(np.repeat([scene.shell.mass, scene.shell.inertia], 3))
    # Waves of the packet have individual polarisations and frequencies, to first order. With those
    # of the central wave, other bands would be excited and cause beats.
    derivative = 1j * place / (width * pitch) ** 2
    shape = wave + derivative @ packet.wave_slope
    phases = (envelope * np.exp(1j * scene.position @ wave_vector))[:, None] / root
    scale = _AMPLITUDE_RATIO * a / np.abs((phases * shape)[:, :3]).max()
    moved = (scale * phases * shape).real
    rate = (-1j * scale * phases * (
        frequency * shape + (derivative @ packet.frequency_slope)[:, None] * wave)).real
    turn = 0.5 * moved[:, 3:]
    simulation.set_state(
        position=scene.position + moved[:, :3], linear_velocity=rate[:, :3],
        angular_velocity=rate[:, 3:],
        orientation=np.hstack([turn, np.sqrt(1.0 - (turn**2).sum(axis=1, keepdims=True))]))
    # Until the centre has moved by the width.
    times = width * pitch / abs(group) * np.linspace(0.0, 1.0, 33)
    waves, centres = [], []
    for time in times:
        simulation.advance_to(float(time))
        found = _amplitudes(simulation, frequency, wave, wave_vector)
        weight = np.abs(found) ** 2
        waves.append(np.sum(found))
        centres.append(weight @ place[:, 0] / weight.sum())
    # Other bands still cause small beats, which fits through all samples average out.
    phase = float(-np.polyfit(times, np.unwrap(np.angle(waves)), 1)[0])
    centre = float(np.polyfit(times, centres, 1)[0])
    return (abs(phase - known) / known, abs(centre - group) / abs(group),
            simulation.status.step_count)


def _solve(long: bool) -> Iterator[Curve]:
    found = {width: _errors(width) for width in (2.0, 3.0, 4.0) + ((5.0, 6.0) if long else ())}
    for of, which, allowed, order in (('phase velocity', 0, 1e-4, None),
                                      ('group velocity', 1, 3e-2, 2.0)):
        yield Curve(
            f'srkn6, {of}', '1 over (k x width)', tuple(
                Point(1.0 / (_WAVE_NUMBER_RATIO * math.pi * width), errors[which], errors[2])
                for width, errors in found.items()), allowed, order=order)


PROBLEM = Problem(
    'wave_packet', 'a packet of Bloch waves in a fabric',
    'Brillouin, Wave Propagation in Periodic Structures; the bands of icofabric modes',
    'error of a velocity against the bands, relative', _solve, has_long_form=True)
