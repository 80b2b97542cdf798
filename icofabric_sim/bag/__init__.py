# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""Recorded runs: writing them beside the simulation, reading them, making a killed one whole."""
from icofabric_sim.bag.handover import RecorderStatistics
from icofabric_sim.bag.reader import BagReader, BagTopic
from icofabric_sim.bag.recorder import BagRecorder
from icofabric_sim.bag.recovery import recover_bag, recover_mcap, RecoveryReport
from icofabric_sim.bag.storage import BagError, next_free_path, STOPPED

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
