#!/usr/bin/env bash
# same_run.sh A B: succeeds when two run directories are equal in every byte that must not depend on how they were made:
# all but timing.csv, the times in the journal with the sums of its lines, and the host stamp of run.json. Prints what differs.
set -euo pipefail
a=$1 b=$2
diff -r -x timing.csv -x journal.jsonl -x run.json -x .lock "$a" "$b"
without_host() { sed '/^  "host": {/,/^  }/d' "$1/run.json"; }
without_times() { sed 's/,"time":{[^}]*}//; s/"sum":"[^"]*",//' "$1/journal.jsonl" | sort; }
diff <(without_host "$a") <(without_host "$b")
diff <(without_times "$a") <(without_times "$b")
