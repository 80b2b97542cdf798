# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric elasticity SCENE`."""

import argparse
from typing import Any, TYPE_CHECKING

from icofabric_sim.commands import elastic_directions
from icofabric_sim.commands.equilibrium_outputs import (
    add_output_arguments,
    EquilibriumOutputs,
    kink_text,
    outputs_of,
)
from icofabric_sim.commands.load_cases import DIRECTED, LoadCases, STRAINED, TURNED
from icofabric_sim.commands.report import add_json_numbers_argument, print_json, text_to_stderr
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.terminal import bad_input, InputError

if TYPE_CHECKING:
    from icofabric_sim.scene.scene import Scene
    from icofabric_sim.statics.directional import Directional
    from icofabric_sim.statics.lattice import LatticeRest
    from icofabric_sim.statics.periodic import Elasticity

    # Moduli by direction, for each branch.
    ByDirection = dict[str, list[tuple[str, Directional]]]

_BY_ITSELF = ('pull', 'push', 'shear')
_DIRECTIONS = {'x': (1, 0, 0), 'y': (0, 1, 0), 'z': (0, 0, 1), 'xy': (1, 1, 0), 'xyz': (1, 1, 1)}
# Two perpendicular directions normal to each direction.
_ACROSS = {'x': ('y', 'z'), 'y': ('z', 'x'), 'z': ('x', 'y'), 'xy': ('z', 'x-y'),
           'xyz': ('x-y', 'x+y-2z')}
_SIDES = {'x': (1, 0, 0), 'y': (0, 1, 0), 'z': (0, 0, 1), 'x-y': (1, -1, 0),
          'x+y-2z': (1, 1, -2)}
_VOIGT = ('xx', 'yy', 'zz', 'yz', 'xz', 'xy')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser)
    parser.add_argument(
        '--strain', type=float, default=0.1, metavar='E',
        help='largest displacement of the moved end divided by the length (%(default)g)')
    parser.add_argument(
        '--angle', type=float, default=0.1, metavar='RAD',
        help='largest relative angle of the ends in bending and twisting [rad] (%(default)g)')
    parser.add_argument(
        '--points', type=int, default=10, metavar='N', help='states in each curve (%(default)d)')
    parser.add_argument(
        '--axis', choices=('x', 'y', 'z'), default='x', help='axis through both ends of the slab '
                                                             '(%(default)s)')
    parser.add_argument(
        '--about', choices=('x', 'y', 'z'),
        help='rotation axis of a bend, normal to --axis (default: the next axis, y for x)')
    parser.add_argument(
        '--along', nargs=3, type=float, metavar=('X', 'Y', 'Z'),
        help='displacement direction of the moved end in a pull or, reversed, a push (default: '
             '--axis), or in a shear (default: the next axis, y for --axis x)')
    parser.add_argument(
        '--cycles', type=int, default=0, metavar='N',
        help='load and unload N times and report the dissipated energy (%(default)d: load only)')
    parser.add_argument(
        '--kinds', nargs='*', choices=(*STRAINED, *TURNED), default=_BY_ITSELF, metavar='KIND',
        help='curves of the slab: pull, push, shear, hydrostatic (all faces inwards), inflation '
             '(outwards), bend, twist (default: pull push shear); --kinds without a value: '
             'constants only')
    parser.add_argument(
        '--direction', nargs=3, type=float, action='append', default=[],
        metavar=('X', 'Y', 'Z'),
        help="Young's modulus, Poisson's ratios and shear moduli of the periodic fabric in this "
             'direction, in addition to thirteen others; may be repeated')
    parser.add_argument(
        '--relaxed', action='store_true',
        help='constants of the periodic fabric about its equilibrium, with contact between shells '
             '(contact.mode never: without contact), instead of about the woven state')
    add_output_arguments(parser)
    add_json_numbers_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """
    Print elastic constants of the periodic fabric and curves of the slab of a scene.

    Return 1 if a curve ends early.
    """
    with text_to_stderr(arguments.json):
        report, early = _find(arguments)
    if arguments.json:
        print_json(report)
    return 1 if early else 0


