#!/usr/bin/env bash
# Compares the instruction counts of the hottest code with results/instructions.json (2 % tolerance); --update records them.
# Ends with code 77 where there is no valgrind.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v valgrind > /dev/null; then
    echo "no valgrind here (apt-get install valgrind)"
    exit 77
fi
case "${1:-}" in
    --update) action=update ;;
    "") action=check ;;
    *) echo "usage: $0 [--update]" >&2; exit 2 ;;
esac
# Incremental builds divide a crate otherwise, and count otherwise.
CARGO_INCREMENTAL=0 cargo bench --quiet --bench counts -- "$action" "$PWD/results/instructions.json"
