# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Style as ament_flake8 judges it, by test/ament_flake8.ini."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.flake8
@pytest.mark.linter
@pytest.mark.filterwarnings('ignore')
def test_flake8(monkeypatch):
    main = pytest.importorskip('ament_flake8.main', reason='ament_flake8 is not installed')
    monkeypatch.chdir(ROOT)
    status, errors = main.main_with_errors(argv=['--config', 'test/ament_flake8.ini'])
    assert status == 0, '\n'.join(errors)
