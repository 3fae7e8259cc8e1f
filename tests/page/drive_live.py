#!/usr/bin/env python3
"""Flies with `--live` and does in headless Chromium what a pilot would do on the page.

drive_live.py BROWSER MORPHQUAD PICTURES

Swaps, disturbs, morphs and stops by button, with a second browser looking on that has neither WebGL nor a
token. Pictures of the page are left in the folder PICTURES.
"""

import re
import subprocess
import sys
import tempfile
import threading
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

from browsing import WITH_GL, WITHOUT_GL, check, colours, launched, opened, overlaps, time_of, wait_for_time, wait_until_painted
from playwright.sync_api import sync_playwright

ASKS = ["flight", "control", "close"]
SERVED = ["--live=127.0.0.1:0", "--no-open", "--for", "900s"]

BACK_AT_ONCE = """(slot, name) => {
  const owner = slot.querySelector(".owner");
  const back = [...slot.querySelectorAll("button")].find((button) => button.textContent === "Roll back");
  const watch = new MutationObserver(() => {
    if (!owner.textContent.startsWith(name)) return;
    watch.disconnect();
    back.click();
    window.wentBack = true;
  });
  watch.observe(owner, { characterData: true, childList: true, subtree: true });
}"""


@contextmanager
def flying(command, folder, summary):
    """A flight, and the address that it prints for a browser. What it says of itself at its end goes to a file:
    this flight is interrupted and disturbed, and what is wrong with the page must not drown in that."""
    # Beside a browser a healthy process exceeds the limits of wall time that are shipped.
    for limit in ("launcher.startup_timeout_s", "launcher.stall_timeout_s", "rehearsal.wall_max_s"):
        command += ["--set", f"{limit}=600"]
    process = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=summary, stderr=subprocess.PIPE, text=True)
    lines, found, address = [], threading.Event(), []

    def listen():
        for line in process.stderr:
            lines.append(line)
            if match := re.search(r"live\s+(http://127\.0\.0\.1:\d+/#token=\S+)", line):
                address.append(match[1])
                found.set()
        found.set()

    threading.Thread(target=listen, daemon=True).start()
    try:
        found.wait(60)
        check(address, "the flight printed no address of its page:\n" + "".join(lines))
        yield process, address[0]
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait(30)


def wait_until(page, holds, what):
    """Until something holds; the page's own policy forbids what Playwright waits with."""
    for _ in range(1200):
        if holds():
            return
        page.wait_for_timeout(50)
    check(False, f"{what}; the page says: {answer(page)} {page.inner_text('#notice')}")


def answer(page):
    return page.inner_text("#control > output")


def press(page, row, button):
    page.locator(f'fieldset[aria-label="{row}"] button', has_text=re.compile(f"^{button}$")).click()


def asked(page, row, button, good=True):
    """Presses a button and waits for what it came to."""
    press(page, row, button)
    wait_until(page, lambda: answer(page)[:1] in "✔✖", f"{row}, {button}: no answer")
    check(answer(page)[0] == ("✔" if good else "✖"), f"{row}, {button}: {answer(page)}")
    return answer(page)


def read_out(page, name):
    text = page.locator("#now div", has_text=name).locator("dd").inner_text()
    return float(re.match(r"[\d.]+", text)[0])


def posted(address, headers, body):
    """Status of the answer to a request that a page did not make."""
    request = urllib.request.Request(address, data=body, headers=headers)
    try:
        return urllib.request.urlopen(request, timeout=20).status
    except urllib.error.HTTPError as error:
        return error.code


def refuses_strangers(address):
    base, token = address.split("#token=")
    stop = b'{"request":"stop"}'
    check(posted(base + "control", {}, stop) == 403, "an order without a token")
    check(posted(base + "control", {"Authorization": "Bearer " + token[:-1]}, stop) == 403, "an order with part of the token")
    check(posted(base + "control", {"Authorization": f"Bearer {token}"}, b"{") == 400, "an order that is none")
    check(posted(base, {"Host": "example.org"}, None) == 403, "a page from elsewhere that gave its name our address")
    page = urllib.request.urlopen(base, timeout=20).read().decode()
    check(token not in page, "the page tells the token to every client")


