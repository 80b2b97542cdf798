# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Changes of a running scene: built aside in a thread of their own, swapped in between two steps.
"""

from collections.abc import Callable
import threading

from icofabric_sim.parameters import Parameters
from icofabric_sim.scene import Scene
from icofabric_sim.simulation import compile_scene, Simulation

# Parameters that concern the runner alone: the fabric is not touched.
_RUNNER_NAMES = frozenset({
    'publish_rate', 'marker_rate', 'clock_rate', 'real_time_factor', 'duration', 'step_count',
    'input_horizon', 'reset_time',
})
# A change of these restarts the motion: there are other bodies.
_WEAVE_PREFIXES = ('weave.', 'shell.', 'bodies.')


def changed_names(before: Parameters, after: Parameters) -> set[str]:
    """
    Names whose values differ, or that only one of the two has.
    """
    return {name for name in {*before, *after} if before.get(name) != after.get(name)}


def concerns_runner_only(before: Parameters, after: Parameters) -> bool:
    """
    Whether rates, pace or duration are all that changes.
    """
    return changed_names(before, after) <= _RUNNER_NAMES


def with_rates(current: Parameters, wanted: Parameters) -> Parameters:
    """
    The `current` set with the rates, pace and duration of the `wanted` one.
    """
    names = changed_names(current, wanted) & _RUNNER_NAMES
    return current.with_changes({name: wanted[name] for name in names}) if names else current


def restarts_motion(before: Parameters, after: Parameters) -> bool:
    """
    Whether the change from one set to the other weaves the fabric anew.
    """
    return any(name.startswith(_WEAVE_PREFIXES) for name in changed_names(before, after))


class Reweaver:
    """
    Builds the wanted scene; what is wanted while a build is under way becomes one more build.
    """

    def __init__(
        self,
        post: Callable[[Callable[[], None]], object],
        on_ready: Callable[[Parameters, Simulation | None, str], None],
    ) -> None:
        """
        `post` brings a call into the runner's thread, where `on_ready` hears of each result.

        The result is the simulation, or None and the reason.
        """
        self._post = post
        self._on_ready = on_ready
        self._wanted: Parameters | None = None

    def want(self, parameters: Parameters) -> None:
        """
        Build the scene of `parameters`; from the runner's thread.
        """
        idle = self._wanted is None
        self._wanted = parameters
        if idle:
            self._build(parameters)

    @property
    def wanted(self) -> Parameters | None:
        """
        What is being built, with all that was accepted meanwhile; None while nothing is.
        """
        return self._wanted

    def amend(self, parameters: Parameters) -> None:
        """
        Let a change of rates also reach a build under way, which need not begin anew for it.
        """
        if self._wanted is not None:
            self._wanted = parameters

    def _build(self, parameters: Parameters) -> None:
        def build() -> None:
            simulation, reason = None, ''
            try:
                simulation = compile_scene(Scene.from_parameters(parameters), body_wrenches=True)
                simulation.warm_up()
            except Exception as error:  # noqa: BLE001 - reported, the old fabric runs on
                simulation, reason = None, str(error) or type(error).__name__
            self._post(lambda: self._finish(parameters, simulation, reason))

        threading.Thread(target=build, name='weave', daemon=True).start()

    def _finish(self, built: Parameters, simulation: Simulation | None, reason: str) -> None:
        wanted, self._wanted = self._wanted, None
        if wanted is None:
            wanted = built
        if not concerns_runner_only(built, wanted):
            self.want(wanted)
            return
        self._on_ready(wanted, simulation, reason)
