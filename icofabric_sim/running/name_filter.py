# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Names matched by a POSIX extended regular expression, as sent by clients of a simulator.

Only forms with the same meaning in Python's `re` are accepted. Expressions that could take
exponential time in `re`, which backtracks, are rejected.
"""

from collections.abc import Callable
import re

_MAX_LENGTH = 200
# Number of repetitions and groups; the time grows with this power of the name's length.
_MAX_CHOICES = 3
_ESCAPED = r'\\[][(){}*+?|^$.\\]'
_BRACKETS = r'\[\^?\]?[^][\\&|~]*\]'
_REPEATED = r'[*+?]|\{[0-9]{1,2}(?:,[0-9]{0,2})?\}'
_FORM = re.compile(
    rf'(?:(?:{_ESCAPED}|{_BRACKETS}|[^][(){{}}*+?|^$\\])(?:{_REPEATED})?|[()|^$])*')


def name_filter(expression: str) -> Callable[[str], bool]:
    """
    Return a predicate for names that contain a match; an empty expression matches all.

    Raises ValueError for an expression that is invalid or not supported.
    """
    plain = re.sub(f'{_ESCAPED}|{_BRACKETS}', 'x', expression)
    if len(expression) > _MAX_LENGTH or sum(map(plain.count, '*+?{(')) > _MAX_CHOICES:
        raise ValueError(
            f'{expression[:_MAX_LENGTH]!r} is too complex: at most {_MAX_LENGTH} characters, and '
            f'{_MAX_CHOICES} repetitions and groups')
    if not _FORM.fullmatch(expression) or '--' in expression:
        raise ValueError(
            f'{expression!r} is not a supported regular expression: characters, '
            r'., [abc], [^a-z], \ before a special one, each once or followed by *, +, ?, {n}, '
             '{n,m}'
            '; (a|b), which cannot be repeated; ^ and $')
    try:
        matches = re.compile(expression)
    except (re.error, OverflowError) as error:
        raise ValueError(f'{expression!r} is not a regular expression: {error}') from None
    return lambda name: matches.search(name) is not None