def _find(arguments: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """Compute constants and curves; return the report and whether a curve ended early."""
    name, parameters = read_parameters(arguments)
    outputs = outputs_of(arguments)
    if not arguments.points >= 1:
        raise InputError(f'--points must be at least 1, got {arguments.points}')
    if arguments.cycles < 0:
        raise InputError(f'--cycles must be at least 0, got {arguments.cycles}')
    if not 0.0 < abs(arguments.angle) < float('inf'):
        raise InputError(f'--angle must be a finite angle in rad, not 0, got {arguments.angle}')
    axis = 'xyz'.index(arguments.axis)
    about = None if arguments.about is None else 'xyz'.index(arguments.about)
    from icofabric_sim.scene.scene import Scene
    from icofabric_sim.statics.held_motion import check_along
    from icofabric_sim.statics.moment_curve import check_about
    from icofabric_sim.statics.periodic import homogenise
    import numpy as np

    with bad_input():
        scene = Scene.from_parameters(parameters)
        check_about('bend', axis, about)
        directed = [kind for kind in arguments.kinds if kind in DIRECTED]
        for kind in directed or arguments.kinds:
            check_along(kind, axis, arguments.along)
        # Curves of the slab do not need the periodic fabric.
        why = _without_constants(scene) if arguments.kinds else ''
        alone = bool(why)
        constants = None if alone else homogenise(scene, relaxed=arguments.relaxed)
    by_direction: ByDirection = {} if constants is None else {
        branch: elastic_directions.by_direction(one, arguments.direction)
        for branch, one in _branches(constants).items()}
    if constants is None:
        print(f'{name}: no constants of a periodic fabric, because {why}')
    else:
        print(f'{name}: periodic fabric')
        aside = rest_text(scene) if constants.relaxed_state is None else lattice_text(
            constants.relaxed_state, scene)
        print('\n'.join([*constants_text(constants, by_direction), *aside]))
    parts = np.arange(1, arguments.points + 1) / arguments.points
    cases = LoadCases(
        arguments.kinds, (arguments.strain * parts).tolist(), (arguments.angle * parts).tolist(),
        axis, about, arguments.cycles, arguments.along)
    try:
        cases.search(scene)
    finally:
        # Also after an interrupt.
        if lines := cases.text(name):
            print('\n'.join(lines))
        if constants is not None:
            _write(outputs, constants, by_direction)
        if outputs.folder is not None:
            cases.write(outputs)
    if outputs.picture is not None:
        from icofabric_sim.pictures.elastic_picture import draw_elasticity
        outputs.picture.parent.mkdir(parents=True, exist_ok=True)
        draw_elasticity(outputs.picture, name, constants, cases.curves, cases.moment_curves)
        print(f'drawn to {outputs.picture}')
    if constants is None:
        return {'scene': name, **cases.numbers()}, cases.early
    branches = {key: _numbers(one, by_direction[key]) for key, one in constants.branches.items()}
    return {
        'scene': name, **_numbers(constants, by_direction[constants.branch]),
        'branch': constants.branch, 'branches': branches, **cases.numbers()}, cases.early


def _without_constants(scene: 'Scene') -> str:
    """
    Return why the periodic fabric of a scene is undefined, otherwise ''; curves are possible.
    """
    from icofabric_sim.scene.connector_groups import differ_by_direction_only
    if scene.parameters['weave.kind'] == 'radial':
        return 'a radial weave does not repeat in space'
    if not differ_by_direction_only(scene.parameters):
        return 'connector_groups.* make connectors differ from place to place'
    if scene.electric.mutual and scene.electric.charge.any():
        return 'charge.mutual is an infinite sum over all charges'
    return ''


def _branches(constants: 'Elasticity') -> dict[str, 'Elasticity']:
    """Return the constants by branch, with key '' if no connector is at its kink."""
    return dict(constants.branches) or {'': constants}


def _numbers(
    constants: 'Elasticity', by_direction: list[tuple[str, 'Directional']]
) -> dict[str, Any]:
    import numpy as np
    return {
        'order': _VOIGT, 'stiffness_pa': constants.stiffness, 'stress_pa': constants.stress,
        'density_kg_m3': constants.density,
        'zero_energy_strain_count': len(constants.zero_energy_strains),
        'young_modulus_pa': {
            label: constants.young_modulus(np.array(direction, float))
            for label, direction in _DIRECTIONS.items()},
        'bulk_modulus_pa': constants.bulk_modulus,
        'poisson_ratio': {label: dict(ratios) for label, _, ratios in moduli(constants)},
        'directions': elastic_directions.numbers(by_direction),
        **_rest_numbers(constants.relaxed_state)}


def _rest_numbers(rest: 'LatticeRest | None') -> dict[str, Any]:
    """Return the state that the constants refer to, unless it is the woven state."""
    return {} if rest is None else {'rest': {
        'deformation_gradient': rest.gradient, 'turn': rest.turn, 'verdict': rest.verdict,
        'contact_pairs': len(rest.contact_vectors), 'overlap_m': rest.overlap,
        'first_touches': rest.first_touches}}


def moduli(
    constants: 'Elasticity'
) -> list[tuple[str, float, list[tuple[str, float | None]]]]:
    """
    Return directions, Young's moduli [Pa], and Poisson's ratios in two transverse directions.

    A ratio is None if a zero-energy strain makes it undefined.
    """
    import numpy as np

    found = []
    for label, direction in _DIRECTIONS.items():
        along = np.array(direction, float)
        modulus = float(constants.young_modulus(along))
        ratios = [(side, float(constants.poisson_ratio(along, np.array(_SIDES[side], float))))
                  for side in _ACROSS[label]]
        found.append((label, modulus, [
            (side, None if np.isnan(ratio) else ratio) for side, ratio in ratios]))
    return found


def one_sided_ratios(
    constants: 'Elasticity', label: str, sign: float
) -> list[tuple[str, float]]:
    """
    Return Poisson's ratios for a small pull (1) or push (-1) along an axis; [] if undefined.
    """
    import numpy as np

    found = constants.uniaxial_response(np.array(_DIRECTIONS[label], float), sign)
    if not found.modulus > 0.0:
        return []
    strain = dict(zip('xyz', found.strain[:3].tolist()))
    return [(side, -strain[side] / strain[label]) for side in _ACROSS[label]]


def constants_text(
    constants: 'Elasticity', by_direction: 'ByDirection'
) -> list[str]:
    """Return lines for the terminal; `by_direction` holds the directions by branch."""
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


def lattice_text(rest: 'LatticeRest', scene: 'Scene') -> list[str]:
    """Describe the equilibrium of the periodic fabric."""
    import numpy as np

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


def rest_text(scene: 'Scene') -> list[str]:
    """Describe the free equilibrium of pre-tensioned point springs."""
    from icofabric_sim.scene.attachments import has_own_attachments
    from icofabric_sim.scene.weave_geometry import geometry_from_length, MINIMUM_LENGTH_RATIO

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


def _one_sided_text(constants: 'Elasticity') -> list[str]:
    """Describe the response to small strains of either sign."""
    import numpy as np

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
            ', '.join(f'{ratio:.4g} along {side}' for side, ratio in one_sided_ratios(
                constants, label, sign)) for sign in (1.0, -1.0))
        if pulled and pushed:
            lines.append(
                f"  Poisson's ratio along {label}: {pulled} in tension, {pushed} in compression")
    return lines


