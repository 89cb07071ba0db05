#!/bin/bash
# Fuzzes one target after the other, again and again, and adds up what was done:
#
#     fuzz/all.sh SECONDS [TARGET …]      # so long in all; by default every target
#
# Inputs that reach more go to corpus/TARGET, those that break a target to artifacts/TARGET; artifacts/table has the sums of all runs.
set -u
cd "$(dirname "$0")"
seconds=$1 && shift
[ -x target/bin/any ] || ./build.sh
targets=("$@")
[ $# -gt 0 ] || mapfile -t targets < <(sed -n 's/^name = "\(.*\)"$/\1/p' Cargo.toml | grep -v -x -e vtex-fuzz -e any)
mkdir -p corpus artifacts
[ -d corpus/vtex ] || VTEX_FUZZ_SEEDS=corpus target/bin/any -runs=1
slice=$((seconds / ${#targets[@]}))
[ $slice -ge 30 ] || slice=30
[ $slice -le 300 ] || slice=300
end=$((SECONDS + seconds))
while [ $SECONDS -lt $end ]; do
    for target in "${targets[@]}"; do
        [ $SECONDS -lt $end ] || break
        mkdir -p "corpus/$target" "artifacts/$target"
        # Messages of panics are long; what was reached and what was done is at the end.
        VTEX_FUZZ=$target target/bin/any "corpus/$target" -artifact_prefix="artifacts/$target/" -max_total_time=$slice -max_len=8192 \
            -timeout=120 -report_slow_units=120 -rss_limit_mb=1024 -print_final_stats=1 -verbosity=1 -reload=0 > "artifacts/$target.log" 2>&1 &
        wait $!
        rm -rf "/dev/shm/vtex-fuzz-$!"
        done=$(sed -n 's/^stat::number_of_executed_units: //p' "artifacts/$target.log")
        [ -n "$done" ] || done=$(sed -n 's/^#\([0-9]*\).*/\1/p' "artifacts/$target.log" | tail -1)
        peak=$(sed -n 's/^peak: \([0-9]*\) KiB/\1/p' "artifacts/$target.log" | sort -n | tail -1)
        found=$(grep -c 'Test unit written to .*/\(crash\|oom\|timeout\|leak\)-' "artifacts/$target.log")
        cover=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "artifacts/$target.log" | tail -1)
        echo "$target ${done:-0} ${found:-0} ${peak:-0} ${cover:-0}" >> artifacts/runs
        [ "$found" -eq 0 ] || cp "artifacts/$target.log" "artifacts/$target.$(date +%s).fault"
    done
done
awk '{ n[$1] += $2; f[$1] += $3; if ($4 > p[$1]) p[$1] = $4; if ($5 > c[$1]) c[$1] = $5; all += $2 }
    END { printf "%-18s%14s%8s%12s%12s\n", "target", "executions", "found", "peak, KiB", "edges"
          for (t in n) printf "%-18s%14d%8d%12d%12d\n", t, n[t], f[t], p[t], c[t] | "sort"; close("sort")
          printf "%-18s%14d\n", "all", all }' artifacts/runs | tee artifacts/table
