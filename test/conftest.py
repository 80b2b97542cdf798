# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Marks tests that start nodes; orders files.

What nodes receive depends on the load of the machine.
"""
import os
from pathlib import Path

# The tests that ask for it say so.
os.environ.setdefault('ICOFABRIC_COMPILE_AHEAD', '0')
# Those that start them through other programs, or are nodes themselves.
_FILES = ('test_colcon', 'test_first_light', 'test_kill_recovery', 'test_live_sink', 'test_soak')
# Files that take longest, the longest first, from an empty cache of kernels. Workers begin with
# them, so that none is left with one when the others have ended. Nodes wait more than they
# compute: they come among the rest, while other workers compile.
LONG_FILES = (
    'terms/links/test_connector_laws', 'terms/contacts/test_contact_runs',
    'physics/test_dense_half', 'physics/test_energy_balance', 'terms/contacts/test_contact_losses',
    'terms/wrapping/test_wrap', 'physics/test_tolerance', 'physics/test_energy_guard',
    'physics/test_lattice_rest', 'physics/test_term_oracles', 'terms/drives/test_drives',
    'physics/test_breakage', 'physics/test_attachments', 'physics/test_body_force',
    'physics/test_error_estimate', 'physics/test_kernels', 'physics/test_electric',
    'physics/test_moments', 'terms/tractions/test_tractions', 'physics/test_driven_contacts',
    'terms/contacts/test_contact_sizes', 'physics/test_gyration', 'physics/test_invariance',
    'physics/test_implicit_steps', 'terms/maxwell/test_maxwell', 'physics/test_own_masses',
    'physics/test_reactions', 'physics/test_friction_at_rest',
    'validation/test/stress/test_stress', 'simulation/test_ranks',
    'validation/test/robustness/test_soak', 'sweeps/test_sweep_workers',
    'validation/test/benchmarks/test_benchmark', 'commands/test_commands',
    'ros/test_fabric_node_graph', 'ros/test_replay_node', 'simulation/test_gpu_contact',
    'kernels/test_kernel_cache', 'ros/test_fabric_node_subscribers', 'ros/test_examples',
    'validation/test/named/test_named', 'simulation/test_method_near_contact',
    'validation/test/benchmarks/test_benchmark_terms', 'commands/test_warm',
    'simulation/test_threads', 'ros/test_fabric_node_advance', 'ros/test_fabric_node_clock',
    'ros/test_fabric_node_start', 'validation/test/material/test_material_study',
    'running/test_change_column', 'scene/test_example_scenes', 'simulation/test_traversal_order',
    'test_installation', 'running/test_checkpoint_files', 'simulation/inputs/test_pulls',
    'simulation/test_evaluation_counts', 'ros/test_fabric_node_limits',
    'running/replay/test_verify', 'ros/test_fabric_node_recording',
    'simulation/checkpoints/test_checkpoint', 'running/test_runner_state_machine',
    'ros/test_fabric_node_wrenches', 'ros/test_fabric_node', 'ros/test_fabric_node_services',
    'ros/test_node_state_machine', 'validation/test/robustness/test_kill_recovery',
    'bag/test_bag_split', 'simulation/test_state_machine', 'ros/test_live_delivery',
    'bag/test_bag', 'simulation/checkpoints/test_checkpoint_random', 'geometry/test_shell',
    'bag/test_bag_recovery', 'running/replay/test_verify_complete', 'test_rooms',
    'ros/test_node_ranks', 'ros/test_stop_signals', 'test_colcon', 'test_package',
    'simulation/test_speed_guard', 'parameters/test_parameter_file_rcl')
_PLACES = {name: place for place, name in enumerate(LONG_FILES)}
_ROOT = Path(__file__).parents[1]


def pytest_collection_modifyitems(config, items):
    for item in items:
        # From the fixtures of test/ros/conftest.py, by themselves, or by other programs.
        if ('node' in item.fixturenames or 'NodeProcess' in vars(item.module)
                or item.module.__name__ in _FILES):
            item.add_marker('graph')
    if hasattr(config, 'workerinput'):
        items.sort(key=lambda item: _PLACES.get(_name(item), len(_PLACES)))


def _name(item):
    """Return the file of a test without its ending, below test/ or with validation/test/."""
    return item.path.relative_to(_ROOT).with_suffix('').as_posix().removeprefix('test/')
