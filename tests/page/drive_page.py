#!/usr/bin/env python3
"""Drives the page of a flight in headless Chromium and looks at what it does.

drive_page.py BROWSER PAGE.html PICTURES URL

PAGE.html shows 20 s of figure8-morph with a swap and a fault; URL is the same page as `morphquad view` serves it.
Pictures of it are left in the folder PICTURES.
"""

import sys
from pathlib import Path

from browsing import WITH_GL, WITHOUT_GL, check, colours, launched, opened, overlaps, time_of, wait_for_time, wait_until_painted
from playwright.sync_api import sync_playwright


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
    wait_until_painted(page)
    stood = time_of(page)
    wait_until_painted(page)
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
            wait_until_painted(page)
            check(not overlaps(page), f"{theme}, {name}: {overlaps(page)}")
            page.screenshot(path=pictures / f"{theme}-{name}.png")
        page.evaluate("document.getElementById('charts').scrollTop = 1e6")
        wait_until_painted(page)
        page.screenshot(path=pictures / f"{theme}-loops.png")
        page.evaluate("document.getElementById('charts').scrollTop = 0")
    page.set_viewport_size({"width": 400, "height": 900})
    wait_until_painted(page)
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
        with_gl = launched(playwright, browser_path, WITH_GL)
        drive_in_space(with_gl, file, pictures)
        page, complaints = opened(with_gl, url)
        check(not complaints, f"served, the console says {complaints}")
        with_gl.close()
        without_gl = launched(playwright, browser_path, WITHOUT_GL)
        drive_on_plan(without_gl, file, pictures)
        without_gl.close()
    print(f"the page moves, in space and without WebGL; pictures in {pictures}")


main()
