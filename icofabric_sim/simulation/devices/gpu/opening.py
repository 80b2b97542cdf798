# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Import of Warp, and the device that `solver.device` selects."""

from functools import cache
from importlib import import_module
import sys
from typing import Any, NamedTuple

from icofabric_sim.libraries import install_command
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.available_memory import available_memory

# Values of `solver.device` other than `cpu`, with the names of Warp.
DEVICES = {'cuda': 'cuda', 'warp_cpu': 'cpu'}


class Device(NamedTuple):
    """A device of Warp."""

    choice: str  # of solver.device
    handle: Any  # of Warp
    name: str
    is_cuda: bool

    @property
    def free_bytes(self) -> int:
        """Free memory [bytes] of the device."""
        return int(self.handle.free_memory) if self.is_cuda else available_memory()


@cache
def warp() -> Any:
    """Return Warp. Raise ParameterError if it is not installed or has no folder for kernels."""
    is_own = 'warp' not in sys.modules
    try:
        module = import_module('warp')
    except ImportError as error:
        raise ParameterError(
            'solver.device',
            f'solver.device needs NVIDIA Warp: {error}; install it: {install_command("warp")}, '
            'or take solver.device cpu') from error
    if is_own:
        # Messages of Warp on devices and compilation are for authors of kernels.
        module.config.log_level = module.LOG_WARNING
    try:
        module.init()
    except OSError as error:
        raise ParameterError(
            'solver.device',
            f'solver.device: Warp cannot keep its kernels: {error}; WARP_CACHE_PATH names another '
            'folder for them') from error
    return module


def open_device(choice: str) -> Device:
    """
    Return the device of `solver.device`, which is not `cpu`.

    Raises ParameterError if Warp is missing or finds no such device.
    """
    module = warp()
    if DEVICES[choice] == 'cuda':
        if not module.is_cuda_available():
            raise ParameterError(
                'solver.device',
                'solver.device cuda finds no NVIDIA GPU with a driver on this machine: take cpu, '
                'or warp_cpu, which runs the kernels of the GPU on the processor')
        handle = module.get_preferred_device()
        return Device(choice, handle, f'{handle.alias}, {handle.name}', True)
    return Device(choice, module.get_device('cpu'), 'the processor, by Warp', False)