def _limits_text(constants: 'Elasticity') -> list[str]:
    """
    Describe the strains at which the first connector changes between tension and compression.
    """
    import numpy as np

    limits = [
        (label + sign, constants.response(value * np.eye(6)[number]).limit)
        for number, label in enumerate(_VOIGT) for sign, value in (('+', 1.0), ('-', -1.0))]
    if not any(np.isfinite(limit) for _, limit in limits):
        return []
    return ['  valid up to the strain at which the first connector changes between tension and '
            'compression: ' + ', '.join(
                f'{label} {limit:.4g}' for label, limit in limits if np.isfinite(limit))]


def _branch_text(
    constants: 'Elasticity', by_direction: list[tuple[str, 'Directional']]
) -> list[str]:
    import numpy as np

    largest = float(np.abs(constants.stiffness).max())
    lines = [f'  stiffness [Pa]  {"".join(f"{label:>12}" for label in _VOIGT)}']
    for label, row in zip(_VOIGT, constants.stiffness):
        cells = (0.0 if abs(value) < 1e-9 * largest else value for value in row.tolist())
        lines.append(f'            {label:>4}  ' + ''.join(f'{value:12.5g}' for value in cells))
    if np.abs(constants.stress).max() > 1e-9 * largest:
        lines.append('  stress as woven [Pa] ' + ', '.join(
            f'{label} {value:.5g}' for label, value in zip(_VOIGT, constants.stress.tolist())))
    for label, modulus, ratios in moduli(constants):
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


def _write(
    outputs: EquilibriumOutputs, constants: 'Elasticity', by_direction: 'ByDirection'
) -> None:
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
             for label, modulus, ratios in moduli(one) for side, ratio in ratios))
    for file, found in zip(tables, by_direction.values()):
        outputs.table(
            file.replace('stiffness', 'directions'), elastic_directions.COLUMNS,
            elastic_directions.rows(found))
    if constants.branches:
        import numpy as np
        outputs.table('one_sided.csv', ('strain', 'sign', 'modulus_pa', *_VOIGT), (
            [label, sign, found.modulus, *found.stress.tolist()]
            for number, label in enumerate(_VOIGT) for sign in (1, -1)
            for found in [constants.response(sign * np.eye(6)[number])]))
