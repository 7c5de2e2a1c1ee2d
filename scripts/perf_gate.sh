#!/usr/bin/env bash
# Compares the instruction counts of the hottest code with results/instructions.json (2 % tolerance); --update records them.
# Needs valgrind: installs the Debian package where it may, else says that it skips.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v valgrind >/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    timeout 120 apt-get install -y --no-install-recommends valgrind >/dev/null 2>&1 || true
fi
if ! command -v valgrind >/dev/null; then
    echo "instruction counts skipped: no valgrind here (apt-get install valgrind)"
    exit 0
fi
case "${1:-}" in
    --update) action=update ;;
    "") action=check ;;
    *) echo "usage: $0 [--update]" >&2; exit 2 ;;
esac
# Incremental builds divide a crate otherwise, and count otherwise.
CARGO_INCREMENTAL=0 cargo bench --quiet --bench counts -- "$action" "$PWD/results/instructions.json"
