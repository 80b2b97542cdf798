# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Many runs of one scene: what is not in the store is handed out, all of it becomes a table."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
import os
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim import checks
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.scene import check_parameters, estimate_bodies, require_scene, Scene
from icofabric_sim.sweeps.dask_runs import pool
from icofabric_sim.sweeps.outcomes import check_end, check_work, make_work, Work
from icofabric_sim.sweeps.plan import make_plan, Plan
from icofabric_sim.sweeps.run_key import key_of, surroundings
from icofabric_sim.sweeps.single_run import Order, Outcome, outcome_of, perform, State
from icofabric_sim.sweeps.store import Store
from icofabric_sim.sweeps.table import SweepTable

# Fabrics up to this size are all built before anything starts, to be sure of them: some
# milliseconds each. Of larger ones, and of more runs, parameters are judged alone.
_BUILT, _BUILT_RUNS = 5_000, 20_000
_PLACE = Path('runs/sweep')
# A study asks for at most so many workers.
_MOST_WORKERS = 4096
Judged = Callable[[int, int], None]


def sweep(
    scene: Scene, vary: Mapping[str, Any] | None = None, *,
    verbs: str | Sequence[str] = ('run',), keep: str | Sequence[str] | None = None,
    cases: Sequence[Mapping[str, Any]] | None = None, sample: Mapping[str, Any] | None = None,
    workers: int | None = None, scheduler: str = '',
    store: str | os.PathLike[str] = _PLACE, retry: bool = False,
    progress: Callable[[int, int], None] | None = None
) -> SweepTable:
    """
    Run a scene for many values of its parameters.

    Results are bit-identical for any number of workers.

    Parameters
    ----------
    scene
        The scene.
    vary
        Values of each parameter, `{'connector.stiffness': [300.0, 500.0]}`, or a range,
        `{'weave.connector_angle': '0.1..0.7/13'}`; several parameters span a grid.
    verbs
        Computations of each run: run, statics, modes, elasticity, bands, curve.
    keep
        Results to keep, such as 'energies', 'displacement tip', 'frequencies 6', 'bag'.
    cases
        Sets of parameter values that belong together.
    sample
        Sampling of ranges without a count: `{'method': 'sobol', 'count': 64, 'seed': 0}`.
    workers
        Number of Dask processes (extra `sweep`); None: one a core; 0: this process.
    scheduler
        Address of a Dask scheduler whose workers compute the runs.
    store
        Folder of the results; runs found there are not repeated.
    retry
        True: repeat runs of the store that failed.
    progress
        Called with the number of finished runs and of all runs.

    Returns
    -------
    SweepTable
        A row for each run.

    Raises
    ------
    ValueError
        A run is not possible as described; nothing has started.
    """
    if progress is not None:
        checks.function('progress', progress)
    checks.flag('retry', retry)
    how = how_to_run(workers, scheduler)
    study = Study(
        scene, vary, verbs=verbs, keep=keep, cases=cases, sample=sample, store=store)
    outcomes: list[Outcome] = []
    for outcome in study.outcomes(how, retry=retry):
        outcomes.append(outcome)
        if progress is not None:
            progress(len(outcomes), len(study.orders))
    return study.table(outcomes)


class How(NamedTuple):
    """Number of local workers, and address of a scheduler."""

    workers: int
    scheduler: str


def how_to_run(workers: int | None, scheduler: str) -> How:
    """Judge who does the runs; by default a process for each core."""
    checks.text('scheduler', scheduler, "the address of a scheduler of Dask, or '' for none")
    if workers is None:
        return How(len(os.sched_getaffinity(0)), scheduler)
    if scheduler:
        raise ValueError('workers: those of the scheduler are taken; leave workers out')
    return How(checks.count('workers', workers, 0, _MOST_WORKERS), '')


