# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a node that is still being built, e.g. while its kernels are compiled."""

from collections.abc import Iterator
from contextlib import contextmanager
import threading

from icofabric_sim.messages.topics import DIAGNOSTICS
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.ros.live_sink import message_class, quality
from icofabric_sim.running.diagnostics import HealthReport
from rclpy.node import Node

_INTERVAL_S = 1.0


@contextmanager
def reporting_start(node: Node) -> Iterator[None]:
    """Publish /diagnostics of `node` once a second, from another thread, during the block."""
    publisher = node.create_publisher(
        message_class(DIAGNOSTICS.type), DIAGNOSTICS.name, quality(DIAGNOSTICS))
    report, over = HealthReport(node.get_fully_qualified_name()), threading.Event()

    def work() -> None:
        before = 0.0
        while not over.wait(_INTERVAL_S):
            compiling = compile_notice.seconds
            publisher.publish(report.start_bytes(compiling if compiling > before else 0.0))
            before = compiling

    thread = threading.Thread(target=work, name='start report', daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        node.destroy_publisher(publisher)
