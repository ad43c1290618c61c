#!/usr/bin/env bash
# Make .venv with everything pinned in requirements.txt, and see that an OpenCL device works.
# Usage: scripts/setup.sh [--with-intel | --without-device]
#   --without-device      make .venv alone, which is enough to draw figures from records
#   --with-intel          add Intel's CPU runtime to .venv even where another device works
#   DEFRAY_SETUP_APT=0    install no Debian package
# Doing it again takes no time: a stamp in .venv remembers what was done. Details go to .setup-log.
set -euo pipefail
cd "$(dirname "$0")/.."

LOG=.setup-log
VENDORS=.venv/etc/defray/opencl-vendors # harness/device/runtime.py shows these ICD files to the loader
INSTALL="apt-get install python3.11 python3.11-venv"

say() { echo "setup: $*"; }
fail() { echo "setup: error: $*" >&2; exit 1; }

# Run a command with its output in the log; on failure show the end of it and return the command's code.
logged() {
    echo "+ $*" >>"$LOG"
    "$@" >>"$LOG" 2>&1 && return
    local code=$?
    echo "setup: '$*' failed (exit code $code); the end of $LOG:" >&2
    tail -n 6 "$LOG" >&2
    return "$code"
}

can_apt() { [ "${DEFRAY_SETUP_APT:-1}" != 0 ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; }

apt_install() {
    export DEBIAN_FRONTEND=noninteractive
    # A stale package list is the commonest failure; an update that fails may still leave a usable one.
    logged apt-get update || true
    logged apt-get install -y --no-install-recommends "$@"
}

# ---------------------------------------------------------------- the stamp

wanted_stamp() { cat requirements.txt pyproject.toml scripts/setup.sh scripts/runtimes/*.txt | sha256sum; }

has_vendor() {
    local system=${OCL_ICD_VENDORS:-/etc/OpenCL/vendors}
    [ -f "$system" ] || compgen -G "$system/*" >/dev/null || compgen -G "$VENDORS/*.icd" >/dev/null ||
        compgen -G ".venv/lib/python3*/site-packages/pyopencl/.libs/*.icd" >/dev/null
}

is_done() {
    [ -x .venv/bin/python ] && [ "$(cat .venv/defray-stamp 2>/dev/null)" = "$(wanted_stamp)" ] && has_vendor &&
        { [ "$with_intel" = 0 ] || [ -f "$VENDORS/intel.icd" ]; }
}

# ---------------------------------------------------------------- Python

# Print a Python 3.11 or newer; 3.11 first, because requirements.txt was pinned with it.
find_python() {
    local name
    for name in ${DEFRAY_PYTHON:-} python3.11 python3 python3.12 python3.13; do
        if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            echo "$name"
            return
        fi
    done
    return 1
}

make_environment() {
    local python version
    python=$(find_python) || fail "no Python 3.11 or newer; as root: $INSTALL"
    if .venv/bin/python -c 'import pip' 2>/dev/null; then return; fi
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        can_apt || fail "$python has no venv module; as root: apt-get install python$version-venv"
        say "installing Debian's python$version-venv"
        apt_install "python$version-venv" || apt_install python3-venv || fail "see the lines above"
    fi
    say "making .venv with $("$python" --version)"
    rm -rf .venv
    logged "$python" -m venv .venv || fail "see the lines above"
}

install_packages() {
    say "installing the packages pinned in requirements.txt"
    logged .venv/bin/python -m pip install --require-hashes --no-deps --only-binary :all: -r requirements.txt ||
        fail "see the lines above"
    logged .venv/bin/python -m pip install --no-deps --no-build-isolation -e . || fail "see the lines above"
}

# ---------------------------------------------------------------- OpenCL

# Print the title of a device that passes its probe and whose platform or name contains $1.
working_device() {
    .venv/bin/python -c '
import sys
from harness.device.opened import open_device
from harness.errors import DefrayError
try:
    print(open_device(sys.argv[1]).title)
except DefrayError as error:
    sys.exit(str(error))' "${1:-}" 2>>"$LOG"
}

# Install runtime $1 (a list in scripts/runtimes) into .venv, make library $3 visible where one is named,
# and keep it only if platform $2 passes the probe.
add_runtime() {
    local name=$1 platform=$2 library=${3:-}
    say "trying the packages of scripts/runtimes/$name.txt"
    logged .venv/bin/python -m pip install --require-hashes --no-deps --only-binary :all: \
        -r "scripts/runtimes/$name.txt" || return
    if [ -n "$library" ]; then
        mkdir -p "$VENDORS"
        echo "$PWD/$library" >"$VENDORS/$name.icd"
    fi
    if device=$(working_device "$platform"); then return; fi
    rm -f "$VENDORS/$name.icd"
    grep -oE '^[a-z][a-z0-9-]+' "scripts/runtimes/$name.txt" |
        xargs .venv/bin/python -m pip uninstall -y >>"$LOG" 2>&1 || true
    return 1
}

add_intel() { add_runtime intel "Intel(R) OpenCL" .venv/lib/libintelocl.so; }
add_pocl() { add_runtime pocl "Portable Computing Language"; } # lies where pyopencl's own loader looks

find_device() {
    unset DEFRAY_DEVICE # set-up looks for any device; the choice among them comes later
    if device=$(working_device); then return; fi
    if can_apt; then
        say "no OpenCL device works; installing Debian's pocl-opencl-icd"
        if apt_install pocl-opencl-icd && device=$(working_device); then return; fi
    fi
    # Each is kept by its probe alone: which version works on which processor cannot be known beforehand.
    add_intel || add_pocl || {
        .venv/bin/python -m harness.commands.doctor >&2 || true
        fail "no OpenCL device works; as root: apt-get install pocl-opencl-icd, then make setup"
    }
}

# ---------------------------------------------------------------- main

with_intel=0
device_wanted=1
for argument; do
    case "$argument" in
        --with-intel) with_intel=1 ;;
        --without-device) device_wanted=0 ;;
        *) fail "unknown argument '$argument'; known: --with-intel, --without-device" ;;
    esac
done

has_packages() { [ -x .venv/bin/python ] && [ "$(cat .venv/defray-packages 2>/dev/null)" = "$(wanted_stamp)" ]; }

is_done && exit
[ "$device_wanted" = 0 ] && has_packages && exit
if command -v flock >/dev/null; then # two at once would break one another's .venv
    exec 9>.setup-lock
    flock 9
    is_done && exit
    [ "$device_wanted" = 0 ] && has_packages && exit
fi
: >"$LOG"
rm -f .venv/defray-stamp # what stops halfway is not done
if ! has_packages; then
    make_environment
    install_packages
    wanted_stamp >.venv/defray-packages
fi
if [ "$device_wanted" = 0 ]; then
    say "ready to draw after $SECONDS s, without a look for an OpenCL device"
    exit
fi
device=""
find_device
if [ "$with_intel" = 1 ] && [ ! -f "$VENDORS/intel.icd" ]; then
    add_intel || fail "Intel's runtime does not work here; $LOG says why"
fi
wanted_stamp >.venv/defray-stamp
say "ready after $SECONDS s; OpenCL device: $device"
