#!/usr/bin/env python3
"""Drives the page of a flight in headless Chromium and looks at what it does.

drive_page.py BROWSER PAGE.html PICTURES URL

PAGE.html shows 20 s of figure8-morph with a swap and a fault; URL is the same page as `morphquad view` serves it.
Pictures of it are left in the folder PICTURES.
"""

import base64
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

SIZE = {"width": 1280, "height": 800}
# The software renderer stands in for a graphics card.
WITH_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
WITHOUT_GL = ["--disable-gpu", "--disable-3d-apis"]


def check(holds, what):
    if not holds:
        sys.exit(f"drive_page.py: {what}")


def opened(browser, address, **options):
    """A page that is ready, with what its console complains of."""
    page = browser.new_page(viewport=SIZE, **options)
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(address)
    page.wait_for_selector("html[data-ready=yes]", timeout=20_000)
    others = [url for url in requests if url.split("#")[0] != address.split("#")[0] and not url.startswith("data:")]
    check(not others, f"the page asked for {others}")
    return page, complaints


def wait_for_time(page, holds):
    """Until the time shown is as wanted; the page's own policy forbids what Playwright waits with."""
    for _ in range(200):
        if holds(time_of(page)):
            return
        page.wait_for_timeout(50)
    check(False, f"the time stays at {time_of(page)} s")


def time_of(page):
    return float(page.inner_text("#clock").split("/")[0].replace("\u2212", "-"))


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


def drive_in_space(browser, address, pictures):
    page, complaints = opened(browser, address)
    check(page.get_attribute("html", "data-view") == "3d", "no WebGL 2 although the browser has it")
    check(page.locator("#charts canvas").count() >= 14, "charts are missing")
    check("flown" in page.inner_text("#outcome"), page.inner_text("#outcome"))
    check(time_of(page) == 0.0, "the page does not begin at the start")

    page.focus("#scene")
    page.keyboard.press("Space")
    wait_for_time(page, lambda t: t > 0.2)
    page.keyboard.press("Space")
    stood = time_of(page)
    page.wait_for_timeout(200)
    check(time_of(page) == stood, "it plays on although paused")
    page.keyboard.press("End")
    wait_for_time(page, lambda t: t > 19.9)
    page.keyboard.press("Home")
    wait_for_time(page, lambda t: t == 0)

    flip = page.locator("#events button:not(.minor)", has_text="commands from now on").first
    flip.click()
    wait_for_time(page, lambda t: abs(t - 8) < 0.1)
    check(page.locator("#events button", has_text="killed by signal 9").count() == 1, "no fault among the events")

    chart = page.locator("#charts canvas").first
    box = chart.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    wait_for_time(page, lambda t: abs(t - 9.5) < 1.5)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    page.keyboard.down("Shift")
    page.mouse.wheel(0, -600)
    page.keyboard.up("Shift")
    page.wait_for_selector("#unzoom:enabled")
    page.click("#unzoom")
    page.wait_for_selector("#unzoom:disabled")

    def beta():
        return float(page.inner_text("#now").split("deployable angle")[1].split("\n")[1].split("°")[0])

    page.evaluate("document.getElementById('scrub').value = 15; document.getElementById('scrub').dispatchEvent(new Event('input'))")
    wait_for_time(page, lambda t: t == 15)
    check(beta() > 150, f"the arms are not out at 15 s: {beta()}")
    open_colours = colours(page, "#scene")
    check(open_colours > 60, f"the picture in space is nearly empty: {open_colours} colours")

    for theme in ["light", "dark"]:
        if page.get_attribute("html", "data-theme") != theme:
            page.click("#theme")
        for name, t, view in [("start", 0, "follow"), ("morphing", 5, "follow"), ("events", 8.0, "course")]:
            page.click(f"[data-view={view}]")
            page.evaluate(f"document.getElementById('scrub').value = {t}; document.getElementById('scrub').dispatchEvent(new Event('input'))")
            page.wait_for_timeout(150)
            check(not overlaps(page), f"{theme}, {name}: {overlaps(page)}")
            page.screenshot(path=pictures / f"{theme}-{name}.png")
        page.evaluate("document.getElementById('charts').scrollTop = 1e6")
        page.wait_for_timeout(150)
        page.screenshot(path=pictures / f"{theme}-loops.png")
        page.evaluate("document.getElementById('charts').scrollTop = 0")
    page.set_viewport_size({"width": 400, "height": 900})
    page.wait_for_timeout(150)
    wide = page.evaluate("document.documentElement.scrollWidth")
    check(wide <= 400, f"on a narrow screen the page is {wide} wide")
    page.screenshot(path=pictures / "narrow.png")
    check(not complaints, f"the console says {complaints}")


def drive_on_plan(browser, address, pictures):
    page, complaints = opened(browser, address + "#t=5&theme=light")
    check(page.get_attribute("html", "data-view") == "2d", "WebGL although the browser has none")
    check("no WebGL 2" in page.inner_text("#message"), "nothing is said about WebGL")
    check(colours(page, "#labels") > 20, "top and side view are empty")
    page.screenshot(path=pictures / "without-webgl.png")
    complaints = [line for line in complaints if "WebGL" not in line]
    check(not complaints, f"the console says {complaints}")


def main():
    browser_path, page_path, pictures, url = sys.argv[1:]
    pictures = Path(pictures)
    pictures.mkdir(parents=True, exist_ok=True)
    file = Path(page_path).resolve().as_uri()
    with sync_playwright() as playwright:
        def launch(flags):
            return playwright.chromium.launch(executable_path=browser_path, args=["--no-sandbox", *flags])

        with_gl = launch(WITH_GL)
        drive_in_space(with_gl, file, pictures)
        page, complaints = opened(with_gl, url)
        check(not complaints, f"served, the console says {complaints}")
        with_gl.close()
        without_gl = launch(WITHOUT_GL)
        drive_on_plan(without_gl, file, pictures)
        without_gl.close()
    print(f"the page moves, in space and without WebGL; pictures in {pictures}")


main()
