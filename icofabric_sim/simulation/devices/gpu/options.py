# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How kernels for devices are compiled."""

# Products and sums are rounded one by one, as they are written: so processors and graphics cards
# agree to the bit.
# Loops are left to the compiler, which takes a third of the time then.
OPTIONS = {'fuse_fp': False, 'fast_math': False, 'max_unroll': 0}
# For each thread of a GPU, so that a multiprocessor holds 16 groups of 32 threads. The code of
# loads would take twice as many, and is for few bodies: it keeps the rest in memory.
MOST_REGISTERS = 128
