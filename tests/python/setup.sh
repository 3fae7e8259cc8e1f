#!/bin/sh
# Makes target/python-tests, a Python with what verify_recording.py needs, and prints its path; another one,
# from another list, if told: setup.sh VENV REQUIREMENTS.
# Debian and Ubuntu keep the venv module in a package of its own, which root gets here.
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
venv=${1:-$here/../../target/python-tests}
if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
        echo "setup.sh: this Python has no venv module; on Debian: apt-get install python3-venv" >&2
        exit 3
    fi
    # Others may be installing something at the same time.
    flock /var/lock sh -c 'apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy python3-venv' >&2
fi
[ -x "$venv/bin/python" ] || python3 -m venv --clear "$venv"
# Not `bin/pip`, which knows only the place where the environment was made.
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "${2:-$here/requirements.txt}" >&2
echo "$venv/bin/python"
