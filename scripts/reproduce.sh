#!/usr/bin/env bash
# Measure a tier, draw its report, say where it is: scripts/reproduce.sh TIER OUT (make reproduce sets up first).
# The exit code is the sweep's, else that of what follows: a failed check still gets its report, and still fails.
set -u
cd "$(dirname "$0")/.." || exit 1
tier=$1
out=$2

sweep=0
.venv/bin/defray sweep harness/paper/sweeps.toml --tier "$tier" --out "$out" --resume || sweep=$?
[ "$sweep" -lt 128 ] || exit "$sweep" # interrupted or killed: nothing to report yet
[ -s "$out/records.jsonl" ] || exit "$(( sweep ? sweep : 1 ))"

accuracy=0
.venv/bin/defray accuracy --tier "$tier" --out "$out" --resume || accuracy=$?
[ "$accuracy" -lt 128 ] || exit "$accuracy"

# The suite says itself which promise is broken; it is drawn in any case.
size=smoke
[ "$tier" = full ] && size=full
stability=0
.venv/bin/defray stability --intersector all --size "$size" --out "$out" || stability=$?
[ "$stability" -lt 128 ] || exit "$stability"

# Exact counts that explain the ratios, and where the time goes.
work=0
if [ "$tier" != smoke ]; then
    .venv/bin/defray coherence sponza conference hairball crown san-miguel --rays 8k --out "$out" || work=$?
    .venv/bin/defray roofline sponza --reading adaptive --density 0.3 --rays 256k --out "$out" || work=$?
    [ "$work" -lt 128 ] || exit "$work"
fi

# Where nothing can be drawn or judged, as on a machine that only measures, DEFRAY_REPORT=0.
report=0
if [ "${DEFRAY_REPORT:-1}" != 0 ]; then
    .venv/bin/defray views "$out" >/dev/null || report=$?
    .venv/bin/defray report "$out" || report=$?
    [ -f "$out/report.html" ] && echo "report: $out/report.html"
    .venv/bin/defray claims "$out" || report=$?
fi
[ "$sweep" -eq 0 ] || echo "reproduce: the sweep reported failed checks (exit code $sweep)" >&2
[ "$accuracy" -eq 0 ] || echo "reproduce: accuracy could not be measured (exit code $accuracy)" >&2
[ "$stability" -eq 0 ] || echo "reproduce: the stress suite failed (exit code $stability)" >&2
[ "$work" -eq 0 ] || echo "reproduce: coherence or roofline could not be measured (exit code $work)" >&2
exit "$(( sweep ? sweep : accuracy ? accuracy : stability ? stability : work ? work : report ))"
