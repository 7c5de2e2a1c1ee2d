#!/usr/bin/env bash
# Speed of mtf-eval beside ViSP and OpenCV (from PyPI), in the same run, on one core, under the same terms:
#
# - the same pixels: frames are lossless and soft, and nobody filters them; what each program's filter costs is said apart;
# - the same warm-up: one pass untimed, and a value of every cache line of a frame is read right before its update;
# - the same stop: once when the corners move by less than 0.01 px, once after ten iterations (`{epsilon=0,max_iters=10}`).
#
#   scripts/bench_peers.sh [OUT]        OUT: folder of the results [default: results/bench/<date>-<host>]
#
# Prints ratios (how many times longer the others take, per frame and per iteration), the accuracy reached (median alignment
# error, px) and what it had to skip. The others are timed in processor time, which other work on the machine hardly
# touches; mtf-eval, whose updates are far shorter, by the clock, to its own disadvantage.
#
# ViSP is built from Debian's sources for this very machine, which mtf-eval is not, where cmake and `apt-get source` can be
# had (`native` in the table). VISP_BUILD names a folder with such a build already made. Else Debian's library is measured
# (`Debian`); INSTALL=1 lets apt-get install it. Nothing else is installed outside a temporary folder. Other settings: MTF_EVAL
# (program to measure; built otherwise), CORE (core to run on, or `any`), LIMIT (seconds for each step), PASSES.
set -euo pipefail
MTF_EVAL=${MTF_EVAL:+$(realpath "$MTF_EVAL")}
cd "$(dirname "$0")/.."

limit=${LIMIT:-300} passes=${PASSES:-5}
host=$(uname -n)
out=${1:-results/bench/$(date -u +%F)-$host}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
touch "$work/said"
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

# 200 frames of a textured plane: an object of 220x180 px under a smooth homography, 3 px a frame, with little noise, as
# soft as the usual filter makes frames.
sequence=$work/data/plane
"$MTF_EVAL" synth "$sequence" --texture rock --size 640x480 --frames 200 --box 220x180 --soften 1.2 \
    --motion homography --amplitude 60 --speed 3 --tilt 0.2 --noise 1 --seed 7 --format png >&2

packages=(libvisp-tt-mi-dev libvisp-tt-dev libvisp-io-dev)

# visp_from_source FOLDER: builds the template trackers of ViSP there, for this machine.
visp_from_source() {
    local apt=(-o Dir::Etc::sourcelist="$1/sources.list" -o Dir::Etc::sourceparts=- -o Dir::State::lists="$1/lists")
    command -v cmake >/dev/null && command -v apt-get >/dev/null || return 1
    mkdir -p "$1/lists/partial" "$1/build"
    # shellcheck source=/dev/null
    echo "deb-src http://deb.debian.org/debian $(. /etc/os-release && echo "$VERSION_CODENAME") main" >"$1/sources.list"
    (
        cd "$1"
        timeout 300 apt-get "${apt[@]}" update && timeout 300 apt-get "${apt[@]}" source --download-only visp &&
            tar xzf visp_*.orig.tar.gz && cd build &&
            cmake ../visp-*/ -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS_RELEASE="-O3 -march=native -DNDEBUG" \
                -DBUILD_SHARED_LIBS=OFF -DBUILD_DEMOS=OFF -DBUILD_EXAMPLES=OFF -DBUILD_TUTORIALS=OFF -DBUILD_TESTS=OFF \
                -DBUILD_JAVA=OFF -DUSE_OPENCV=OFF -DUSE_X11=OFF &&
            timeout 3600 make -j "$(nproc)" visp_tt_mi visp_io
    ) >"$1/log" 2>&1
}

# compile_with BUILD: the timer of ViSP's trackers, with the libraries of that folder.
compile_with() {
    mkdir -p "$work/timer"
    cat >"$work/timer/CMakeLists.txt" <<LIST
cmake_minimum_required(VERSION 3.10)
project(visp_bench CXX)
find_package(VISP REQUIRED visp_tt_mi visp_io)
add_executable(visp_bench $PWD/scripts/visp_bench.cpp)
target_include_directories(visp_bench BEFORE PRIVATE \${VISP_INCLUDE_DIRS})
target_link_libraries(visp_bench \${VISP_LIBRARIES})
LIST
    cmake -S "$work/timer" -B "$work/timer" -DVISP_DIR="$build" -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_CXX_FLAGS_RELEASE="-O3 -march=native" >&2 &&
        make -C "$work/timer" >&2 && cp "$work/timer/visp_bench" "$work"
}

visp() {
    local build=${VISP_BUILD:-$work/visp/build}
    if { [ -n "${VISP_BUILD:-}" ] || visp_from_source "$work/visp"; } && compile_with "$build"; then
        visp_rows native
        return
    fi
    skip "ViSP from source: cannot be built here; Debian's library is measured"
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
    if ! timeout "$limit" g++ -O3 -march=native -std=c++17 -I/usr/include/opencv4 scripts/visp_bench.cpp \
        -o "$work/visp_bench" -lvisp_tt_mi -lvisp_tt -lvisp_io -lvisp_core >&2; then
        skip "ViSP: visp_bench.cpp does not compile here"
        return
    fi
    visp_rows Debian
}

# visp_rows BUILD: a sample every 4 px, 2475 of this object, for 50x50 of ours.
visp_rows() {
    "${one_core[@]}" "$work/visp_bench" "$sequence" blur - - "$1" 2>>"$work/said"
    while read -r tracker warp like; do
        "${one_core[@]}" "$work/visp_bench" "$sequence" "$tracker" "$warp" "$like" "$1" 4 "$passes" ||
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
    "${one_core[@]}" "$work/venv/bin/python" scripts/opencv_bench.py "$sequence" "$passes" 2> >(tee -a "$work/said" >&2) ||
        skip "OpenCV: failed or longer than $limit s"
}

{ visp; opencv; } >"$work/rows"
printf '{"schema_version": 1, "rows": [%s]}\n' "$(paste -sd, "$work/rows")" >"$work/peers.json"

ours=()
for tracker in {esm,fclk,falk,iclk}/ssd/homography {iclk,falk}/zncc/homography; do
    ours+=(--tracker "$tracker" --tracker "$tracker{epsilon=0,max_iters=10}")
done
bench() { (cd "$work" && "${one_core[@]}" "$MTF_EVAL" bench data --repeats "$passes" "$@"); }

mkdir -p "$out"
load=$(cut -d' ' -f2 /proc/loadavg 2>/dev/null || echo 0)
bench --pre none "${ours[@]}" --tracker 'grid(flow)' --against peers.json --format md --save bench.json --chart speed.svg |
    tee "$out/bench.md"
# What filtering and halving a frame cost, which is in no time above.
{
    echo
    bench --pre gaussian:5:3 --tracker iclk/ssd/homography | grep '^before the updates'
    grep -h '^before the updates' "$work/said" || true
} | tee -a "$out/bench.md"
cp "$work"/{bench,peers}.json "$work/speed.svg" "$out"
if awk "BEGIN { exit !($load > 1.5) }"; then
    echo "
The machine was shared with other work (load $load): ours are upper bounds." |
        tee -a "$out/bench.md"
fi
echo "results in $out" >&2
