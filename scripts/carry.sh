#!/usr/bin/env bash
# Pack what a machine without a network needs to measure: this commit, its wheels, chosen scenes, and run.sh.
# Usage: scripts/carry.sh [--to FOLDER] [--scenes A,B] [--python X.Y] [--report]
#   --to FOLDER    where to; carried by default. Beside it FOLDER.tar holds the same in one file
#   --scenes A,B   real scenes to take from the folder DEFRAY_SCENES; the other machine generates stand-ins for others
#   --python X.Y   the other machine's Python, .venv's by default: wheels are made for one version
#   --report       what draws figures too, not only what measures: twice as large
# On the other machine: tar xf FOLDER.tar, then FOLDER/run.sh TIER.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "carry: error: $*" >&2; exit 1; }

# What only tests, lints or draws; the rest measures.
LEFT_OUT="click contourpy cycler execnet fonttools grimp import-linter iniconfig kiwisolver matplotlib pillow pluggy
    py-cpuinfo2 pyparsing pytest pytest-benchmark pytest-xdist ruff typst vl-convert-python"

# The locked requirements but those named in $1, each with its hashes.
without() { awk -v names="$1" '
    BEGIN { count = split(names, list, /[ \n]+/); for (i = 1; i <= count; i++) left_out[list[i]] = 1 }
    /^[a-z]/ { split($0, part, "=="); taken = !(part[1] in left_out) }
    taken && !/^ *#/' requirements.txt; }

download_wheels() {
    local pip=".venv/bin/python -m pip" ours other=()
    ours=$(.venv/bin/python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    if [ "$version" != "$ours" ]; then
        other=(--python-version "$version" --implementation cp)
        for age in 2_28 2_27 2_26 2_24 2_17 2_12 2_5; do other+=(--platform "manylinux_${age}_x86_64"); done
        other+=(--platform manylinux2014_x86_64)
    fi
    # pip itself, for a Python that comes without it: it is not measured, so its version is this environment's.
    $pip download --quiet --no-deps --only-binary :all: -d "$to/wheels" \
        "pip==$($pip --version | cut -d' ' -f2)" || fail "pip's own wheel could not be had"
    $pip download --quiet --no-deps --require-hashes --only-binary :all: "${other[@]}" -d "$to/wheels" \
        -r "$to/requirements.txt" || fail "a wheel could not be had for Python $version; see the lines above"
}

# Copy the files of scene $1 from DEFRAY_SCENES.
copy_scene() {
    local files
    files=$(.venv/bin/python -c '
import sys
from harness.errors import DefrayError
from harness.inputs.scenes_by_name import carried_files
try:
    print(*carried_files(sys.argv[1]), sep="\n")
except DefrayError as error:
    sys.exit(f"carry: error: {error}")' "$1") || exit 1
    mkdir -p "$to/scenes"
    while read -r file; do cp "$file" "$to/scenes/"; done <<<"$files"
}

to=carried scenes="" version="" report=0
while [ $# -gt 0 ]; do
    case $1 in
        --report) report=1; shift; continue ;;
        --to | --scenes | --python) [ $# -gt 1 ] || fail "$1 needs a value" ;;
        *) fail "unknown argument '$1'; known: --to, --scenes, --python, --report" ;;
    esac
    case $1 in --to) to=$2 ;; --scenes) scenes=$2 ;; --python) version=$2 ;; esac
    shift 2
done
[ -x .venv/bin/python ] || fail "no .venv; run make setup"
version=${version:-$(.venv/bin/python -c 'import sys; print("%d.%d" % sys.version_info[:2])')}
commit=$(git rev-parse HEAD) || fail "not a git checkout: what is measured needs a commit"
[ -z "$(git status --porcelain)" ] || echo "carry: uncommitted changes are left behind; what is carried is $commit" >&2
if [ -e "$to" ] && [ ! -f "$to/commit" ]; then fail "$to is there and was not made by carry; choose another --to"; fi

rm -rf "$to" "$to.tar"
mkdir -p "$to/wheels"
echo "$commit" >"$to/commit"
echo "$version" >"$to/python"
git archive --prefix=defray/ HEAD -- . ':!results' | gzip -9n >"$to/source.tar.gz"
if [ "$report" = 1 ]; then without "" >"$to/requirements.txt"; else without "$LEFT_OUT" >"$to/requirements.txt"; fi
download_wheels
for scene in ${scenes//,/ }; do copy_scene "$scene"; done
cp scripts/carried/run.sh "$to/run.sh"
chmod +x "$to/run.sh"
(cd "$to" && find . -type f ! -name sums -print0 | sort -z | xargs -0 sha256sum >sums)
tar -cf "$to.tar" -C "$(dirname "$to")" "$(basename "$to")"
size() { du -sk --apparent-size "$@" | awk '{ sum += $1 } END { printf "%.1f MiB", sum / 1024 }'; }
echo "carry: $to.tar, $(size "$to.tar") (wheels for Python $version $(size "$to/wheels")$(
    [ -d "$to/scenes" ] && echo ", scenes $(size "$to/scenes")")); there: tar xf, then run.sh TIER"
