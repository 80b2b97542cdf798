# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Version of the package, importable from every module."""

__version__ = '0.1.0'
