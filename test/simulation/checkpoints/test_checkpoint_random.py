# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Random runs with many terms at once: in one go, in pieces and restored they show the same bits.

Everything public of a simulation and of its snapshot counts, not the motion alone. Two kinds of
scenes, so that kernels are compiled twice: what does work and stores energy, for the splitting
methods, and what breaks and dissipates, for dop8. What touches is in physics/test_contact_*.py.
"""

from pathlib import Path
import pickle
import subprocess
import sys

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.stepping.methods import METHODS
import numpy as np
import pytest
from shown_bits import figures, unlike

END = 0.012
SPLITTINGS = [name for name, method in METHODS.items() if method.symplectic]


def table(path: Path, generator: np.random.Generator, sizes: tuple[float, ...]) -> str:
    """A random path of some 1 to 3 ms a piece."""
    times = np.append(0.0, generator.uniform(1e-3, 3e-3, 7).cumsum())
    values = np.array(sizes) * np.append(
        np.zeros((1, len(sizes))), generator.standard_normal((7, len(sizes))), axis=0)
    np.savetxt(path, np.column_stack([times, values]), delimiter=',', fmt='%.9g')
    return str(path)


def random_scene(folder: Path, method: str, seed: int) -> ico.Scene:
    """A slab with every term that the method takes, their values at random."""
    g = np.random.default_rng(seed)

    def some(size: float) -> list[float]:
        return (size * g.standard_normal(3)).tolist()

    length = make_scene((2, 2, 2)).geometry.connector_length
    changes = {
        'solver.method': method, 'solver.tolerance': 1e-2 if method == 'leapfrog' else 1e-4,
        'solver.energy_limit': 1e3, 'connector.stiffness': float(g.uniform(300.0, 600.0)),
        'groups.driven': 'ids 0', 'groups.held': 'ids 3', 'groups.free': 'ids 1 2',
        'supports.s.group': 'held', 'supports.s.fix': 'tx rotation',
        'drives.d.group': 'driven', 'drives.d.motion': 'table',
        'drives.d.file': table(folder / f'drive{seed}.csv', g, (4e-4,) * 3 + (2e-2,) * 3),
        'anchors.a.body': 2, 'anchors.a.edge': 'up', 'anchors.a.position': [0.02, 0.02, 0.09],
        'anchors.a.file': table(folder / f'anchor{seed}.csv', g, (1e-3,) * 3),
        'loads.m.group': 'free', 'loads.m.hold': 2e-3,
        'initial_random.velocity_sigma': 0.2, 'initial_random.spin_sigma': 30.0,
        'initial_random.seed': seed,
    }
    if method == 'dop8':
        # The same kind as in test_drives.py.
        changes.update({
            'connector.damping': 1e-2 * float(g.uniform(0.5, 2.0)),
            'connector.break_length_extension': length * float(g.uniform(1.05, 1.1))})
    else:
        changes.update({
            'connector.attachment.up': [0.0, 1e-4 * float(g.uniform()), 0.0162],
            'gravity': some(5.0), 'charge.per_body': 1e-7, 'charge.dipole': some(1e-9),
            'field.electric': some(1e5), 'loads.l.group': 'free', 'loads.l.frame': 'body',
            'loads.l.point': some(0.005), 'loads.l.force': some(0.3),
            'loads.l.profile': 'half_sine', 'loads.l.start': 1e-3,
            'loads.l.duration': float(g.uniform(3e-3, 8e-3))})
    return make_scene((2, 2, 2), changes)


def prepared(scene: ico.Scene, seed: int) -> ico.Simulation:
    """A run at its start that inputs wait for."""
    g = np.random.default_rng(seed + 100)
    simulation = ico.compile_scene(scene)
    for time in g.uniform(0.0, END, 3):
        simulation.apply_wrench('m', 0.3 * g.standard_normal(3), time=float(time))
    simulation.apply_body_wrench(2, 0.1 * g.standard_normal(3), time=float(g.uniform(0.0, END)))
    if seed % 2:
        simulation.apply_twist(
            'd', 0.05 * g.standard_normal(3), g.standard_normal(3),
            time=float(g.uniform(0.5 * END, END)))
    return simulation


def moments(scene: ico.Scene, seed: int) -> list[float]:
    """When checkpoints are taken: also where a piece of a path begins."""
    starts = [piece.start for piece in scene.drives['d'].path.pieces if 0.0 < piece.start < END]
    return sorted([starts[1], *np.random.default_rng(seed + 200).uniform(0.0, END, 3).tolist()])


def other_runs(scene: ico.Scene, seed: int) -> tuple[ico.Simulation, list[Checkpoint]]:
    """The run in pieces, with snapshots between them, and checkpoints of it."""
    simulation, checkpoints = prepared(scene, seed), []
    for time in moments(scene, seed):
        simulation.advance_to(time)
        checkpoints.append(Checkpoint.from_bytes(simulation.checkpoint().to_bytes()))
        figures(simulation)
    return simulation, checkpoints


CASES = [(method, seed) for seed in range(2) for method in SPLITTINGS] + [
    ('dop8', seed) for seed in range(4)]


@pytest.mark.parametrize('method, seed', CASES)
def test_all_figures_are_the_same_in_one_go_in_pieces_and_restored(
    method: str, seed: int, tmp_path: Path
) -> None:
    scene = random_scene(tmp_path, method, seed)
    whole = prepared(scene, seed)
    whole.advance_to(END)
    expected = figures(whole)
    pieces, checkpoints = other_runs(scene, seed)
    pieces.advance_to(END)
    assert unlike(expected, figures(pieces)) == []
    again = ico.compile_scene(scene)
    for checkpoint in checkpoints:
        again.restore(checkpoint)
        assert again.checkpoint().difference(checkpoint) == ''
        again.advance_to(END)
        assert unlike(expected, figures(again)) == [], checkpoint.time
    # There was work to be added up, and shells were looked at.
    energy = whole.snapshot().energy
    assert abs(energy['work_in']) > 1e-5
    assert whole.status.step_count > 10 and whole.status.active_loads
    if method == 'dop8':
        assert energy['dissipated'] > 0.0
        assert 0 < whole.status.broken_count < scene.connector_count
    else:
        assert energy['field'] != 0.0


FRESH = f"""
import pickle, sys
import icofabric_sim as ico
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from shown_bits import figures

