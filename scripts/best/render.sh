#!/bin/bash
# Renders the hard sequences of `best` (sequences.txt) and those of the embedded dataset into FOLDER.
#
#     scripts/best/render.sh FOLDER            # MTF_EVAL: the program, target/release/mtf-eval unless told
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=${MTF_EVAL:-$here/../../target/release/mtf-eval}
folder=$1
mkdir -p "$folder/hard"
grep '^mtf-eval synth ' "$here/sequences.txt" | while read -r _ _ name options; do
    # shellcheck disable=SC2086
    "$program" synth "$folder/hard/$name" $options --force > /dev/null < /dev/null
    echo "$name"
done
"$program" synth --builtin "$folder/embedded" --force > /dev/null
