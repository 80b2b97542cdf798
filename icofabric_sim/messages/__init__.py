# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS messages built as bytes with NumPy views of their numbers; no ROS needed.

Building a message from objects takes a hundred times as long as computing the step. Each class
here therefore writes the constant parts of its message once and exposes the numbers as an array.
Publishers and bags use the same bytes.
"""
from icofabric_sim.messages.arrays import Float64MultiArrayBytes, StringBytes, UInt8MultiArrayBytes
from icofabric_sim.messages.decode import (
    decode_clock,
    decode_diagnostic_array,
    decode_float64_multi_array,
    decode_marker_array,
    decode_marker_points,
    decode_pose_array,
    decode_string,
    decode_uint8_multi_array,
    LabelledArray,
    MarkerPoints,
    PoseArrayValues,
)
from icofabric_sim.messages.diagnostics import (
    DiagnosticArrayBytes,
    DiagnosticStatus,
    ERROR,
    OK,
    STALE,
    WARN,
)
from icofabric_sim.messages.input_topics import (
    decode_point_stamped,
    decode_twist_stamped,
    decode_wrench_stamped,
    StampedPair,
    StampedPoint,
)
from icofabric_sim.messages.marker import MarkerAction, MarkerBytes, MarkerType
from icofabric_sim.messages.stamped import (
    ClockBytes,
    PointStampedBytes,
    PoseArrayBytes,
    TwistStampedBytes,
    WrenchStampedBytes,
)

__all__ = [
    'ClockBytes',
    'decode_clock',
    'decode_diagnostic_array',
    'decode_float64_multi_array',
    'decode_marker_array',
    'decode_marker_points',
    'decode_point_stamped',
    'decode_pose_array',
    'decode_string',
    'decode_twist_stamped',
    'decode_uint8_multi_array',
    'decode_wrench_stamped',
    'DiagnosticArrayBytes',
    'DiagnosticStatus',
    'ERROR',
    'Float64MultiArrayBytes',
    'LabelledArray',
    'MarkerAction',
    'MarkerBytes',
    'MarkerPoints',
    'MarkerType',
    'OK',
    'PointStampedBytes',
    'PoseArrayBytes',
    'PoseArrayValues',
    'STALE',
    'StampedPair',
    'StampedPoint',
    'StringBytes',
    'TwistStampedBytes',
    'UInt8MultiArrayBytes',
    'WARN',
    'WrenchStampedBytes',
]
