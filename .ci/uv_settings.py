# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Prints settings of pip as variables of uv, one a line, from what `pip config list` prints.

Fails where uv has nothing for a setting, e.g. a client's certificate: then pip installs.
"""

import ast
from collections.abc import Iterable
import sys

_NAMES = {
    'index-url': 'UV_DEFAULT_INDEX', 'extra-index-url': 'UV_INDEX', 'find-links': 'UV_FIND_LINKS',
    'trusted-host': 'UV_INSECURE_HOST', 'cert': 'SSL_CERT_FILE', 'timeout': 'UV_HTTP_TIMEOUT'}
# Where pip keeps what it has fetched, and how it reports and asks.
_OF_PIP_ALONE = {
    'cache-dir', 'disable-pip-version-check', 'no-color', 'no-input', 'no-warn-script-location',
    'progress-bar', 'quiet', 'retries', 'root-user-action', 'verbose'}
# What a command is told wins over what all are told, and the environment over files.
_SECTIONS = ('global', 'install', ':env:')


def uv_settings(lines: Iterable[str]) -> dict[str, str]:
    """Return variables of uv and their values; raise ValueError where uv has no such setting."""
    found: dict[str, dict[str, str]] = {section: {} for section in _SECTIONS}
    for line in lines:
        name, _, value = line.partition('=')
        section, _, key = name.rpartition('.')
        key = key.replace('_', '-').removeprefix('default-')
        if section not in found or key in _OF_PIP_ALONE:
            continue
        if key not in _NAMES:
            raise ValueError(f'uv has no setting for {name} of pip')
        found[section][_NAMES[key]] = ' '.join(ast.literal_eval(value.strip()).split())
    settings = {name: value for section in found.values() for name, value in section.items()}
    if 'UV_FIND_LINKS' in settings:
        settings['UV_FIND_LINKS'] = settings['UV_FIND_LINKS'].replace(' ', ',')
    if 'UV_INDEX' in settings:
        # As pip: the pinned version, from whichever index has it.
        settings['UV_INDEX_STRATEGY'] = 'unsafe-best-match'
    return settings


def main() -> None:
    """Print them."""
    try:
        settings = uv_settings(sys.stdin)
    except ValueError as error:
        sys.exit(f'pip installs, as {error}')
    for name, value in settings.items():
        print(f'{name}={value}')


if __name__ == '__main__':
    main()
