#!/usr/bin/env bash
# Measure a tier on this machine, without a network: run.sh [TIER]. Comes with wheels, source and scenes around it.
#   TIER           smoke (default), paper or full
#   DEVICE=part    which OpenCL device: a part of "platform / name"; NVIDIA, for one
#   DEFRAY_PYTHON  the Python to use
# Leaves defray-MACHINE-DEVICE-TIER.tar.gz beside itself: a folder of results for `defray report`.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
tier=${1:-smoke}
wheels=$here/wheels
log=$here/run-log

say() { echo "run: $*"; }
fail() { echo "run: error: $*" >&2; exit 1; }

# Print the Python that the wheels were made for.
find_python() {
    local name
    for name in ${DEFRAY_PYTHON:-} "python$version" python3 python; do
        if [ "$("$name" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = "$version" ]; then
            echo "$name"
            return
        fi
    done
    return 1
}

make_environment() {
    local python pip=(-m pip)
    python=$(find_python) || fail "the wheels are for Python $version, which is not here; DEFRAY_PYTHON names one"
    # Debian's Python has no ensurepip: pip runs from its wheel.
    if compgen -G "$wheels/pip-*.whl" >/dev/null; then
        "$python" -m venv --without-pip .venv >>"$log" 2>&1 || fail "$python cannot make an environment; see $log"
        pip=("$(compgen -G "$wheels/pip-*.whl" | head -n 1)/pip")
    else
        "$python" -m venv .venv >>"$log" 2>&1 || fail "$python cannot make an environment; see $log"
    fi
    PIP_CONFIG_FILE=/dev/null .venv/bin/python "${pip[@]}" install --no-index --find-links "$wheels" --no-deps \
        --require-hashes --only-binary :all: -r "$here/requirements.txt" >>"$log" 2>&1 ||
        fail "a wheel is missing or damaged: $(grep -m 1 -iE '^ *error' "$log" || echo "see $log")"
    .venv/bin/python "${pip[@]}" install --no-index --no-deps --no-build-isolation -e . >>"$log" 2>&1 ||
        fail "defray cannot be installed from its source; see $log"
    touch .venv/defray-stamp
}

# Records and what stands beside them, in one file named by machine, device and tier.
pack() {
    local name
    name=$(.venv/bin/python -c '
import json, platform, re, sys
device = json.load(open(f"{sys.argv[1]}/env.json"))["device"]
print("-".join(re.sub("[^A-Za-z0-9]+", "-", part).strip("-") for part in ("defray", platform.node(), device, sys.argv[2])))
' "$out" "$tier")
    cp "$here/commit" "$here/doctor.txt" "$out/"
    # A folder of that name inside, so that results of several machines unpack side by side.
    rm -rf "$here/packed" && mkdir -p "$here/packed/$name"
    find "$out" -maxdepth 1 -type f \( -name '*.json' -o -name '*.jsonl' -o -name commit -o -name doctor.txt \) \
        -exec cp {} "$here/packed/$name/" \;
    tar -czf "$here/$name.tar.gz" -C "$here/packed" "$name"
    rm -rf "$here/packed"
    say "results: $here/$name.tar.gz"
}

case $tier in smoke | paper | full) ;; *) fail "unknown tier '$tier'; known: smoke, paper, full" ;; esac
[ $# -le 1 ] || fail "run.sh takes a tier; the device is chosen by DEVICE=part"
version=$(cat "$here/python")
: >"$log"
bad=$(cd "$here" && sha256sum --check sums 2>/dev/null | sed -n 's/: FAILED.*//p' | head -n 1) || true
[ -z "$bad" ] || fail "$bad is missing or damaged; carry it again"
[ -d "$here/defray" ] || tar -xzf "$here/source.tar.gz" -C "$here"
cd "$here/defray"
cp "$here/commit" carried-commit
[ -f .venv/defray-stamp ] || { rm -rf .venv; make_environment; }

bash scripts/find_icds.sh .venv/etc/defray/opencl-vendors
export DEFRAY_CACHE=${DEFRAY_CACHE:-$here/cache}
if [ -d "$here/scenes" ]; then export DEFRAY_SCENES=${DEFRAY_SCENES:-$here/scenes}; fi
if [ -n "${DEVICE:-}" ]; then export DEFRAY_DEVICE=$DEVICE; fi
.venv/bin/defray doctor >"$here/doctor.txt" || { cat "$here/doctor.txt"; fail "no OpenCL device works"; }
cat "$here/doctor.txt"

# Relative, so that records name no folder of this machine.
out=../results-$tier${DEVICE:+-${DEVICE//[^A-Za-z0-9]/-}}
code=0
.venv/bin/defray reproduce "$tier" --out "$out" --no-report || code=$?
if [ -s "$out/records.jsonl" ]; then pack; fi
exit "$code"
