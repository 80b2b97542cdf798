# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of steps on a GPU measures what it says; no wall times here, and no GPU."""

import csv

from icofabric_sim.simulation.devices.gpu import opening
from icofabric_validation.benchmarks import gpu, gpu_report
import pytest

pytest.importorskip('warp', reason='Warp (extra `gpu`) is not installed')


@pytest.fixture(scope='module')
def result():
    return gpu.measure(
        rounds=1, choice='warp_cpu', sizes=((5, 5, 5), (400, 400, 400)), kernels=(gpu.PLAIN,))


def test_both_move_the_same_fabric_the_same_way(result):
    row, = result.rows
    assert row.body_count == 63 and 0.0 < row.error < 1e-12
    assert all(rates[0] > 0.0 for rates in (row.processor, row.run, row.kernel))
    # Pose and velocities read and written, and the tables of blocks that are not full.
    assert 208.0 < row.bytes_each < 240.0 and result.bytes_held > 208


def test_what_the_kernel_becomes_for_a_gpu_is_counted(result):
    kernel = result.compiled[gpu.PLAIN]
    assert kernel.architecture == 90
    # Two products and a sum for each of the twelve connectors at least; none contracted.
    assert kernel.fused == 0 and kernel.operations > 100
    # Position, orientation, force and torque of a body are registers, and nothing else is memory.
    assert 26 < kernel.registers <= 128 and kernel.stack == 0 and kernel.warps >= 16


def test_without_a_gpu_the_report_says_so(result, tmp_path):
    text = '\n'.join(gpu_report.lines(result))
    assert 'NO GPU was found' in text and 'compute capability, not run' in text
    path, = gpu_report.write(result, tmp_path)
    with open(path, newline='', encoding='utf-8') as stream:
        row, = csv.DictReader(stream)
    assert row['bodies'] == '63' and row['is_gpu'] == '0'


def test_without_warp_there_is_one_line(monkeypatch):
    monkeypatch.setattr(opening, 'import_module', lambda name: (_ for _ in ()).throw(
        ImportError(f'no {name} here')))
    opening.warp.cache_clear()
    try:
        line, = gpu_report.lines(gpu.measure(rounds=1))
    finally:
        opening.warp.cache_clear()
    assert line.startswith('Steps on a GPU: not measured; ') and 'pip install warp-lang' in line
