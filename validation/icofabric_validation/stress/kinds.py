# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The kinds of random scenes: which terms they have, and which method integrates them.

Each kind has kernels of its own, so kinds are drawn before values. A number keeps its meaning:
new kinds go to the end, where there is room for them (`MOST`), and to another version of the seeds
(`scenes.VERSIONS`).
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

# Kernels of a kind take up to two minutes to compile.
MOST: Final = 200

TERMS: Final = {
    'loaded': 'wrenches of all profiles',
    'heavy': 'gravity',
    'held': 'supports',
    'bent': 'bending stiffness',
    'twisted': 'twisting stiffness',
    'attached': 'attachment points of their own',
    'kinked': 'connectors that pull otherwise than they push',
    'tabled': 'connector laws by table',
    'grouped': 'connectors of a group with laws of their own',
    'damped': 'damped connectors',
    'relaxing': 'connectors that are standard linear solids',
    'tumbling': 'inertias that are not isotropic',
    'dragged': 'drag',
    'breaking': 'connectors that break',
    'wrapped': 'connectors that lie around shells',
    'charged': 'charges in an electric field',
    'dipole': 'dipoles in an electric field',
    'magnetic': 'charges in a magnetic field',
    'mutual': 'charges that repel each other',
    'pressed': 'tractions on faces',
    'anchored': 'connectors to points of the world',
    'driven': 'prescribed motion',
    'touching': 'contact between shells',
    'lossy': 'contact with damping and friction',
    'floored': 'a plane',
    'loose': 'bodies outside the weave',
    'parted': 'bodies without connectors',
}


class Kind(NamedTuple):
    """The terms of a scene, in the order of TERMS, and `solver.method`."""

    method: str
    terms: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the method and the terms in words."""
        return ' '.join((self.method, *self.terms))


def _kinds(text: str) -> Iterator[Kind]:
    for line in text.strip().splitlines():
        methods, _, terms = line.partition(':')
        for method in methods.split():
            yield Kind(method, tuple(terms.split()))


KINDS: Final = tuple(_kinds("""
    auto leapfrog srkn4 srkn6 srkn8 dop8:
    leapfrog srkn6 dop8: loaded heavy held
    leapfrog srkn4 srkn6 dop8: kinked
    leapfrog srkn6 dop8: bent twisted
    srkn4 dop8: attached
    srkn6 dop8: tabled
    dop8 srkn6: damped
    dop8: dragged
    dop8: loaded heavy held damped dragged
    dop8 leapfrog: breaking
    dop8: kinked breaking
    dop8: wrapped
    dop8: damped wrapped
    srkn6: charged
    srkn8: dipole
    dop8: magnetic
    srkn6: mutual
    srkn4 dop8: pressed
    srkn6 dop8: anchored
    leapfrog srkn6 dop8: driven
    dop8: damped driven
    srkn4 srkn6 dop8: touching
    dop8: touching lossy
    dop8: heavy touching floored
    dop8: heavy touching lossy floored
    dop8: touching parted
    dop8: loaded bent twisted grouped damped driven
    dop8: loaded heavy kinked grouped damped breaking
    srkn6: loaded heavy held bent twisted attached grouped
    dop8: heavy held tabled damped anchored
    auto: loaded heavy held touching loose
    srkn8: loaded bent twisted kinked
    dop8: heavy dragged charged magnetic driven
    sdirk4:
    sdirk4: damped
    sdirk4: loaded heavy held damped
    sdirk4: bent twisted damped
    sdirk4: kinked damped
    sdirk4: tabled damped
    sdirk4: damped dragged driven
    sdirk4: damped pressed
    sdirk4: loaded heavy held grouped damped dragged
    auto: loaded heavy held damped
    dop8: tabled grouped
    auto dop8: kinked touching
    leapfrog srkn6: loaded kinked driven
    dop8: breaking touching lossy
    dop8: breaking anchored
    leapfrog: anchored
    dop8: pressed touching floored
    dop8: bent twisted driven touching
    srkn6: loaded heavy held touching
    dop8: charged touching
    auto: heavy held damped breaking anchored
    sdirk4: damped touching
    sdirk4: loaded heavy held damped touching floored
    sdirk4: bent twisted damped driven touching
    auto: heavy held damped touching
    dop8: relaxing
    auto: loaded heavy held relaxing
    dop8: kinked relaxing breaking
    dop8: tabled damped relaxing driven
    dop8: bent twisted attached grouped relaxing
    dop8: heavy relaxing touching lossy floored
    dop8: tumbling
    auto: loaded heavy held damped tumbling
    dop8: kinked tumbling driven
    dop8: heavy tumbling touching lossy floored
    dop8: attached wrapped
    dop8: bent twisted attached wrapped
    dop8: relaxing wrapped
    dop8: heavy attached damped wrapped touching
    dop8: bent kinked relaxing breaking wrapped touching
"""))
assert len(KINDS) <= MOST
# The kinds of scenes for which `auto` may take implicit steps.
AUTO_DAMPED: Final = (
    Kind('auto', ('loaded', 'heavy', 'held', 'damped')),
    Kind('auto', ('heavy', 'held', 'damped', 'touching')))
assert {*AUTO_DAMPED} <= {*KINDS}