shown = []
for name in sys.argv[2:]:
    checkpoint = Checkpoint.load(name)
    simulation = ico.compile_scene(ico.Scene.from_parameters(checkpoint.parameters()))
    simulation.restore(checkpoint)
    simulation.advance_to({END})
    shown.append(figures(simulation))
with open(sys.argv[1], 'wb') as file:
    pickle.dump(shown, file)
"""


def test_all_figures_are_the_same_in_another_process(tmp_path: Path) -> None:
    expected, names = [], []
    for method in ('srkn6', 'dop8'):
        scene = random_scene(tmp_path, method, 7)
        whole = prepared(scene, 7)
        for number, time in enumerate(moments(scene, 7)):
            whole.advance_to(time)
            names.append(str(tmp_path / f'{method}{number}'))
            whole.checkpoint().save(names[-1])
        whole.advance_to(END)
        expected += [figures(whole)] * len(moments(scene, 7))
    subprocess.run(
        [sys.executable, '-c', FRESH, str(tmp_path / 'shown'), *names], check=True, timeout=600,
        env={'PYTHONPATH': ':'.join(sys.path), 'PATH': '/usr/bin'})
    with (tmp_path / 'shown').open('rb') as file:
        shown = pickle.load(file)
    assert [unlike(one, other) for one, other in zip(expected, shown, strict=True)] == (
        [[]] * len(expected))
