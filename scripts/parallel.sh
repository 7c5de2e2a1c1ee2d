#!/usr/bin/env bash
# parallel.sh SHARDS GRID OUT [FLAG...]: a sweep in SHARDS shards by GNU parallel, merged into OUT/merged.
#
# Each shard is one process with one thread. Run the same command again after anything: shards that are done are not
# started, the others go on where they stopped. JOBS (default: all cores), LOGIN (--sshlogin, needs a common file
# system) and MTF_EVAL (the program) may be set.
set -euo pipefail
if [ $# -lt 3 ]; then
    sed -n '2,6s/^# //p' "$0" >&2
    exit 2
fi
shards=$1 grid=$2 out=$3
shift 3
program=${MTF_EVAL:-mtf-eval}
mkdir -p "$out"
status=0
# The exit code is the number of shards that failed.
seq "$shards" | parallel --jobs "${JOBS:-100%}" ${LOGIN:+--sshlogin "$LOGIN" --workdir .} \
    --joblog "$out/joblog" --resume-failed \
    "$program" run --grid "$grid" "$@" --shard "slice:{}/$shards" --out "$out/shard-{}" -j 1 --quiet \
    ">" /dev/null || status=$?
[ "$status" = 0 ] || echo "parallel.sh: $status shards failed" >&2
# Says what is missing when shards are.
exec "$program" merge "$out/merged" $(seq -f "$out/shard-%g" "$shards")
