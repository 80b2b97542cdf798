# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Access to a device by one thread at a time, loading and launch of kernels, and error messages.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
import logging
from pathlib import Path
import shutil
from threading import RLock
from typing import Any

from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.simulation.errors import DeviceError

wp: Any = import_module('warp')
_LOGGER = logging.getLogger('icofabric_sim')

# Launches and copies of other threads would enter a graph that a thread records.
TURN = RLock()
# Loaded kernels, with the name of the device.
_LOADED: set[tuple[str, Any]] = set()


@contextmanager
def named_failure(device: str, forget: Callable[[], None]) -> Iterator[None]:
    """Raise DeviceError with the name of the `device` for any failure, after `forget`."""
    try:
        yield
    except (DeviceError, KernelsMissing):
        # A live run compiles missing kernels in another process and tries again.
        forget()
        raise
    except Exception as error:
        forget()
        raise DeviceError(f'{device} has failed: {error}') from error


def load(kernel: Any, device: Any) -> None:
    """
    Load a kernel, and compile it again if its files in Warp's cache cannot be read.

    Raises
    ------
    DeviceError
        If the kernel cannot be compiled, or the cache cannot be written.
    """
    if (device.alias, kernel) in _LOADED:
        return
    try:
        wp.load_module(kernel.module, device=device)
    except Exception as damage:  # noqa: BLE001 - Warp raises Exception for a damaged file
        cache = Path(wp.config.kernel_cache_dir)
        _LOGGER.warning(
            'Warp cannot load a kernel from %s and compiles it again: %s', cache, damage)
        for folder in cache.glob(f'wp_{kernel.module.name}_{"[0-9a-f]" * 7}'):
            shutil.rmtree(folder, ignore_errors=True)
        kernel.module.mark_modified()
        try:
            wp.load_module(kernel.module, device=device)
        except Exception as error:
            raise DeviceError(
                f'Warp cannot keep or load its kernels in {cache}: {error}; WARP_CACHE_PATH '
                'names another folder for them') from error
    _LOADED.add((device.alias, kernel))


def launch(kernel: Any, *, dim: Any, inputs: list[Any], device: Any) -> None:
    """Load a kernel and launch it."""
    load(kernel, device)
    wp.launch(kernel, dim=dim, inputs=inputs, device=device)
