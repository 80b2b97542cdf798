# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Exudyn: rigid bodies with rotation vectors and Lie group integration, and spring-dampers."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from icofabric_sim.libraries import install_command
from icofabric_validation.benchmarks.scenes import Motion, PlainScene
from icofabric_validation.benchmarks.solver import Solver, StepSolver, Unusable
import numpy as np

DISTRIBUTION = 'exudyn'
INSTALL = install_command('exudyn')
# Explicit integrator, order, evaluations per step, and initial step times frequency.
_INTEGRATORS = {'VelocityVerlet': (2, 1, 1.0), 'RK44': (4, 4, 1.5), 'RK67': (6, 9, 1.5)}


class Exudyn(StepSolver):
    """One explicit integrator over an assembled system."""

    tool = 'exudyn'

    def __init__(self, scene: PlainScene, integrator: str, system: 'ExudynSystem') -> None:
        """Create a solver of `system` with `integrator`."""
        self._scene, self._system = scene, system
        self._integrator = getattr(system.exudyn.DynamicSolverType, integrator)
        self.label = f'Exudyn {integrator}'
        self.order, self.evaluations, courant = _INTEGRATORS[integrator]
        self.longest = courant / scene.frequency_bound

    def start(self, step: float) -> None:
        self._step = step
        self._system.reset()

    def advance(self, count: int) -> None:
        self._system.advance(self._integrator, self._step, count)

    def motion(self) -> Motion:
        return self._system.motion()


class ExudynSystem:
    """The bodies and springs of a scene."""

    def __init__(self, scene: PlainScene) -> None:
        """Assemble bodies and springs."""
        exudyn = import_module('exudyn')
        items = import_module('exudyn.itemInterface')
        from scipy.spatial.transform import Rotation
        exudyn.config.printToConsole = False
        exudyn.config.suppressWarnings = True
        self.exudyn = exudyn
        self._container = exudyn.SystemContainer()
        self._system = system = self._container.AddSystem()
        self._nodes, bodies = [], []
        turns = Rotation.from_quat(scene.orientation)
        places = np.hstack([scene.position, turns.as_rotvec()])
        # Angular velocities are in the frames of the bodies.
        rates = np.hstack([scene.velocity, turns.apply(scene.spin, inverse=True)])
        for place, rate in zip(places.tolist(), rates.tolist()):
            node = system.AddNode(items.NodeRigidBodyRotVecLG(
                referenceCoordinates=[0.0] * 6, initialCoordinates=place, initialVelocities=rate))
            self._nodes.append(node)
            bodies.append(system.AddObject(items.ObjectRigidBody(
                mass=scene.mass, inertia=[scene.inertia] * 3 + [0.0] * 3, nodeNumber=node)))
        points, markers = scene.edge_points.tolist(), {}
        for end in zip(scene.bodies.ravel().tolist(), scene.edges.ravel().tolist()):
            if end not in markers:
                markers[end] = system.AddMarker(items.MarkerBodyPosition(
                    bodyNumber=bodies[end[0]], localPosition=points[end[1]]))
        for (i, j), (e, f) in zip(scene.bodies.tolist(), scene.edges.tolist()):
            system.AddObject(items.ObjectConnectorSpringDamper(
                markerNumbers=[markers[i, e], markers[j, f]], stiffness=scene.stiffness,
                referenceLength=scene.natural_length))
        system.Assemble()
        initial = exudyn.ConfigurationType.Initial
        self._start = (system.systemData.GetODE2Coordinates(configuration=initial),
                       system.systemData.GetODE2Coordinates_t(configuration=initial))

    def reset(self) -> None:
        """Restore the initial state."""
        initial = self.exudyn.ConfigurationType.Initial
        data = self._system.systemData
        data.SetODE2Coordinates(self._start[0], configuration=initial)
        data.SetODE2Coordinates_t(self._start[1], configuration=initial)

    def advance(self, integrator: Any, step: float, count: int) -> None:
        """Advance by `count` steps of length `step` [s]."""
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.active = False
        settings.parallel.numberOfThreads = 1
        settings.linearSolver.solverType = self.exudyn.LinearSolverType.EigenSparse
        times = settings.timeIntegration
        times.numberOfSteps, times.endTime = count, count * step
        times.automaticStepSize = False
        times.stepInformation = 0
        times.explicit.computeMassMatrixInversePerBody = True
        times.explicit.computeEndOfStepAccelerations = False
        try:
            self._system.SolveDynamic(
                settings, solverType=integrator, updateInitialValues=True)
        except Exception as error:
            raise Unusable(str(error).strip().splitlines()[-1]) from error

    def motion(self) -> Motion:
        """Return positions and axes of all bodies."""
        kinds = self.exudyn.OutputVariableType
        position = [self._system.GetNodeOutput(node, kinds.Position) for node in self._nodes]
        turns = [self._system.GetNodeOutput(node, kinds.RotationMatrix) for node in self._nodes]
        return Motion(
            np.array(position), np.swapaxes(np.array(turns).reshape(-1, 3, 3), 1, 2).copy())


def solvers(scene: PlainScene) -> Iterator[Solver]:
    """Yield explicit integrators of order 2, 4 and 6."""
    system = ExudynSystem(scene)
    for integrator in _INTEGRATORS:
        yield Exudyn(scene, integrator, system)
