# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
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
