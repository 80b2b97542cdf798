# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""HTML summaries of scenes and results for notebooks."""

from collections.abc import Mapping
from html import escape


def html_of(title: str, facts: Mapping[str, object]) -> str:
    """Return an HTML table of names and values with a title, for notebooks."""
    rows = ''.join(f'<tr><th style="text-align:left">{escape(name)}</th>'
                   f'<td style="text-align:left">{escape(str(value))}</td></tr>'
                   for name, value in facts.items())
    return f'<table><caption>{escape(title)}</caption>{rows}</table>'