def commands(page, pictures):
    """By button: swap, refusal, disturbance, sweep."""
    owner = page.locator('fieldset[aria-label="attitude"] .owner')
    wait_until(page, lambda: owner.inner_text().startswith("attitude-mpc"), "no controller commands the attitude")
    page.select_option('fieldset[aria-label="attitude"] select', "attitude-lqr")
    # Back as soon as the swap shows: to a busy machine the seconds of its rollback window are short.
    page.locator('fieldset[aria-label="attitude"]').evaluate(BACK_AT_ONCE, "attitude-lqr")
    press(page, "attitude", "Swap")
    wait_until(page, lambda: page.evaluate("window.wentBack === true"), "the swap does not show")
    wait_until(page, lambda: owner.inner_text().startswith("attitude-mpc"), "the way back does not show")
    wait_until(page, lambda: page.locator('[aria-busy="true"]').count() == 0, "an order gets no answer")

    page.select_option('fieldset[aria-label="attitude"] select', "attitude-lqr")
    asked(page, "attitude", "Swap")
    check(owner.inner_text().startswith("attitude-lqr"), f"after a swap {owner.inner_text()} commands")
    mark = page.locator("#events button:not(.minor)", has_text="commands from now on")
    wait_until(page, lambda: mark.count() > 0, "the swap is not among the events")

    page.fill('fieldset[aria-label="morph β"] input[type=number]', "0.01")
    answers = asked(page, "morph β", "Morph", good=False)
    check("the servo gives" in answers, answers)
    check(page.get_attribute("#control > output", "class") == "bad", "a refusal looks like success")
    page.screenshot(path=pictures / "live-refused.png")
    page.fill('fieldset[aria-label="morph β"] input[type=number]', "1")
    page.fill('fieldset[aria-label="morph β"] input[type=range]', "120")
    asked(page, "morph β", "Morph")
    wait_until(page, lambda: read_out(page, "deployable angle") == 120, "the arms do not move")

    page.select_option('fieldset[aria-label="disturb"] select', "force")
    page.fill('fieldset[aria-label="disturb"] label:has-text("for s") input', "")
    asked(page, "disturb", "Disturb")
    wait_until(page, lambda: read_out(page, "external force") > 0.2, "no force acts")
    asked(page, "disturb", "Calm")
    wait_until(page, lambda: read_out(page, "external force") == 0, "the force does not end")
    asked(page, "go to", "Go")


def drive_time(page):
    """Away from the newest sample and back."""
    page.focus("#scene")
    page.keyboard.press("Space")
    wait_until_painted(page)
    stood = time_of(page)
    wait_until_painted(page)
    check(time_of(page) == stood, "it goes on although paused")
    page.keyboard.press("l")
    wait_for_time(page, lambda t: t > stood)
    page.click("#unzoom")
    page.wait_for_selector("#unzoom:disabled")
    page.click("#recent")
    check(page.get_attribute("#edge", "aria-pressed") == "true", "another window leaves the flight behind")


def take_pictures(page, pictures):
    for theme in ["dark", "light"]:
        if page.get_attribute("html", "data-theme") != theme:
            page.click("#theme")
        wait_until_painted(page)
        check(not overlaps(page), f"{theme}: {overlaps(page)}")
        page.screenshot(path=pictures / f"live-{theme}.png")
    page.set_viewport_size({"width": 400, "height": 900})
    wait_until_painted(page)
    wide = page.evaluate("document.documentElement.scrollWidth")
    check(wide <= 400, f"on a narrow screen the page is {wide} wide")
    page.screenshot(path=pictures / "live-narrow.png")
    page.set_viewport_size({"width": 1280, "height": 800})


def look_on(browser, base, pictures):
    """A second browser, without WebGL: first without a token, then with a wrong one."""
    page, complaints = opened(browser, base, may_ask=ASKS)
    check(page.get_attribute("html", "data-view") == "2d", "WebGL although the browser has none")
    begun = time_of(page)
    wait_for_time(page, lambda t: t > begun)
    check(colours(page, "#labels") > 20, "top and side view are empty")
    buttons = page.locator("#control button")
    check(all(not buttons.nth(i).is_enabled() for i in range(buttons.count())), "a button works without a token")
    check("token" in answer(page), f"nothing is said about the token: {answer(page)}")
    page.screenshot(path=pictures / "live-without-token.png")
    page.evaluate("location.hash = 'token=wrong'")
    wait_until(page, lambda: "wrong token" in answer(page), "nothing is said about a wrong token")
    check(all(not buttons.nth(i).is_enabled() for i in range(buttons.count())), "a button works with a wrong token")
    complaints = [line for line in complaints if "WebGL" not in line and "403" not in line]
    check(not complaints, f"the console of the second browser says {complaints}")
    return page


