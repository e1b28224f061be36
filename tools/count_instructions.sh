#!/usr/bin/env bash
# count_instructions.sh PROGRAM [--update]
# Counts the instructions of each operation of PROGRAM (instructions_core, built with the preset `bench`) under valgrind, and
# fails if one needs more than 10 % above its limit in cpp/benchmarks/instruction_limits.txt. Counts, unlike times, do not
# depend on the machine or on what else it does; another compiler may well give others. With --update it writes the counts
# into that file as the new limits.
set -euo pipefail
program=${1:?usage: count_instructions.sh PROGRAM [--update]}
update=${2:-}
limits=$(dirname "${BASH_SOURCE[0]}")/../cpp/benchmarks/instruction_limits.txt

# Both are multiples of the numbers of samples that the operations go round; what a run sets up cancels in the difference.
few=256
many=1280

# instructions OPERATION COUNT
instructions() {
    local said
    if ! said=$(valgrind --tool=callgrind --callgrind-out-file=/dev/null "$program" "$1" "$2" 2>&1 >/dev/null); then
        # Valgrind 3.19 does not know vmovq from one of the upper eight registers to one of the lower, which a compiler may choose.
        echo "$program $1 fails under valgrind:" >&2
        grep -m 3 -E 'unhandled instruction|Illegal opcode|Process terminating' <<<"$said" >&2
        return 1
    fi
    sed -n 's/^.*Collected : \([0-9]*\).*$/\1/p' <<<"$said" | grep .
}

failed=0
counts=""
printf '%-46s %12s %12s\n' operation instructions limit
for operation in $("$program"); do
    long=$(instructions "$operation" $many)
    short=$(instructions "$operation" $few)
    count=$(((long - short) / (many - few)))
    counts+=$(printf '%-46s %8d' "$operation" "$count")$'\n'
    limit=$(awk -v name="$operation" '$1 == name { print $2 }' "$limits")
    verdict=""
    if [ -z "$update" ]; then
        if [ -z "$limit" ]; then
            verdict="no limit: add one with --update"
            failed=1
        elif ((count * 10 > limit * 11)); then
            verdict="TOO MANY"
            failed=1
        elif ((count * 10 < limit * 9)); then
            verdict="fewer: lower the limit with --update"
        fi
    fi
    printf '%-46s %12d %12s %s\n' "$operation" "$count" "${limit:--}" "$verdict"
done

if [ "$update" = --update ]; then
    {
        grep '^#' "$limits"
        printf '%s' "$counts"
    } >"$limits.new"
    mv "$limits.new" "$limits"
fi
exit "$failed"
