# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Mark and order tests as in test/: see its conftest.py."""
from pathlib import Path
import runpy

_SHARED = runpy.run_path(str(Path(__file__).parents[2] / 'test' / 'conftest.py'))
pytest_collection_modifyitems = _SHARED['pytest_collection_modifyitems']
