# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Validation of icofabric_sim: stress tests, known problems, a material study, benchmarks."""
