#!/usr/bin/env bash
# Pin requirements.in and scripts/runtimes/*.in with hashes, in an environment of its own.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT

.venv/bin/python -m venv "$tools"
"$tools/bin/pip" install --quiet pip-tools
for names in requirements.in scripts/runtimes/*.in; do
    # No registry may be named in the result: whoever installs uses the one their pip is set up for.
    "$tools/bin/pip-compile" --quiet --upgrade --no-header --generate-hashes --strip-extras --allow-unsafe \
        --no-emit-index-url --no-emit-find-links --no-emit-trusted-host -o "${names%.in}.txt" "$names"
    echo "lock: ${names%.in}.txt"
done
