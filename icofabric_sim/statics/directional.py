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
"""What the endless fabric answers along one direction: its moduli, and its ratios across."""

from typing import NamedTuple

import numpy as np

# Voigt's order; shears are angles.
LABELS = ('xx', 'yy', 'zz', 'yz', 'xz', 'xy')
# A unit stress that does more work than this on a unit strain without energy meets that strain.
_MET = 1e-6
# Ratios and moduli that differ by less than this part of themselves are the same all round.
_ALIKE = 1e-9


class Directional(NamedTuple):
    """Moduli and ratios for one direction of the endless fabric, world axes."""

    direction: np.ndarray  # (3,) of length 1
    young_modulus: float  # [Pa] of a pull along it; 0 where a strain without energy yields
    # Least and largest Poisson's ratio of that pull, and where across they are; NaN with 0 Pa.
    poisson_ratio: tuple[float, float]
    poisson_across: np.ndarray  # (2, 3) of length 1
    # Least and largest shear modulus [Pa] of the planes across it, and which way they slide.
    shear_modulus: tuple[float, float]
    shear_along: np.ndarray  # (2, 3) of length 1
    undefined: str  # why there is no Poisson's ratio; '' where there is one


def voigt(tensor: np.ndarray) -> np.ndarray:
    """Stresses (..., 3, 3) in Voigt's order, (..., 6)."""
    return np.stack([
        tensor[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))], axis=-1)


def pull_of(n: np.ndarray) -> np.ndarray:
    """The stress (..., 6) of a unit pull along n (..., 3)."""
    return voigt(n[..., :, None] * n[..., None, :])


def shear_of(n: np.ndarray, m: np.ndarray) -> np.ndarray:
    """The stress (..., 6) of a unit shear of the planes across n along m, both (..., 3)."""
    product = n[..., :, None] * m[..., None, :]
    return voigt(product + np.swapaxes(product, -1, -2))


def meets_soft(stress: np.ndarray, soft: np.ndarray) -> np.ndarray:
    """Whether stresses (..., 6) do work on strains (z, 6) that cost no energy, (...)."""
    return np.abs(stress @ soft.T).max(axis=-1, initial=0.0) > _MET


def why_it_yields(stress: np.ndarray, soft: np.ndarray) -> str:
    """The strain without energy that a stress (6,) meets, in words; '' where it meets none."""
    if not meets_soft(stress, soft):
        return ''
    strain = soft.T @ (soft @ stress)
    strain = strain / strain[np.argmax(np.round(np.abs(strain), 9))]
    parts = [
        label if value == 1.0 else f'{value:.3g} {label}'
        for label, value in zip(LABELS, np.round(strain, 9).tolist()) if abs(value) > _MET]
    return f'it meets the strain {" + ".join(parts)}, which costs no energy'


def directional(compliance: np.ndarray, soft: np.ndarray, n: np.ndarray) -> Directional:
    """
    Judge one direction n (3,) of length 1.

    `compliance`: (6, 6) [1/Pa], the inverse of the stiffness where strains cost energy.
    `soft`: an orthonormal basis (z, 6) of the strains that cost none.
    """
    across = _plane(n)
    pull = pull_of(n)
    undefined = why_it_yields(pull, soft)
    modulus, ratios, sides = 0.0, np.full(2, np.nan), across
    if not undefined:
        strain = compliance @ pull
        along = float(strain @ pull)
        modulus = 1.0 / along
        tensor = _tensor(strain)
        ratios, sides = _extremes(-across @ tensor @ across.T / along, across)
    slid, ways = _shears(compliance, soft, n, across)
    return Directional(
        n, modulus, (float(ratios[0]), float(ratios[1])), _signed(sides), slid, _signed(ways),
        undefined)


def _shears(
    compliance: np.ndarray, soft: np.ndarray, n: np.ndarray, across: np.ndarray
) -> tuple[tuple[float, float], np.ndarray]:
    """Least and largest shear modulus [Pa] of the planes across n, and their ways (2, 3)."""
    stress = np.stack([shear_of(n, m) for m in across])
    met = stress @ soft.T
    # The ways that meet no strain without energy: all, one, or none.
    values, vectors = np.linalg.eigh(met @ met.T)
    bears = values <= _MET**2
    if not bears.any():
        return (0.0, 0.0), across
    ways = vectors.T
    if not bears.all():
        [held] = ways[bears]
        [loose] = ways[~bears]
        return (0.0, 1.0 / float(held @ stress @ compliance @ stress.T @ held)), np.stack(
            [loose @ across, held @ across])
    # The plane that yields most has the least modulus.
    (stiffest, softest), found = _extremes(stress @ compliance @ stress.T, across)
    return (1.0 / float(softest), 1.0 / float(stiffest)), found[::-1]


def _extremes(form: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values (2,) of a form (2, 2) on unit vectors, and where (2, 3)."""
    values, vectors = np.linalg.eigh(form)
    if values[1] - values[0] <= _ALIKE * np.abs(values).max():
        # Alike all round: rounding would choose.
        return values, across
    return values, vectors.T @ across


def _plane(n: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3) across n (3,) and each other."""
    first = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(n, first)])


def _tensor(strain: np.ndarray) -> np.ndarray:
    """The symmetric strain (3, 3) of one in Voigt's order with angles (6,)."""
    xx, yy, zz, yz, xz, xy = strain
    return np.array([
        [xx, 0.5 * xy, 0.5 * xz], [0.5 * xy, yy, 0.5 * yz], [0.5 * xz, 0.5 * yz, zz]])


def _signed(vectors: np.ndarray) -> np.ndarray:
    """The same lines (k, 3), each with its largest component positive, without rounding's -0."""
    rows = np.arange(len(vectors))
    largest = vectors[rows, np.argmax(np.round(np.abs(vectors), 9), axis=1)]
    return np.where(np.abs(vectors) < 1e-12, 0.0, vectors * np.sign(largest)[:, None])
