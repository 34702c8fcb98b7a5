#!/usr/bin/env bash
# Makes the virtual environment $VENV with the package, editable, and what its tests need.
# Says what the system lacks and, if allowed, installs it (Debian or Ubuntu, as root or with sudo). In a terminal it asks
# first, unless CI is set or YES=1; where nobody can be asked, as in a container that is being built, it goes on.
set -euo pipefail
PYTHON=${PYTHON:-python3}
VENV=${VENV:-.venv}
cd "$(dirname "$0")/.."

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi; }

allowed() {
    if [ -n "${CI:-}" ] || [ "${YES:-}" = 1 ]; then return 0; fi
    if ! [ -t 0 ]; then return 0; fi
    local answer
    read -r -p "setup: missing: $*. Install with apt-get, as root? [y/N] " answer
    [[ $answer == [yY]* ]]
}

install_packages() {
    if ! command -v apt-get >/dev/null || ! allowed "$@"; then
        echo "setup: missing: $*. Please run: sudo apt-get install $* (or let this script do it: make setup YES=1)" >&2
        return 1
    fi
    echo "setup: installing $*" >&2
    local said
    if ! said=$({ as_root apt-get update -qq && as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@"; } 2>&1); then
        printf '%s\nsetup: could not install them; please run: sudo apt-get install %s\n' "$said" "$*" >&2
        return 1
    fi
}

if ! command -v "$PYTHON" >/dev/null; then
    install_packages python3 python3-venv
fi
if ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "setup: $("$PYTHON" --version) is too old, needs Python 3.11 or later: make PYTHON=python3.11 ..." >&2
    exit 1
fi
if ! "$PYTHON" -c 'import ensurepip, venv' 2>/dev/null; then
    install_packages "python$("$PYTHON" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv"
fi

# Drake's Python bindings load these, its renderer EGL and Mesa's drivers; 'dot' is wanted by 'ortilo diagram' alone,
# Chromium by the tests of pages alone, which are skipped without it.
missing=()
for pair in libGL.so.1:libgl1 libX11.so.6:libx11-6 libgomp.so.1:libgomp1 libEGL.so.1:libegl1; do
    ldconfig -p 2>/dev/null | grep -q "${pair%%:*}" || missing+=("${pair##*:}")
done
compgen -G '/usr/lib/*/dri/*_dri.so' >/dev/null || missing+=(libgl1-mesa-dri)
if [ ${#missing[@]} -gt 0 ]; then install_packages "${missing[@]}"; fi
if [ -n "${CI:-}" ] && ! command -v chromium chromium-browser google-chrome >/dev/null; then
    install_packages chromium || echo "setup: tests of pages will be skipped without it" >&2
fi
if [ -n "${EXPORT:-}" ]; then # the tests of `ortilo export`: compilers for other processors, and qemu to run what they make
    install_packages gcc g++ cmake clang gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm qemu-user \
        gcc-aarch64-linux-gnu libc6-dev-arm64-cross
fi
command -v dot >/dev/null || install_packages graphviz || echo "setup: 'ortilo diagram' will need it" >&2

[ -x "$VENV/bin/python" ] || "$PYTHON" -m venv "$VENV"
echo "setup: installing into $VENV" >&2
"$VENV/bin/python" -m pip install -qq --disable-pip-version-check --no-compile -c constraints.txt -e '.[dev]'
