# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables and CSV file of `gpu`."""

from pathlib import Path

from icofabric_sim.commands.report import write_csv
from icofabric_validation.benchmarks.gpu import Gpu
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.report import table
from icofabric_validation.benchmarks.timing import Spread


def lines(result: Gpu) -> list[str]:
    """Return tables for a terminal."""
    if result.missing:
        return [f'Steps on a GPU: not measured; {result.missing}']
    times = [[
        'bodies', 'Numba, body-steps/s', 'run on the device', 'kernel alone', 'device / Numba',
        'GB/s', 'apart [a]']]
    for row in result.rows:
        times.append([
            f'{row.body_count:,}', *(
                f'{Spread.of(rates).median:.3g}' for rates in (
                    row.processor, row.run, row.kernel)),
            row.gain().text(), f'{row.bandwidth() / 1e9:.3g}', f'{row.error:.1e}'])
    kernels = [[
        'kernel for a GPU (compute capability, not run)', 'registers', 'stack [B]', 'operations',
        'fused', 'warps of 64']]
    for terms, kernel in result.compiled.items():
        major, minor = divmod(kernel.architecture, 10)
        kernels.append([
            f'{terms} ({major}.{minor})', str(kernel.registers), str(kernel.stack),
            str(kernel.operations), str(kernel.fused), str(kernel.warps)])
    remark = '' if result.is_gpu else (
        ': NO GPU was found, so these are the kernels of the GPU on the processor, by one thread')
    bytes_each = f'{result.rows[-1].bytes_each:.0f}' if result.rows else '?'
    return [
        f'Steps on a device: leapfrog, steps given; {result.rounds} rounds; medians',
        f'device: {result.device}{remark}',
        *machine_lines(('warp-lang',), threads='as many as pay for Numba'), '',
        *table(times), '',
        f'a step reads and writes {bytes_each} B for each body, and {result.bytes_held} B are '
        'held, counted from the arrays', '', *table(kernels)]


def write(result: Gpu, folder: Path) -> list[Path]:
    """Write the results into `folder`; return their paths."""
    return [write_csv(folder / 'gpu.csv', (
        'bodies', 'device', 'is_gpu', 'processor_body_steps_per_s', 'run_body_steps_per_s',
        'kernel_body_steps_per_s', 'gain', 'low', 'high', 'bytes_per_body_step', 'error_a',
        'rounds'), (
            [row.body_count, result.device, int(result.is_gpu),
             *(f'{Spread.of(rates).median:.4g}' for rates in (
                 row.processor, row.run, row.kernel)),
             *(f'{value:.4g}' for value in row.gain()), f'{row.bytes_each:.4g}',
             f'{row.error:.2g}', result.rounds]
            for row in result.rows))]
