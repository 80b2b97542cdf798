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
