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
