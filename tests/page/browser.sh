#!/bin/sh
# Prints the path of a Chromium that runs without a screen; root gets Debian's where there is none.
set -eu
find_browser() {
    for name in chromium-headless-shell chromium chromium-browser google-chrome google-chrome-stable; do
        command -v "$name" && return 0
    done
    return 1
}
if ! find_browser; then
    if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
        echo "browser.sh: there is no Chromium; on Debian: apt-get install chromium" >&2
        exit 3
    fi
    { apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends \
        chromium fonts-dejavu-core; } >&2
    find_browser
fi
