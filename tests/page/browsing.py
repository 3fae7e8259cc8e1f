"""A browser, and how a page of a flight is looked at with it."""

import base64
import sys
from pathlib import Path

SIZE = {"width": 1280, "height": 800}
# Pictures are drawn by software, on a machine that may have other things to do.
PATIENCE_MS = 120_000
# The software renderer stands in for a graphics card, where only a card will do.
WITH_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-accelerated-2d-canvas", "--disable-gpu-rasterization"]
WITHOUT_GL = ["--disable-gpu", "--disable-3d-apis"]
# Three frames a second: each takes software a tenth of a second and more, and the flight that is shown needs processors too.
FRAMES = "(() => { const soon = requestAnimationFrame; window.requestAnimationFrame = (draw) => setTimeout(() => soon(draw), 300); })()"


def check(holds, what):
    if not holds:
        sys.exit(f"{Path(sys.argv[0]).name}: {what}")


def launched(playwright, path, flags):
    return playwright.chromium.launch(executable_path=path, args=["--no-sandbox", *flags])


def opened(browser, address, may_ask=(), **options):
    """A page that is ready, with what its console complains of; it asks for nothing but itself and what it may."""
    # A badge that pulses has software compose the whole page sixty times a second.
    page = browser.new_page(viewport=SIZE, reduced_motion="reduce", **options)
    page.set_default_timeout(PATIENCE_MS)
    page.add_init_script(FRAMES)
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(address)
    page.wait_for_selector("html[data-ready=yes]")
    own = address.split("#")[0]
    known = {own, *(own + path for path in may_ask)}
    others = [url for url in requests if url.split("#")[0].split("?")[0] not in known and not url.startswith("data:")]
    check(not others, f"the page asked for {others}")
    return page, complaints


def wait_for_time(page, holds):
    """Until the time shown is as wanted; the page's own policy forbids what Playwright waits with."""
    for _ in range(1200):
        if holds(time_of(page)):
            return
        page.wait_for_timeout(50)
    check(False, f"the time stays at {time_of(page)} s")


def time_of(page):
    return float(page.inner_text("#clock").split("/")[0].replace("\u2212", "-"))


def wait_until_painted(page):
    """Until everything on the page is as the player has it: it is drawn once per frame, which a slow machine paces."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def colours(page, selector):
    """How many different colours a part of the page shows, by its canvas as the browser composed it."""
    picture = page.locator(selector).screenshot()
    return page.evaluate(
        """async (letters) => {
            const bytes = Uint8Array.from(atob(letters), (letter) => letter.charCodeAt(0));
            const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
            const canvas = new OffscreenCanvas(image.width, image.height), context = canvas.getContext("2d");
            context.drawImage(image, 0, 0);
            return new Set(new Uint32Array(context.getImageData(0, 0, image.width, image.height).data.buffer)).size;
        }""",
        base64.b64encode(picture).decode(),
    )


def overlaps(page):
    """Pairs of words in header, read-outs and footer that lie on one another or are cut off."""
    return page.evaluate(
        """() => {
            const parts = [...document.querySelectorAll("header > *, footer > *, #now dt, #now dd")]
                .filter((part) => part.offsetWidth > 0 && !part.classList.contains("gap"));
            const boxes = parts.map((part) => part.getBoundingClientRect());
            const found = [];
            for (let i = 0; i < boxes.length; i++) {
                if (parts[i].tagName === "DD" && parts[i].scrollWidth > parts[i].clientWidth + 1) found.push("cut: " + parts[i].textContent);
                if (boxes[i].right > innerWidth + 1) found.push("outside: " + parts[i].textContent);
                for (let j = i + 1; j < boxes.length; j++) {
                    const [a, b] = [boxes[i], boxes[j]];
                    if (a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1)
                        found.push(parts[i].textContent + " on " + parts[j].textContent);
                }
            }
            return found;
        }"""
    )
