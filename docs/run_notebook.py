# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs the cells of a notebook in a Jupyter kernel and writes their outputs into it.

    .venv/bin/python docs/run_notebook.py examples/first_steps.ipynb

Needs the package ipykernel, which requirements-test.txt lists.
"""

import argparse
import json
import os
from pathlib import Path
import tempfile
from typing import Any

# For one cell, or the start of the kernel, on a busy machine that compiles [s].
_PATIENCE = 900.0


def run(notebook: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run `notebook` in `folder` as Jupyter does, by a new kernel; return it with the outputs."""
    from jupyter_client.manager import KernelManager
    # A plain kernel: no settings of the user, and the backend of pictures that ipykernel chooses.
    environment = {name: value for name, value in os.environ.items() if name != 'MPLBACKEND'}
    with tempfile.TemporaryDirectory() as settings:
        manager = KernelManager(transport='ipc', connection_file=f'{settings}/kernel.json')
        manager.start_kernel(cwd=str(folder), env={**environment, 'IPYTHONDIR': settings})
        client = manager.client()
        client.start_channels()
        try:
            client.wait_for_ready(timeout=_PATIENCE)
            number = 0
            for cell in notebook['cells']:
                if cell['cell_type'] == 'code':
                    number += 1
                    cell['execution_count'] = number
                    cell['outputs'] = run_cell(client, ''.join(cell['source']))
        finally:
            client.stop_channels()
            manager.shutdown_kernel(now=True)
    return notebook


def run_cell(client: Any, source: str) -> list[dict[str, Any]]:
    """Return the outputs of a cell in the form of nbformat 4, without what goes to stderr."""
    outputs: list[dict[str, Any]] = []

    def keep(message: dict[str, Any]) -> None:
        kind, content = message['msg_type'], message['content']
        if kind == 'stream' and content['name'] == 'stdout':
            before = outputs.pop()['text'] if outputs and outputs[-1].get('text') else []
            text = ''.join(before) + content['text']
            outputs.append({'output_type': kind, 'name': 'stdout',
                            'text': text.splitlines(keepends=True)})
        elif kind in ('display_data', 'execute_result'):
            count = {name: content[name] for name in ('execution_count',) if name in content}
            outputs.append({'output_type': kind, **count, 'metadata': content['metadata'],
                            'data': {name: _lines(name, data)
                                     for name, data in content['data'].items()}})

    answer = client.execute_interactive(source, timeout=_PATIENCE, output_hook=keep)['content']
    if answer['status'] != 'ok':
        raise RuntimeError('\n'.join(answer['traceback']))
    return outputs


def _lines(kind: str, data: Any) -> Any:
    """Return text as the list of its lines, as notebooks are stored."""
    return data.splitlines(keepends=True) if kind.startswith('text/') else data


def main() -> None:
    parser = argparse.ArgumentParser(description='Run a notebook and keep its outputs.')
    parser.add_argument('notebook', type=Path, help='a file that ends in .ipynb; it is changed')
    path = parser.parse_args().notebook.absolute()
    notebook = run(json.loads(path.read_text(encoding='utf-8')), path.parent)
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + '\n', encoding='utf-8')
    print(f'{len(notebook["cells"])} cells, {path}')


if __name__ == '__main__':
    main()
