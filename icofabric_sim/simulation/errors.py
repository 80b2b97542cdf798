# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""Why a simulation does not go on."""


class SimulationError(RuntimeError):
    """
    The run cannot go on; time, bodies and reason are in the message, the last good state is kept.
    """


class Interrupted(Exception):
    """`should_stop` ended an advance; the simulation stands at a step end and can go on."""
