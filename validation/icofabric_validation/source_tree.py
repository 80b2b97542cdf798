# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The source tree that this package is part of: pages, example scenes and tests lie there."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
