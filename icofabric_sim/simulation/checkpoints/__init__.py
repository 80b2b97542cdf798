# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: the state tree of a run, its encoding as bytes, and differences between two."""
