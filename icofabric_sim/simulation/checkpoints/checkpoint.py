# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Checkpoints: the state of a run, from which the run continues bit-identically.

A checkpoint holds the state tree of a `Simulation` (see state_tree.py) and identifies scene,
method, version and processor. It is plain text and numbers; reading a checkpoint executes no code.
"""

from collections.abc import Mapping
from dataclasses import dataclass
import os
from pathlib import Path
import stat
from typing import Any, Protocol, Self
import uuid

from icofabric_sim import checks
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.target import host_processor, kernel_target
from icofabric_sim.parameters.named_files import append_files
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.difference import (
    memory_difference,
    scene_difference,
    scene_parameters,
)
from icofabric_sim.simulation.checkpoints.encoding import claimed_size, decode, encode, HEAD
from icofabric_sim.simulation.checkpoints.state_tree import plain_number, StateTree
from icofabric_sim.simulation.reports.status import SimulationStatus
from icofabric_sim.version import __version__
import llvmlite
import numba
import numpy as np
import scipy

FORMAT = 2


class Run(Protocol):
    """The parts of a simulation that a checkpoint describes."""

    @property
    def scene(self) -> Scene: ...

    @property
    def time(self) -> float: ...

    @property
    def status(self) -> SimulationStatus: ...

    @property
    def rotation(self) -> str: ...


@dataclass(frozen=True, eq=False, repr=False)
class Checkpoint:
    """
    State of a run at one time: a `header` of words and numbers, and `arrays`.

    `Simulation.checkpoint` makes one; `Simulation.restore` continues from it.
    """

    header: dict[str, Any]
    arrays: dict[str, np.ndarray]

    def __post_init__(self) -> None:
        """Raise for a header without its required entries, or arrays of another type."""
        _check_header(checks.mapping('header', self.header))
        for array in checks.mapping('arrays', self.arrays).values():
            if checks.instance('arrays', array, np.ndarray).dtype != np.float64:
                raise TypeError(f'arrays must be of doubles, got the type {array.dtype}')

    def __repr__(self) -> str:
        """Return time and size in words."""
        size = sum(array.nbytes for array in self.arrays.values())
        return f'<Checkpoint at t = {self.time:.9g} s: arrays of {size:,} bytes>'

    @classmethod
    def of(cls, simulation: Run, tree: dict[str, Any]) -> Self:
        """
        Return a checkpoint of a simulation.

        Parameters
        ----------
        simulation
            The run.
        tree
            Its state, as `Simulation.checkpoint` collects it.
        """
        arrays: dict[str, np.ndarray] = {}
        _require_simulation(simulation)
        values = _split(checks.mapping('tree', tree), '', arrays)
        return cls({**_identity(simulation), 'memory': values}, arrays)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.header['time'])

    def parameters(self) -> Parameters:
        """Return the parameters of its scene; ValueError if this version does not accept them."""
        return scene_parameters(self.header)

    def state_tree(self) -> StateTree:
        """Return the state as a tree of numbers and arrays."""
        return StateTree(_joined(self.header['memory'], self.arrays))

    def to_bytes(self) -> bytes:
        """Return the checkpoint as bytes, for a file or a message."""
        return b''.join(encode(self.header, self.arrays))

    @classmethod
    def from_bytes(cls, data: bytes | bytearray | memoryview) -> Self:
        """
        Return the checkpoint that `to_bytes` has written.

        Parameters
        ----------
        data
            Bytes.

        Raises
        ------
        ValueError
            The bytes are damaged, or no checkpoint.
        """
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise TypeError(f'data must be the bytes of a checkpoint, got {checks.shown(data)}')
        try:
            return cls(*decode(bytes(data)))
        except (TypeError, ValueError) as error:
            raise ValueError(f'this is not a checkpoint that can be read: {error}') from error

    def save(self, path: str | os.PathLike[str]) -> None:
        """
        Write a file, which appears only when it is complete.

        Parameters
        ----------
        path
            The file; an existing one is replaced.
        """
        target = Path(checks.path('path', path))
        beside = target.with_name(f'.{uuid.uuid4().hex}.checkpoint')
        try:
            with beside.open('xb') as file:
                for piece in encode(self.header, self.arrays):
                    file.write(piece)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """
        Return the checkpoint in a file.

        Parameters
        ----------
        path
            The file.

        Raises
        ------
        OSError
            The file cannot be read.
        ValueError
            It contains no checkpoint, or a damaged one.
        """
        checks.path('path', path)
        try:
            return cls.from_bytes(_read(path))
        except ValueError as error:
            raise ValueError(f'{os.fspath(path)}: {error}') from error

    def difference(self, other: 'Checkpoint') -> str:
        """
        Return in words where two runs first differ, '' if their continuations are bit-identical.

        Machines, rates, numbers of threads and other things that the motion does not depend on are
        not compared.

        Parameters
        ----------
        other
            The checkpoint to compare with.

        Returns
        -------
        str
            First difference, or ''.
        """
        checks.instance('other', other, Checkpoint)
        words = 'in the first', 'in the second'
        return scene_difference(self.header, other.header, words) or memory_difference(
            [(each.header, each.arrays) for each in (self, other)], words)

    def unlike_machine(self) -> str:
        """Return how its processor and libraries differ from the present ones, '' if equal."""
        there, here = _flat_machine(self.header), _flat_machine(machine())
        return '; '.join(
            f'{name} {there.get(name, "?")} in it, {here[name]} here'
            for name in here if there.get(name) != here[name])

    def require_fit(self, simulation: Run) -> None:
        """
        Raise ValueError with the difference if scene, method or version are others.

        Parameters
        ----------
        simulation
            The run that is to continue from this checkpoint.

        Raises
        ------
        ValueError
            If scene, method or version differ.
        """
        _require_simulation(simulation)
        different = scene_difference(self.header, _identity(simulation), ('in it', 'here'))
        if different:
            raise ValueError(f'the checkpoint cannot be restored here: {different}')


def _require_simulation(simulation: Any) -> None:
    wanted = ('scene', 'time', 'status', 'rotation')
    if not all(hasattr(simulation, name) for name in wanted):
        raise TypeError(
            f'simulation must be a Simulation, got {checks.shown(simulation)}; '
            'compile_scene(scene) makes one')


def machine() -> dict[str, Any]:
    """Return what bits depend on besides the version: processor, vector lanes, libraries."""
    return {
        'processor': host_processor(),
        'kernels': kernel_target(),
        'lanes': LANES,
        'libraries': {
            'numpy': np.__version__, 'scipy': scipy.__version__, 'numba': numba.__version__,
            'llvmlite': llvmlite.__version__},
    }


def _identity(simulation: Run) -> dict[str, Any]:
    """Return the fingerprint of the scene and run that a checkpoint belongs to."""
    scene = simulation.scene
    return {
        'format': FORMAT,
        'version': __version__,
        'time': float(simulation.time),
        'scene': append_files(dump_parameters(scene.parameters.given()), scene.files),
        'method': simulation.status.method_name,
        'rotation': simulation.rotation,
        # A shell may have been given apart from the parameters.
        'mass': scene.shell.mass,
        'inertia': scene.shell.inertia,
        'body_count': scene.body_count,
        'connector_count': scene.connector_count,
        **machine(),
    }


def _check_header(header: Mapping[str, Any]) -> None:
    """Raise ValueError if the header lacks a required entry."""
    known = StateTree(header, 'header')
    number = known.count('format')
    if number != FORMAT:
        raise ValueError(f'its format is {number}, and this version reads format {FORMAT}')
    for name in ('version', 'scene', 'method', 'rotation', 'processor'):
        known.text(name)
    for name in ('time', 'mass', 'inertia'):
        known.number(name, 0.0)
    for name in ('body_count', 'connector_count', 'lanes'):
        known.count(name)
    for name in ('memory', 'libraries'):
        known.part(name)


def _flat_machine(header: Mapping[str, Any]) -> dict[str, Any]:
    return {
        'processor': header['processor'], 'kernels': header.get('kernels', '?'),
        'lanes': header['lanes'], **header['libraries']}


def _split(tree: Mapping[str, Any], place: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the JSON values of a state tree; move its arrays to `arrays`, by their path."""
    values: dict[str, Any] = {}
    for name, value in tree.items():
        path = f'{place}.{name}' if place else name
        if isinstance(value, np.ndarray):
            arrays[path] = value
        elif isinstance(value, Mapping):
            values[name] = _split(value, path, arrays)
        elif isinstance(value, float):
            values[name] = plain_number(value)
        else:
            values[name] = value
    return values


def _joined(values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return the state tree of JSON values and arrays."""
    tree = dict(values)
    for path, array in arrays.items():
        *parts, name = path.split('.')
        part = tree
        for step in parts:
            inner = part.get(step, {})
            if not isinstance(inner, Mapping):
                raise ValueError(f'the array {path} is in a part that is missing')
            part[step] = dict(inner)
            part = part[step]
        part[name] = array
    return tree


def _read(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a file that may be a checkpoint."""
    # A pipe without a writer must not hold up the reader.
    with open(path, 'rb', opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError('this is not an ordinary file')
        size = claimed_size(file.read(HEAD))
        if status.st_size != size:
            raise ValueError(f'it has {status.st_size:,} bytes instead of {size:,}')
        memory = os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES')
        if size > memory:
            raise ValueError(f'its {size:,} bytes are more than the memory of this machine')
        file.seek(0)
        return file.read(size)
