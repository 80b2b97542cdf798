# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The Lorentz force of a uniform magnetic field on moving charges and dipoles."""
