# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the runs of a sweep that the store lacks, and collect all results in a table."""

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
from icofabric_sim.sweeps.run_key import key_of, run_environment
from icofabric_sim.sweeps.single_run import Outcome, outcome_of, perform, RunRequest, State
from icofabric_sim.sweeps.store import Store
from icofabric_sim.sweeps.table import SweepTable

# Up to this number of bodies and runs, all fabrics are built before the first run starts, in some
# milliseconds each. For larger fabrics or more runs only the parameters are validated.
_BUILT, _BUILT_RUNS = 5_000, 20_000
_PLACE = Path('runs/sweep')
_MAX_WORKERS = 4096
ValidationCallback = Callable[[int, int], None]


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
        Computations of each run: run, statics, modes, elasticity, bands, curve, mechanisms.
    keep
        Results to keep, such as 'energies', 'displacement tip', 'frequencies 6', 'bag'; all are
        listed in docs/howto/sweep.md. None: the default results of each verb.
    cases
        Combinations of parameter values; each is combined with all values of `vary`.
    sample
        Sampling of ranges without a count: `{'method': 'sobol', 'count': 64, 'seed': 0}`.
    workers
        Number of Dask processes (extra `sweep`); None: one per core; 0: this process.
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
        The parameters of a run are invalid (before any run starts).
    WorkersDiffer
        Source, libraries, processor target or store of a worker differ.
    SchedulerLost
        The Dask scheduler or all its workers were lost, or no worker connected.
    """
    if progress is not None:
        checks.function('progress', progress)
    checks.flag('retry', retry)
    executor = make_executor(workers, scheduler)
    study = Study(
        scene, vary, verbs=verbs, keep=keep, cases=cases, sample=sample, store=store)
    outcomes: list[Outcome] = []
    for outcome in study.outcomes(executor, retry=retry):
        outcomes.append(outcome)
        if progress is not None:
            progress(len(outcomes), len(study.requests))
    return study.table(outcomes)


class Executor(NamedTuple):
    """Number of local workers, and address of a scheduler."""

    workers: int
    scheduler: str


def make_executor(workers: int | None, scheduler: str) -> Executor:
    """Validate workers and scheduler; by default there is one worker per core."""
    checks.text('scheduler', scheduler, "the address of a Dask scheduler, or '' for none")
    if workers is None:
        return Executor(len(os.sched_getaffinity(0)), scheduler)
    if scheduler:
        raise ValueError(
            'workers cannot be combined with scheduler, which has its own workers')
    return Executor(checks.count('workers', workers, 0, _MAX_WORKERS), '')


class Study:
    """Validated runs of a sweep, each with its key."""

    def __init__(
        self, scene: Scene, vary: Mapping[str, Any] | None = None, *, verbs: Any = ('run',),
        keep: Any = None, cases: Any = None, sample: Any = None,
        store: str | os.PathLike[str] = _PLACE
    ) -> None:
        """Validate all runs. Raise ValueError that names the run and the parameter."""
        require_scene(scene)
        own, _ = check_parameters(scene.parameters)
        if own != scene.shell:
            raise ValueError(
                'scene: a scene built with a custom Shell object cannot be swept; describe '
                'the shell by shell.thickness, shell.density, shell.mass, shell.inertia')
        self._prepare(scene.parameters, scene.files, vary, verbs, keep, cases, sample, store)

    @classmethod
    def from_parameters(
        cls, parameters: Parameters, vary: Mapping[str, Any] | None = None, *,
        verbs: Any = ('run',), keep: Any = None, cases: Any = None, sample: Any = None,
        store: str | os.PathLike[str] = _PLACE, on_validated: ValidationCallback | None = None
    ) -> 'Study':
        """
        Return a sweep of parameters that may be valid only with the varied values.

        `on_validated` is called with the number of validated runs and of all runs.
        """
        study = cls.__new__(cls)
        study._prepare(parameters, {}, vary, verbs, keep, cases, sample, store, on_validated)
        return study

    def _prepare(
        self, base: Parameters, files: Mapping[str, Any], vary: Any, verbs: Any, keep: Any,
        cases: Any, sample: Any, store: str | os.PathLike[str],
        on_validated: ValidationCallback | None = None
    ) -> None:
        self.store = Store(checks.path('store', store, 'the path of a folder'))
        if self.store.path.exists() and not self.store.path.is_dir():
            raise ValueError(f'store {self.store.path} is not a folder; choose another path')
        self.work: Work = make_work(verbs, keep)
        self.plan: Plan = make_plan(base, vary=vary, cases=cases, sample=sample)
        self._contents: dict[str, bytes] = {}
        self._kernel_variants: dict[str, int] = {}
        self._files_of: dict[tuple[Any, ...], dict[str, str]] = {}
        environment = run_environment()
        self.requests: list[RunRequest] = []
        for number in range(len(self.plan.points)):
            try:
                self.requests.append(self._request(number, files, environment))
            except ParameterError as error:
                raise ParameterError(
                    error.name, f'{self.plan.describe(number)}: {error}') from error
            except ValueError as error:
                raise ValueError(f'{self.plan.describe(number)}: {error}') from error
            if on_validated is not None:
                on_validated(number + 1, len(self.plan.points))
        self.kernel_variant_count = len(set(self._kernel_variants.values()))

    def _request(
        self, number: int, files: Mapping[str, Any], environment: Mapping[str, str]
    ) -> RunRequest:
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
            for name, file in built.files.items():
                if file.content is None:
                    raise ValueError(
                        f'the scene needs {name}, which its bag does not contain')
                self._contents[file.total] = file.content
        else:
            check_parameters(parameters)
        key = key_of(parameters, known, self.work, environment)
        self._kernel_variants[key] = hash(_kernel_variant(parameters))
        return RunRequest(
            number, key, parameters.given(), known, self.work, environment, str(self.store.path))

    def finished(self) -> dict[int, Outcome]:
        """Return the runs of this sweep that the store has, by number."""
        keys = self.store.keys()
        return {
            request.number: outcome_of(request.number, request.key, there, reused=True)
            for request in self.requests
            if request.key in keys and (there := self.store.read(request.key)) is not None}

    def outcomes(self, executor: Executor, *, retry: bool = False) -> Iterator[Outcome]:
        """Compute missing runs; yield the outcome of every run once."""
        self.store.prepare()
        for total, content in self._contents.items():
            self.store.keep_file(total, content)
        done = self.finished()
        if retry:
            # The process that repeats a failed run removes its folder, under a lock.
            done = {number: one for number, one in done.items() if one.state is not State.FAILED}
        yield from done.values()
        # Equal points are computed once.
        same: dict[str, list[RunRequest]] = {}
        for request in self.requests:
            if request.number not in done:
                same.setdefault(request.key, []).append(request)
        identity = self.store.identity
        todo = [requests[0]._replace(identity=identity, retry=retry) for requests in same.values()]
        if not todo:
            return
        for outcome in self._compute(todo, executor):
            for request in same[outcome.key]:
                yield outcome._replace(number=request.number)

    def _compute(self, todo: Sequence[RunRequest], executor: Executor) -> Iterator[Outcome]:
        if not executor.workers and not executor.scheduler:
            for request in todo:
                outcome = perform(request)
                while outcome.state is State.BUSY:
                    wait_for_other_process()
                    outcome = perform(request)
                yield outcome
            return
        with pool(
                workers=min(executor.workers, len(todo)),
                scheduler=executor.scheduler) as workers:
            workers.check(self.store.path)
            yield from workers.perform(*self._by_kernel_variant(todo))

    def _by_kernel_variant(
        self, todo: Sequence[RunRequest]
    ) -> tuple[list[RunRequest], dict[int, list[RunRequest]]]:
        """Return the first run of each kernel variant, which compiles, and the waiting runs."""
        places: dict[int, int] = {}
        leaders: list[RunRequest] = []
        followers: dict[int, list[RunRequest]] = {}
        for request in todo:
            kind = self._kernel_variants[request.key]
            if kind in places:
                followers[places[kind]].append(request)
            else:
                places[kind] = len(leaders)
                followers[len(leaders)] = []
                leaders.append(request)
        return leaders, followers

    def table(self, outcomes: Sequence[Outcome]) -> SweepTable:
        """Return the table of these outcomes."""
        return SweepTable(self.plan, outcomes, store=self.store.path)


def _kernel_variant(parameters: Parameters) -> tuple[Any, ...]:
    """
    Return the key of the kernel variant: strings, flags, and which numbers differ from 0.

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


def wait_for_other_process() -> None:
    """Wait shortly for a run that another process computes."""
    import time
    time.sleep(0.2)
