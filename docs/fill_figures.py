# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes the figures of docs/figures.yaml into the pages that quote them; a test holds them to it.

    .venv/bin/python docs/fill_figures.py
"""

from pathlib import Path
import re
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([ROOT / 'README.md', ROOT / 'CHANGELOG.md', *(ROOT / 'docs').rglob('*.md')])
# Name of the figure, `.value` where the unit is left out, and what stands between the comments.
QUOTE = re.compile(r'<!--fig (\w+)(\.value)?-->(.*?)<!--/fig-->', re.DOTALL)


def read_figures() -> dict[str, dict[str, Any]]:
    path = ROOT / 'docs' / 'figures.yaml'
    return dict(yaml.safe_load(path.read_text(encoding='utf-8'))['figures'])


def filled(text: str, figures: dict[str, dict[str, Any]]) -> str:
    """Return the page with each quote as in docs/figures.yaml; KeyError if one is missing."""
    def fill(quote: re.Match[str]) -> str:
        name, bare, _ = quote.groups()
        figure = figures[name]
        value = figure['value'] if bare else f'{figure["value"]} {figure["unit"]}'.rstrip()
        return f'<!--fig {name}{bare or ""}-->{value}<!--/fig-->'

    return QUOTE.sub(fill, text)


def main() -> None:
    figures = read_figures()
    for page in PAGES:
        text = page.read_text(encoding='utf-8')
        page.write_text(filled(text, figures), encoding='utf-8')


if __name__ == '__main__':
    main()