def tried(page, name):
    """Presses a button of the demo and gives back what came of it."""
    page.locator("#demo .tries button", has_text=re.compile(f"^{name}$")).click()
    said = page.locator("#demo > output")
    wait_until(page, lambda: said.inner_text()[:1] in "✔✖", f"{name}: no answer")
    return said.inner_text()


def demonstrate(morphquad, browser_path, pictures):
    """By one click each: a gust, the arms, a bad swap that is refused and drawn, a death."""
    command = [morphquad, "demo", "--listen", "127.0.0.1:0", "--no-open", "--for", "600s"]
    with (
        sync_playwright() as playwright,
        tempfile.TemporaryDirectory() as folder,
        open(pictures / "demo.txt", "w") as summary,
        flying(command, folder, summary) as (process, address),
    ):
        browser = launched(playwright, browser_path, WITH_GL)
        page, complaints = opened(browser, address, may_ask=[*ASKS, "demo"], color_scheme="light")
        wait_for_time(page, lambda t: t > 2.5)
        check(page.inner_text("#badge") == "LIVE" and page.is_visible("#demo"), "a demo does not open playing")
        answers = tried(page, "Bad swap")
        check("flown ahead, it would" in answers and "red course" in answers, answers)
        wait_until_painted(page)
        page.screenshot(path=pictures / "demo-refused.png")
        for name in ["Gust", "Arms"]:
            check(tried(page, name)[0] == "✔", f"{name}: {page.inner_text('#demo > output')}")
        answers = tried(page, "Kill")
        check("is killed" in answers, answers)
        wait_until(page, lambda: page.locator("#events button", has_text="killed by signal 9").count() > 0, "no successor")
        check(page.locator("#demo code").count() == 3, "nothing to go on with")
        page.screenshot(path=pictures / "demo-killed.png")
        check(not complaints, f"the console of the demo says {complaints}")
        process.terminate()
        page.close()
        process.wait(60)


def main():
    browser_path, morphquad, pictures = sys.argv[1:]
    pictures = Path(pictures)
    pictures.mkdir(parents=True, exist_ok=True)
    with (
        sync_playwright() as playwright,
        tempfile.TemporaryDirectory() as folder,
        open(pictures / "flight.txt", "w") as summary,
        flying([morphquad, "run", "figure8-morph", *SERVED], folder, summary) as (process, address),
    ):
        refuses_strangers(address)
        with_gl, without_gl = (launched(playwright, browser_path, flags) for flags in [WITH_GL, WITHOUT_GL])
        page, complaints = opened(with_gl, address, may_ask=ASKS, color_scheme="dark")
        check("token" not in page.url, f"the token stays in the address: {page.url}")
        check(page.get_attribute("html", "data-view") == "3d", "no WebGL 2 although the browser has it")
        begun = time_of(page)
        wait_for_time(page, lambda t: t > begun)
        check(page.inner_text("#badge") == "LIVE", page.inner_text("#badge"))
        commands(page, pictures)
        other = look_on(without_gl, address.split("#")[0], pictures)
        drive_time(page)
        take_pictures(page, pictures)
        page.reload()
        page.wait_for_selector("html[data-ready=yes]")
        # The token has outlived the reload.
        asked(page, "disturb", "Calm")

        # Both clicks at once: to a busy machine three seconds are short.
        stop = page.locator('fieldset[aria-label="stop the flight"] button')
        once = stop.evaluate("(button) => { button.click(); const text = button.textContent; button.click(); return text; }")
        check(once == "Really stop?", f"after one click the button says {once}")
        for each in [page, other]:
            wait_until(each, lambda each=each: each.inner_text("#badge") == "ENDED", "the end does not show")
            check("morphquad view" in each.inner_text("#notice"), each.inner_text("#notice"))
            check(not each.locator("#control button").first.is_enabled(), "a button works after the end")
        status = process.wait(60)
        check(status == 130, f"the flight ends with {status}, not as one that is interrupted")
        page.focus("#scene")
        page.keyboard.press("Home")
        wait_for_time(page, lambda t: t == 0)
        page.keyboard.press("Space")
        wait_for_time(page, lambda t: t > 0.1)
        page.screenshot(path=pictures / "live-ended.png")
        check(not complaints, f"the console says {complaints}")
    demonstrate(morphquad, browser_path, pictures)
    print(f"the live page flies by button, and others look on; pictures in {pictures}")


if __name__ == "__main__":
    main()
