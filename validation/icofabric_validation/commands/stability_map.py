# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric stress --map`: every method with steps up to and beyond its stability limit."""

import argparse
import math
from pathlib import Path

from icofabric_sim.commands.picture_arguments import picture_path
from icofabric_sim.commands.report import rows_as_they_come
from icofabric_sim.terminal import InputError, require_place
from icofabric_validation.commands.named_problems import is_given, RANDOM_SCENE_OPTIONS

_MAX_STEPS = 10**9


def add_map_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        '--map', action='store_true',
        help='a stability map instead of random scenes: all methods, steps up to and beyond '
        'the limit, drifts of energy, momentum and norms')
    parser.add_argument(
        '--steps', type=int, metavar='N',
        help='with --map: steps of each run (default 10000; 10000000 take hours)')
    parser.add_argument(
        '--fabrics', metavar='NAME,...',
        help='with --map: only these of free, hanging, driven, tensioned, touching, kinked and '
        'breaking')
    parser.add_argument(
        '--products', metavar='X,...',
        help='with --map: only these steps, times the largest frequency, e.g. 0.2,1,1.9')
    parser.add_argument(
        '--picture', metavar='FILE', help='with --map: draw it (PNG)')


def main_map(arguments: argparse.Namespace) -> int:
    """Run the map; return 1 if a step is rejected or a run contradicts the theory."""
    from icofabric_validation.stability_map import (
        Cell,
        cell_line,
        FABRICS,
        HEAD,
        map_stability,
        methods_of,
        products_of,
        STEPS,
    )
    for name in (*RANDOM_SCENE_OPTIONS, 'named', 'problem', 'long', 'list'):
        if is_given(arguments, name):
            raise InputError(f'--{name} cannot be combined with --map')
    steps = STEPS if arguments.steps is None else arguments.steps
    if not 100 <= steps <= _MAX_STEPS:
        raise InputError(f'--steps must be from 100 to {_MAX_STEPS}, got {steps}')
    fabrics = _fabrics(arguments.fabrics, tuple(FABRICS))
    products = _products(arguments.products)
    table, picture = None, picture_path(arguments, 'picture')
    if arguments.output is not None:
        table = require_place('--output', Path(arguments.output).expanduser())
    cells: list[Cell] = []
    if not arguments.json:
        print(HEAD)
    with rows_as_they_come(
            Cell._fields, cell_line, table=table, as_json=arguments.json,
            total=sum(
                len(products_of(method) if products is None else products)
                for name in fabrics for method in methods_of(name))
    ) as take:
        for cell in map_stability(fabrics, products=products, steps=steps):
            cells.append(cell)
            take(cell, len(cells))
    if picture is not None:
        from icofabric_validation.pictures.stability_picture import draw_map
        picture.parent.mkdir(parents=True, exist_ok=True)
        draw_map(picture, cells)
    faults = sum(bool(cell.fault) for cell in cells)
    if not arguments.json:
        print(f'{len(cells)} runs of {steps} steps, {faults} contradict the theory')
    return int(faults > 0)


def _fabrics(text: str | None, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the requested fabrics in the order of the map."""
    if text is None:
        return known
    names = [name.strip() for name in text.split(',')]
    for name in names:
        if name not in known:
            raise InputError(f'--fabrics must be among {", ".join(known)}, got {name!r}')
    return tuple(name for name in known if name in names)


def _products(text: str | None) -> tuple[float, ...] | None:
    """Return the requested products of step and largest frequency; None: those of each method."""
    if text is None:
        return None
    from icofabric_sim.checks import number_in

    try:
        products = tuple(number_in(word) for word in text.split(','))
    except ValueError:
        products = ()
    if not products or not all(0.0 < product < math.inf for product in products):
        raise InputError(
            f'--products must be steps times the largest frequency, above 0, e.g. 0.2,1,1.9, got '
            f'{text!r}')
    return products
