# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Marks the tests that start nodes: what they hear depends on what else the machine does.
"""
import os

# The tests that ask for it say so.
os.environ.setdefault('ICOFABRIC_COMPILE_AHEAD', '0')
# Those that start them through other programs.
_FILES = ('test_colcon', 'test_kill_recovery', 'test_live_sink', 'test_soak')


def pytest_collection_modifyitems(items):
    for item in items:
        if 'NodeProcess' in vars(item.module) or item.module.__name__ in _FILES:
            item.add_marker('graph')
