# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Marks tests that start nodes and those that `make test` leaves to `make test-long`; orders files.

What nodes receive depends on the load of the machine. Long are repetitions of what a shorter test
of the same file shows: the other rotation form, further tolerances, further seeds.
"""
import os
from pathlib import Path
import re

# The tests that ask for it say so.
os.environ.setdefault('ICOFABRIC_COMPILE_AHEAD', '0')
# Those that start them through other programs, or are nodes themselves.
_FILES = ('test_colcon', 'test_first_light', 'test_kill_recovery', 'test_live_sink', 'test_soak')
_LONG = re.compile(
    r'test_ready_scenes\[.*-(0\.0001|1e-08)\]'  # of test_tolerance
    r'|test_random_scenes\[[2-4][0-9]\]'
    r'|test_splittings_of_higher_order_keep_it\[.*direction_cosines.*\]'
    r'|test_energy_is_bounded_without_trend_over_a_million_steps\[.*direction_cosines.*\]'
    r'|test_an_interrupt_of_a_sweep_says_what_is_kept'
    r'|test_a_study_that_is_killed_goes_on_beside_another_one'
    r'|test_units_by_powers_of_four_give_the_same_bits\[True.*\]'
    r'|test_momenta_are_kept_to_rounding_over_100000_steps\[direction_cosines\]'
    r'|test_wrench_is_minus_the_gradient_and_the_hessian_its_derivative\[.*cosines\]'
    r'|test_period_is_half_of_each_stiffness\[.*direction_cosines\]'
    r'|test_a_connector_breaks_when_it_is_as_long_as_its_limit\[.*direction_cosines\]'
    r'|test_from_any_points_the_open_segment_meets_the_interior\[.*direction_cosines\]'
    r'|test_energy_errs_by_the_square_of_the_step_through_contacts\[srkn[46]\]'
    r'|test_a_pile_comes_to_rest\[walls\]'
    r'|test_balance_of_ready_scenes_holds_by_far\[(?!dropped_slab|hanging_slab).*\]'
    # Of test_tolerance, like the first.
    r'|test_ready_scenes\[(draped|folded|pressed|squeezed|tightened|torn)_slab-.*\]'
    r'|test_ready_scenes\[stiff_cantilever-.*\]'
    r'|test_(scene_moves_and_keeps_its_energy|every_load_channel_of_a_scene_moves_its_bodies)'
    r'\[(auxetic_slab|charged_slab|hung_slab|radial_arch|squeezed_slab|tightened_slab)\]'
    r'|test_energy_and_momenta_stay_on_a_kinked_fabric\[dop8\]'
    r'|test_one_law_written_in_two_ways_is_the_same_motion\[dop8\]'
    r'|test_two_bodies_along_their_connector\[direction_cosines\]'
    r'|test_from_any_points_the_open_segment_meets_the_interior\[changes1-.*\]'
    r'|test_small_flaw_among_equal_balls_is_found\[0.001\]'
    r'|test_a_damped_press_does_work_that_is_found_again'
    r'|test_damping_follows_the_rate_of_the_whole_way'
    r'|test_bodies_are_where_their_path_says\[srkn4-.*\]'
    r'|test_order_is_four\[direction_cosines\]'
    r'|test_the_tolerance_is_kept_where_damping_is_stiff\[0.001\]'
    r'|test_estimate_counts_what_contacts_add\[7-dop8\]'
    r'|test_faces_and_pre_tension_bear_a_push_that_point_springs_do_not'
    r'|test_scene_moves_and_keeps_its_energy\[(draped_slab|pressed_slab|twisted_column)\]'
    r'|test_every_load_channel_of_a_scene_moves_its_bodies\[(pressed_slab|twisted_column)\]'
    r'|test_steps_through_forces_of_bands_that_jump_are_within_the_promise'
    r'|test_bodies_have_masses_of_their_own_on_a_device'
    r'|test_implicit_steps_move_each_body_by_its_own_mass'
    r'|test_a_pull_that_is_held_decays|test_shells_that_touch_with_arms_between_them'
    r'|test_the_motion_against_an_independent_right_hand_side\[changes0\]'
    r'|test_a_body_tumbles_by_jacobi_functions\[True\]'
    r'|test_a_fabric_moves_as_an_independent_right_hand_side_says\[changes0\]'
    r'|test_other_scenes_have_the_bits_of_one_process'
    r'|test_ready_scenes_have_the_bits_of_one_process_or_are_refused'
    r'|test_a_bias_slab_of_point_springs_rests_however_far_it_is_pulled'
    r'|test_quick_arms_around_shells_are_dampers_and_slow_ones_springs'
    r'|test_they_break_at_the_length_of_the_whole_way\[1-2\]'
    r'|test_a_stop_where_shells_may_pass_through_each_other_names_contact_mode\[auto\]'
    r'|test_statics_and_motion_bend_a_beam_alike'
    r'|test_the_depth_is_four_times_the_mean_depth_of_the_overlap\[.*(0\.7|4\.0)\]'
    r'|test_collisions_of_bodies_of_several_sizes_keep_what_is_conserved\[(?!dop8).*\]'
    r'|test_forces_are_the_gradient_of_the_energy\[.*(0\.7|4\.0)\]'
    r'|test_a_change_does_what_its_column_says\[masses\.it\.edge_length\]'
    r'|test_what_is_known_of_contacts_changes_no_bit\[losses1\]'
    r'|test_a_crowd_moves_on_a_device_as_on_the_processor\[(dop8, given|auto)\]'
    r'|test_a_device_moves_as_the_processor_does\[driven, dop8\]'
    r'|test_from_any_points_the_open_segment_meets_the_interior\[(both-.*|sizes-dir.*)\]'
    r'|test_an_indenter_feels_what_the_floor_bears_and_a_heavy_ball_bounces\[.*')

# Files that take longest, the longest first, from an empty cache of kernels. Workers begin with
# them, so that none is left with one when the others have ended. Nodes wait more than they
# compute: they come among the rest, while other workers compile.
LONG_FILES = (
    'physics/test_connector_laws', 'physics/test_contact_runs', 'physics/test_dense_half',
    'physics/test_energy_balance', 'physics/test_contact_losses', 'physics/test_wrap',
    'physics/test_tolerance', 'physics/test_energy_guard', 'physics/test_lattice_rest',
    'physics/test_term_oracles', 'physics/test_drives', 'physics/test_breakage',
    'physics/test_attachments', 'physics/test_body_force', 'physics/test_error_estimate',
    'physics/test_kernels', 'physics/test_electric', 'physics/test_moments',
    'physics/test_tractions', 'studies/test_stress', 'simulation/test_ranks', 'ros/test_soak',
    'sweeps/test_sweep_workers', 'benchmarking/test_benchmark', 'commands/test_commands',
    'ros/test_fabric_node_graph', 'ros/test_replay_node', 'simulation/test_gpu_contact',
    'kernels/test_kernel_cache', 'ros/test_fabric_node_subscribers', 'ros/test_examples',
    'studies/test_named', 'simulation/test_method_near_contact',
    'benchmarking/test_benchmark_terms', 'commands/test_warm', 'simulation/test_threads',
    'ros/test_fabric_node_advance', 'ros/test_fabric_node_clock', 'ros/test_fabric_node_start',
    'studies/test_material_study', 'running/test_change_column', 'scene/test_ready_scenes',
    'simulation/test_traversal_order', 'test_installation', 'running/test_checkpoint_files',
    'simulation/test_pulls', 'simulation/test_evaluation_counts', 'ros/test_fabric_node_limits',
    'running/replay/test_verify', 'ros/test_fabric_node_recording', 'simulation/test_checkpoint',
    'running/test_runner_state_machine', 'ros/test_fabric_node_wrenches', 'ros/test_fabric_node',
    'ros/test_fabric_node_services', 'ros/test_node_state_machine', 'ros/test_kill_recovery',
    'bag/test_bag_split', 'simulation/test_state_machine', 'ros/test_live_delivery',
    'bag/test_bag', 'simulation/test_checkpoint_random', 'geometry/test_shell',
    'bag/test_bag_recovery', 'running/replay/test_verify_complete', 'test_rooms',
    'ros/test_node_ranks', 'ros/test_stop_signals', 'test_colcon', 'test_package',
    'simulation/test_speed_guard', 'parameters/test_parameter_file_rcl')
_PLACES = {name: place for place, name in enumerate(LONG_FILES)}
_HERE = Path(__file__).parent


def pytest_collection_modifyitems(config, items):
    for item in items:
        # From the fixtures of test/ros/conftest.py, by themselves, or by other programs.
        if ('node' in item.fixturenames or 'NodeProcess' in vars(item.module)
                or item.module.__name__ in _FILES):
            item.add_marker('graph')
        if _LONG.fullmatch(item.name):
            item.add_marker('long')
    if hasattr(config, 'workerinput'):
        items.sort(key=lambda item: _PLACES.get(_name(item), len(_PLACES)))


def _name(item):
    """Return the file of a test, below test/ and without its ending."""
    return item.path.relative_to(_HERE).with_suffix('').as_posix()
