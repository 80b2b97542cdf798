# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Recorded runs: writing in a separate thread, reading, and recovery after a kill.

Names are loaded on first use, so that a node without recording does not import rosbags at its
start.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from icofabric_sim.bag.folder import BagError, next_free_path
    from icofabric_sim.bag.handover import RecorderStatistics
    from icofabric_sim.bag.reader import BagReader, BagTopic
    from icofabric_sim.bag.recorder import BagRecorder
    from icofabric_sim.bag.recovery import recover_bag, RecoveryReport
    from icofabric_sim.bag.storage import STOPPED

_HOMES = {
    'BagError': 'folder',
    'BagReader': 'reader',
    'BagRecorder': 'recorder',
    'BagTopic': 'reader',
    'RecorderStatistics': 'handover',
    'RecoveryReport': 'recovery',
    'STOPPED': 'storage',
    'next_free_path': 'folder',
    'recover_bag': 'recovery',
}

__all__ = [
    'BagError',
    'BagReader',
    'BagRecorder',
    'BagTopic',
    'next_free_path',
    'recover_bag',
    'RecorderStatistics',
    'RecoveryReport',
    'STOPPED',
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f'icofabric_sim.bag.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
