# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Random scenes over all parameters; a seed gives the same text on every machine.

The kind is drawn first, then values, as multiples of the scales of the fabric: half edge a, mass,
stiffness and their frequency. Some scenes are spoiled: one value is impossible, and the refusal
must give its name.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
import math
from pathlib import Path
from typing import Any, Final

from icofabric_sim import checks
from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius
from icofabric_sim.geometry.shell import maximum_thickness, Shell
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.scene.weave_geometry import geometry_from_angle
from icofabric_sim.simulation.stepping.methods import IMPLICIT
from icofabric_validation.stress.kinds import AUTO_DAMPED, Kind, KINDS
import numpy as np

MAX_SEED: Final = 2**32 - 1
# Fraction of scenes with a value that must be refused.
_SPOILED_RATIO = 0.06
# Fraction of scenes whose parameters change during the run, and fraction of these changes that
# must be refused.
_CHANGED_RATIO, _SPOILED_CHANGE_RATIO = 0.7, 0.08
# Largest number of grid positions, so that a scene can be judged in seconds.
_MAX_GRID_POSITIONS = 120
_EDGES = ('up', 'down', 'north', 'south', 'west', 'east')
# Approximate largest frequency of a fabric of identical springs over sqrt(k / M).
_FREQUENCY_RATIO = 4.0
# Prefix of values that name a file of the scene.
_FILE_PREFIX = 'FILE:'


@dataclass(frozen=True)
class StressScene:
    """
    A drawn scene: its parameters, the files that they name, and what must be refused.

    Parameters may change during the run, as by the services of a node. Then a value that must be
    refused is in the change.
    """

    seed: int
    kind: int  # index in KINDS
    parameters: dict[str, Any]  # dotted names; files as FILE:NAME
    files: dict[str, str]  # name and text
    spoiled: str = ''  # name of the parameter with an impossible value; '': none
    spoiled_with: tuple[str, ...] = ()  # names of all parameters that were changed for it
    change: dict[str, Any] = field(default_factory=dict)  # values set during the run
    change_at: float = 0.0  # fraction of the duration after which they are set

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return float(self.parameters['duration'])

    def write_files(self, folder: Path) -> dict[str, Any]:
        """Write the files into a folder, and return the parameters with their paths."""
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding='utf-8')
        return {name: _with_folder(value, folder) for name, value in self.parameters.items()}

    def text(self) -> str:
        """Return the scene as a parameter file, with relative names of its files."""
        kind = KINDS[self.kind]
        head = (
            f'# Seed {self.seed} of icofabric stress, kind {self.kind}: {kind}.\n')
        if self.change:
            changed = ', '.join(f'{name}: {value}' for name, value in self.change.items())
            head += f'# After {self.change_at * self.duration!r} s: {changed}.\n'
        if self.spoiled:
            head += f'# To be refused for {self.spoiled}.\n'
        return head + dump_parameters(
            {name: _with_folder(value, None) for name, value in self.parameters.items()})

    def with_files_named(self, prefix: str) -> 'StressScene':
        """Return the scene with a prefix in the names of its files, without unused files."""
        used = {
            name for name in self.files
            if any(isinstance(value, str) and value.endswith(_FILE_PREFIX + name)
                   for value in self.parameters.values())}
        return replace(
            self, files={prefix + name: self.files[name] for name in self.files if name in used},
            parameters={
                name: value.replace(_FILE_PREFIX, _FILE_PREFIX + prefix)
                if isinstance(value, str) else value
                for name, value in self.parameters.items()})

    def without(self, names: Collection[str]) -> 'StressScene':
        """Return the scene without some of its parameters."""
        return replace(self, parameters={
            name: value for name, value in self.parameters.items() if name not in names})


def draw_scene(seed: int) -> StressScene:
    """Return the scene of a seed, 0 to 2^32 - 1."""
    seed = checks.count('seed', seed, 0, MAX_SEED)
    generator, kind = _draw_kind(seed)
    return _Draw(generator, KINDS[kind]).scene(seed, kind)


def kind_of(seed: int) -> int:
    """Return the number of the kind that a seed draws."""
    return _draw_kind(seed)[1]


def _draw_kind(seed: int) -> tuple[np.random.Generator, int]:
    """Return the generator of a seed after its first draw, and the kind that this draw gave."""
    generator = np.random.default_rng(seed)
    return generator, int(generator.integers(len(KINDS)))


def seeds_of(first: int, count: int, kinds: Collection[int]) -> Iterator[int]:
    """Yield the first `count` seeds from `first` on whose kinds are in `kinds`."""
    found, seed = 0, first
    while found < count and seed <= MAX_SEED:
        if kind_of(seed) in kinds:
            found += 1
            yield seed
        seed += 1


