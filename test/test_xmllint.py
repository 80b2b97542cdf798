# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""package.xml as ament_xmllint judges it, by the schema that it names."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.linter
@pytest.mark.xmllint
@pytest.mark.filterwarnings('ignore')
def test_xmllint(monkeypatch):
    main = pytest.importorskip('ament_xmllint.main', reason='ament_xmllint is not installed')
    monkeypatch.chdir(ROOT)
    assert main.main(argv=['.']) == 0, 'the output above has the reasons'
