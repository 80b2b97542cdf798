# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of Warp on disk: damaged files, and folders that cannot be written."""
import os
import subprocess
import sys

from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.simulation.errors import DeviceError
import numpy as np
import pytest

warp = pytest.importorskip('warp', reason='Warp (extra `gpu`) is not installed')


@pytest.fixture
def doubled(tmp_path, monkeypatch):
    """Return what a kernel of Warp computes that is loaded anew from the folder `tmp_path`."""
    from icofabric_sim.simulation.devices.gpu import launching, opening
    device = opening.open_device('warp_cpu').handle
    monkeypatch.setattr(warp.config, 'kernel_cache_dir', str(tmp_path))

    @warp.kernel(module='unique', enable_backward=False)
    def double(values: warp.array(dtype=warp.float64)):
        values[warp.tid()] *= warp.float64(2.0)

    def run():
        double.module.unload()
        launching._LOADED.clear()
        values = warp.array(np.arange(3.0), dtype=warp.float64, device=device)
        with launching.named_failure('the device', lambda: None):
            launching.launch(double, dim=3, inputs=[values], device=device)
        return values.numpy().tolist()

    yield run
    launching._LOADED.clear()


@pytest.mark.parametrize('ending', ['.o', '.meta'])
@pytest.mark.parametrize('left', [0.0, 0.5])
def test_damaged_files_are_compiled_again(ending, left, doubled, tmp_path, caplog):
    assert doubled() == [0.0, 2.0, 4.0] and not caplog.records
    path, = tmp_path.glob(f'*/*{ending}')
    whole = path.read_bytes()
    path.write_bytes(whole[:int(left * len(whole))])
    assert doubled() == [0.0, 2.0, 4.0]
    assert path.stat().st_size == len(whole)
    assert 'compiles it again' in caplog.text
    caplog.clear()
    assert doubled() == [0.0, 2.0, 4.0] and not caplog.records


def test_a_cache_that_cannot_be_written_later_is_named(doubled, tmp_path, monkeypatch):
    (tmp_path / 'file').write_text('')
    monkeypatch.setattr(warp.config, 'kernel_cache_dir', str(tmp_path / 'file'))
    with pytest.raises(DeviceError, match=r'^Warp .*/file: .*; WARP_CACHE_PATH names another'):
        doubled()


def test_a_cache_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / 'file').write_text('')
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_sim.commands.main', 'run', 'free_slab', '--no-record',
         '--duration', '0.1', '-p', 'solver.device:=warp_cpu'], cwd=tmp_path,
        env={**os.environ, 'WARP_CACHE_PATH': str(tmp_path / 'file')}, capture_output=True,
        text=True, timeout=300, check=False)
    assert done.returncode == 2, done.stderr
    line, = [line for line in done.stderr.splitlines() if line.startswith('icofabric run')]
    assert str(tmp_path / 'file') in line and 'WARP_CACHE_PATH' in line
    assert 'Traceback' not in done.stderr


def test_missing_kernels_are_no_failure_of_the_device():
    """A live run compiles them in another process and tries again."""
    from icofabric_sim.simulation.devices.gpu.launching import named_failure
    forgotten = []
    with pytest.raises(KernelsMissing), named_failure('the device', lambda: forgotten.append(1)):
        raise KernelsMissing
    assert forgotten == [1]
