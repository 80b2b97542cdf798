# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Makes the pictures and films of docs/gallery.md, by the commands that stand there.

    .venv/bin/python docs/draw_gallery.py                       # films of all scenes: make films
    .venv/bin/python docs/draw_gallery.py --pictures            # films and pictures
    .venv/bin/python docs/draw_gallery.py torn_slab free_slab   # of these scenes
"""

import argparse
from pathlib import Path
import re
import shlex
import subprocess
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[1]
GALLERY = ROOT / 'docs' / 'gallery.md'


def commands(text: str) -> dict[str, list[list[str]]]:
    """Words of the commands below each heading that names a scene."""
    found = {}
    for name, body in re.findall(
            r'^## (\w+)\n(.*?)(?=^## |\Z)', text, re.MULTILINE | re.DOTALL):
        found[name] = [shlex.split(line) for line in body.splitlines() if line.startswith('    ')]
    return found


def main(words: list[str] | None = None) -> int:
    """Run the commands of the scenes that are named, or of all."""
    parser = argparse.ArgumentParser(description='Pictures and films of docs/gallery.md.')
    parser.add_argument('scenes', nargs='*', metavar='SCENE', help='these (default: all)')
    parser.add_argument('--pictures', action='store_true', help='pictures, too')
    arguments = parser.parse_args(words)
    known = commands(GALLERY.read_text('utf-8'))
    unknown = sorted(set(arguments.scenes) - set(known))
    if unknown:
        parser.error(f'docs/gallery.md does not show {", ".join(unknown)}')
    for name in arguments.scenes or known:
        # Records go elsewhere than in the page: there may be one of that name.
        with tempfile.TemporaryDirectory() as folder:
            for line in known[name]:
                if line[1] == 'film' or arguments.pictures:
                    print(shlex.join(line), flush=True)
                    words = [f'{folder}/{name}' if word == f'runs/{name}' else word
                             for word in line]
                    status = subprocess.run(words, cwd=ROOT, check=False).returncode
                    if status:
                        return status
    return 0


if __name__ == '__main__':
    sys.exit(main())
