# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Output files of `icofabric statics`, `modes` and `elasticity`: tables and pictures."""

import argparse
from collections.abc import Iterable
import math
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

import icofabric_sim as ico
from icofabric_sim.commands.picture_arguments import picture_path
from icofabric_sim.commands.report import write_csv
from icofabric_sim.terminal import InputError, require_place

if TYPE_CHECKING:
    from icofabric_sim.pictures.moment import Push
    from icofabric_sim.simulation.reports.load_cells import ContactForces, Reactions
    import numpy as np

_BODIES = (
    'body', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'reaction_x_n', 'reaction_y_n',
    'reaction_z_n', 'reaction_torque_x_nm', 'reaction_torque_y_nm', 'reaction_torque_z_nm')
_CONTACT = tuple(
    f'contact_{name}_{axis}_{unit}' for name, unit in (('force', 'n'), ('torque', 'nm'))
    for axis in 'xyz')
_UNBALANCED = tuple(name.replace('contact_', 'unbalanced_') for name in _CONTACT)
_CONNECTORS = ('connector', 'first', 'second', 'length_m', 'tension_n')


def kink_text(connectors: int, anchors: tuple[str, ...] = ()) -> str:
    """Describe connectors and anchors at their kink, for the terminal."""
    parts = [f'{connectors:,} connectors'] if connectors else []
    parts += [f'anchors.{name}' for name in anchors]
    return f'{", ".join(parts)}: at the natural length, where k_e and k_c differ'


def touch_text(count: int) -> str:
    """Describe contacts at zero force, for the terminal."""
    return (
        f'{count:,} contacts at first touch (zero force): treated as open, but they resist '
        'compression')


class EquilibriumOutputs(NamedTuple):
    """Destinations of tables and pictures, if any."""

    folder: Path | None
    picture: Path | None

    def write(
        self, name: str, scene: 'ico.Scene', snapshot: 'ico.Snapshot', tension: 'np.ndarray',
        reaction: 'np.ndarray', reactions: 'Reactions | None' = None,
        contacts: 'ContactForces | None' = None, unbalanced_wrench: 'np.ndarray | None' = None
    ) -> None:
        """
        Write tables of bodies, connectors, reactions and contacts, and draw start and end.

        If shells can touch, `bodies.csv` also has the contact resultants of each body and, if
        given, the residual `unbalanced_wrench` (n, 6).
        """
        if self.folder is not None:
            head: tuple[str, ...] = _BODIES
            columns = [snapshot.position, snapshot.orientation, reaction]
            if contacts is not None:
                head += _CONTACT
                columns.append(contacts.resultants(scene.body_count))
                touching = contacts.table()
                self.table('contacts.csv', tuple(touching), zip(*touching.values()))
            if unbalanced_wrench is not None:
                head += _UNBALANCED
                columns.append(unbalanced_wrench)
            self.table('bodies.csv', head, (
                [number, *(value for part in row for value in part)]
                for number, row in enumerate(zip(*(part.tolist() for part in columns)))))
            ends = scene.connectors.bodies.tolist() if scene.connector_count else []
            self.table('connectors.csv', _CONNECTORS, (
                [number, *pair, length, pull] for number, (pair, length, pull) in enumerate(
                    zip(ends, snapshot.connector_length.tolist(), tension.tolist()))))
            if reactions is not None and reactions.names:
                borne = reactions.table()
                self.table('reactions.csv', tuple(borne), zip(*borne.values()))
        if self.picture is not None:
            # Imported here, so that help texts do not need it.
            import numpy as np

            self.draw(name, scene, [
                (scene.initial.position, scene.initial.orientation, 'start'),
                (snapshot.position, snapshot.orientation, 'equilibrium')],
                _arrows(reactions, float(np.abs(tension).max(initial=0.0))), contacts)

    def table(
        self, file: str, head: tuple[str, ...], rows: Iterable[Iterable[object]]
    ) -> None:
        """Write a CSV file of that name."""
        assert self.folder is not None
        print(f'written to {write_csv(self.folder / file, head, rows)}')

    def draw(
        self, name: str, scene: 'ico.Scene', states: list[tuple['np.ndarray', 'np.ndarray', str]],
        pushes: tuple['Push', ...] = (), contacts: 'ContactForces | None' = None
    ) -> None:
        """Draw configurations side by side, with force arrows in the last one."""
        from icofabric_sim.pictures.drawing import frame_moments, Renderer
        from icofabric_sim.pictures.measures import fit_scale
        from icofabric_sim.pictures.moment import Moment

        assert self.picture is not None
        moments = [Moment(math.nan, *state[:2], scene, state[2]) for state in states]
        moments[-1] = moments[-1]._replace(
            pushes=pushes, contact_forces=None if contacts is None else contacts.arrows())
        self.picture.parent.mkdir(parents=True, exist_ok=True)
        Renderer(
            frame_moments(moments), title=name, color='strain',
            scale=fit_scale('strain', moments)).sheet(moments, self.picture)
        print(f'drawn to {self.picture}')


def _arrows(reactions: 'Reactions | None', tension: float) -> tuple['Push', ...]:
    """Return arrows of reactions that exceed round-off relative to the largest `tension` [N]."""
    from icofabric_sim.pictures.moment import Push

    if reactions is None or not len(reactions.names):
        return ()
    sizes = (reactions.force**2).sum(axis=1)**0.5
    return tuple(
        Push(name, reactions.point[number], reactions.force[number])
        for number, name in enumerate(reactions.names)
        if sizes[number] > 1e-6 * max(tension, sizes.max()))


def add_output_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --output and --picture."""
    parser.add_argument('--output', metavar='DIR', help='folder for tables (CSV)')
    parser.add_argument('--picture', metavar='FILE', help='draw the results to this PNG')


def outputs_of(arguments: argparse.Namespace) -> EquilibriumOutputs:
    """Return the requested outputs."""
    folder = None if arguments.output is None else Path(arguments.output).expanduser()
    picture = picture_path(arguments, 'picture')
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f'--output {folder} is a file; give a folder')
    if folder is not None:
        require_place('--output', folder, is_folder=True)
    return EquilibriumOutputs(folder, picture)
