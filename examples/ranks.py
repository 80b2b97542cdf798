# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
One fabric on several processes of MPI: what falls at 0.1 s does so at the same bits, however many.

    .venv/bin/mpiexec -n 2 .venv/bin/python examples/ranks.py
    .venv/bin/python examples/ranks.py

Needs the extra `mpi`. The first process has the simulation, the others take their part of its
steps.
"""

import hashlib

import icofabric_sim as ico

SCENE = {
    'weave.size': [15, 15, 15], 'contact.mode': 'never', 'gravity': [0.0, 0.0, -9.81],
    'groups.top': 'z_max', 'supports.top': {'group': 'top', 'fix': 'all'},
    'solver': {'method': 'srkn6', 'tolerance': 1e-3}}


def main() -> None:
    """Let a slab sag, and print a digest of where its bodies are then."""
    with ico.Ranks() as ranks:
        if ranks.leads:
            scene = ico.Scene.from_parameters(SCENE)
            simulation = ico.compile_scene(scene, ranks=ranks)
            simulation.advance_to(0.1)
            places = simulation.snapshot().position
            digest = hashlib.sha256(places.tobytes()).hexdigest()
            print(f'{ranks.size} ranks, {scene.body_count:,} bodies: {digest[:16]}')


if __name__ == '__main__':
    main()
