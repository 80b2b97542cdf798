# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Window of a rank: its blocks and those that it reads, in separate arrays.

Slots are in the order of the whole fabric, and adjacent slots remain adjacent: a vector that
starts in one block may end in the next. Blocks that are never read are left out, so only the
places of neighbours differ.
"""

from typing import NamedTuple

from icofabric_sim.kernels.figures import figures_room, group_size
from icofabric_sim.kernels.records import Blocks, Loads, Model, State, Supports
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.division import Part
from icofabric_sim.simulation.devices.near_pairs import LOSING_EACH, TOUCHING_EACH
from icofabric_sim.simulation.model.layout import aligned_empty, aligned_zeros, Layout
from icofabric_sim.terms.contacts.record import Watch
from icofabric_sim.terms.laws import Laws
from icofabric_sim.terms.registry import LAWS, TERMS
from icofabric_sim.terms.shared import Variety
from icofabric_sim.terms.tractions.record import Tractions
import numpy as np

# Doubles that a rank holds for each slot: state, its trials and the one that was saved,
# accelerations of the first three, points, and constants (1e7 bodies on two ranks: 96 in all); and
# what steps need that follow where slopes jump.
_DOUBLES_EACH, _KINKS_EACH = 4 * 13 + 3 * 6 + 18 + 8, 12 + 48 + 36 + 6 + 18 + 18

# Slopes of the stages, what a stage and the start of a step are, of both states; speeds of points.
_PAIR_EACH = 2 * (16 * 13 + 2 * 13 + 18)


class Exchange(NamedTuple):
    """Blocks and slots that a rank drifts, pushes, sends and receives."""

    first: int  # its own blocks
    last: int
    drifts: np.ndarray  # uint32
    border: int
    inner: np.ndarray  # uint32
    ahead: np.ndarray  # int32
    # (rank, first slots int32 of the blocks)
    gives: tuple[tuple[int, np.ndarray], ...]
    needs: tuple[tuple[int, np.ndarray], ...]
    samples: np.ndarray  # (m,) int32 first slots of its blocks in which roughness is judged


class Slots(NamedTuple):
    """Slots of the whole fabric in a window, in runs of LANES."""

    kept: np.ndarray  # numbers of the runs, rising
    total: int  # of slots in the window
    whole: int  # of slots in the whole fabric

    def cut(self, values: np.ndarray) -> np.ndarray:
        """Return the slots of the window from rows (..., s) of the whole fabric."""
        runs = values.reshape(*values.shape[:-1], -1, LANES)
        target = aligned_zeros((*values.shape[:-1], self.total))
        target.reshape(*runs.shape[:-2], -1, LANES)[..., :len(self.kept), :] = (
            runs[..., self.kept, :])
        target.flags.writeable = values.flags.writeable
        return target


class Window(NamedTuple):
    """Data of a rank at the start of a run, without loads and state."""

    model: Model
    exchange: Exchange
    slot_count: int
    known: np.ndarray  # (b,) uint8, as Blocks.alive, with the bodies of others
    group: int  # blocks in a group, over which sums are formed
    watch: Watch | None = None  # without places; None: nothing can touch
    spends: bool = False  # whether contacts take energy

    def figures_room(self) -> np.ndarray:
        """Room for sums over its own blocks."""
        return figures_room(self.exchange.last - self.exchange.first, self.group)


def exchange_of(layout: Layout, part: Part, samples: np.ndarray) -> Exchange:
    """Return the exchange of the first rank, which has the arrays of the whole fabric."""
    slot = layout.blocks.slot
    return _exchange(part, np.arange(len(slot)), slot, samples)


def slots_of(model: Model, layout: Layout, part: Part) -> Slots:
    """Return the slots of the window of a part, including those that vectors pass over."""
    links, kept = model.links, np.zeros(layout.slot_count // LANES, bool)
    kept[layout.blocks.slot[_blocks(part)] // LANES] = True
    if links is not None:
        at = links.place[part.first:part.last] % layout.slot_count
        kept[at // LANES] = True
        kept[(at + LANES - 1) // LANES] = True
    runs = np.flatnonzero(kept)
    return Slots(runs, LANES * (len(runs) + 1 - len(runs) % 2), layout.slot_count)


def window_of(
    model: Model, layout: Layout, part: Part, slots: Slots, samples: np.ndarray
) -> Window:
    """
    Cut a window with these `slots` from the `model` of a whole fabric.

    `samples` are blocks of the part that sample the roughness.
    """
    own, blocks = np.arange(part.first, part.last), _blocks(part)
    kept, slot_count, _ = slots
    # From a run of slots in the whole fabric to where it is in the window.
    moved = np.zeros(layout.slot_count // LANES, np.int64)
    moved[kept] = np.arange(len(kept))

    def cut(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else slots.cut(values)

    slot = (LANES * moved[layout.blocks.slot[blocks] // LANES]).astype(np.int32)
    alive = model.blocks.alive[blocks].copy()
    alive[len(own):] = 0  # nothing is computed for the bodies of others
    links = model.links
    if links is not None:
        edge, at = np.divmod(links.place[own].astype(np.int64), 3 * layout.slot_count)
        at = LANES * moved[at // LANES] + at % LANES
        place = np.zeros((len(blocks), links.place.shape[1]), np.int32)
        present = np.zeros(place.shape, np.uint8)
        place[:len(own)], present[:len(own)] = 3 * slot_count * edge + at, links.present[own]
        place[len(own):] = slot[len(own):, None]
        variety = links.variety
        if variety is not None:
            variety = Variety(*(slots.cut(values) for values in variety))
        links = links._replace(
            place=place, present=present, variety=variety, laws=_laws_of(links.laws, slots))
    bending, twisting = model.bending, model.twisting
    supports, masses = model.supports, model.masses
    if bending is not None:
        bending = bending._replace(
            directions=cut(bending.directions), variety=cut(bending.variety),
            woven=cut(bending.woven))
    if twisting is not None:
        twisting = twisting._replace(variety=cut(twisting.variety), woven=cut(twisting.woven))
    if supports is not None:
        supports = Supports(*(slots.cut(values) for values in supports))
    if masses is not None:
        masses = masses._replace(mass=cut(masses.mass), inertia=cut(masses.inertia))
    damping, maxwell, magnet = model.damping, model.maxwell, model.magnet
    if damping is not None:
        damping = damping._replace(own=cut(damping.own))
    if maxwell is not None:
        maxwell = maxwell._replace(
            own_stiffness=cut(maxwell.own_stiffness), own_rate=cut(maxwell.own_rate))
    if magnet is not None:
        magnet = magnet._replace(
            charge=cut(magnet.charge), moment=cut(magnet.moment), second=cut(magnet.second))
    gyration = model.gyration
    if gyration is not None:
        gyration = gyration._replace(moments=cut(gyration.moments), axes=cut(gyration.axes))
    shells = model.shells
    if shells is not None:
        shells = shells._replace(deeper=cut(shells.deeper))
    numbers = np.zeros(len(layout.blocks.slot), np.int64)
    numbers[blocks] = np.arange(len(blocks))
    own_model = model._replace(
        blocks=Blocks(slot, alive, 0), links=links, bending=bending, twisting=twisting,
        supports=supports, masses=masses, contacts=None, damping=damping, maxwell=maxwell,
        magnet=magnet, gyration=gyration, shells=shells)
    _require_cut(model, own_model, layout.slot_count)
    return Window(
        own_model,
        _exchange(part, numbers, slot, samples), slot_count, model.blocks.alive[blocks].copy(),
        group_size(len(layout.blocks.slot)))


def _require_cut(whole: Model, own: Model, slot_count: int) -> None:
    """Raise NotImplementedError if a term has an array of all `slot_count` slots as it was."""
    for term in TERMS:
        record = getattr(own, term.name, None)
        for name, values in record._asdict().items() if record is not None else ():
            if values is getattr(getattr(whole, term.name), name) and (
                    isinstance(values, np.ndarray) and values.shape[-1:] == (slot_count,)):
                raise NotImplementedError(
                    f'ranks have no part of {name} of the term {term.name}; cut it in window_of')


def _laws_of(laws: Laws | None, slots: Slots) -> Laws | None:
    """Return the laws of the connectors of a window."""
    if laws is None:
        return None
    found = {
        law.name: law.record(**{name: slots.cut(row) for name, row in rows._asdict().items()})
        for law in LAWS if (rows := getattr(laws, law.name)) is not None and law.name != 'tables'}
    if laws.tables is not None:
        number = slots.cut(laws.tables.number)
        found['tables'] = laws.tables._replace(
            number=number, near=np.full(number.size >> 2, -1, np.int32))
    return Laws(**found)


def pair_bytes_of(slot_count: int, *, touching: bool, spends: bool) -> int:
    """Return the approximate memory [bytes] of a window for steps of an embedded pair."""
    return bytes_of(
        slot_count, kinked=False, touching=touching, spends=spends) + 8 * _PAIR_EACH * slot_count


def bytes_of(
    slot_count: int, *, kinked: bool, touching: bool = False, spends: bool = False
) -> int:
    """Return the approximate bytes of a window of a number of slots, without pairs."""
    each = _DOUBLES_EACH + kinked * _KINKS_EACH + touching * TOUCHING_EACH + spends * LOSING_EACH
    return 8 * each * slot_count


def resting(slot_count: int, *, has_arms: bool = False) -> State:
    """Allocate a state at rest; slots without a body have finite values."""
    position, orientation, velocity, spin, rest = (
        aligned_zeros((rows, slot_count)) for rows in (3, 4, 3, 3, 12 * has_arms))
    state = State(position, orientation, velocity, spin, rest if has_arms else None)
    state.orientation[3] = 1.0
    return state


def loads_of(loads: Loads, part: Part, slots: Slots, *, stages: int = 0) -> Loads:
    """Return the rows of a part without its halo, with powers at a number of `stages`."""
    first, last = int(loads.start[part.first]), int(loads.start[part.last])
    start = loads.start[part.first:part.last + 1] - first
    start = np.concatenate([start, np.full(len(part.halo), start[-1])]).astype(np.int32)
    rows, drives, tractions = slice(first, last), loads.drives, loads.tractions
    if drives is not None:
        drives = drives._replace(arm=slots.cut(drives.arm), first=slots.cut(drives.first))
    if tractions is not None:
        tractions = _tractions_of(tractions, loads.wrench[rows], rows)
    return loads._replace(
        start=start, wrench=loads.wrench[rows].copy(), lanes=loads.lanes[rows].copy(),
        work=aligned_zeros((LANES * (last - first),)),
        earlier_work=aligned_zeros((LANES * (last - first) * (stages > 0),)),
        power=aligned_zeros((stages * LANES * (last - first),)).reshape(
            stages, LANES * (last - first) * (stages > 0)),
        drives=drives, tractions=tractions)


def _tractions_of(tractions: Tractions, wrench: np.ndarray, rows: slice) -> Tractions:
    """Return surface forces of some rows of the loads, with these wrenches."""
    place, mine = tractions.place[rows].copy(), wrench >= tractions.first
    wanted = place[mine]
    place[mine] = np.arange(len(wanted))

    def cut(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        count = len(tractions.force) // LANES
        whole = values.reshape(count, len(values) // max(count, 1))
        target = aligned_empty((len(wanted) * whole.shape[1],))
        target[:] = whole[wanted].ravel()
        return target

    return tractions._replace(
        place=place, turning=cut(tractions.turning), fixed=cut(tractions.fixed),
        sliding=cut(tractions.sliding), kept=cut(tractions.kept), force=cut(tractions.force),
        moment=cut(tractions.moment))


def _exchange(
    part: Part, number: np.ndarray, slot: np.ndarray, samples: np.ndarray
) -> Exchange:
    def slots(blocks: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(slot[number[blocks]], dtype=np.int32)

    return Exchange(
        first=int(number[part.first]), last=int(number[part.last - 1]) + 1,
        drifts=number[part.drifts].astype(np.uint32), border=part.border,
        inner=number[part.inner].astype(np.uint32), ahead=part.ahead,
        gives=tuple((rank, slots(blocks)) for rank, blocks in part.gives),
        needs=tuple((rank, slots(blocks)) for rank, blocks in part.needs),
        samples=slots(samples))


def _blocks(part: Part) -> np.ndarray:
    """Return the blocks of a window: its own and those that it reads."""
    return np.concatenate([np.arange(part.first, part.last), part.halo])
