# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""For all tests of the viewer."""

from icofabric_sim.viewer import flow
import pytest


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Have pages answer later, as they do beside other programs."""
    monkeypatch.setattr(flow, '_SILENCE_S', 10.0)
