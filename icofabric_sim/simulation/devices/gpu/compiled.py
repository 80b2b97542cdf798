# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Properties of kernels compiled for a GPU: registers, stack memory, operations.

Neither a GPU nor the CUDA toolkit is needed, because Warp contains the compiler.
"""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
import re
import struct
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from icofabric_sim.simulation.devices.gpu.kernels import step_kernel, Terms
from icofabric_sim.simulation.devices.gpu.slopes import Losses, slope_kernel

wp: Any = import_module('warp')

# Compute capability of a H100 or H200.
HOPPER = 90
# Registers of a multiprocessor, threads of a group with common instructions, and most groups.
_REGISTER_TOTAL, _WARP_SIZE, _MAX_WARPS = 65536, 32, 64
# Allocation unit of registers, per thread.
_REGISTER_UNIT = 8
# Attributes of a kernel in the compiled file, and the format of numeric attributes.
_REGISTER_COUNT, _FRAME_SIZE, _SIZED = 0x2F, 0x11, 4
_FUSED_PATTERN = r'\bfma\.rn\.f64\b'
_ROUNDED_PATTERN = r'\b(?:add|sub|mul|div|sqrt)(?:\.rn)?\.f64\b'


class CompiledKernel(NamedTuple):
    """Properties of the kernel of a scene for one architecture."""

    architecture: int
    registers: int  # of 32 bits, for each thread
    stack: int  # bytes of a thread outside registers
    operations: int  # in double precision, in the text of the program
    fused: int  # fused multiply-add operations
    block: int  # threads of a block

    @property
    def warps(self) -> int:
        """Number of groups of 32 threads that a multiprocessor holds at a time, of 64."""
        each = -(-self.registers // _REGISTER_UNIT) * _REGISTER_UNIT * self.block
        return min(_REGISTER_TOTAL // each * self.block // _WARP_SIZE, _MAX_WARPS)


def compiled_kernel(
    terms: Terms, losses: Losses | None = None, architecture: int = HOPPER
) -> CompiledKernel:
    """
    Compile the kernel of scenes with these terms for a GPU, without caching it.

    `losses` selects the kernel of slopes with these losses; None selects that of splitting
    methods.
    """
    return compiled_as(
        step_kernel(terms) if losses is None else slope_kernel(terms, losses), architecture)


def compiled_as(kernel: Any, architecture: int = HOPPER) -> CompiledKernel:
    """Compile a kernel that is alone in its module, without caching it."""
    with TemporaryDirectory() as folder:
        texts, programs = (
            [Path(path) for path in wp.compile_aot_module(
                kernel.module, arch=architecture, module_dir=folder, use_ptx=use_ptx)]
            for use_ptx in (True, False))
        text = texts[0].read_text(encoding='utf-8')
        program = programs[0].read_bytes()
    found = list(_attributes(program))
    return CompiledKernel(
        architecture,
        max(value for name, value in found if name == _REGISTER_COUNT),
        max(value for name, value in found if name == _FRAME_SIZE),
        len(re.findall(_ROUNDED_PATTERN, text)) + len(re.findall(_FUSED_PATTERN, text)),
        len(re.findall(_FUSED_PATTERN, text)), int(kernel.module.options['block_dim']))


def _attributes(program: bytes) -> Iterator[tuple[int, int]]:
    """Yield names and values of the function attributes in a CUDA ELF file."""
    start, = struct.unpack_from('<Q', program, 0x28)
    size, count, names = struct.unpack_from('<HHH', program, 0x3A)
    heads = [struct.unpack_from('<IIQQQQ', program, start + size * k) for k in range(count)]
    texts = heads[names][4]
    for head in heads:
        begin = texts + head[0]
        if program[begin:program.index(b'\0', begin)] != b'.nv.info':
            continue
        at, end = head[4], head[4] + head[5]
        while at < end:
            form, name, length = struct.unpack_from('<BBH', program, at)
            at += 4
            if form == _SIZED:
                if length == 8:
                    yield name, struct.unpack_from('<II', program, at)[1]
                at += length
