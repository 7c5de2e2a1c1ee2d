#!/usr/bin/env bash
# A sweep through a real engine on this machine: test_engines.sh parallel | snakemake | slurm (on the loopback, as root).
# Ends with code 77 where the engine is missing; the last line says so.
#
# Every engine gets the same sixteen shards, with trouble on the way, and must end with the bytes of a run without shards.
# MTF_EVAL names the program (default: the release build).
set -uo pipefail
cd "$(dirname "$0")/.."
root=$PWD
program=$(realpath "${MTF_EVAL:-${CARGO_TARGET_DIR:-target}/release/mtf-eval}")
engine=${1:?which engine: parallel, snakemake or slurm}
grid=$root/scripts/plans/engines.toml
shards=16
work=$(mktemp -d)
failures=0
slurm_pids=()

say() { printf '%s\n' "engines: $*"; }
fail() { say "FAILED: $*"; failures=$((failures + 1)); }
expect() { # CODE COMMAND...: the command must end with this code; what it says is kept in $work/said
    local code=$1 got=0
    shift
    timeout -k 5 300 "$@" > "$work/said" 2>&1 || got=$?
    [ "$got" = "$code" ] || { fail "'$*' ended with $got instead of $code:"; tail -20 "$work/said"; return 1; }
}
said() { grep -q -- "$1" "$work/said" || { fail "expected to read '$1' in:"; tail -20 "$work/said"; }; }
same() { "$root/scripts/same_run.sh" "$work/whole" "$1" > "$work/diff" 2>&1 || { fail "$1 differs:"; cut -c1-200 "$work/diff" | head; }; }
missing() { printf "%s\n" "$*"; exit 77; }
finish() {
    [ ${#slurm_pids[@]} = 0 ] || kill "${slurm_pids[@]}" 2> /dev/null
    sleep 0.2
    rm -rf "$work"
}
trap finish EXIT

# A program that gets into trouble: shard 7 fails at its first start, shards 9 and 10 say when they are running and go on
# until they are told to stop.
cat > "$work/troubled" <<EOF
#!/usr/bin/env bash
line="\$* "
case "\$line" in
*" slice:7/$shards "*) if mkdir "$work/failed-once" 2> /dev/null; then echo "on purpose" >&2; exit 3; fi ;;
*" slice:9/$shards "* | *" slice:10/$shards "*)
    part=\${line##* slice:}
    slow=$work/slow-\${part%%/*}
    if [ -n "\${SLURM_JOB_ID:-}" ] && mkdir "\$slow" 2> /dev/null; then
        "$program" "\$@" &
        child=\$!
        trap 'kill -TERM \$child 2> /dev/null; touch "\$slow/told-TERM"' TERM
        trap 'kill -USR1 \$child 2> /dev/null; touch "\$slow/told-USR1"' USR1
        # Who it is that Slurm would tell.
        echo \$PPID > "\$slow/runs"
        for i in \$(seq 300); do [ -e "\$slow/told-TERM" ] || [ -e "\$slow/told-USR1" ] && break; sleep 0.1; done
        wait \$child
        exit 75
    fi ;;
esac
exec "$program" "\$@"
EOF
chmod +x "$work/troubled"
again() { rm -rf "$work/failed-once" "$work"/slow-*; }

test_parallel() {
    export MTF_EVAL=$work/troubled JOBS=2
    expect 21 scripts/parallel.sh $shards "$grid" "$work/parallel" || return
    said "slice:7/$shards lacks"
    local before
    before=$(stat -c %Y "$work/parallel/shard-1/summary.json")
    sleep 1
    expect 0 scripts/parallel.sh $shards "$grid" "$work/parallel" || return
    [ "$before" = "$(stat -c %Y "$work/parallel/shard-1/summary.json")" ] || fail "a shard that was done ran again"
    same "$work/parallel/merged"
    say "GNU parallel: a shard failed, --resume-failed ran it alone, merged"
}

test_snakemake() {
    local run=(snakemake -s scripts/snakemake/Snakefile -c 2 --keep-going --directory "$work"
        --config "grid=$grid" "out=$work/snakemake" "shards=$shards" "program=$work/troubled")
    expect 1 "${run[@]}" || return
    [ ! -e "$work/snakemake/merged" ] || fail "merged without shard 7"
    expect 0 "${run[@]}" || return
    said "3 of 3 steps"
    same "$work/snakemake/merged"
    expect 0 "${run[@]}" || return
    said "Nothing to be done"
    say "Snakemake: a shard failed, a second run did what was missing, a third nothing"
}

start_slurm() {
    local host d=$work/slurm
    host=$(hostname -s)
    mkdir -p "$d/ctld" "$d/d" /run/munge /var/log/munge
    chown munge: /run/munge /var/log/munge
    if ! munge -n > /dev/null 2>&1; then
        [ -e /etc/munge/munge.key ] || su -s /bin/bash munge -c /usr/sbin/mungekey > /dev/null 2>&1
        su -s /bin/bash munge -c /usr/sbin/munged || return 1
        slurm_pids+=("$(cat /run/munge/munged.pid)")
    fi
    cat > "$d/slurm.conf" <<EOF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
AuthType=auth/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$d/ctld
SlurmdSpoolDir=$d/d
SlurmctldPidFile=$d/ctld.pid
SlurmdPidFile=$d/d.pid
SlurmctldLogFile=$d/ctld.log
SlurmdLogFile=$d/d.log
SlurmctldPort=16817
SlurmdPort=16818
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
ReturnToService=2
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
MinJobAge=300
SchedulerParameters=sched_interval=2,batch_sched_delay=1,requeue_delay=1
KillWait=20
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=3000 State=UNKNOWN
PartitionName=debug Nodes=$host Default=YES MaxTime=INFINITE State=UP
EOF
    export SLURM_CONF=$d/slurm.conf
    slurmctld -f "$d/slurm.conf" && sleep 1 && slurmd -f "$d/slurm.conf" -N "$host" || return 1
    sleep 1
    slurm_pids+=("$(cat "$d/ctld.pid")" "$(cat "$d/d.pid")")
    for _ in $(seq 20); do
        sinfo -h -o %T 2> /dev/null | grep -q idle && return
        sleep 0.5
    done
    return 1
}

test_slurm() {
    start_slurm > "$work/slurm.log" 2>&1 || { tail -3 "$work/slurm.log"; missing "no Slurm can be run here"; }
    again
    export MTF_EVAL=$work/troubled SBATCH_FLAGS="--cpus-per-task=1 --mem=1000 --chdir=$work" AT_ONCE=2
    expect 0 scripts/slurm/submit.sh $shards "$grid" "$work/slurm-out" || return
    local array merge
    read -r array merge < <(sed 's/shards: job \([0-9]*\), merge: job \([0-9]*\)/\1 \2/' "$work/said")
    scancel "${array}_16" || fail "cannot cancel"
    # One is preempted (TERM, and Slurm queues it again), one near its time limit (USR1, and it queues itself again).
    runs 9 && { tries 10 scontrol requeue "${array}_9" || fail "cannot requeue"; }
    runs 10 && { kill -USR1 "$(cat "$work/slow-10/runs")" || fail "cannot signal"; }
    wait_for "$merge"
    cp "$work/slurm-mtf-eval-merge-$merge.log" "$work/said"
    said "slice:7/$shards lacks"
    said "slice:16/$shards lacks"
    [ "$(grep -c " lacks " "$work/said")" = 2 ] || { fail "more is missing than was broken:"; cat "$work/said"; }
    [ -e "$work/slow-9/told-TERM" ] || fail "the preempted shard was not told to stop"
    [ -e "$work/slow-10/told-USR1" ] || fail "the shard near its limit was not told to stop"
    [ ! -e "$work/slurm-out/merged" ] || fail "an incomplete merge left files"
    SHARDS=7,16 expect 0 scripts/slurm/submit.sh $shards "$grid" "$work/slurm-out" || return
    wait_for "$(sed 's/.*merge: job //' "$work/said")"
    same "$work/slurm-out/merged"
    say "Slurm: a shard failed, one was cancelled, two were requeued; the merge named the two that lacked units;" \
        "a second submission completed them"
}
tries() { # N COMMAND...: Slurm has moments in which it takes no orders
    local n=$1
    shift
    for _ in $(seq "$n"); do "$@" 2> /dev/null && return; sleep 1; done
    return 1
}
runs() { # SHARD: waits until it says so
    for _ in $(seq 600); do [ -e "$work/slow-$1/runs" ] && sleep 0.5 && return; sleep 0.1; done
    fail "shard $1 does not start"
    return 1
}
wait_for() { # JOB
    for _ in $(seq 240); do
        [ -n "$(squeue -h -j "$1" 2> /dev/null)" ] || return 0
        squeue -h -j "$1" -o %T 2> /dev/null | grep -qv 'PENDING\|RUNNING\|CONFIGURING\|COMPLETING' && return 0
        sleep 1
    done
    fail "job $1 does not end"
}

case $engine in
parallel) command -v parallel > /dev/null || missing "no GNU parallel here" ;;
snakemake) command -v snakemake > /dev/null || missing "no Snakemake here" ;;
slurm)
    command -v slurmctld > /dev/null && command -v munged > /dev/null || missing "no Slurm here"
    [ "$(id -u)" = 0 ] || missing "Slurm needs root here"
    ;;
*) say "unknown engine '$engine'"; exit 2 ;;
esac
"$program" run --grid "$grid" --out "$work/whole" --quiet > /dev/null || { fail "the run without shards"; exit 1; }
again
"test_$engine"
exit $((failures > 0))
