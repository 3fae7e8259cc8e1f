#!/bin/sh
# Makes a folder with the scripts here and the libraries that they need, and prints verify_recording.mjs's path:
# setup.sh FOLDER. Debian and Ubuntu have Node in packages of their own, which root gets here.
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
folder=${1:?usage: setup.sh FOLDER}
if ! command -v npm >/dev/null; then
    if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
        echo "setup.sh: there is no npm; on Debian: apt-get install nodejs npm" >&2
        exit 3
    fi
    # Others may be installing something at the same time.
    flock /var/lock sh -c 'apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy nodejs npm' >&2
fi
mkdir -p "$folder"
# Several may ask for the same folder at the same time, and one of them may use what another would make anew.
exec 9>"$folder/lock"
flock 9
cp "$here"/*.mjs "$folder"
if ! cmp -s "$here/package-lock.json" "$folder/installed-lock.json"; then
    cp "$here"/package.json "$here"/package-lock.json "$folder"
    npm ci --silent --ignore-scripts --no-audit --no-fund --prefix "$folder" >&2
    cp "$here/package-lock.json" "$folder/installed-lock.json"
fi
echo "$folder/verify_recording.mjs"
