# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The key of a run: a hash of everything that its result depends on.

These are the resolved parameters, the contents of the files that they name, verbs and kept
results, the source of the subpackages used by a run, the libraries, and the processor that kernels
are compiled for. Other subpackages (`pictures`, `commands`, ...) do not count: a run never imports
them.
"""

from collections.abc import Mapping
import functools
import hashlib
import json
from pathlib import Path
from typing import Any, Final

from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.sweeps.outcomes import Work

_ROOMS: Final = (
    'process', 'geometry', 'terms', 'parameters', 'kernels', 'scene', 'simulation', 'statics',
    'messages', 'bag', 'running', 'sweeps')
_MODULES: Final = ('version.py', 'checks.py')
_PACKAGE = Path(__file__).resolve().parents[1]
_KEY_DIGITS = 32  # hexadecimal, 128 bits
_FEATURES_DIGITS = 12  # hexadecimal digits of the hash of features


@functools.cache
def source_digest() -> str:
    """Return the SHA-256 of the source that a run uses."""
    digest = hashlib.sha256()
    paths = [_PACKAGE / name for name in _MODULES] + [
        path for room in _ROOMS for path in sorted((_PACKAGE / room).rglob('*.py'))]
    for path in paths:
        text = path.read_bytes()
        digest.update(f'{path.relative_to(_PACKAGE).as_posix()} {len(text)}\n'.encode() + text)
    return digest.hexdigest()


@functools.cache
def run_environment() -> dict[str, str]:
    """Return the fingerprint of source, libraries and processor that results depend on."""
    from icofabric_sim.kernels.runtime.target import kernel_target
    from icofabric_sim.running.recording import library_versions
    return {
        'source': source_digest(), 'libraries': library_versions(),
        'kernels': f'{kernel_target()} with features {features_digest()}'}


def features_digest() -> str:
    """
    Return a hash of the processor features that kernels are compiled for.

    NUMBA_CPU_NAME does not determine these features: if it is set, Numba adds the features of
    this processor unless NUMBA_CPU_FEATURES is set too.
    """
    from icofabric_sim.kernels.runtime.numba_private import processor_features
    return hashlib.sha256(processor_features().encode()).hexdigest()[:_FEATURES_DIGITS]


def key_of(
    parameters: Parameters, files: Mapping[str, str], work: Work, environment: Mapping[str, str]
) -> str:
    """
    Return the key of a run.

    `files`: SHA-256 of the files that the scene reads, by file name.
    """
    facts: dict[str, Any] = {
        'parameters': dict(parameters.table), 'files': dict(files), 'verbs': work.verbs,
        'keep': sorted(map(str, work.keep)), **environment}
    text = json.dumps(facts, sort_keys=True, separators=(',', ':'))
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_DIGITS]
