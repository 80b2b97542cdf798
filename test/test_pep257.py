# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Docstrings as ament_pep257 judges them."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
# A summary may be as long as a line of code and need not be a command.
# D413: no line after the last section.
FREE = ('D200', 'D401', 'D413')


@pytest.mark.linter
@pytest.mark.pep257
@pytest.mark.filterwarnings('ignore')
def test_pep257(monkeypatch):
    main = pytest.importorskip('ament_pep257.main', reason='ament_pep257 is not installed')
    monkeypatch.chdir(ROOT)
    assert main.main(argv=['.', '--add-ignore', *FREE]) == 0, 'the output above has the places'
