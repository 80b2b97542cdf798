# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Photographs the viewer in a Chromium without a window: the pictures of docs/viewer.md.

    .venv/bin/python docs/draw_viewer.py
"""

import io
from pathlib import Path
import signal
import subprocess
import sys
import time

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / 'test'), str(ROOT / 'test' / 'viewer')]
from browser import Browser  # noqa: E402, I100 - beside the tests
from test_page_in_browser import CONTROL, SHELLS  # noqa: E402 - beside the tests

# The last shell of the free side, and how far the mouse draws it [pixels].
BODY, DRAWN = 55, (150.0, -170.0)
# Without what only says that a browser draws on the processor.
CLOSE = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click())"


def keep(picture: bytes, name: str, height: int) -> None:
    """Write the upper part of a picture [pixels] in 255 colours: a third of its size."""
    image = Image.open(io.BytesIO(picture)).convert('RGB')
    image = image.crop((0, 0, image.width, height))
    # Means of colours: without, the red of connectors is lost.
    image = image.quantize(255, kmeans=3, dither=Image.Dither.NONE)
    image.save(ROOT / 'docs' / name, optimize=True)


def main() -> None:
    viewer = subprocess.Popen(
        [sys.executable, '-m', 'icofabric_sim.commands.main', 'view', 'hanging_slab',
         '-p', 'pull.strength:=10'], stdout=subprocess.PIPE, text=True)
    assert viewer.stdout is not None
    try:
        address = viewer.stdout.readline().strip()
        with Browser(width=1280, height=800) as browser:
            browser.open(address)
            browser.wait_for(SHELLS, 'no shells')
            time.sleep(6.0)
            browser.ask(CLOSE)
            start = browser.ask(SHELLS)[BODY][3:]
            browser.mouse('moved', start)
            browser.mouse('pressed', start, 1)
            for part in range(1, 11):
                browser.mouse('moved', [
                    place + 0.1 * part * way for place, way in zip(start, DRAWN)], 1)
            time.sleep(3.0)
            keep(browser.screenshot(), 'viewer.png', 760)
            browser.mouse('released', [place + way for place, way in zip(start, DRAWN)])
            browser.click(browser.ask(CONTROL.replace('TEXT', "'Start recording'")))
            time.sleep(1.5)
            keep(browser.screenshot(), 'viewer_refused.png', 240)
    finally:
        viewer.send_signal(signal.SIGINT)
        viewer.wait(60.0)


if __name__ == '__main__':
    main()
