# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Names picked by a POSIX extended regular expression, as clients of a simulator may send.

The expression is run by the C library: Python's own engine has another syntax, and a short
hostile expression keeps it busy for hours, with everything else of the process waiting.
"""

from collections.abc import Callable
import ctypes
import re

# <regex.h> of glibc and musl.
_EXTENDED, _NO_POSITIONS = 1, 8
_STORAGE = 256  # bytes of a regex_t, with room to spare
_LONGEST = 200
# Copies of its parts that an expression may ask for: a{9}{9}{9} becomes 729 of them.
_MOST_COPIES = 1000
_REPEATED = re.compile(r'\{([0-9]*),?([0-9]*)\}')


class NameFilter:
    """Tells whether a name matches; ValueError where the expression is none."""

    def __init__(self, expression: str) -> None:
        """Compile `expression`; an empty one matches everything."""
        self._expression = expression
        self._regexec: Callable[..., int] | None = None
        if expression:
            self._compile()

    def __call__(self, name: str) -> bool:
        """Whether any part of `name` matches."""
        if self._regexec is None:
            return True
        return self._regexec(self._compiled, name.encode(), 0, None, 0) == 0

    def __del__(self) -> None:
        """Give back what the C library keeps."""
        if getattr(self, '_regexec', None) is not None:
            self._library.regfree(self._compiled)

    def _compile(self) -> None:
        self._refuse_costly()
        self._library = ctypes.CDLL(None)
        self._compiled = ctypes.create_string_buffer(_STORAGE)
        code = self._library.regcomp(
            self._compiled, self._expression.encode(), _EXTENDED | _NO_POSITIONS)
        if code:
            reason = ctypes.create_string_buffer(200)
            self._library.regerror(code, self._compiled, reason, len(reason))
            raise ValueError(
                f'{self._expression!r} is not a POSIX extended regular expression: '
                f'{reason.value.decode(errors="replace")}')
        self._regexec = self._library.regexec

    def _refuse_costly(self) -> None:
        copies = 1
        for least, most in _REPEATED.findall(self._expression):
            copies *= max(int(least or 0), int(most or 0), 1)
        # Back references are no part of POSIX, and may take for ever.
        if (
            len(self._expression) > _LONGEST or copies > _MOST_COPIES
            or '\0' in self._expression or re.search(r'\\[0-9]', self._expression)
        ):
            raise ValueError(
                f'{self._expression[:_LONGEST]!r} asks for too much: at most {_LONGEST} '
                f'characters and {_MOST_COPIES} repetitions, and no back references')
