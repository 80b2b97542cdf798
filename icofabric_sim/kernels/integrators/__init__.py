# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The loops over steps: splitting methods and the embedded Runge-Kutta pair."""
