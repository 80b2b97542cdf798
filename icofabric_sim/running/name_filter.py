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
"""
Names picked by a POSIX extended regular expression, as clients of a simulator may send.

Taken are the forms that mean the same to Python's `re`; the others are refused, and so are
expressions that could keep `re`, which tries one choice after the other, busy for long.
"""

from collections.abc import Callable
import re

_LONGEST = 200
# Repetitions and groups: time grows with the length of a name to this power.
_MOST_CHOICES = 3
_ESCAPED = r'\\[][(){}*+?|^$.\\]'
_BRACKETS = r'\[\^?\]?[^][\\&|~]*\]'
_REPEATED = r'[*+?]|\{[0-9]{1,2}(?:,[0-9]{0,2})?\}'
_FORM = re.compile(
    rf'(?:(?:{_ESCAPED}|{_BRACKETS}|[^][(){{}}*+?|^$\\])(?:{_REPEATED})?|[()|^$])*')


def name_filter(expression: str) -> Callable[[str], bool]:
    """
    A function that says whether any part of a name matches; an empty expression matches all.

    ValueError where the expression is not valid or not taken.
    """
    plain = re.sub(f'{_ESCAPED}|{_BRACKETS}', 'x', expression)
    if len(expression) > _LONGEST or sum(map(plain.count, '*+?{(')) > _MOST_CHOICES:
        raise ValueError(
            f'{expression[:_LONGEST]!r} asks for too much: at most {_LONGEST} characters, and '
            f'{_MOST_CHOICES} repetitions and groups')
    if not _FORM.fullmatch(expression) or '--' in expression:
        raise ValueError(
            f'{expression!r} is not a regular expression of the forms that are taken: characters, '
            r'., [abc], [^a-z], \ before a special one, each once or with *, +, ?, {n}, {n,m} '
            'behind it; (a|b), which cannot be repeated; ^ and $')
    try:
        matches = re.compile(expression)
    except (re.error, OverflowError) as error:
        raise ValueError(f'{expression!r} is not a regular expression: {error}') from None
    return lambda name: matches.search(name) is not None
