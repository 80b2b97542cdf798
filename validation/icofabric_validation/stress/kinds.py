# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The kinds of random scenes: their terms, and the method that integrates them.

Each kind has separate kernels, so kinds are drawn before values. Add new kinds at the end: numbers
of kinds are arguments of `--kinds`.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

# Largest number of kinds: the kernels of one take up to two minutes to compile.
MAX_KINDS: Final = 200

TERMS: Final = {
    'loads': 'wrenches of all profiles',
    'gravity': 'gravity',
    'supports': 'supports',
    'bending': 'bending stiffness',
    'twisting': 'twisting stiffness',
    'attachments': 'individual attachment points',
    'bilinear': 'connectors with two stiffnesses',
    'tabulated': 'connector laws by table',
    'groups': 'connector groups with separate laws',
    'damping': 'damped connectors',
    'maxwell': 'connectors that are standard linear solids',
    'anisotropic': 'anisotropic inertias',
    'drag': 'drag',
    'breaking': 'connectors that break',
    'wrapped': 'connectors wrapped over shells',
    'charges': 'charges in an electric field',
    'dipoles': 'dipoles in an electric field',
    'magnetic': 'charges in a magnetic field',
    'coulomb': 'charges that repel each other',
    'tractions': 'tractions on faces',
    'anchors': 'connectors to fixed or moving points',
    'drives': 'prescribed motion',
    'contact': 'contact between shells',
    'dissipation': 'contact with damping and friction',
    'plane': 'a plane',
    'bodies': 'bodies outside the weave',
    'disconnected': 'bodies without connectors',
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
    leapfrog srkn6 dop8: loads gravity supports
    leapfrog srkn4 srkn6 dop8: bilinear
    leapfrog srkn6 dop8: bending twisting
    srkn4 dop8: attachments
    srkn6 dop8: tabulated
    dop8 srkn6: damping
    dop8: drag
    dop8: loads gravity supports damping drag
    dop8 leapfrog: breaking
    dop8: bilinear breaking
    dop8: wrapped
    dop8: damping wrapped
    srkn6: charges
    srkn8: dipoles
    dop8: magnetic
    srkn6: coulomb
    srkn4 dop8: tractions
    srkn6 dop8: anchors
    leapfrog srkn6 dop8: drives
    dop8: damping drives
    srkn4 srkn6 dop8: contact
    dop8: contact dissipation
    dop8: gravity contact plane
    dop8: gravity contact dissipation plane
    dop8: contact disconnected
    dop8: loads bending twisting groups damping drives
    dop8: loads gravity bilinear groups damping breaking
    srkn6: loads gravity supports bending twisting attachments groups
    dop8: gravity supports tabulated damping anchors
    auto: loads gravity supports contact bodies
    srkn8: loads bending twisting bilinear
    dop8: gravity drag charges magnetic drives
    sdirk4:
    sdirk4: damping
    sdirk4: loads gravity supports damping
    sdirk4: bending twisting damping
    sdirk4: bilinear damping
    sdirk4: tabulated damping
    sdirk4: damping drag drives
    sdirk4: damping tractions
    sdirk4: loads gravity supports groups damping drag
    auto: loads gravity supports damping
    dop8: tabulated groups
    auto dop8: bilinear contact
    leapfrog srkn6: loads bilinear drives
    dop8: breaking contact dissipation
    dop8: breaking anchors
    leapfrog: anchors
    dop8: tractions contact plane
    dop8: bending twisting drives contact
    srkn6: loads gravity supports contact
    dop8: charges contact
    auto: gravity supports damping breaking anchors
    sdirk4: damping contact
    sdirk4: loads gravity supports damping contact plane
    sdirk4: bending twisting damping drives contact
    auto: gravity supports damping contact
    dop8: maxwell
    auto: loads gravity supports maxwell
    dop8: bilinear maxwell breaking
    dop8: tabulated damping maxwell drives
    dop8: bending twisting attachments groups maxwell
    dop8: gravity maxwell contact dissipation plane
    dop8: anisotropic
    auto: loads gravity supports damping anisotropic
    dop8: bilinear anisotropic drives
    dop8: gravity anisotropic contact dissipation plane
    dop8: attachments wrapped
    dop8: bending twisting attachments wrapped
    dop8: maxwell wrapped
    dop8: gravity attachments damping wrapped contact
    dop8: bending bilinear maxwell breaking wrapped contact
"""))
assert len(KINDS) <= MAX_KINDS
# Kinds for which `auto` may take implicit steps.
AUTO_DAMPED: Final = (
    Kind('auto', ('loads', 'gravity', 'supports', 'damping')),
    Kind('auto', ('gravity', 'supports', 'damping', 'contact')))
assert {*AUTO_DAMPED} <= {*KINDS}
