# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Runs the cells of a notebook in order and writes their outputs into it; needs no Jupyter.

    .venv/bin/python docs/run_notebook.py examples/first_steps.ipynb
"""

import argparse
import ast
import base64
from contextlib import redirect_stdout
import io
import json
from pathlib import Path
from typing import Any


def run_cell(source: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """Outputs of a cell in the form of nbformat 4: what it prints, and what its last line is."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    said, value = io.StringIO(), None
    with redirect_stdout(said):
        exec(compile(tree, 'cell', 'exec'), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), 'cell', 'eval'), names)
    outputs: list[dict[str, Any]] = []
    if said.getvalue():
        outputs.append({'output_type': 'stream', 'name': 'stdout',
                        'text': said.getvalue().splitlines(keepends=True)})
    if value is not None:
        outputs.append({'output_type': 'execute_result', 'execution_count': number,
                        'metadata': {}, 'data': _shown(value)})
    return outputs


def _shown(value: Any) -> dict[str, Any]:
    data: dict[str, Any] = {'text/plain': [repr(value)]}
    if hasattr(value, '_repr_html_'):
        data['text/html'] = [value._repr_html_()]
    if hasattr(value, 'savefig'):
        picture = io.BytesIO()
        value.savefig(picture, format='png', dpi=80, metadata={'Software': None})
        data['text/plain'] = ['<Figure>']
        data['image/png'] = base64.b64encode(picture.getvalue()).decode()
    return data


def run(notebook: dict[str, Any]) -> dict[str, Any]:
    """The notebook with the outputs of its cells."""
    names: dict[str, Any] = {}
    number = 0
    for cell in notebook['cells']:
        if cell['cell_type'] == 'code':
            number += 1
            cell['execution_count'] = number
            cell['outputs'] = run_cell(''.join(cell['source']), names, number)
    return notebook


def main() -> None:
    parser = argparse.ArgumentParser(description='Run a notebook and keep its outputs.')
    parser.add_argument('notebook', type=Path, help='a file that ends in .ipynb; it is changed')
    path = parser.parse_args().notebook
    notebook = run(json.loads(path.read_text(encoding='utf-8')))
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + '\n', encoding='utf-8')
    print(f'{len(notebook["cells"])} cells, {path}')


if __name__ == '__main__':
    main()