def _with_folder(value: Any, folder: Path | None) -> Any:
    if not (isinstance(value, str) and _FILE_PREFIX in value):
        return value
    head, _, name = value.partition(_FILE_PREFIX)
    return head + (name if folder is None else str(folder / name))


class _Draw:
    """The state of drawing one scene."""

    def __init__(self, generator: np.random.Generator, kind: Kind) -> None:
        self.generator, self.kind = generator, kind
        self.values: dict[str, Any] = {}
        self.files: dict[str, str] = {}

    def scene(self, seed: int, kind: int) -> StressScene:
        self._draw_weave()
        for term in self.kind.terms:
            getattr(self, f'_{term}')()
        self._draw_charges_of_groups()
        self._draw_masses()
        self._draw_layers()
        self._draw_initial_state()
        self._draw_solver()
        change: dict[str, Any] = {}
        if self.chance(_CHANGED_RATIO):
            change = self._draw_change()
        if change and self.chance(_SPOILED_CHANGE_RATIO):
            spoiled, change = self._draw_impossible_change()
            with_it = tuple(change)
        elif not change and self.chance(_SPOILED_RATIO):
            spoiled, with_it = self._spoil_value()
        else:
            spoiled, with_it = '', ()
        return StressScene(
            seed, kind, self.values, self.files, spoiled, with_it, change,
            self.uniform(0.1, 0.7) if change else 0.0)

    # Numbers are plain Python, so that they can be written to files.

    def chance(self, share: float) -> bool:
        return bool(self.generator.random() < share)

    def uniform(self, low: float, high: float) -> float:
        return float(self.generator.uniform(low, high))

    def log(self, low: float, high: float) -> float:
        """Return a number whose decimal logarithm is between `low` and `high`."""
        return 10.0 ** self.uniform(low, high)

    def vector(self, size: float) -> list[float]:
        return [float(x) for x in size * self.generator.standard_normal(3)]

    def choice(self, *words: Any) -> Any:
        return words[int(self.generator.integers(len(words)))]

    def _draw_weave(self) -> None:
        values = self.values
        kind = self.choice('orthogonal', 'orthogonal', 'bias', 'radial')
        size = [1 + int(6.99 * self.generator.random() ** 2) for _ in range(3)]
        if kind != 'orthogonal':
            # Bands of a radial weave have several rows; corners of a rotated slab have few bodies.
            size = [max(n, 3) for n in size]
        while math.prod(size) > _MAX_GRID_POSITIONS:
            size[size.index(max(size))] -= 1
        # Half of the fabrics have shells of 3 mm to 10 cm.
        edge = self.log(-2.5, -1.0) if self.chance(0.5) else self.log(-5.7, 3.3)
        self.a = 0.5 * edge
        thickness = self.a * (self.log(-4.0, -1.0) if self.chance(0.3) else self.uniform(0.1, 1.4))
        density = self.log(1.0, 4.0)
        shell = Shell.from_thickness(edge, thickness, density)
        self.mass, self.inertia = shell.mass, shell.inertia
        low, high = (-0.36, 0.05) if self.chance(0.15) else (0.05, 0.75)
        angle = self.uniform(low, high)
        self.length = geometry_from_angle(self.a, angle).connector_length
        values |= {
            'weave.kind': kind, 'weave.size': size, 'weave.variant': int(
                self.generator.integers(4)),
            'shell.edge_length': edge, 'shell.density': density}
        if self.chance(0.2):
            values['shell.inner_edge_length'] = 2.0 * shell.inner_half_edge
        else:
            values['shell.thickness'] = thickness
        if self.chance(0.3):
            values['weave.connector_length'] = self.length
        else:
            values['weave.connector_angle'] = angle
        if self.chance(0.15):
            self.mass *= (factor := self.log(-1.0, 1.0))
            self.inertia *= factor
            values['shell.mass'] = self.mass
        if self.chance(0.15):
            # The vertices are 1.9 a from the centre, and some of the mass is nearer.
            self.inertia = min(self.inertia * self.log(-0.7, 0.7), self.mass * self.a**2)
            values['shell.inertia'] = self.inertia
        if kind == 'bias':
            values['weave.boundary'] = self.choice('upright', 'fabric')
            if self.chance(0.7):
                values['weave.azimuth'] = self.uniform(-math.pi, math.pi)
        if kind == 'radial' and self.chance(0.7):
            values['weave.radius'] = self.length * self.uniform(3.0, 12.0)
        if kind != 'radial' and self.chance(0.15):
            width = self.length * max(size)
            values['weave.region'] = self.choice(
                f'sphere {0.6 * width!r}', f'cylinder {0.5 * width!r} {width!r}',
                f'box {width!r} {0.8 * width!r} {width!r}')
        if kind == 'orthogonal' and self.chance(0.1):
            # A box as large as the fabric of that size.
            values['weave.box'] = [self.length * n for n in size]
        # Ten decades of stiffness; most are soft enough for the scale of the shells.
        self.k = self.mass * (self.log(1.0, 7.0) if self.chance(0.6) else self.log(-1.0, 9.0))
        values['connector.stiffness'] = self.k
        self.rate = math.sqrt(self.k / self.mass)
        self.natural = self.length
        if 'tabulated' not in self.kind.terms and self.chance(0.5):
            wide = self.chance(0.3)
            self.natural *= self.uniform(0.5, 2.0) if wide else self.uniform(0.9, 1.1)
            values['connector.natural_length'] = self.natural
        values['contact.mode'] = 'never'

    # One method for each term; the name is that of the term.

    def _loads(self) -> None:
        force = self.k * self.a * self.log(-4.0, -0.7)
        self.values |= {
            'groups.pushed': self.choice('x_max', 'all', 'y_min', 'not z_max'),
            'loads.push.group': 'pushed', 'loads.push.force': self.vector(force),
            'loads.push.frame': self.choice('world', 'body'),
            'loads.push.share': self.choice('each', 'total')}
        if self.chance(0.5):
            self.values['loads.push.torque'] = self.vector(0.5 * self.a * force)
        if self.chance(0.5):
            self.values['loads.push.point'] = self.vector(self.a)
        self._profile('loads.push')
        if self.chance(0.3):
            self.values['loads.push.profile'] = f'sine {self._frequency()!r}'

    def _profile(self, prefix: str) -> None:
        profile = self.choice('steady', 'ramp', 'half_sine', 'table')
        length = 2.0 * math.pi / self.rate * self.log(-0.5, 1.3)
        if profile == 'table':
            times = length * np.cumsum(self.generator.uniform(0.05, 0.4, 6))
            factors = self.generator.uniform(-1.0, 1.0, 6)
            profile = f'table {self._file("profile.csv", times, factors)}'
        elif profile != 'steady' or self.chance(0.5):
            self.values[f'{prefix}.duration'] = length
        if self.chance(0.5):
            self.values[f'{prefix}.start'] = self.uniform(0.0, 1.0) * length
        self.values[f'{prefix}.profile'] = profile

    def _file(self, name: str, *columns: np.ndarray) -> str:
        self.files[name] = ''.join(
            ','.join(repr(float(x)) for x in row) + '\n' for row in zip(*columns))
        return _FILE_PREFIX + name

    def _gravity(self) -> None:
        self.values['gravity'] = self.vector(self.a * self.rate**2 * self.log(-4.0, -1.5))

    def _supports(self) -> None:
        self.values |= {
            'groups.held': self.choice('z_max', 'ids 0', 'x_min'), 'supports.hold.group': 'held',
            'supports.hold.fix': self.choice('all', 'tx ty tz', 'rotation', 'tz', 'tx rotation')}

    def _bending(self) -> None:
        self.values['connector.bending_stiffness'] = self.k * self.a**2 * self.log(-3.0, 0.0)

    def _twisting(self) -> None:
        self.values['connector.twisting_stiffness'] = self.k * self.a**2 * self.log(-3.0, 0.0)

    def _attachments(self) -> None:
        if 'wrapped' in self.kind.terms:
            self._attach_outside()
            return
        if self.chance(0.5):
            self.values['connector.attachment_scale'] = self.uniform(0.6, 1.0)
        for edge in _EDGES:
            if self.chance(0.5):
                self.values[f'connector.attachment.{edge}'] = self.vector(0.6 * self.a)

    def _attach_outside(self) -> None:
        """Draw attachment points on or outside the shell, for wrapped connectors."""
        if self.chance(0.5):
            self.values['connector.attachment_scale'] = self.uniform(1.0, 1.5)
        faces = face_geometry(self.a)
        for edge in _EDGES:
            if self.chance(0.5):
                way = np.array(self.vector(1.0))
                on_shell = way * (inscribed_radius(self.a) / (faces.normals @ way).max())
                out = 1.0 if self.chance(0.4) else self.uniform(1.0, 1.5)
                self.values[f'connector.attachment.{edge}'] = [float(x) for x in out * on_shell]

    def _bilinear(self) -> None:
        ratio = self.log(-1.0, 0.0) if self.chance(0.6) else self.log(-6.0, 0.0)
        soft = self.choice('compression', 'compression', 'extension')
        hard = 'extension' if soft == 'compression' else 'compression'
        self.values[f'connector.stiffness_{hard}'] = self.k
        self.values[f'connector.stiffness_{soft}'] = 0.0 if self.chance(0.1) else self.k * ratio

    def _tabulated(self) -> None:
        lengths = self.length * np.concatenate((
            [0.2], np.sort(self.generator.uniform(0.3, 1.9, 5)), [2.5]))
        force = self.k * (lengths - self.length) * self.generator.uniform(0.3, 1.0, 7)
        self.values['connector.law'] = self._file('law.csv', lengths, np.sort(force))

    def _groups(self) -> None:
        self.values |= {
            'groups.low': 'z_min', 'groups.high': 'not z_min',
            'connector_groups.seam.between': 'low high',
            'connector_groups.seam.stiffness': self.k * self.uniform(0.2, 1.0)}
        if self.chance(0.5):
            self.values['connector_groups.seam.natural_length'] = (
                self.natural * self.uniform(0.9, 1.1))
        for term, name, unit in (
                ('bending', 'bending_stiffness', self.k * self.a**2),
                ('twisting', 'twisting_stiffness', self.k * self.a**2),
                ('damping', 'damping', self.mass * self.rate)):
            if term in self.kind.terms and self.chance(0.5):
                self.values[f'connector_groups.seam.{name}'] = unit * self.log(-2.0, 0.0)
        if self.chance(0.5):
            self.values['connector_groups.seam.direction'] = self.choice('up down', 'west east')
        self._draw_group_laws()

    def _draw_group_laws(self) -> None:
        values, terms, seam = self.values, self.kind.terms, 'connector_groups.seam'
        if 'bilinear' in terms and self.chance(0.7):
            values[f'{seam}.stiffness_{self.choice("extension", "compression")}'] = (
                self.k * self.log(-1.0, 0.0))
        if 'breaking' in terms and self.chance(0.7):
            natural = values.get(f'{seam}.natural_length', self.natural)
            values[f'{seam}.break_length_extension'] = natural * (1.0 + self.log(-2.0, 0.0))
            if self.chance(0.5):
                values[f'{seam}.break_length_compression'] = natural * (
                    1.0 - self.log(-2.0, -0.2))
        if 'tabulated' in terms and self.chance(0.7):
            lengths = self.length * np.array([0.1, 0.7, 1.0, 1.4, 3.0])
            force = self.k * (lengths - self.length) * self.uniform(0.2, 1.0)
            values[f'{seam}.law'] = self._file('seam.csv', lengths, force)
            for name in ('stiffness', 'natural_length'):
                values.pop(f'{seam}.{name}', None)

    def _damping(self) -> None:
        # Critical damping is at about 1; some values are far above.
        if self._is_stiff:
            # Strong damping, for implicit steps.
            part = self.log(-2.0, 1.0) if self.chance(0.4) else self.log(1.0, 3.0)
        else:
            part = self.log(-3.0, 0.0) if self.chance(0.8) else self.log(0.0, 2.0)
        self.values['connector.damping'] = self.mass * self.rate * part

    def _maxwell(self) -> None:
        # From nearly a damper to nearly a spring.
        self.values |= {
            'connector.maxwell_stiffness': self.k * self.log(-1.5, 1.0),
            'connector.maxwell_time': self.log(-2.0, 2.0) / self.rate}
        if 'groups' in self.kind.terms and self.chance(0.5):
            self.values |= {
                'connector_groups.seam.maxwell_stiffness': self.choice(
                    0.0, self.k * self.log(-1.5, 1.0)),
                'connector_groups.seam.maxwell_time': self.log(-2.0, 2.0) / self.rate}

    def _anisotropic(self) -> None:
        # At most the sum of the other two, and at most that of the mass at the vertices.
        most = min(self.inertia, 3.0 * self.mass * self.a**2)
        parts = [0.5, 0.5, 1.0] if self.chance(0.2) else [self.uniform(0.55, 1.1) for _ in 'xyz']
        self.values['shell.principal_inertia'] = [most * part for part in parts]
        self.values.pop('shell.inertia', None)

    @property
    def _is_stiff(self) -> bool:
        """True if steps may be implicit."""
        return self.kind.method in IMPLICIT or self.kind in AUTO_DAMPED

    def _drag(self) -> None:
        part = self.log(-3.0, 0.0) if self.chance(0.8) else self.log(0.0, 2.0)
        if self.chance(0.8):
            self.values['drag.linear'] = self.mass * self.rate * part
        if 'drag.linear' not in self.values or self.chance(0.6):
            self.values['drag.angular'] = self.inertia * self.rate * part

    def _breaking(self) -> None:
        self.values['connector.break_length_extension'] = self.natural * (
            1.0 + self.log(-2.0, 0.0))
        if self.chance(0.4):
            self.values['connector.break_length_compression'] = self.natural * (
                1.0 - self.log(-2.0, -0.2))

    def _wrapped(self) -> None:
        self.values['connector.obstruction'] = 'wrap'

    def _draw_charge(self) -> float:
        """Draw the charge [C] of each body, whose repulsion over L is a fraction of k a."""
        force = self.k * self.a * self.log(-4.0, -1.0)
        charge = math.sqrt(force / 8.9875517923e9) * self.length
        self.values['charge.per_body'] = self.choice(-1.0, 1.0) * charge
        return charge

    def _charges(self) -> None:
        field = self.k * self.a * self.log(-4.0, -1.0) / self._draw_charge()
        self.values['field.electric'] = self.vector(field)
        self._draw_field_profile()

    def _dipoles(self) -> None:
        moment = self.vector(1e-9 * self.a)
        turn = self.k * self.a**2 * self.log(-4.0, -1.0)
        self.values |= {
            'charge.dipole': moment, 'field.electric': self.vector(turn / math.hypot(*moment))}
        self._draw_field_profile()

    def _draw_field_profile(self) -> None:
        if 'magnetic' in self.kind.terms:
            return
        values, period = self.values, 2.0 * math.pi / self.rate
        if self.chance(0.5):
            values['field.profile'] = self.choice(
                f'sine {self._frequency()!r}', 'ramp', 'half_sine')
            values['field.duration'] = period * self.log(0.0, 1.0)
        if self.chance(0.3):
            values['field.start'] = period * self.uniform(0.0, 2.0)

    def _magnetic(self) -> None:
        charge = self._draw_charge()
        self.values['field.magnetic'] = self.vector(
            self.mass * self.rate * self.log(-3.0, 0.0) / charge)

    def _coulomb(self) -> None:
        self._draw_charge()
        self.values['charge.mutual'] = True

    def _tractions(self) -> None:
        pressure = self.k / self.a * self.log(-4.0, -1.0)
        self.values |= {
            'groups.skin': self.choice('z_max', 'all', 'x_min'),
            'tractions.wind.group': 'skin', 'tractions.wind.pressure': pressure,
            'tractions.wind.faces': self.choice(
                'exterior', 'all', 'numbers 1 5 7', 'toward 0 0 1'),
            'tractions.wind.direction': self.choice('follower', 'fixed')}
        if self.chance(0.4):
            self.values['tractions.wind.shear'] = self.vector(0.3 * pressure)[:2]
        if self.chance(0.3):
            self.values['tractions.wind.frictionless'] = True
        if self.chance(0.3):
            self.values['tractions.wind.variation'] = '1.0 0.5 -0.3'
        self._profile('tractions.wind')

    def _anchors(self) -> None:
        self.values |= {
            'anchors.tie.body': int(self.generator.integers(3)),
            'anchors.tie.edge': self.choice(*_EDGES),
            'anchors.tie.position': self.vector(2.0 * self.length)}
        if self.chance(0.3):
            self.values['anchors.tie.point'] = self.vector(self.a)
        if self.chance(0.5):
            self.values['anchors.tie.velocity'] = self.vector(
                self.a * self.rate * self.log(-4.0, -1.5))
        elif self.chance(0.6):
            times = 2.0 * math.pi / self.rate * np.cumsum(self.generator.uniform(0.3, 2.0, 5))
            path = self.a * self.log(-3.0, -0.5) * self.generator.standard_normal((3, 5))
            path[:, 0] = 0.0
            self.values['anchors.tie.file'] = self._file('tie.csv', times - times[0], *path)
        self._draw_anchor_law()

    def _draw_anchor_law(self) -> None:
        values, tie = self.values, 'anchors.tie'
        if self.chance(0.7):
            values[f'{tie}.stiffness'] = self.k * self.log(-1.0, 0.5)
            if self.chance(0.4):
                side = self.choice('extension', 'compression')
                values[f'{tie}.stiffness_{side}'] = self.k * self.choice(
                    0.0, self.log(-1.0, 0.5))
            if self.chance(0.6):
                values[f'{tie}.natural_length'] = self.length * self.uniform(0.3, 3.0)
        if self.chance(0.6):
            natural = values.get(f'{tie}.natural_length', self.natural)
            values[f'{tie}.break_length_extension'] = natural * (1.0 + self.log(-0.3, 1.3))
            if self.chance(0.4):
                values[f'{tie}.break_length_compression'] = natural * (
                    1.0 - self.log(-1.5, 0.0))

    def _drives(self) -> None:
        motion = self.choice('hold', 'velocity', 'ramp', 'sine', 'table')
        prefix, period = 'drives.table', 2.0 * math.pi / self.rate
        self.values |= {'groups.table': 'z_min', f'{prefix}.group': 'table',
                        f'{prefix}.motion': motion}
        part = self.log(-3.5, -1.2)
        if motion in ('velocity', 'ramp'):
            self.values[f'{prefix}.linear'] = self.vector(self.a * self.rate * part)
            if self.chance(0.5):
                self.values[f'{prefix}.angular'] = self.vector(self.rate * part * 0.3)
            if motion == 'ramp' or self.chance(0.5):
                self.values[f'{prefix}.duration'] = period * self.log(-0.5, 1.0)
        elif motion == 'sine':
            self.values |= {
                f'{prefix}.linear': self.vector(self.a * part),
                f'{prefix}.frequency': self.rate / (2.0 * math.pi) * self.log(-1.5, 0.3)}
            if self.chance(0.5):
                self.values[f'{prefix}.phase'] = self.uniform(0.0, 6.0)
        elif motion == 'table':
            times = period * np.concatenate((
                [0.0], np.cumsum(self.generator.uniform(0.3, 2.0, 5))))
            path = self.a * part * self.generator.standard_normal((3, 6))
            path[:, 0] = 0.0
            self.values[f'{prefix}.file'] = self._file('path.csv', times, *path)
        if motion != 'hold' and self.chance(0.4):
            self.values[f'{prefix}.start'] = period * self.uniform(0.0, 2.0)
        if not self._is_stiff and self.chance(0.6):
            self._restrict_drive()

    def _contact(self) -> None:
        self.values |= {
            'contact.mode': 'auto' if self.kind.method == 'auto' else 'always',
            'contact.stiffness': self.k * self.log(0.3, 1.5)}

    def _dissipation(self) -> None:
        if self.chance(0.7):
            self.values['contact.damping'] = self.log(-2.0, 0.3) / (self.a * self.rate)
        if 'contact.damping' not in self.values or self.chance(0.6):
            self.values['contact.friction'] = self.uniform(0.05, 1.0)

    def _plane(self) -> None:
        size = self.values['weave.size']
        down = 0.5 * size[2] * self.length + 3.0 * self.a
        self.values |= {
            'planes.floor.normal': [0.0, 0.0, 1.0],
            'planes.floor.offset': -down * self.uniform(0.9, 1.3)}

    def _bodies(self) -> None:
        reach = self.length * max(self.values['weave.size']) + 4.0 * self.a
        self.values |= {
            'bodies.ball.position': [0.0, 0.0, reach],
            'bodies.ball.linear_velocity': [0.0, 0.0, -self.a * self.rate * self.log(-2.5, -0.7)],
            'bodies.ball.angular_velocity': self.vector(self.rate * self.log(-3.0, -0.5))}
        turn = self.generator.standard_normal(4)
        self.values['bodies.ball.orientation'] = [
            float(x) for x in turn / np.linalg.norm(turn)]
        if self.chance(0.7):
            self.values['bodies.ball.edge_length'] = 2.0 * self.a * self.log(-0.5, 0.3)
        # Implicit steps support no individual masses.
        if not self._is_stiff and self.chance(0.6):
            self._draw_mass('bodies.ball', 2.0)

    def _draw_mass(self, prefix: str, power: float) -> None:
        """Draw a mass of up to 10 to the power of `power` shells, and sometimes an inertia."""
        mass = self.values[f'{prefix}.mass'] = self.mass * self.log(-1.0, power)
        if self.chance(0.4):
            self.values[f'{prefix}.inertia'] = mass * self.inertia / self.mass * self.log(
                -0.7, 0.0)

    def _draw_charges_of_groups(self) -> None:
        values = self.values
        if not {'charges', 'coulomb', 'magnetic', 'dipoles'} & {*self.kind.terms} or (
                self.chance(0.5)):
            return
        values |= {'groups.some': 'y_min', 'charges.some.group': 'some'}
        if 'charge.per_body' in values and self.chance(0.7):
            values['charges.some.charge'] = values['charge.per_body'] * self.uniform(-1.0, 1.0)
        if 'charge.dipole' in values:
            values['charges.some.dipole'] = [
                self.uniform(-1.0, 1.0) * part for part in values['charge.dipole']]

    def _draw_masses(self) -> None:
        values = self.values
        # Implicit steps support no individual masses.
        if self._is_stiff or not self.chance(0.3):
            return
        values |= {
            'groups.others': self.choice('x_max', 'z_max', 'ids 0'),
            'masses.others.group': 'others'}
        self._draw_mass('masses.others', 1.0)
        if 'tractions' not in self.kind.terms and 'wrapped' not in self.kind.terms and (
                self.chance(0.7)):
            values['masses.others.edge_length'] = 2.0 * self.a * self.log(-0.3, 0.1)

    def _draw_layers(self) -> None:
        values = self.values
        if not self.chance(0.2):
            return
        # Layers of about the same mean density, so that the scales of the fabric remain.
        faces = maximum_thickness(self.a)
        inner = faces - values['shell.thickness'] if 'shell.thickness' in values else (
            faces * values['shell.inner_edge_length'] / values['shell.edge_length'])
        count = 2 + int(self.generator.integers(4))
        # Some thick shells have a core.
        cored = inner < 0.5 * faces and self.chance(0.5)
        distances = np.linspace(0.0 if cored else inner, faces, count)
        values['shell.layers'] = self._file(
            'layers.csv', distances,
            values['shell.density'] * self.generator.uniform(0.2, 2.0, count))

    def _frequency(self) -> float:
        return self.rate / (2.0 * math.pi) * self.log(-1.5, 0.3)

    def _restrict_drive(self) -> None:
        """Restrict the drive to some degrees of freedom."""
        prefix = 'drives.table'
        words = self.choice(('tx', 'ty'), ('tz',), ('tx', 'ty', 'tz'), ('tx', 'rotation'))
        self.values[f'{prefix}.freedoms'] = ' '.join(words)
        if f'{prefix}.linear' in self.values:
            self.values[f'{prefix}.linear'] = [
                part if axis in words else 0.0
                for axis, part in zip(('tx', 'ty', 'tz'), self.values[f'{prefix}.linear'])]
        if 'rotation' not in words:
            self.values.pop(f'{prefix}.angular', None)

    def _disconnected(self) -> None:
        self.values['weave.connected'] = False

    def _draw_initial_state(self) -> None:
        """Draw random velocities, and a group with another initial state."""
        speed, spin = self.log(-4.0, -0.6), self.log(-4.0, -0.3)
        if self.chance(0.9):
            self.values |= {
                'initial_random.velocity_sigma': self.a * self.rate * speed,
                'initial_random.spin_sigma': min(self.rate * spin, 1e4),
                'initial_random.seed': int(self.generator.integers(2**31))}
        if self.chance(0.3):
            self.values |= {'groups.first': 'ids 0', 'initial.kick.group': 'first'}
            for name, unit in (
                    ('displacement', self.a), ('rotation', 1.0),
                    ('linear_velocity', self.a * self.rate), ('angular_velocity', self.rate)):
                if self.chance(0.5):
                    self.values[f'initial.kick.{name}'] = self.vector(unit * self.log(-4.0, -0.7))

    def _draw_solver(self) -> None:
        values = self.values
        values['solver.method'] = self.kind.method
        values['solver.threads'] = 1
        if not self.chance(0.15):
            # For each radian of the fastest motion from 1e-10 to 1e-3; round-off dominates below.
            # Steps of order 4 are for the larger tolerances.
            powers = (-6.5, -2.0) if self._is_stiff else (-9.5, -3.0)
            values['solver.tolerance'] = min(self.rate * self.log(*powers), 1e9)
        if self.kind.method in IMPLICIT and self.chance(0.25):
            values['solver.step'] = self.log(-1.3, 1.2) * 2.0 / (_FREQUENCY_RATIO * self.rate)
        elif self.kind.method not in IMPLICIT and self.chance(0.25):
            # Around the limit of leapfrog, 2 over the largest frequency.
            values['solver.step'] = self.log(-1.3, 0.2) * 2.0 / (_FREQUENCY_RATIO * self.rate)
        if self.chance(0.1):
            values['solver.energy_limit'] = self.log(-3.0, 0.0)
        if 'connector.obstruction' not in values and self.chance(0.1):
            values['connector.obstruction'] = 'stop'
        values['duration'] = 2.0 * math.pi / (_FREQUENCY_RATIO * self.rate) * self.log(0.5, 1.7)

    def _draw_change(self) -> dict[str, Any]:
        """Draw one to three parameter changes; some of them restart the motion."""
        values, terms = self.values, self.kind.terms
        size = values['weave.size']
        axis = int(self.generator.integers(3))
        least = 1 if values['weave.kind'] == 'orthogonal' else 3
        other = [
            max(n + self.choice(-1, 1), least) if k == axis else n for k, n in enumerate(size)]
        ways: list[Callable[[], dict[str, Any]]] = [
            lambda: {'weave.size': other},
            lambda: {'weave.variant': int(self.generator.integers(4))},
            lambda: {'shell.density': values['shell.density'] * self.log(-0.5, 0.5)},
            lambda: {'initial_random.seed': int(self.generator.integers(2**31))}]
        if 'weave.connector_angle' in values:
            ways.append(lambda: {
                'weave.connector_angle': values['weave.connector_angle'] + self.uniform(
                    0.0, 0.03)})
        # No other run can continue a state with friction springs.
        if 'dissipation' not in terms:
            ways += [
                partial(self._scaled, name, 0.5) for name in (
                    'connector.stiffness', 'connector.stiffness_extension',
                    'connector.stiffness_compression', 'connector.bending_stiffness',
                    'connector.twisting_stiffness', 'connector.damping', 'drag.linear',
                    'drag.angular', 'solver.tolerance', 'contact.stiffness',
                    'connector_groups.seam.stiffness', 'anchors.tie.stiffness',
                    'connector.maxwell_stiffness', 'connector.maxwell_time')
                if values.get(name)]
            ways += [
                partial(self._scaled, name, 0.02) for name in (
                    'connector.natural_length', 'anchors.tie.natural_length',
                    'connector.break_length_extension') if values.get(name)]
            if 'gravity' in values:
                ways.append(lambda: {'gravity': self.vector(math.hypot(*values['gravity']))})
            if 'loads.push.force' in values:
                ways.append(lambda: {
                    'loads.push.force': self.vector(math.hypot(*values['loads.push.force']))})
        change: dict[str, Any] = {}
        for _ in range(1 + int(self.generator.integers(3))):
            change |= ways[int(self.generator.integers(len(ways)))]()
        return change

    def _scaled(self, name: str, power: float) -> dict[str, Any]:
        """Return a value of a parameter scaled by a factor of up to 10 to the power of `power`."""
        return {name: self.values[name] * self.log(-power, power)}

    def _draw_impossible_change(self) -> tuple[str, dict[str, Any]]:
        """Draw an impossible change; return the name of its parameter, and the change."""
        ways: tuple[tuple[str, dict[str, Any]], ...] = (
            ('shell.thickness', {'shell.thickness': 1.6 * self.a, 'shell.inner_edge_length': 0.0}),
            ('weave.connector_angle', {
                'weave.connector_angle': -0.4, 'weave.connector_length': 0.0}),
            ('weave.size', {'weave.size': [3, 0, 2]}),
            ('weave.kind', {'weave.kind': 'knitted'}),
            ('connector.stiffness', {'connector.stiffness': -self.k}),
            ('gravity', {'gravity': [0.0, math.inf, 0.0]}),
            ('groups.strange', {'groups.strange': 'east of here'}))
        return self.choice(*ways)

    def _spoil_value(self) -> tuple[str, tuple[str, ...]]:
        """Make one value impossible; return the name of its parameter, and all that changed."""
        ways: tuple[tuple[str, Callable[[], Mapping[str, Any]]], ...] = (
            ('solver.step', lambda: {
                'solver.step': 50.0 / self.rate, 'weave.connected': True,
                'solver.method': 'leapfrog'}),
            ('shell.thickness', lambda: {
                'shell.thickness': 1.6 * self.a, 'shell.inner_edge_length': 0.0}),
            ('weave.connector_angle', lambda: {
                'weave.connector_angle': -0.4, 'weave.connector_length': 0.0}),
            ('weave.connector_length', lambda: {'weave.connector_length': 0.5 * self.a}),
            ('weave.size', lambda: {'weave.size': [3, 0, 2]}),
            ('connector.damping', lambda: {'connector.damping': -self.mass}),
            ('gravity', lambda: {'gravity': [0.0, math.nan, 0.0]}),
            ('solver.method', lambda: {
                'solver.method': 'leapfrog', 'drag.linear': self.mass * self.rate}),
            ('loads.lost.group', lambda: {'loads.lost.group': 'nowhere'}),
            ('connector.break_length_extension', lambda: {
                'connector.break_length_extension': 0.5 * self.natural,
                'weave.connected': True, 'solver.method': 'dop8'}),
            ('groups.strange', lambda: {'groups.strange': 'east of here'}))
        name, change = ways[int(self.generator.integers(len(ways)))]
        changed = change()
        self.values |= changed
        return name, tuple(changed)
