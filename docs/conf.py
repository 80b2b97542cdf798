# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation site: `make docs` builds it into build/site. Why Sphinx: decisions/site.md."""

import dataclasses
import inspect
from pathlib import Path
import re
import shutil
from typing import Any

from icofabric_sim.version import __version__

project = 'icofabric_sim'
author = 'The icofabric_sim authors'
copyright = f'2026 {author}'  # noqa: A001 - the name that Sphinx reads
release = version = __version__

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
# Anchors as GitHub makes them, so that one link serves both.
myst_heading_anchors = 4
# Docstrings write code in single backticks.
default_role = 'code'
autodoc_member_order = 'groupwise'
autodoc_typehints = 'signature'
autodoc_default_options = {'members': True, 'undoc-members': False}
napoleon_google_docstring = False
# Types as they are written in the source.
autodoc_type_aliases = {'ArrayLike': 'ArrayLike'}
python_use_unqualified_type_names = True

html_theme = 'furo'
html_title = f'icofabric_sim {release}'
html_show_sphinx = False


def fields_of(record: type) -> list[tuple[str, str]]:
    """Fields of a dataclass or named tuple, each with the comment beside or above it."""
    found, above = [], []
    for line in inspect.getsource(record).splitlines():
        comment = re.fullmatch(r' {4}# ?(.*)', line)
        field = re.fullmatch(r' {4}([a-z]\w*): ([^#]*?)(?:  # (.*))?', line)
        if comment:
            above.append(comment[1])
        elif field:
            words = ' '.join([*above, field[3] or '']).strip()
            found.append((field[1], words))
            above = []
        elif re.match(r' {4}(def|@)', line):
            break
        else:
            above = []
    return found


def add_fields(
    app: Any, what: str, name: str, record: Any, options: Any, lines: list[str]
) -> None:
    """List the fields of records, which autodoc leaves out: their comments are no docstrings."""
    if what != 'class' or not (dataclasses.is_dataclass(record) or hasattr(record, '_fields')):
        return
    lines += ['', '**Fields**', '']
    for field, words in fields_of(record):
        plain = re.sub(r'([*|])', r'\\\1', words)
        lines.append(f'- ``{field}`` {": " if plain else ""}{plain}')
    lines.append('')


def copy_films(app: Any, error: Exception | None) -> None:
    """Put the films of the gallery where its page looks for them: Sphinx copies pictures only."""
    target = Path(app.outdir) / 'gallery'
    if error is None and app.builder.format == 'html':
        target.mkdir(exist_ok=True)
        for film in sorted((Path(app.srcdir) / 'gallery').glob('*.mp4')):
            shutil.copy2(film, target)


def setup(app: Any) -> None:
    app.connect('autodoc-process-docstring', add_fields)
    app.connect('build-finished', copy_films)
