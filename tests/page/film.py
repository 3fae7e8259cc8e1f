#!/usr/bin/env python3
"""Makes the animation of the README: the demo, with a bad swap that is refused and a sweep of the arms.

film.py BROWSER MORPHQUAD FILE.gif

It needs Pillow beside what requirements.txt names. `tests/page/browser.sh` names the browser.
"""

import io
import subprocess
import sys
import tempfile

from browsing import SIZE, WITH_GL, launched, opened, wait_for_time
from drive_live import ASKS, flying
from PIL import Image
from playwright.sync_api import sync_playwright

# What is pressed when [s of flight], and the end.
PRESSED = [(3.5, "Gust"), (6.0, "Bad swap"), (14.0, "Arms")]
UNTIL_S = 17.0
WIDE_PX = 760
EVERY_MS = 320


def main():
    browser_path, morphquad, out = sys.argv[1:]
    command = [morphquad, "demo", "--listen", "127.0.0.1:0", "--no-open", "--for", "600s"]
    frames, presses = [], list(PRESSED)
    with (
        sync_playwright() as playwright,
        tempfile.TemporaryDirectory() as folder,
        flying(command, folder, subprocess.DEVNULL) as (process, address),
    ):
        page, _ = opened(launched(playwright, browser_path, WITH_GL), address, may_ask=[*ASKS, "demo"], color_scheme="light")
        page.set_viewport_size({"width": SIZE["width"], "height": 640})
        wait_for_time(page, lambda t: t > 2.5)
        while (t := float(page.inner_text("#clock").split("/")[0])) < UNTIL_S:
            if presses and t > presses[0][0]:
                page.locator("#demo .tries button", has_text=presses.pop(0)[1]).last.click()
            picture = Image.open(io.BytesIO(page.screenshot()))
            high = round(picture.height * WIDE_PX / picture.width)
            frames.append(picture.convert("RGB").resize((WIDE_PX, high), Image.Resampling.LANCZOS))
            page.wait_for_timeout(EVERY_MS)
        process.terminate()
        page.close()
        process.wait(60)
    palette = frames[len(frames) // 2].quantize(96)
    first, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    first.save(out, save_all=True, append_images=others, duration=2 * EVERY_MS, loop=0, optimize=True)


main()
