# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Arrays whose references are not counted.

A compiled function with a loop counts a reference to each of its arrays when it begins and ends.
Counting halts other work of the processor for longer than small functions take. The caller that
passes on a borrowed array has to keep the array itself until the call is over.
"""

from typing import Any

from numba import types
from numba.extending import intrinsic, overload
import numpy as np


@intrinsic
def _without_owner(typingctx: Any, array: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = context.make_array(signature.args[0])(context, builder, arguments[0])
        value.meminfo = value.meminfo.type(None)
        value.parent = value.parent.type(None)
        return value._getvalue()

    if isinstance(array, types.Array):
        return array(array), generate
    return None


def borrowed(array: np.ndarray) -> np.ndarray:
    """Return `array` itself; compiled code does not count the reference."""
    return array


emit: Any = _without_owner
overload(borrowed)(lambda array: lambda array: emit(array))
