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
Marks the tests that start nodes, and those that `make test` leaves to `make test-long`.

What nodes receive depends on the load of the machine. Long are repetitions of what a shorter test
of the same file shows: the other rotation form, further tolerances, further seeds.
"""
import os
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
    r'|test_units_by_powers_of_four_give_the_same_bits\[True.*\]')


def pytest_collection_modifyitems(items):
    for item in items:
        # From the fixtures of test/ros/conftest.py, by themselves, or by other programs.
        if ('node' in item.fixturenames or 'NodeProcess' in vars(item.module)
                or item.module.__name__ in _FILES):
            item.add_marker('graph')
        if _LONG.fullmatch(item.name):
            item.add_marker('long')
