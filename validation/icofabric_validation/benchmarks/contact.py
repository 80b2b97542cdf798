# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Time of contact per pair of shells, compared with the collision library coal, successor of FCL.

The library is called from Python for each pair, with all objects made before. Shells that are far
apart show the cost of such a call. Times are processor times of one thread, which vary less on a
shared machine.
"""

from collections.abc import Callable
from importlib import import_module
import time
from typing import Any, NamedTuple

from icofabric_sim.geometry.icosahedron import FACES, vertices
from icofabric_sim.libraries import install_command
from icofabric_sim.terms.contacts.many import apart_pairs, separations_on, touch_pairs
from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE
from icofabric_validation.benchmarks.contact_pairs import families, HALF_EDGE, Pairs
from icofabric_validation.benchmarks.timing import in_rounds, Spread
import numpy as np

LIBRARY = 'coal'
STORED_AXIS, APART = 'axis kept from before', 'whether they touch'
FORCE = 'force, torques and energy'
COLLIDE, DISTANCE = 'coal: collide', 'coal: distance or depth'
# Overlap above the accuracy of the library, over a.
_MIN_OVERLAP_RATIO = 1e-5
# Number of pairs for the library.
_LIBRARY_PAIRS = 5_000


class ContactTime(NamedTuple):
    """Times of one test of one family of pairs, one for each round."""

    family: str
    what: str
    times: list[float]  # [s] of the processor for each pair

    def per_pair(self) -> Spread:
        """Time per pair [ns]."""
        return Spread.of([1e9 * value for value in self.times])


class Contact(NamedTuple):
    """The results of all families."""

    rows: list[ContactTime]
    touching: dict[str, float]  # fraction of pairs in contact, by family
    missed: int  # pairs in contact only according to the library
    compared: int
    missing: str  # remedy if the library is missing; '': installed
    pair_count: int  # of each family
    rounds: int

    def row(self, family: str, what: str) -> ContactTime | None:
        """Return the row of a family."""
        return next((row for row in self.rows if (row.family, row.what) == (family, what)), None)

    def ratio(self, family: str, ours: str, theirs: str) -> Spread | None:
        """Return the time of the library over ours, round by round."""
        own, other = self.row(family, ours), self.row(family, theirs)
        if own is None or other is None:
            return None
        return Spread.of([two / one for one, two in zip(own.times, other.times)])


def measure(
    *, library: bool = True, rounds: int = 5, count: int = 20_000,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Contact:
    """Time all tests of all families of `count` pairs, in rounds."""
    say('compiling and placing pairs')
    coal, missing = None, ''
    if library:
        try:
            coal = import_module(LIBRARY)
        except ImportError:
            missing = f'{LIBRARY} is not installed: {install_command(LIBRARY)}'
    tasks: list[tuple[str, str, Callable[[], float]]] = []
    touching = {}
    missed = compared = 0
    for pairs in families(count):
        own = _Own(pairs)
        touching[pairs.label] = float(own.touching.mean())
        tasks += [(pairs.label, STORED_AXIS, own.keep), (pairs.label, APART, own.decide),
                  (pairs.label, FORCE, own.push)]
        if coal is not None:
            say(f'{LIBRARY} tests the same pairs')
            other = _Library(coal, pairs, min(count, _LIBRARY_PAIRS))
            missed += int((other.depths() & ~own.touching[:other.count]).sum())
            compared += other.count
            tasks += [(pairs.label, COLLIDE, other.collide),
                      (pairs.label, DISTANCE, other.measure)]
    times = in_rounds([task for _, _, task in tasks], rounds, progress)
    rows = [ContactTime(family, what, found)
            for (family, what, _), found in zip(tasks, times)]
    return Contact(rows, touching, missed, compared, missing, count, rounds)


class _Own:
    """The kernels of the package on one family."""

    def __init__(self, pairs: Pairs) -> None:
        count = len(pairs.xa)
        self._poses = np.full((count, 2), HALF_EDGE), pairs.xa, pairs.ra, pairs.xb, pairs.rb
        self._scratch = contact_scratch()
        self.touching, self._out = np.zeros(count, bool), np.zeros((count, OUT_SIZE))
        self._apart, self._gap = np.zeros(count, bool), np.zeros(count)
        self.push()
        self._axis = np.ascontiguousarray(self._out[:, 12:15])
        self.decide()
        self.keep()
        # Pairs that are apart must not be in contact.
        assert not (self._apart & self.touching).any()

    def keep(self) -> float:
        return self._timed(separations_on, *self._poses, self._axis, self._gap)

    def decide(self) -> float:
        return self._timed(apart_pairs, *self._poses, self._scratch, self._apart)

    def push(self) -> float:
        return self._timed(touch_pairs, *self._poses, self._scratch, self.touching, self._out)

    def _timed(self, kernel: Any, *arguments: Any) -> float:
        started = time.thread_time()
        kernel(*arguments)
        return (time.thread_time() - started) / len(self.touching)


class _Library:
    """The library on the first pairs of a family."""

    def __init__(self, coal: Any, pairs: Pairs, count: int) -> None:
        points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for vertex in vertices(HALF_EDGE):
            points.append(vertex)
        for face in FACES:
            triangles.append(coal.Triangle(*map(int, face)))
        # A reference is kept, because the searches only point to the shell.
        self._shell = shell = coal.Convex(points, triangles)
        self.count = count
        self._first = [coal.Transform3s(*pose) for pose in zip(pairs.ra[:count], pairs.xa)]
        self._second = [coal.Transform3s(*pose) for pose in zip(pairs.rb[:count], pairs.xb)]
        self._collide = coal.ComputeCollision(shell, shell)
        self._measure = coal.ComputeDistance(shell, shell)
        self._collision = coal.CollisionRequest(), coal.CollisionResult()
        self._distance = coal.DistanceRequest(), coal.DistanceResult()

    def depths(self) -> np.ndarray:
        """Return a mask of pairs that overlap by more than the accuracy of the library."""
        request, result = self._distance
        found = np.zeros(self.count)
        for k, (one, two) in enumerate(zip(self._first, self._second)):
            result.clear()
            found[k] = self._measure(one, two, request, result)
        # Failed searches give absurdly large depths.
        return (found < -_MIN_OVERLAP_RATIO * HALF_EDGE) & (found > -4.0 * HALF_EDGE)

    def collide(self) -> float:
        return self._timed(self._collide, *self._collision)

    def measure(self) -> float:
        return self._timed(self._measure, *self._distance)

    def _timed(self, call: Any, request: Any, result: Any) -> float:
        started = time.thread_time()
        for one, two in zip(self._first, self._second):
            result.clear()
            call(one, two, request, result)
        return (time.thread_time() - started) / self.count
