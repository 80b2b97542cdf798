# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Elastic constants of the periodic fabric as text and tables, for `icofabric elasticity`."""

from collections.abc import Sequence
from typing import Any

from icofabric_sim.commands import elastic_directions
from icofabric_sim.commands.equilibrium_outputs import EquilibriumOutputs, kink_text
from icofabric_sim.scene.attachments import has_own_attachments
from icofabric_sim.scene.connector_groups import differ_by_direction_only
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.weave_geometry import geometry_from_length, MINIMUM_LENGTH_RATIO
from icofabric_sim.statics.directional import Directional
from icofabric_sim.statics.lattice import LatticeRest
from icofabric_sim.statics.periodic import Elasticity
import numpy as np

# Moduli by direction, for each branch.
ByDirection = dict[str, list[tuple[str, Directional]]]

_DIRECTIONS = {'x': (1, 0, 0), 'y': (0, 1, 0), 'z': (0, 0, 1), 'xy': (1, 1, 0), 'xyz': (1, 1, 1)}
# Two perpendicular directions normal to each direction.
_ACROSS = {'x': ('y', 'z'), 'y': ('z', 'x'), 'z': ('x', 'y'), 'xy': ('z', 'x-y'),
           'xyz': ('x-y', 'x+y-2z')}
_SIDES = {'x': (1, 0, 0), 'y': (0, 1, 0), 'z': (0, 0, 1), 'x-y': (1, -1, 0),
          'x+y-2z': (1, 1, -2)}
_VOIGT = ('xx', 'yy', 'zz', 'yz', 'xz', 'xy')


def missing_reason(scene: Scene) -> str:
    """
    Return why the periodic fabric of a scene is undefined, otherwise ''; curves are possible.
    """
    if scene.parameters['weave.kind'] == 'radial':
        return 'a radial weave does not repeat in space'
    if not differ_by_direction_only(scene.parameters):
        return 'connector_groups.* make connectors differ from place to place'
    if scene.electric.is_mutual:
        return 'charge.mutual is an infinite sum over all charges'
    return ''


def _branches(constants: Elasticity) -> dict[str, Elasticity]:
    """Return the constants by branch, with key '' if no connector is at its kink."""
    return dict(constants.branches) or {'': constants}


def by_direction(
    constants: Elasticity, more: Sequence[Sequence[float]]
) -> ByDirection:
    """Return the moduli of named directions, and of those in `more`, for each branch."""
    return {
        branch: elastic_directions.by_direction(one, more)
        for branch, one in _branches(constants).items()}


def numbers(constants: Elasticity, found: ByDirection) -> dict[str, Any]:
    """Return the constants, and those of each branch, for JSON."""
    return {
        **_branch_numbers(constants, found[constants.branch]), 'branch': constants.branch,
        'branches': {key: _branch_numbers(one, found[key])
                     for key, one in constants.branches.items()}}


def _branch_numbers(
    constants: Elasticity, by_direction: list[tuple[str, Directional]]
) -> dict[str, Any]:
    return {
        'order': _VOIGT, 'stiffness_pa': constants.stiffness, 'stress_pa': constants.stress,
        'density_kg_m3': constants.density,
        'zero_energy_strain_count': len(constants.zero_energy_strains),
        'young_modulus_pa': {
            label: constants.young_modulus(np.array(direction, float))
            for label, direction in _DIRECTIONS.items()},
        'bulk_modulus_pa': constants.bulk_modulus,
        'poisson_ratio': {label: dict(ratios) for label, _, ratios in _moduli(constants)},
        'directions': elastic_directions.numbers(by_direction),
        **_rest_numbers(constants.relaxed_state)}


def _rest_numbers(rest: LatticeRest | None) -> dict[str, Any]:
    """Return the state that the constants refer to, unless it is the woven state."""
    return {} if rest is None else {'rest': {
        'deformation_gradient': rest.gradient, 'turn': rest.turn, 'verdict': rest.verdict,
        'contact_pairs': len(rest.contact_vectors), 'overlap_m': rest.overlap,
        'first_touches': rest.first_touches}}


def _moduli(
    constants: Elasticity
) -> list[tuple[str, float, list[tuple[str, float | None]]]]:
    """
    Return directions, Young's moduli [Pa], and Poisson's ratios in two transverse directions.

    A ratio is None if a zero-energy strain makes it undefined.
    """
    found = []
    for label, direction in _DIRECTIONS.items():
        along = np.array(direction, float)
        modulus = float(constants.young_modulus(along))
        ratios = [(side, float(constants.poisson_ratio(along, np.array(_SIDES[side], float))))
                  for side in _ACROSS[label]]
        found.append((label, modulus, [
            (side, None if np.isnan(ratio) else ratio) for side, ratio in ratios]))
    return found


