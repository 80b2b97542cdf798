# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Shear and Young's stiffness of a slab with point springs alone and with resisting moments.

The lowest and the highest level move as rigid plates, and all others are in equilibrium, by second
derivatives in the woven state. Least squares handle mechanisms.

    .venv/bin/python -m icofabric_validation.benchmarks.shear_stiffness
"""


import icofabric_sim as ico
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import hessian_product
import numpy as np

SIZE = (5, 5, 5)
# Stiffnesses against moments in units of k a^2.
CASES = ((0.0, 0.0), (0.01, 0.0), (0.1, 0.0), (1.0, 0.0), (0.0, 0.01), (0.0, 0.1), (0.0, 1.0),
         (0.1, 0.1))


def assembled(scene: ico.Scene) -> np.ndarray:
    """Return second derivatives of the connector energy in the woven state, (6 n, 6 n)."""
    packed, count = pack_scene(scene), scene.body_count
    state = packed.layout.pack(scene.initial)
    columns = [
        np.concatenate([part.ravel() for part in hessian_product(packed, state, *unit)])
        for unit in np.eye(6 * count).reshape(6 * count, 2, count, 3)]
    return np.array(columns).T


def moduli(scene: ico.Scene) -> tuple[float, float]:
    """Return shear modulus along x and Young's modulus along z [N/m^2], between rigid plates."""
    matrix, count = assembled(scene), scene.body_count
    level = scene.weave.grid[:, 2]
    plate = (level == level.min()) | (level == level.max())
    held = np.concatenate([np.repeat(plate, 3), np.repeat(plate, 3)])
    height = scene.geometry.pitch * float(np.ptp(level))
    area = float(np.prod(scene.geometry.pitch * np.array(scene.weave.size[:2])))
    found = []
    for axis in (0, 2):
        shift = np.zeros((2, count, 3))
        shift[0, :, axis] = scene.position[:, 2] * plate
        motion = shift.ravel()
        load = matrix[np.ix_(~held, held)] @ motion[held]
        motion[~held] = -np.linalg.lstsq(matrix[np.ix_(~held, ~held)], load, rcond=1e-9)[0]
        found.append(float(motion @ matrix @ motion) / (area * height))
    return found[0], found[1]


def main() -> None:
    """Print a table in units of k / W."""
    print('| kappa_b / (k a^2) | kappa_t / (k a^2) | shear G W / k | Young E W / k |')
    print('|---|---|---|---|')
    for bending, twisting in CASES:
        plain = ico.Scene.from_parameters({'weave.size': list(SIZE)})
        a, k = plain.geometry.half_edge, plain.parameters['connector.stiffness']
        scene = ico.Scene.from_parameters(plain.parameters.with_changes({
            'connector.bending_stiffness': bending * k * a * a,
            'connector.twisting_stiffness': twisting * k * a * a}))
        shear, young = (value * scene.geometry.pitch / k for value in moduli(scene))
        print(f'| {bending:g} | {twisting:g} | {shear:.4g} | {young:.4g} |')


if __name__ == '__main__':
    main()
