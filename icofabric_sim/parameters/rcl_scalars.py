# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Resolve one YAML scalar to a value and type as ROS 2 does.

Source: rcl 9.2 (ROS 2 Jazzy), rcl_yaml_param_parser/src/parse.c, get_value. It tries eleven words
for true and eleven for false, then C strtoll with base 0, then C strtod; otherwise the scalar is
a string. Both C functions must consume the whole text, and a result out of range (ERANGE) is no
number. glibc also reports ERANGE for an inexact subnormal result, so `5e-324` is a string.
"""

from decimal import Decimal
from fractions import Fraction
import math
import re
import sys

Scalar = bool | int | float | str

STRING_TAG = 'tag:yaml.org,2002:str'
# Plain words for "no value" in YAML, which ROS reads as text.
NULL_WORDS = ('~', 'null', 'Null', 'NULL')

_TRUE = {'Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'}
_FALSE = {'N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'}
_NOT_A_NUMBER = {'.nan', '.NaN', '.NAN'}
_INFINITE = {sign + word for sign in ('', '+', '-') for word in ('.inf', '.Inf', '.INF')}

# Characters that isspace() skips before a number, in the C locale.
_SPACE = r'[ \t\n\v\f\r]*'
_INTEGER = re.compile(
    _SPACE + r'(?P<sign>[+-]?)'
    r'(?:0[xX](?P<hex>[0-9a-fA-F]+)|(?P<oct>0[0-7]*)|(?P<dec>[1-9][0-9]*))')
_DECIMAL = re.compile(
    _SPACE + r'[+-]?(?P<digits>[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?')
_HEXADECIMAL = re.compile(
    _SPACE + r'[+-]?0[xX](?P<digits>[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)'
    r'(?:[pP](?P<exponent_sign>[+-]?)(?P<exponent>[0-9]+))?')
_SPECIAL = re.compile(
    _SPACE + r'(?P<sign>[+-]?)(?:(?P<inf>inf|infinity)|nan(?:\([0-9a-z_]*\))?)',
    re.ASCII | re.IGNORECASE)

# 2^-1022 is the smallest normal double. A number less than half a unit in the last place below it
# rounds up to it, so there is no underflow.
_SMALLEST_NORMAL = sys.float_info.min
_UNDERFLOW_LIMIT = Fraction(1, 2**1022) - Fraction(1, 2**1076)


def resolve_scalar(text: str, *, quoted: bool = False, tag: str | None = None) -> Scalar:
    """
    Return the value that a ROS parameter gets from one YAML scalar, in its type.

    `quoted` means single or double quotes; block scalars (`|`, `>`) count as not quoted. Only the
    tag `!!str` has an effect. A NUL character ends the text, as in C.
    """
    text = text.partition('\0')[0]
    if quoted or tag == STRING_TAG:
        return text
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    integer = _strtoll(text)
    if integer is not None:
        return integer
    number = _strtod(text)
    return text if number is None else number


def _strtoll(text: str) -> int | None:
    match = _INTEGER.fullmatch(text)
    if match is None:
        return None
    for group, base in (('hex', 16), ('oct', 8), ('dec', 10)):
        digits = match[group]
        if digits is not None:
            digits = digits.lstrip('0')
            if len(digits) > 22:  # 22 octal digits hold 64 bits
                return None
            value = int(digits or '0', base)
    if match['sign'] == '-':
        value = -value
    return value if -2**63 <= value < 2**63 else None


def _strtod(text: str) -> float | None:
    if text in _NOT_A_NUMBER:
        return math.nan
    if text in _INFINITE:
        return -math.inf if text[0] == '-' else math.inf
    match = _SPECIAL.fullmatch(text)
    if match is not None:
        value = math.inf if match['inf'] else math.nan
        return math.copysign(value, -1.0) if match['sign'] == '-' else value
    match = _HEXADECIMAL.fullmatch(text)
    hexadecimal = match is not None
    if match is None:
        match = _DECIMAL.fullmatch(text)
    if match is None:
        return None
    try:
        value = float.fromhex(text) if hexadecimal else float(text)
    except OverflowError:
        return None
    if math.isinf(value):
        return None
    if abs(value) <= _SMALLEST_NORMAL and match['digits'].strip('0.'):
        if value == 0.0:
            return None
        exact = abs(_exact_hexadecimal(match) if hexadecimal else Fraction(Decimal(text.strip())))
        if exact != abs(value) and exact < _UNDERFLOW_LIMIT:
            return None
    return value


def _exact_hexadecimal(match: re.Match[str]) -> Fraction:
    whole, _, fraction = match['digits'].partition('.')
    exponent = int((match['exponent'] or '').lstrip('0') or '0')
    if match['exponent_sign'] == '-':
        exponent = -exponent
    return int(whole + fraction, 16) * Fraction(2) ** (exponent - 4 * len(fraction))
