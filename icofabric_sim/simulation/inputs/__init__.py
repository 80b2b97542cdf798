# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs of a run: wrenches, twists and drag forces, and the profiles and paths of the scene."""
