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
"""The documentation site: `make docs` builds it into build/site. Why Sphinx: decisions/site.md."""

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
