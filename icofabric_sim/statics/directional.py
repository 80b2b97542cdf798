# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Moduli and Poisson's ratios of the periodic fabric for one direction."""

from typing import NamedTuple

import numpy as np

# Voigt's order; shears are angles.
LABELS = ('xx', 'yy', 'zz', 'yz', 'xz', 'xy')
# Largest work of a unit stress on a unit zero-energy strain that counts as zero.
_ZERO_WORK = 1e-6
# Relative difference below which ratios and moduli count as equal in all directions.
_EQUAL_RATIO = 1e-9


class Directional(NamedTuple):
    """Moduli and Poisson's ratios for one direction of the periodic fabric, world axes."""

    direction: np.ndarray  # (3,) unit vector
    young_modulus: float  # [Pa]; 0 if the load does work on a zero-energy strain
    # Smallest and largest Poisson's ratio, and their lateral directions; NaN if the modulus is 0.
    poisson_ratio: tuple[float, float]
    poisson_across: np.ndarray  # (2, 3) unit vectors
    # Smallest and largest shear modulus [Pa] of planes normal to the direction, and the directions
    # in which these slide.
    shear_modulus: tuple[float, float]
    shear_along: np.ndarray  # (2, 3) unit vectors
    undefined: str  # reason why Poisson's ratio is undefined, or ''


def voigt(tensor: np.ndarray) -> np.ndarray:
    """Return stresses (..., 3, 3) in Voigt's order, (..., 6)."""
    return np.stack([
        tensor[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))], axis=-1)


def unit_tension(n: np.ndarray) -> np.ndarray:
    """Return the stress (..., 6) of a unit tension along n (..., 3)."""
    return voigt(n[..., :, None] * n[..., None, :])


def unit_shear(n: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Return the stress (..., 6) of a unit shear of planes normal to n along m, both (..., 3)."""
    product = n[..., :, None] * m[..., None, :]
    return voigt(product + np.swapaxes(product, -1, -2))


def excites_zero_energy(stress: np.ndarray, soft: np.ndarray) -> np.ndarray:
    """Return the mask (...) of stresses (..., 6) that do work on zero-energy strains (z, 6)."""
    return np.abs(stress @ soft.T).max(axis=-1, initial=0.0) > _ZERO_WORK


def undefined_reason(stress: np.ndarray, soft: np.ndarray) -> str:
    """Describe the zero-energy strain on which a stress (6,) does work, or return ''."""
    if not excites_zero_energy(stress, soft):
        return ''
    strain = soft.T @ (soft @ stress)
    strain = strain / strain[np.argmax(np.round(np.abs(strain), 9))]
    parts = [
        label if value == 1.0 else f'{value:.3g} {label}'
        for label, value in zip(LABELS, np.round(strain, 9).tolist()) if abs(value) > _ZERO_WORK]
    return f'the load does work on the strain {" + ".join(parts)}, which costs no energy'


def directional(compliance: np.ndarray, soft: np.ndarray, n: np.ndarray) -> Directional:
    """
    Return moduli and ratios for one unit vector n (3,).

    `compliance` (6, 6) [1/Pa] is the pseudoinverse of the stiffness, and `soft` (z, 6) an
    orthonormal basis of the zero-energy strains.
    """
    across = _plane(n)
    pull = unit_tension(n)
    undefined = undefined_reason(pull, soft)
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
    """Return the extreme shear moduli [Pa] of planes normal to n, and their directions (2, 3)."""
    stress = np.stack([unit_shear(n, m) for m in across])
    met = stress @ soft.T
    # Directions in which the shear does no work on zero-energy strains: all, one, or none.
    values, vectors = np.linalg.eigh(met @ met.T)
    bears = values <= _ZERO_WORK**2
    if not bears.any():
        return (0.0, 0.0), across
    ways = vectors.T
    if not bears.all():
        [held] = ways[bears]
        [loose] = ways[~bears]
        return (0.0, 1.0 / float(held @ stress @ compliance @ stress.T @ held)), np.stack(
            [loose @ across, held @ across])
    # The most compliant direction has the smallest modulus.
    (stiffest, softest), found = _extremes(stress @ compliance @ stress.T, across)
    return (1.0 / float(softest), 1.0 / float(stiffest)), found[::-1]


def _extremes(form: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the extreme values (2,) of a form (2, 2) on unit vectors, and the vectors (2, 3)."""
    values, vectors = np.linalg.eigh(form)
    if values[1] - values[0] <= _EQUAL_RATIO * np.abs(values).max():
        # Isotropic: round-off would choose the vectors.
        return values, across
    return values, vectors.T @ across


def _plane(n: np.ndarray) -> np.ndarray:
    """Return two unit vectors (2, 3) perpendicular to n (3,) and to each other."""
    first = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(n, first)])


def _tensor(strain: np.ndarray) -> np.ndarray:
    """Return the strain tensor (3, 3) of a strain (6,) in Voigt's order with shear angles."""
    xx, yy, zz, yz, xz, xy = strain
    return np.array([
        [xx, 0.5 * xy, 0.5 * xz], [0.5 * xy, yy, 0.5 * yz], [0.5 * xz, 0.5 * yz, zz]])


def _signed(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (k, 3) with the largest component made positive, and tiny ones made 0."""
    rows = np.arange(len(vectors))
    largest = vectors[rows, np.argmax(np.round(np.abs(vectors), 9), axis=1)]
    return np.where(np.abs(vectors) < 1e-12, 0.0, vectors * np.sign(largest)[:, None])
