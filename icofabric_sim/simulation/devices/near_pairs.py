# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Candidate pairs of a rank: those with at least one of its bodies.

A pair whose bodies belong to two ranks is evaluated by both, from the same poses and history. So
both results are bit-identical. Each body sums its pairs in the order of the whole fabric.
"""

from typing import Any, NamedTuple

from icofabric_sim.kernels.integrators.tableau import SLOPE_COUNT
from icofabric_sim.kernels.records import Blocks, Sweep, Team
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.outlined import address_of
from icofabric_sim.kernels.runtime.team import flag_count
from icofabric_sim.simulation.contact.broad_phase import SLOTS_OF_A_PAIR
from icofabric_sim.simulation.model.layout import aligned_empty, Layout
from icofabric_sim.terms.contacts.force import LEAST_PART, touch_some
from icofabric_sim.terms.contacts.listing import arrange
from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE
from icofabric_sim.terms.contacts.record import ContactLosses, Contacts, Nearby, Sleep, Watch
from icofabric_sim.terms.contacts.sleeping import AWAKE
import numpy as np

# Doubles that a rank holds for each slot where shells may touch: what acts, where bodies were
# evaluated, twice each, and from where they are watched; and what friction and damping need.
TOUCHING_EACH, LOSING_EACH = 2 * (6 + 7) + 7, 2 * (1 + 6 + 6 + 2)


class ContactConstants(NamedTuple):
    """Constants of all contacts of a scene."""

    stiffness: float  # K [N/m]
    half_edge: float  # a [m]
    planes: np.ndarray  # (k, 4)
    radius: float  # of the sphere around a body [m]
    free: bool  # nothing is held
    # damping [s/m], friction, stiffness [N/m] and lag [s] of its springs; None: nothing is lost
    losses: tuple[float, float, float, float] | None


class NearPairs(NamedTuple):
    """Candidate pairs of a rank."""

    pairs: np.ndarray  # (p, 2) int32 first slots, as Contacts.pairs, in the window
    constants: ContactConstants

    @property
    def has_friction(self) -> bool:
        """True if pairs have friction springs."""
        return self.constants.losses is not None and self.constants.losses[1] > 0.0


def constants_of(contacts: Contacts) -> ContactConstants:
    """Return the constants of the contacts of a whole fabric."""
    losses = contacts.losses
    return ContactConstants(
        contacts.stiffness, contacts.half_edge, contacts.planes, contacts.sleep.radius,
        contacts.sleep.free, None if losses is None else (
            losses.damping, losses.friction, losses.friction_stiffness, losses.lag))


def contacts_of(
    near: NearPairs, slot: np.ndarray, followed: Blocks, slot_count: int, address: int = 0
) -> Contacts:
    """
    Return contacts of such pairs, without history.

    `slot` are first slots of all blocks of the window; `followed` are blocks with known poses.
    `address` is that of `touch_some`; 0: it is compiled or loaded.
    """
    pairs, constants = near.pairs, near.constants
    count, block_count = len(pairs), len(slot)
    turns = np.full(max(slot_count // LANES, 1), -1, np.int32)
    turns[slot // LANES] = np.arange(block_count)
    rows = aligned_empty((6, slot_count))
    rows[:] = 0.0
    entries = count + int(np.count_nonzero(pairs[:, 1] >= 0))
    start, acting, entry = (
        np.zeros(length, np.int32) for length in (block_count + 1, entries, entries))
    # Bodies are where they are: the slots of a window have no other numbers.
    arrange(
        pairs, np.arange(slot_count, dtype=np.int32), slot, np.empty(slot_count, np.int64),
        np.empty((count, 2), np.int32), start, acting, entry)
    contacts = Contacts(
        stiffness=constants.stiffness, half_edge=constants.half_edge, pairs=pairs,
        planes=constants.planes, result=np.zeros((count, OUT_SIZE)),
        start=start, slot=acting, entry=entry, turns=turns,
        rows=rows, pushes=np.zeros(block_count), deepest=np.zeros(8), tests=np.zeros(8),
        latest=np.full(8, -1), earlier=np.zeros(count // LEAST_PART + 2, np.int64),
        first=np.zeros((1, 8, 3)), second=np.zeros((1, 8, 3)), aside=np.zeros((0, OUT_SIZE)),
        scratch=contact_scratch(), touch_address=0, gap_address=0,
        sleep=_sleep(near, followed, slot_count), losses=_losses(near, slot_count))
    if not address:
        place, turned = aligned_empty((3, 0)), aligned_empty((4, 0))
        address = address_of(
            touch_some, contacts, place, turned, contacts.scratch, contacts.result,
            contacts.sleep.until, 0.0, contacts.earlier, 0, 1)
    return contacts._replace(touch_address=address)


def no_contacts(contacts: Contacts, blocks: Blocks, layout: Layout) -> Contacts:
    """Return contacts without pairs, of the type of those of a whole fabric."""
    return contacts_of(
        NearPairs(contacts.pairs[:0], constants_of(contacts)), layout.blocks.slot, blocks,
        layout.slot_count, contacts.touch_address)


def team_of_one() -> Team:
    """Return the team of one thread that contact kernels get on a rank."""
    none = np.zeros(0, np.uint32)
    return Team(
        0, 1, np.zeros(flag_count(1), np.int64), Sweep(none, none, np.zeros(0, np.int32), 0),
        contact_scratch())


def watch_stub(watch: Watch) -> Watch:
    """Return the watch of a fabric without positions and pairs, for a rank."""
    nearby: dict[str, Any] = {
        name: value[..., :0] for name, value in watch.nearby._asdict().items()
        if isinstance(value, np.ndarray)}
    return watch._replace(
        reference=watch.reference[:, :0], turned=watch.turned[:, :0], frame=watch.frame.copy(),
        far=np.zeros(8), nearby=Nearby(**{**watch.nearby._asdict(), **nearby}))


def watch_of(stub: Watch, slot_count: int) -> Watch:
    """Return the watch of a window."""
    reference, turned = aligned_empty((3, slot_count)), aligned_empty((4, slot_count))
    reference[:] = turned[:] = 0.0
    return stub._replace(reference=reference, turned=turned)


def _sleep(near: NearPairs, blocks: Blocks, slot_count: int) -> Sleep:
    """Let pairs sleep if tracking all bodies is cheaper than testing the pairs."""
    count = len(near.pairs)
    followed = slot_count
    if not SLOTS_OF_A_PAIR * count > followed:
        blocks, followed = Blocks(blocks.slot[:0], blocks.alive[:0], blocks.reach), 0
    position, orientation = aligned_empty((3, followed)), aligned_empty((4, followed))
    position[:] = orientation[:] = 0.0
    path = np.zeros(8)
    path[0] = AWAKE
    return Sleep(
        blocks=blocks, radius=near.constants.radius, free=near.constants.free, position=position,
        orientation=orientation, path=path, until=np.full(count, AWAKE),
        looked=np.full(count, AWAKE), axis=np.zeros((count, 3)),
        awake=np.zeros(count, np.int32))


def _losses(near: NearPairs, slot_count: int) -> ContactLosses | None:
    if near.constants.losses is None:
        return None
    damping, friction, stiffness, lag = near.constants.losses
    spent, lead, lost = (aligned_empty((rows, slot_count)) for rows in (1, 6, 6))
    spent[:] = lead[:] = lost[:] = 0.0
    count = len(near.pairs)
    rows = count if near.has_friction else 0
    stretch, held, start, stage, saved = (np.zeros((rows, 4)) for _ in range(5))
    return ContactLosses(
        damping, friction, stiffness, lag, np.zeros(count), spent, stretch, held, start, stage,
        saved, np.zeros((SLOPE_COUNT, rows, 4)), lead, np.zeros((count, 9)), lost)
