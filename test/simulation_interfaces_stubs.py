# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Stands for `simulation_interfaces`, which no package index has: its fields and constants.

Source: the interface files of ros-simulation/simulation_interfaces 2.1.0. Only what the simulator
uses; the classes carry no type support, so they do not travel.
"""
import sys
from types import ModuleType

from geometry_msgs.msg import Accel, Pose, Twist
from std_msgs.msg import Header


def record(name, fields=(), **constants):
    """A class with `fields` (name: maker of its default) and constants."""
    fields = dict(fields)

    def begin(self, **values):
        for field, make in fields.items():
            setattr(self, field, values.pop(field) if field in values else make())
        assert not values, f'{name} has no {", ".join(values)}'

    return type(name, (), {'__init__': begin, '__slots__': tuple(fields), **constants})


def service(name, request=(), response=(), request_constants=(), response_constants=()):
    return type(name, (), {
        'Request': record(f'{name}_Request', request, **dict(request_constants)),
        'Response': record(f'{name}_Response', response, **dict(response_constants))})


FEATURES = {
    'SPAWNING': 0, 'DELETING': 1, 'NAMED_POSES': 2, 'POSE_BOUNDS': 3, 'ENTITY_TAGS': 4,
    'ENTITY_BOUNDS': 5, 'ENTITY_BOUNDS_BOX': 6, 'ENTITY_BOUNDS_CONVEX': 7, 'ENTITY_CATEGORIES': 8,
    'SPAWNING_RESOURCE_STRING': 9, 'ENTITY_STATE_GETTING': 10, 'ENTITY_STATE_SETTING': 11,
    'ENTITY_INFO_GETTING': 12, 'ENTITY_INFO_SETTING': 13, 'SPAWNABLES': 14,
    'SIMULATION_RESET': 20, 'SIMULATION_RESET_TIME': 21, 'SIMULATION_RESET_STATE': 22,
    'SIMULATION_RESET_SPAWNED': 23, 'SIMULATION_STATE_GETTING': 24,
    'SIMULATION_STATE_SETTING': 25, 'SIMULATION_STATE_PAUSE': 26, 'STEP_SIMULATION_SINGLE': 31,
    'STEP_SIMULATION_MULTIPLE': 32, 'STEP_SIMULATION_ACTION': 33, 'WORLD_LOADING': 40,
    'WORLD_UNLOADING': 43}


class Messages:
    Result = record(
        'Result', {'result': int, 'error_message': str}, RESULT_FEATURE_UNSUPPORTED=0,
        RESULT_OK=1, RESULT_NOT_FOUND=2, RESULT_INCORRECT_STATE=3, RESULT_OPERATION_FAILED=4)
    SimulationState = record(
        'SimulationState', {'state': int}, STATE_STOPPED=0, STATE_PLAYING=1, STATE_PAUSED=2,
        STATE_QUITTING=3, STATE_NO_WORLD=4, STATE_LOADING_WORLD=5)
    SimulatorFeatures = record(
        'SimulatorFeatures', {'features': list, 'spawn_formats': list, 'custom_info': str},
        **FEATURES)
    EntityCategory = record(
        'EntityCategory', {'category': int}, CATEGORY_OBJECT=0, CATEGORY_ROBOT=1,
        CATEGORY_HUMAN=2, CATEGORY_DYNAMIC_OBJECT=4, CATEGORY_STATIC_OBJECT=5)
    Bounds = record(
        'Bounds', {'type': int, 'points': list}, TYPE_EMPTY=0, TYPE_BOX=1, TYPE_CONVEX_HULL=2,
        TYPE_SPHERE=3)
    TagsFilter = record(
        'TagsFilter', {'tags': list, 'filter_mode': int}, FILTER_MODE_ANY=0, FILTER_MODE_ALL=1)
    EntityState = record(
        'EntityState', {'header': Header, 'pose': Pose, 'twist': Twist, 'acceleration': Accel})


Messages.EntityInfo = record(
    'EntityInfo', {'category': Messages.EntityCategory, 'description': str, 'tags': list})
Messages.EntityFilters = record('EntityFilters', {
    'filter': str, 'categories': list, 'tags': Messages.TagsFilter, 'bounds': Messages.Bounds})

_RESULT = {'result': Messages.Result}
_ENTITY, _FILTERS = {'entity': str}, {'filters': Messages.EntityFilters}


class Services:
    GetSimulatorFeatures = service(
        'GetSimulatorFeatures', (), {'features': Messages.SimulatorFeatures})
    GetSimulationState = service(
        'GetSimulationState', (), {'state': Messages.SimulationState, **_RESULT})
    SetSimulationState = service(
        'SetSimulationState', {'state': Messages.SimulationState}, _RESULT, (),
        {'ALREADY_IN_TARGET_STATE': 101, 'STATE_TRANSITION_ERROR': 102,
         'INCORRECT_TRANSITION': 103})
    ResetSimulation = service(
        'ResetSimulation', {'scope': int}, _RESULT,
        {'SCOPE_DEFAULT': 0, 'SCOPE_TIME': 1, 'SCOPE_STATE': 2, 'SCOPE_SPAWNED': 4,
         'SCOPE_ALL': 255})
    StepSimulation = service('StepSimulation', {'steps': lambda: 1}, _RESULT)
    GetEntities = service('GetEntities', _FILTERS, {'entities': list, **_RESULT})
    GetEntitiesStates = service(
        'GetEntitiesStates', _FILTERS, {'entities': list, 'states': list, **_RESULT})
    GetEntityState = service(
        'GetEntityState', _ENTITY, {'state': Messages.EntityState, **_RESULT})
    SetEntityState = service(
        'SetEntityState',
        {**_ENTITY, 'state': Messages.EntityState, 'set_pose': bool, 'set_twist': bool,
         'set_acceleration': bool}, _RESULT, (), {'INVALID_POSE': 101})
    GetEntityInfo = service('GetEntityInfo', _ENTITY, {'info': Messages.EntityInfo, **_RESULT})
    GetEntityBounds = service('GetEntityBounds', _ENTITY, {'bounds': Messages.Bounds, **_RESULT})


class SimulateSteps:
    Goal = record('Goal', {'steps': int})
    Result = record('SimulateSteps_Result', _RESULT)
    Feedback = record('Feedback', {'completed_steps': int, 'remaining_steps': int})


def install(monkeypatch, *, without=()):
    """Have these stand for the installed package, less the services and actions `without`."""
    parts = {
        'msg': vars(Messages), 'srv': vars(Services), 'action': {'SimulateSteps': SimulateSteps}}
    monkeypatch.setitem(
        sys.modules, 'simulation_interfaces', ModuleType('simulation_interfaces'))
    for part, content in parts.items():
        module = ModuleType(f'simulation_interfaces.{part}')
        vars(module).update({
            name: value for name, value in content.items()
            if not name.startswith('_') and name not in without})
        monkeypatch.setitem(sys.modules, module.__name__, module)
