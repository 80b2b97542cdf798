# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What goes into a running simulation, and what it reports.
"""

from typing import Any, NamedTuple

from icofabric_sim.inputs import Key


class WrenchInput(NamedTuple):
    """
    A wrench as it was received.
    """

    topic: str
    key: Key  # load channel or body
    stamp: int  # [ns] of simulated time, 0: at once
    force: Any
    torque: Any
    data: bytes  # the message, for the bag


class Status(NamedTuple):
    """
    What diagnostics and summaries report.
    """

    time: int  # [ns]
    paused: bool
    finished: bool
    failure: str  # '': none
    factor: float  # simulated over wall time, lately
    wanted_factor: float
    step: float  # [s]
    limit: float  # [s]
    step_count: int
    body_count: int
    connector_count: int
    loads_active: int
    dropped: int  # wrenches that came too late, or for what is gone
    proximity: str