class Study:
    """A plan that has been judged: every run is known, with its key."""

    def __init__(
        self, scene: Scene, vary: Mapping[str, Any] | None = None, *, verbs: Any = ('run',),
        keep: Any = None, cases: Any = None, sample: Any = None,
        store: str | os.PathLike[str] = _PLACE
    ) -> None:
        """Judge it all; ValueError (mostly ParameterError) names the run and the parameter."""
        require_scene(scene)
        own, _ = check_parameters(scene.parameters)
        if own != scene.shell:
            raise ValueError(
                'scene: a Shell object cannot be swept, because a shell is no '
                'parameter; describe it by shell.thickness, shell.density, shell.mass, '
                'shell.inertia')
        self._prepare(scene.parameters, scene.files, vary, verbs, keep, cases, sample, store)

    @classmethod
    def from_parameters(
        cls, parameters: Parameters, vary: Mapping[str, Any] | None = None, *,
        verbs: Any = ('run',), keep: Any = None, cases: Any = None, sample: Any = None,
        store: str | os.PathLike[str] = _PLACE, judged: Judged | None = None
    ) -> 'Study':
        """
        Make a study of parameters that may be incomplete without the varied ones.

        `judged` is called with the number of validated runs and of all runs.
        """
        study = cls.__new__(cls)
        study._prepare(parameters, {}, vary, verbs, keep, cases, sample, store, judged)
        return study

    def _prepare(
        self, base: Parameters, files: Mapping[str, Any], vary: Any, verbs: Any, keep: Any,
        cases: Any, sample: Any, store: str | os.PathLike[str], judged: Judged | None = None
    ) -> None:
        self.store = Store(checks.path('store', store, 'the path of a folder'))
        if self.store.path.exists() and not self.store.path.is_dir():
            raise ValueError(f'store {self.store.path} is not a folder; choose another place')
        self.work: Work = make_work(verbs, keep)
        self.plan: Plan = make_plan(base, vary=vary, cases=cases, sample=sample)
        self._contents: dict[str, bytes] = {}
        self._kinds: dict[str, int] = {}
        self._files_of: dict[tuple[Any, ...], dict[str, str]] = {}
        around = surroundings()
        self.orders: list[Order] = []
        for number in range(len(self.plan.points)):
            try:
                self.orders.append(self._order(number, files, around))
            except ParameterError as error:
                raise ParameterError(
                    error.name, f'{self.plan.describe(number)}: {error}') from error
            except ValueError as error:
                raise ValueError(f'{self.plan.describe(number)}: {error}') from error
            if judged is not None:
                judged(number + 1, len(self.plan.points))
        self.kinds = len(set(self._kinds.values()))

    def _order(
        self, number: int, files: Mapping[str, Any], around: Mapping[str, str]
    ) -> Order:
        parameters = replace(self.plan.parameters(number), files=files)
        check_end(self.work, parameters)
        texts = tuple(value for value in parameters.values() if isinstance(value, str))
        known = self._files_of.get(texts)
        is_small = len(self.plan.points) <= _BUILT_RUNS and (
            estimate_bodies(parameters) <= _BUILT)
        if known is None or is_small:
            built = Scene.from_parameters(parameters)
            check_work(self.work, built)
            known = {name: file.total for name, file in built.files.items()}
            self._files_of[texts] = known
            for file in built.files.values():
                if file.content is None:
                    raise ValueError('a file that was recorded without its contents is needed')
                self._contents[file.total] = file.content
        else:
            check_parameters(parameters)
        key = key_of(parameters, known, self.work, around)
        self._kinds[key] = hash(_kind(parameters))
        return Order(
            number, key, parameters.given(), known, self.work, around, str(self.store.path))

    def finished(self) -> dict[int, Outcome]:
        """Return the runs of this study that the store has, by number."""
        keys = self.store.keys()
        found: dict[int, Outcome] = {}
        for order in self.orders:
            if order.key in keys and (there := self.store.read(order.key)) is not None:
                found[order.number] = outcome_of(order.number, order.key, there, reused=True)
        return found

    def outcomes(self, how: How, *, retry: bool = False) -> Iterator[Outcome]:
        """Do what is not done yet; yields every run of the study once."""
        self.store.prepare()
        for total, content in self._contents.items():
            self.store.keep_file(total, content)
        done = self.finished()
        if retry:
            # What is there is removed by who does the run again, and holds it.
            done = {number: one for number, one in done.items() if one.state is not State.FAILED}
        yield from done.values()
        # Points that are alike are one run.
        same: dict[str, list[Order]] = {}
        for order in self.orders:
            if order.number not in done:
                same.setdefault(order.key, []).append(order)
        identity = self.store.identity
        todo = [orders[0]._replace(identity=identity, retry=retry) for orders in same.values()]
        if not todo:
            return
        for outcome in self._do(todo, how):
            for order in same[outcome.key]:
                yield outcome._replace(number=order.number)

    def _do(self, todo: Sequence[Order], how: How) -> Iterator[Outcome]:
        if not how.workers and not how.scheduler:
            for order in todo:
                outcome = perform(order)
                while outcome.state is State.BUSY:
                    time_to_wait()
                    outcome = perform(order)
                yield outcome
            return
        with pool(workers=min(how.workers, len(todo)), scheduler=how.scheduler) as workers:
            workers.check(self.store.path)
            yield from workers.perform(*self._by_kind(todo))

    def _by_kind(
        self, todo: Sequence[Order]
    ) -> tuple[list[Order], dict[int, list[Order]]]:
        """Return the first run of each kernel variant, which compiles, and the waiting runs."""
        places: dict[int, int] = {}
        leaders: list[Order] = []
        followers: dict[int, list[Order]] = {}
        for order in todo:
            kind = self._kinds[order.key]
            if kind in places:
                followers[places[kind]].append(order)
            else:
                places[kind] = len(leaders)
                followers[len(leaders)] = []
                leaders.append(order)
        return leaders, followers

    def table(self, outcomes: Sequence[Outcome]) -> SweepTable:
        """Return the outcomes so far."""
        return SweepTable(self.plan, outcomes, store=self.store.path)


def _kind(parameters: Parameters) -> tuple[Any, ...]:
    """
    Return the key of the kernel variant: texts, flags, and which numbers differ from 0.

    Integers (`weave.size`, seeds) do not change kernels.
    """
    found: list[Any] = []
    for name, value in sorted(parameters.items()):
        for element in value if isinstance(value, list) else [value]:
            if isinstance(element, (str, bool)):
                found.append((name, element))
            elif isinstance(element, float):
                found.append((name, element != 0.0))
    return tuple(found)


def time_to_wait() -> None:
    """Wait a little for a run that another study is at."""
    import time
    time.sleep(0.2)
