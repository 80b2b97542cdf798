# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""How kernels for devices are compiled."""

# Products and sums are rounded one by one, as they are written: so processors and graphics cards
# agree to the bit.
# Loops are left to the compiler, which takes a third of the time then.
OPTIONS = {'fuse_fp': False, 'fast_math': False, 'max_unroll': 0}
# For each thread of a GPU, so that a multiprocessor holds 16 groups of 32 threads. The code of
# loads would take twice as many, and is for few bodies: it keeps the rest in memory.
MOST_REGISTERS = 128
