# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What a kernel becomes when it is compiled for a GPU: registers, memory beside them, operations.

Needs no GPU and no CUDA toolkit: the compiler is a part of Warp.
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
# Of a multiprocessor of such a card: registers, threads that share an instruction, and most
# of these groups.
_REGISTERS, _WARP, _MOST_WARPS = 65536, 32, 64
# Registers of a group are given in lumps [for each thread].
_LUMP = 8
# Attributes of a kernel in the compiled file, and the form that all with numbers have.
_REGISTER_COUNT, _FRAME_SIZE, _SIZED = 0x2F, 0x11, 4
_FUSED, _ROUNDED = r'\bfma\.rn\.f64\b', r'\b(?:add|sub|mul|div|sqrt)(?:\.rn)?\.f64\b'


class CompiledKernel(NamedTuple):
    """Figures of the kernel of a scene, for one architecture."""

    architecture: int
    registers: int  # of 32 bits, for each thread
    stack: int  # bytes of a thread that do not fit in registers
    operations: int  # in double precision, in the text of the program
    fused: int  # of products with sums, rounded once
    block: int  # threads of a block

    @property
    def warps(self) -> int:
        """Groups of 32 threads that a multiprocessor holds at a time, of 64."""
        each = -(-self.registers // _LUMP) * _LUMP * self.block
        return min(_REGISTERS // each * self.block // _WARP, _MOST_WARPS)


def compiled_kernel(
    terms: Terms, losses: Losses | None = None, architecture: int = HOPPER
) -> CompiledKernel:
    """
    Compile the kernel of scenes with these terms for a GPU; nothing is kept.

    `losses`: the one of slopes, of scenes that lose this; None: that of splitting methods.
    """
    return compiled_as(
        step_kernel(terms) if losses is None else slope_kernel(terms, losses), architecture)


def compiled_as(kernel: Any, architecture: int = HOPPER) -> CompiledKernel:
    """The same of any kernel that is alone in its module."""
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
        len(re.findall(_ROUNDED, text)) + len(re.findall(_FUSED, text)),
        len(re.findall(_FUSED, text)), int(kernel.module.options['block_dim']))


def _attributes(program: bytes) -> Iterator[tuple[int, int]]:
    """Yield the numbers that an ELF file for CUDA holds of its functions, with their names."""
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
