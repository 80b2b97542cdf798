# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Terms of the equations of motion: a folder for each, and the registry of all."""
