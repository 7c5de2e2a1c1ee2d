#!/usr/bin/env bash
# Speed of mtf-eval beside ViSP (a Debian package) and OpenCV (from PyPI), on the same frames, in the same run, on one core.
#
#   scripts/bench_peers.sh [OUT]        OUT: folder of the results [default: results/bench/<date>-<host>]
#
# Prints ratios (how many times longer the others take, per frame and per iteration) and what it had to skip. The others are
# timed in processor time, which other work on the machine hardly touches; mtf-eval, whose updates are far shorter, by the
# clock, to its own disadvantage. Nothing is installed outside a temporary folder unless INSTALL=1 is set, which lets
# apt-get install ViSP. Other settings: MTF_EVAL (program to measure; built otherwise), CORE (core to run on, or `any`), LIMIT
# (seconds for each step), PASSES.
set -euo pipefail
MTF_EVAL=${MTF_EVAL:+$(realpath "$MTF_EVAL")}
cd "$(dirname "$0")/.."

limit=${LIMIT:-300} passes=${PASSES:-5}
host=$(uname -n)
out=${1:-results/bench/$(date -u +%F)-$host}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
skip() { echo "skipped: $*" >&2; }

one_core=()
if [ "${CORE:-0}" != any ] && command -v taskset >/dev/null; then
    one_core=(taskset -c "${CORE:-0}")
fi
one_core+=(timeout -k 10 "$limit")

if [ -z "$MTF_EVAL" ]; then
    cargo build --release
    MTF_EVAL=$(realpath "${CARGO_TARGET_DIR:-target}/release/mtf-eval")
fi

# 200 frames of a textured plane: an object of 220x180 px under a smooth homography, 3 px a frame, with noise.
sequence=$work/data/plane
"$MTF_EVAL" synth "$sequence" --texture rock --size 640x480 --frames 200 --box 220x180 --soften 0.7 \
    --motion homography --amplitude 60 --speed 3 --tilt 0.2 --noise 3 --seed 7 --quality 95 >&2

packages=(libvisp-tt-mi-dev libvisp-tt-dev libvisp-io-dev)
visp() {
    if ! dpkg -s "${packages[@]}" >/dev/null 2>&1; then
        if [ "${INSTALL:-0}" != 1 ]; then
            skip "ViSP: not installed (apt-get install --no-install-recommends ${packages[*]}, or INSTALL=1)"
            return
        fi
        if ! timeout "$limit" apt-get install -y --no-install-recommends "${packages[@]}" >&2; then
            skip "ViSP: apt-get could not install ${packages[*]}"
            return
        fi
    fi
    # Optimised for this very machine, which the program it is compared with is not.
    if ! timeout "$limit" g++ -O3 -march=native -std=c++17 -I/usr/include/opencv4 scripts/visp_bench.cpp \
        -o "$work/visp_bench" -lvisp_tt_mi -lvisp_tt -lvisp_io -lvisp_core >&2; then
        skip "ViSP: visp_bench.cpp does not compile here"
        return
    fi
    # A sample every 4 px: 2475 of this object, for 50x50 of ours.
    while read -r tracker warp like; do
        "${one_core[@]}" "$work/visp_bench" "$sequence" "$tracker" "$warp" "$like" 4 30 "$passes" ||
            skip "ViSP $tracker: failed or longer than $limit s"
    done <<'LIST'
SSDESM HomographySL3 esm/ssd/homography
SSDForwardCompositional Homography fclk/ssd/homography
SSDForwardAdditional Homography falk/ssd/homography
SSDInverseCompositional Homography iclk/ssd/homography
ZNCCInverseCompositional Homography iclk/zncc/homography
LIST
}

opencv() {
    if ! { python3 -m venv "$work/venv" && timeout "$limit" "$work/venv/bin/pip" install -q opencv-python-headless numpy; } >&2; then
        skip "OpenCV: PyPI or venv cannot be had"
        return
    fi
    "${one_core[@]}" "$work/venv/bin/python" scripts/opencv_bench.py "$sequence" "$passes" ||
        skip "OpenCV: failed or longer than $limit s"
}

{ visp; opencv; } >"$work/rows"
printf '{"schema_version": 1, "rows": [%s]}\n' "$(paste -sd, "$work/rows")" >"$work/peers.json"

mkdir -p "$out"
load=$(cut -d' ' -f2 /proc/loadavg 2>/dev/null || echo 0)
(cd "$work" && "${one_core[@]}" "$MTF_EVAL" bench data --repeats "$passes" --sm esm,fclk,falk,iclk --am ssd,zncc \
    --tracker 'grid(flow)' --against peers.json --format md --save bench.json --chart speed.svg) | tee "$out/bench.md"
cp "$work"/{bench,peers}.json "$work/speed.svg" "$out"
if awk "BEGIN { exit !($load > 1.5) }"; then
    echo "
The machine was shared with other work (load $load): ours are upper bounds." |
        tee -a "$out/bench.md"
fi
echo "results in $out" >&2
