# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Message bytes against rclpy's own encoder and decoder, value by value.

Padding bytes are not compared: rclpy leaves there whatever was in memory.
"""
from __future__ import annotations

import importlib
from typing import Any

from message_cases import CASES, plain
import pytest
from test_messages import check_decoded, DECODERS

serialization = pytest.importorskip(
    'rclpy.serialization', reason='rclpy is not installed on this machine')


def message_class(type_name: str) -> Any:
    package, _, name = type_name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


@pytest.mark.parametrize(
    ('type_name', 'data', 'expected'), [case[1:] for case in CASES],
    ids=[case[0][:60] for case in CASES])
def test_rclpy_reads_our_bytes_and_we_read_its(
    type_name: str, data: bytes, expected: dict,
) -> None:
    message = serialization.deserialize_message(data, message_class(type_name))
    assert plain(message) == expected
    theirs = serialization.serialize_message(message)
    # It may end with room for the alignment of an empty sequence.
    assert 0 <= len(theirs) - len(data) <= 4
    check_decoded(type_name, DECODERS[type_name](theirs), expected)