def _one_sided_ratios(
    constants: Elasticity, label: str, sign: float
) -> list[tuple[str, float]]:
    """
    Return Poisson's ratios for a small pull (1) or push (-1) along an axis; [] if undefined.
    """
    found = constants.uniaxial_response(np.array(_DIRECTIONS[label], float), sign)
    if not found.modulus > 0.0:
        return []
    strain = dict(zip('xyz', found.strain[:3].tolist()))
    return [(side, -strain[side] / strain[label]) for side in _ACROSS[label]]


def text(constants: Elasticity, by_direction: ByDirection, scene: Scene) -> list[str]:
    """Return lines for the terminal; `by_direction` holds the directions by branch."""
    return [
        *_constants_text(constants, by_direction),
        *(_rest_text(scene) if constants.relaxed_state is None else
          _lattice_text(constants.relaxed_state, scene))]


def _constants_text(constants: Elasticity, by_direction: ByDirection) -> list[str]:
    if not constants.branches:
        return [*_branch_text(constants, by_direction['']), *_limits_text(constants)]
    lines = [
        f'  {kink_text(constants.at_kink)} (of a cell)',
        '  Such a fabric has no single tangent modulus: it depends on the kind and sign of the',
        '  strain. The modulus is independent of the amplitude, but strains and waves do not '
        'superpose.']
    lines += _one_sided_text(constants)
    for branch, said in _BRANCHES.items():
        lines.append(f'  bounds, {branch}: {said}')
        lines += [f'  {line}' for line in _branch_text(
            constants.branches[branch], by_direction[branch])]
    return lines


def _lattice_text(rest: LatticeRest, scene: Scene) -> list[str]:
    """Describe the equilibrium of the periodic fabric."""
    stretches = np.linalg.svd(rest.gradient)[1]
    turn = 2.0 * np.arctan2(np.linalg.norm(rest.turn[:3]), abs(rest.turn[3]))
    lines = [
        f'  about its equilibrium, {rest.verdict}: lengths {stretches.min():.6g} to '
        f'{stretches.max():.6g} times '
        f'the woven ones, bodies rotated by {turn if turn > 1e-9 else 0.0:.3g} rad']
    if len(rest.contact_vectors):
        lines.append(
            f'  each body is in contact with {2 * len(rest.contact_vectors)} others, overlap '
            f'up to {rest.overlap:.3g} m '
            f'({100.0 * rest.overlap / scene.geometry.half_edge:.2g} % of a)')
    if rest.first_touches:
        lines.append(
            f'  {rest.first_touches} pairs of a body touch at zero force: they resist in one '
            'direction only and are left out')
    return lines


def _rest_text(scene: Scene) -> list[str]:
    """Describe the free equilibrium of pre-tensioned point springs."""
    given, woven = scene.parameters, scene.geometry
    natural = given['connector.natural_length']
    unlike = has_own_attachments(given) or given['connector.law'] or given.names(
        'connector_groups')
    plain = not unlike and all(
        given[f'connector.{name}'] == value for name, value in (
            ('bending_stiffness', 0.0), ('twisting_stiffness', 0.0), ('attachment_scale', 1.0)))
    if not (plain and natural > 0.0) or abs(natural / woven.connector_length - 1.0) < 1e-9:
        return []
    shortest = MINIMUM_LENGTH_RATIO * woven.cube_width
    if natural < shortest:
        return [
            f'  connector.natural_length {natural:.6g} m: no weave of such short connectors '
            'exists; the shells touch first, and the equilibrium needs contact. The smallest '
            f'natural length without contact is {shortest:.9g} m']
    angle = geometry_from_length(woven.half_edge, natural).connector_angle
    return [
        f'  connector.natural_length {natural:.6g} m: these are constants of the woven state, '
        'held by external stress; the free fabric is in equilibrium at weave.connector_angle '
        f'{angle:.6g} rad']


_BRANCHES = {
    'pull': 'as if all connectors had k_e', 'push': 'as if all connectors had k_c'}


