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
    from icofabric_sim.bag.recovery import recover_bag, recover_mcap, RecoveryReport
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
    'recover_mcap': 'recovery',
}

__all__ = [
    'BagError',
    'BagReader',
    'BagRecorder',
    'BagTopic',
    'next_free_path',
    'recover_bag',
    'recover_mcap',
    'RecorderStatistics',
    'RecoveryReport',
    'STOPPED',
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f'icofabric_sim.bag.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
