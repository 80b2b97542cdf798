# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Forces on the bodies, F(r, t) of eqs 15 and 47, that a user writes as Python functions."""

from collections.abc import Callable
import ctypes
import inspect
import math
from typing import Any, Final

from icofabric_sim import checks
from icofabric_sim.kernels.runtime.numba_private import is_compiling_disabled
from icofabric_sim.simulation.model.layout import aligned_empty, Layout
from icofabric_sim.terms.body_force.external_force import C_FUNCTION, call_function, External
import numba
from numba import carray, types
import numpy as np

Force = Callable[..., tuple[Any, Any]]
Potential = Callable[..., Any]

# Columns of the arguments: position, orientation, linear and angular velocity.
_PARTS: Final = (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13))
_C_TYPES = types.int64(
    types.float64, types.int64, types.CPointer(types.float64), types.CPointer(types.float64))
_ROW = types.Array(types.float64, 1, 'C')
# Largest difference of the results of both conventions, over the largest value.
_CONVENTION_TOLERANCE_RATIO = 1e-9
_JIT_IS_DISABLED = is_compiling_disabled()


class BodyForce:
    """
    A force and a torque on every body, as functions of time, pose and velocities.

    `force(time, position, orientation, linear_velocity, angular_velocity)` returns the force [N]
    and the torque about the centre [N m], world frame, SI units. The result must depend on these
    arguments only. If the function has a sixth argument `body`, it gets the number of the body, or
    the numbers of all bodies (n,).

    If Numba can compile `force`, kernels call the compiled function for one body at a time, with
    arrays (3,), (3,), (4,), (3,), (3,); the function returns two vectors or tuples of three
    numbers. Otherwise Python calls `force` with all bodies, (n, 3), (n, 3), (n, 4) x y z w, (n,
    3), (n, 3); the function returns two arrays (n, 3). If that call fails, Python calls `force`
    for one body at a time. `compiled` selects one of these conventions: True for the first, False
    for the second. A function that accepts both conventions with different results raises an error
    unless `compiled` is given.

    The work of the force counts as external work. If the force has a potential that does not
    depend on time, give `potential(time, position, orientation)`, which returns energies [J] in
    the same convention and may have an argument `body`, too. The potential is then part of the
    energy.
    """

    def __init__(
        self, force: Force, *, potential: Potential | None = None, compiled: bool | None = None
    ) -> None:
        """Store the functions; a scene compiles and calls them later."""
        checks.function('force', force)
        if potential is not None:
            checks.function('potential', potential)
        if compiled is not None:
            compiled = checks.flag('compiled', compiled)
        self.force, self.potential, self._wanted = force, potential, compiled
        self.name = getattr(force, '__name__', type(force).__name__)
        self.label = f'body_force {self.name}'  # in messages
        self._takes_body, self._potential_takes_body = takes_body(force), takes_body(potential)
        # True if Numba has compiled the function; None before a scene is compiled.
        self.is_compiled: bool | None = None
        # True if the function is called for one body at a time; set by `prepare`.
        self.is_by_body = False
        # Number of rows (13,) of profiles that the function gets as its last argument; 0: none.
        self.profile_count = 0
        self._compiled: Any = None  # compiled code that calls the function for each body
        self._keep: list[Any] = []  # objects that compiled code points to
        self._error: BaseException | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the functions without compiled code, which is valid in one process only."""
        return {**vars(self), 'is_compiled': None, '_compiled': None, '_keep': [], '_error': None}

    def prepare(
        self, layout: Layout, numbers: np.ndarray, time: float = 0.0
    ) -> External:
        """
        Compile the function if possible, and call it once.

        Parameters
        ----------
        layout
            Slots of the bodies.
        numbers
            Initial state, (n, 13): position, orientation, velocity, angular velocity.
        time
            Time [s] of this call, from which on the force acts.

        Returns
        -------
        External
            Record of the function for kernels.

        Raises
        ------
        ValueError
            The function fails, or does not return finite forces and torques.
        """
        checks.instance('layout', layout, Layout)
        time = checks.number('time', time, unit='s')
        numbers = checks.array('numbers', numbers, ('n', 13))
        count = len(numbers)
        if self.profile_count:
            # Rows of profiles follow those of the bodies, where the function finds them.
            rows = np.zeros((self.profile_count, 13))
            rows[:, 1] = 1.0
            numbers = np.vstack([numbers, rows])[:count]
        result = np.zeros((count, 6))
        external = External(
            0, layout.slot, numbers, result, aligned_empty((6, layout.slot_count)),
            np.zeros(1, np.int64), np.zeros(1))
        external.rows[:] = 0.0
        self.compile()
        self.is_by_body = self.is_compiled or bool(_JIT_IS_DISABLED and self._wanted) or (
            self._wanted is None and self._takes_only_one(numbers))
        if self._compiled is not None:
            address = self._compiled.address
        else:
            self._keep.append(C_FUNCTION(self._python(external)))
            address = ctypes.cast(self._keep[-1], ctypes.c_void_p).value
            assert address is not None
        external = external._replace(address=int(address))
        self._try(external, time)
        try:
            start = self.energy(time, numbers[:, _PARTS[0]], numbers[:, _PARTS[1]])
        except Exception as error:  # noqa: BLE001 - code of the user
            raise ValueError(
                self._sentence(external, f'its potential: {_words(error)}')) from error
        if not math.isfinite(start):
            raise ValueError(self._sentence(external, f'its potential is {start} J at the start'))
        return external

    def _rows(self, external: External) -> np.ndarray:
        """Return the rows of profiles behind those of the bodies."""
        count, whole = len(external.numbers), external.numbers.base
        return np.zeros((0, 13)) if not self.profile_count or whole is None else whole[count:]

    def compile(self) -> None:
        """Compile the function if possible, once; raise ValueError if that was requested."""
        if self._wanted is not False and not _JIT_IS_DISABLED and self.is_compiled is None:
            self._compiled = self._compile()
            if self._compiled is None and self._wanted:
                raise ValueError(f'{self.label} cannot be compiled: {self._error}')
        self.is_compiled = self._compiled is not None

    def energy(self, time: float, position: np.ndarray, orientation: np.ndarray) -> float:
        """
        Return the potential energy [J] of all bodies; 0 without a potential.

        Parameters
        ----------
        time
            Simulated time [s].
        position
            Centres [m], (n, 3), world frame.
        orientation
            Unit quaternions x, y, z, w, (n, 4).

        Returns
        -------
        float
            Energy [J].
        """
        time = checks.number('time', time, unit='s')
        position = checks.array('position', position, ('n', 3), 'm')
        orientation = checks.array('orientation', orientation, (len(position), 4))
        if self.potential is None:
            return 0.0
        bodies = np.arange(len(position))
        if not self.is_by_body:
            found = np.asarray(self._potential_at(time, position, orientation, bodies))
            if found.dtype.kind not in 'iuf' or found.shape not in ((), (len(position),)):
                raise ValueError(
                    f'the potential of {self.label} must return energies [J] of '
                    f'{len(position)} bodies, got {checks.shown(found)}')
            return float(np.sum(found))
        return float(sum(
            checks.number(f'the result of the potential of {self.label}', self._potential_at(
                time, *each), unit='J') for each in zip(position, orientation, bodies)))

    def _potential_at(self, time: float, *state: Any) -> Any:
        assert self.potential is not None
        return self.potential(time, *(state if self._potential_takes_body else state[:-1]))

    def explain(self, external: External) -> str:
        """
        Return a sentence on why the function failed.

        Parameters
        ----------
        external
            The record that `prepare` has made.

        Returns
        -------
        str
            Sentence for an error message.
        """
        checks.instance('external', external, External)
        error: BaseException | None = self._error
        if error is None:
            # Compiled code gives no reason: call the Python function.
            for body, row in enumerate(external.numbers):
                try:
                    found = self._of_body(
                        external.moment[0], row, body, self._rows(external))
                except Exception as raised:  # noqa: BLE001 - code of the user
                    return self._sentence(external, f'{_words(raised)} (for body {body})')
                if not np.isfinite(found).all():
                    return self._sentence(external, f'it is not finite for body {body}: {found}')
            return self._sentence(external, 'it failed')
        return self._sentence(external, _words(error))

    def _takes_only_one(self, numbers: np.ndarray) -> bool:
        """Return True if Python can call the function for one body but not for all at once."""
        for call, state in ((self._of_all, numbers), (self._of_body, numbers[0])):
            try:
                call(0.0, state)
            except Exception:  # noqa: BLE001 - reported by the call for all bodies
                continue
            return call == self._of_body
        return False

    def _sentence(self, external: External, what: str) -> str:
        return f'{self.label} failed at t = {external.moment[0]:.9g} s: {what}'

    def _compile(self) -> Any:
        """Compile a C function for all bodies; return None and store the error if Numba fails."""
        force: Any = self.force
        try:
            single = force if hasattr(force, 'py_func') else numba.njit(force)
            single.compile((
                types.float64, *[_ROW] * 4, *[types.int64] * self._takes_body,
                *[types.Array(types.float64, 2, 'C')] * bool(self.profile_count)))
            # The result must be two vectors, too.
            loop = _loop(single, self._takes_body, self.profile_count)
        except Exception as error:  # noqa: BLE001 - Numba raises many types
            self._error = ValueError(_words(error).split('\n')[0])
            return None
        self._error = None
        return loop

    def _python(self, external: External) -> Callable[..., int]:
        """Return a callback that passes all bodies to the Python function and stores errors."""
        def call(time: float, count: int, numbers: int, result: int) -> int:
            try:
                if self.is_by_body:
                    for body, row in enumerate(external.numbers):
                        external.result[body] = self._of_body(
                            time, row, body, self._rows(external))
                else:
                    external.result[:] = self._of_all(time, external.numbers)
                wrong = np.flatnonzero(~np.isfinite(external.result).all(axis=1))
                if len(wrong):
                    raise ValueError(f'it is not finite for body {wrong[0]}')
            except BaseException as error:  # noqa: BLE001 - no exception may cross compiled code
                self._error = error
                return 1
            return 0
        self._error = None
        return call

    def _of_all(self, time: float, numbers: np.ndarray) -> np.ndarray:
        parts = [numbers[:, part].copy() for part in _PARTS]
        bodies = [np.arange(len(numbers))] * self._takes_body
        return self._judged(self.force(time, *parts, *bodies), (len(numbers), 3))

    def _of_body(
        self, time: float, row: np.ndarray, body: int = 0, rows: np.ndarray | None = None
    ) -> np.ndarray:
        force: Any = self.force
        function = getattr(force, 'py_func', force)
        parts = [row[part].copy() for part in _PARTS]
        more = [body] * self._takes_body + [rows] * bool(self.profile_count)
        return self._judged(function(time, *parts, *more), (3,))

    def _judged(self, found: Any, shape: tuple[int, ...]) -> np.ndarray:
        try:
            force, torque = (np.asarray(part, float) for part in found)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f'it must return a force and a torque, two arrays {shape}') from error
        if force.shape != shape or torque.shape != shape:
            raise ValueError(
                f'it must return a force and a torque, two arrays {shape}, not {force.shape} and '
                f'{torque.shape}')
        return np.concatenate([force, torque], axis=-1)

    def _try(self, external: External, time: float) -> None:
        """Call the function once with the initial state."""
        if self.is_compiled:
            # Compiled code would not detect missing values.
            try:
                self._of_body(time, external.numbers[0], 0, self._rows(external))
            except Exception as error:  # noqa: BLE001 - code of the user
                raise ValueError(self._sentence(external, _words(error))) from error
        external.moment[0] = time
        function = C_FUNCTION(external.address)
        status = function(
            time, len(external.numbers), external.numbers.ctypes.data, external.result.ctypes.data)
        if status:
            raise ValueError(self.explain(external))
        if self._wanted is not None or not self.is_compiled:
            return
        try:
            other = self._of_all(time, external.numbers)
        except Exception:  # noqa: BLE001 - the function is for one body
            return
        size = np.abs(external.result).max(initial=0.0)
        difference = np.abs(other - external.result).max(initial=0.0)
        if not difference <= _CONVENTION_TOLERANCE_RATIO * size:
            raise ValueError(
                f'{self.label} can be called for one body and for all at once, but '
                'gives different forces: say which is meant with '
                'BodyForce(..., compiled=True) for one, False for all')


def takes_body(function: Any) -> bool:
    """Return True if a function has an argument `body`."""
    try:
        return 'body' in inspect.signature(getattr(function, 'py_func', function)).parameters
    except (TypeError, ValueError):
        return False


class SummedForce(BodyForce):
    """The sum of several body forces; the work of all counts as external work."""

    def __init__(self, *parts: BodyForce) -> None:
        """Add up `parts`."""
        super().__init__(self._no_force)
        self.label = ' and '.join(part.label for part in parts)
        self.profile_count = sum(part.profile_count for part in parts)
        self._summed = parts
        self._externals: list[External] = []

    @staticmethod
    def _no_force(*state: Any) -> Any:
        """Stand for the functions of the parts."""

    def prepare(
        self, layout: Layout, numbers: np.ndarray, time: float = 0.0
    ) -> External:
        """Prepare each part, and return the record of a function that calls all."""
        external = External(
            0, layout.slot, numbers, np.zeros((len(numbers), 6)),
            aligned_empty((6, layout.slot_count)), np.zeros(1, np.int64), np.zeros(1))
        external.rows[:] = 0.0
        externals = [part.prepare(layout, numbers.copy(), time) for part in self._summed]

        def call(time: float, count: int, given: int, result: int) -> int:
            external.result[:] = 0.0
            for part in externals:
                part.numbers[:], part.moment[0], part.status[0] = external.numbers, time, 0
                if call_function(part.address, time, part.numbers, part.result):
                    part.status[0] = 1
                    return 1
                external.result[:] += part.result
            return 0

        function = C_FUNCTION(call)
        self._keep.append(function)
        self._externals = externals
        self.is_compiled = all(part.is_compiled for part in self._summed)
        self.is_by_body = all(part.is_by_body for part in self._summed)
        return external._replace(address=ctypes.cast(function, ctypes.c_void_p).value or 0)

    def explain(self, external: External) -> str:
        """Return a sentence on why a part failed."""
        return next((
            part.explain(own) for part, own in zip(self._summed, self._externals)
            if own.status[0]), f'{self.label} failed')


def as_body_force(force: 'BodyForce | Force | None') -> BodyForce | None:
    """Return a function as a body force without a potential."""
    if force is None or isinstance(force, BodyForce):
        return force
    return BodyForce(checks.function('body_force', force, 'a function or a BodyForce'))


def set_profiles(force: BodyForce, external: External, table: np.ndarray) -> None:
    """Set the present segments (p, 6) of the profiles of a body force in its record."""
    if isinstance(force, SummedForce):
        for part, own in zip(force._summed, force._externals):
            set_profiles(part, own, table)
    elif force.profile_count:
        force._rows(external)[:, :6] = table


def _loop(single: Any, takes_body: bool, profile_count: int) -> Any:
    """Return a C function that calls a compiled function for each body."""
    def without_profiles(  # type: ignore[no-untyped-def]
        time, position, orientation, linear_velocity, angular_velocity, body, profiles
    ):
        if takes_body:
            return single(time, position, orientation, linear_velocity, angular_velocity, body)
        return single(time, position, orientation, linear_velocity, angular_velocity)

    call_one = single if profile_count else numba.njit(without_profiles)

    @numba.cfunc(_C_TYPES)
    def call(time, count, numbers, result):  # type: ignore[no-untyped-def]
        given = carray(numbers, (count + profile_count, 13))
        target = carray(result, (count, 6))
        for b in range(count):
            try:
                force, torque = call_one(
                    time, given[b, 0:3], given[b, 3:7], given[b, 7:10], given[b, 10:13], b,
                    given[count:])
            except Exception:  # noqa: BLE001 - `explain` finds the reason
                return 1
            for k in range(3):
                target[b, k] = force[k]
                target[b, 3 + k] = torque[k]
                if not (np.isfinite(force[k]) and np.isfinite(torque[k])):
                    return 1
        return 0
    return call


def _words(error: BaseException) -> str:
    return f'{type(error).__name__}: {error}' if str(error) else type(error).__name__
