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
"""The start of a node where packages are missing."""

from icofabric_sim.ros import start
import pytest


@pytest.mark.parametrize('module', ['rclpy', 'geometry_msgs.msg'])
def test_without_ros_one_line_says_what_to_do(module, capsys):
    with pytest.raises(SystemExit) as ended, start.import_without_gc():
        raise ModuleNotFoundError(f'No module named {module!r}', name=module)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count('\n') == 1 and 'ros-jazzy-rclpy' in said and module[:5] in said


def test_another_library_that_is_missing_is_named_in_one_line(capsys):
    with pytest.raises(SystemExit) as ended, start.import_without_gc():
        raise ModuleNotFoundError("No module named 'numpy'", name='numpy')
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count('\n') == 1 and 'numpy is not installed' in said


def test_a_missing_module_of_the_package_stays_an_error():
    with pytest.raises(ModuleNotFoundError), start.import_without_gc():
        raise ModuleNotFoundError(
            "No module named 'icofabric_sim.gone'", name='icofabric_sim.gone')
