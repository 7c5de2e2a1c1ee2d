#!/usr/bin/env bash
# submit.sh N GRID OUT [FLAG...]: sends a sweep in N shards and its merge to Slurm; waits for neither.
#
# Again, with the same words, after a failure: shards that are complete end at once. SHARDS (such as 3,7-9) sends only
# these, SBATCH_FLAGS goes to sbatch (--partition, --account, ...), AT_ONCE is the number of shards that may run together.
set -euo pipefail
if [ $# -lt 3 ]; then
    sed -n '2,5s/^# //p' "$0" >&2
    exit 2
fi
count=$1 grid=$2 out=$3
shift 3
here=$(cd "$(dirname "$0")" && pwd)
array=${SHARDS:-1-$count}%${AT_ONCE:-100}
# shellcheck disable=SC2086
job=$(sbatch --parsable ${SBATCH_FLAGS:-} --array="$array" "$here/array.sbatch" "$count" "$grid" "$out" "$@")
# shellcheck disable=SC2086
merge=$(sbatch --parsable ${SBATCH_FLAGS:-} --dependency="afterany:$job" "$here/merge.sbatch" "$count" "$out")
echo "shards: job $job, merge: job $merge"
