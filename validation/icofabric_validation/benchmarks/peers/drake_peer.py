# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Drake: a continuous MultibodyPlant of floating bodies and linear springs."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from icofabric_sim.libraries import install_command
from icofabric_validation.benchmarks.scenes import axes_from_quaternions, Motion, PlainScene
from icofabric_validation.benchmarks.solver import Solver, StepSolver, Unusable
import numpy as np

DISTRIBUTION = 'drake'
INSTALL = install_command('pydrake')
# Integrator, order, evaluations per step, and initial step times frequency. Euler has order 1, but
# its positions are here those of leapfrog, because no force acts at the start.
_SCHEMES = {'semi_explicit_euler': (2, 1, 0.5), 'runge_kutta5': (5, 7, 1.5)}


class Drake(StepSolver):
    """One integrator over a finalised plant, without error control."""

    tool = 'drake'

    def __init__(self, scene: PlainScene, scheme: str, plant: Any) -> None:
        """Create a solver of `plant` with `scheme`."""
        self._analysis = import_module('pydrake.systems.analysis')
        self._scene, self._scheme, self._plant = scene, scheme, plant
        self._simulator = self._analysis.Simulator(plant)
        self._context = self._simulator.get_mutable_context()
        self.label = f'Drake {scheme}'
        self.order, self.evaluations, courant = _SCHEMES[scheme]
        self.longest = courant / scene.frequency_bound

    def start(self, step: float) -> None:
        scene = self._scene
        self._analysis.ResetIntegratorFromFlags(self._simulator, self._scheme, step)
        integrator = self._simulator.get_mutable_integrator()
        if self._scheme != 'semi_explicit_euler':
            # Other integrators would choose steps by error estimates.
            integrator.set_fixed_step_mode(True)
        integrator.set_maximum_step_size(step)
        self._step = step
        self._context.SetTime(0.0)
        self._count = 0
        quaternion = scene.orientation[:, [3, 0, 1, 2]]
        self._plant.SetPositions(
            self._context, np.hstack([quaternion, scene.position]).ravel())
        self._plant.SetVelocities(self._context, np.hstack([scene.spin, scene.velocity]).ravel())
        self._simulator.Initialize()

    def advance(self, count: int) -> None:
        self._count += count
        try:
            self._simulator.AdvanceTo(self._count * self._step)
        except RuntimeError as error:
            raise Unusable(str(error)) from error

    def motion(self) -> Motion:
        places = self._plant.GetPositions(self._context).reshape(-1, 7)
        return Motion(places[:, 4:].copy(), axes_from_quaternions(places[:, [1, 2, 3, 0]]))


def build_plant(scene: PlainScene) -> Any:
    """Return the plant of `scene`; bodies without a joint float with a quaternion."""
    tree = import_module('pydrake.multibody.tree')
    plant = import_module('pydrake.multibody.plant').MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    unit = tree.UnitInertia(*[scene.inertia / scene.mass] * 3)
    inertia = tree.SpatialInertia(scene.mass, np.zeros(3), unit)
    bodies = [plant.AddRigidBody(f'body{b}', inertia) for b in range(scene.body_count)]
    points = scene.edge_points
    for (i, j), (e, f) in zip(scene.bodies.tolist(), scene.edges.tolist()):
        plant.AddForceElement(tree.LinearSpringDamper(
            bodies[i], points[e], bodies[j], points[f], scene.natural_length, scene.stiffness,
            0.0))
    plant.Finalize()
    return plant


def solvers(scene: PlainScene) -> Iterator[Solver]:
    """Yield the cheapest step and the integrator of highest order."""
    plant = build_plant(scene)
    for scheme in _SCHEMES:
        yield Drake(scene, scheme, plant)
