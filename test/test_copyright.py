# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""Headers, LICENSE and CONTRIBUTING.md as ament_copyright knows them."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.copyright
@pytest.mark.linter
@pytest.mark.filterwarnings('ignore')
def test_copyright(monkeypatch):
    main = pytest.importorskip('ament_copyright.main', reason='ament_copyright is not installed')
    monkeypatch.chdir(ROOT)
    assert main.main(argv=['.']) == 0, 'the output above has the files'