def _one_sided_text(constants: Elasticity) -> list[str]:
    """Describe the response to small strains of either sign."""
    lines = [f'  small strain {"sign":>5} {"modulus [Pa]":>14}  stress [Pa] per unit strain: '
             + ', '.join(_VOIGT)]
    for number, label in enumerate(_VOIGT):
        for sign in (1.0, -1.0):
            found = constants.response(sign * np.eye(6)[number])
            largest = float(np.abs(found.stress).max())
            cells = (0.0 if abs(value) < 1e-9 * largest else value
                     for value in found.stress.tolist())
            lines.append(
                f'  {label:>12} {"+" if sign > 0.0 else "-":>5} {found.modulus:14.6g}  '
                + ''.join(f'{value:12.5g}' for value in cells))
    for label, direction in _DIRECTIONS.items():
        pull, push = (
            constants.uniaxial_response(np.array(direction, float), sign).modulus
            for sign in (1.0, -1.0))
        lines.append(
            f"  Young's modulus along {label:3} {pull:12.6g} Pa in tension, {push:12.6g} Pa in "
            "compression")
    for label in 'xyz':
        pulled, pushed = (
            ', '.join(f'{ratio:.4g} along {side}' for side, ratio in _one_sided_ratios(
                constants, label, sign)) for sign in (1.0, -1.0))
        if pulled and pushed:
            lines.append(
                f"  Poisson's ratio along {label}: {pulled} in tension, {pushed} in compression")
    return lines


def _limits_text(constants: Elasticity) -> list[str]:
    """
    Describe the strains at which the first connector changes between tension and compression.
    """
    limits = [
        (label + sign, constants.response(value * np.eye(6)[number]).limit)
        for number, label in enumerate(_VOIGT) for sign, value in (('+', 1.0), ('-', -1.0))]
    if not any(np.isfinite(limit) for _, limit in limits):
        return []
    return ['  valid up to the strain at which the first connector changes between tension and '
            'compression: ' + ', '.join(
                f'{label} {limit:.4g}' for label, limit in limits if np.isfinite(limit))]


def _branch_text(
    constants: Elasticity, by_direction: list[tuple[str, Directional]]
) -> list[str]:
    largest = float(np.abs(constants.stiffness).max())
    lines = [f'  stiffness [Pa]  {"".join(f"{label:>12}" for label in _VOIGT)}']
    for label, row in zip(_VOIGT, constants.stiffness):
        cells = (0.0 if abs(value) < 1e-9 * largest else value for value in row.tolist())
        lines.append(f'            {label:>4}  ' + ''.join(f'{value:12.5g}' for value in cells))
    if np.abs(constants.stress).max() > 1e-9 * largest:
        lines.append('  stress as woven [Pa] ' + ', '.join(
            f'{label} {value:.5g}' for label, value in zip(_VOIGT, constants.stress.tolist())))
    for label, modulus, ratios in _moduli(constants):
        across = ', '.join(
            f'{ratio:.4g} along {side}' for side, ratio in ratios if ratio is not None)
        lines.append(f"  Young's modulus along {label:3} {modulus:12.6g} Pa" + (
            f", Poisson's ratio {across}" if across else ''))
    lines.append(f'  bulk modulus              {constants.bulk_modulus:12.6g} Pa')
    lines += elastic_directions.text(by_direction)
    lines.append(f'  density {constants.density:.6g} kg/m^3')
    if len(constants.zero_energy_strains):
        lines.append(
            f'  {len(constants.zero_energy_strains)} strains have zero energy: '
            'a pull that excites one has modulus 0')
    return lines


def write(
    outputs: EquilibriumOutputs, constants: Elasticity, by_direction: ByDirection
) -> None:
    """Write tables of the constants of each branch."""
    if outputs.folder is None:
        return
    tables = {f'stiffness{branch and "_"}{branch}.csv': one
              for branch, one in _branches(constants).items()}
    for file, one in tables.items():
        outputs.table(file, ('', *_VOIGT), (
            [label, *row] for label, row in zip(_VOIGT, one.stiffness.tolist())))
    for file, one in tables.items():
        outputs.table(
            file.replace('stiffness', 'moduli'),
            ('pull_along', 'young_modulus_pa', 'across', 'poisson_ratio', 'bulk_modulus_pa'),
            ([label, modulus, side, '' if ratio is None else ratio, one.bulk_modulus]
             for label, modulus, ratios in _moduli(one) for side, ratio in ratios))
    for file, found in zip(tables, by_direction.values()):
        outputs.table(
            file.replace('stiffness', 'directions'), elastic_directions.COLUMNS,
            elastic_directions.rows(found))
    if constants.branches:
        outputs.table('one_sided.csv', ('strain', 'sign', 'modulus_pa', *_VOIGT), (
            [label, sign, found.modulus, *found.stress.tolist()]
            for number, label in enumerate(_VOIGT) for sign in (1, -1)
            for found in [constants.response(sign * np.eye(6)[number])]))
