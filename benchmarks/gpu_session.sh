#!/usr/bin/env bash
# All that a machine with an NVIDIA GPU can tell that others cannot, without a network: at most ten minutes on an H100.
#
#     benchmarks/gpu_session.sh                      all parts, one after another
#     benchmarks/gpu_session.sh tests speed          some of: standard equality sanitizer tests speed layouts large shares
#
# PYTHON: an interpreter with the cuda extra (default: .venv/bin/python, else python3). OUT: folder of the results
# (default: benchmarks/results), where each session writes a file of its own. LIMIT: seconds for all of it (default:
# 600). Each run has a limit of its own too; these sum up to no more, and one that fails does not keep the next from
# running. The run of 8 million particles has what the others leave.
set -uo pipefail
[[ -z ${PYTHON:-} ]] || PYTHON=$(realpath -s "$(command -v "$PYTHON" || printf %s "$PYTHON")") # not to what a link names
out=$(realpath -m "${OUT:-$(dirname "${BASH_SOURCE[0]}")/results}")
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1

here=.venv/bin/python
[[ -x $here ]] || here=python3
python=${PYTHON:-$here}
mkdir -p "$out"
results=$out/gpu-$(date -u +%Y-%m-%d-%H%M%S).json
export PYTHONPATH=src${PYTHONPATH:+:$PYTHONPATH} PYTHONUNBUFFERED=1 PYBONDEM_REQUIRE_GPU=1
most=${LIMIT:-600}
every=(standard equality sanitizer tests speed layouts large shares)
parts=("$@")
((${#parts[@]})) || parts=("${every[@]}")
for part in "${parts[@]}"; do
    if [[ " ${every[*]} " != *" $part "* ]]; then
        echo "there is no part $part: ${every[*]}" >&2
        exit 2
    fi
done
failed=() ran=()
# Tests of the standard that the engine is held to: the same bits again, the same as other engines, rigid rotation.
named=(
    S1 tests/engines/test_repeat.py::test_s1_five_runs_with_breaking_bonds_have_the_same_bits
    S6 tests/engines/test_invariants.py::test_one_step_from_a_loaded_state_is_the_same_on_every_engine
    S6 tests/engines/test_invariants.py::test_a_thousand_steps_are_the_same_on_every_engine
    S13 tests/engines/test_invariants.py::test_rigid_rotation_loads_nothing
    S13 tests/cases/test_verification_cluster.py::test_d06_rigid_rotation_gives_nothing
)

# run NAME SECONDS COMMAND...: at most so long; what it prints is shown and kept.
run() {
    local name=$1 limit=$2 began=$SECONDS left=$((most - SECONDS))
    shift 2
    printf '\n== %s\n' "$name"
    if ((left <= 0 || limit <= 0)); then
        failed+=("$name (no time was left for it)")
        return
    fi
    ((limit < left)) || limit=$left
    timeout -k 10 "$limit" "$@" 2>&1 | tee "$out/gpu-${name// /-}.log"
    local code=${PIPESTATUS[0]} spent=$((SECONDS - began))
    ran+=("$name" "$code" "$spent")
    ((code == 0)) || failed+=("$name (exit code $code)")
    printf '== %s: exit code %d after %d s\n' "$name" "$code" "$spent"
}

standard() {
    local tests=()
    for ((n = 1; n < ${#named[@]}; n += 2)); do tests+=("${named[n]}"); done
    run "S1 S6 S13" 45 "$python" -m pytest -v -p no:cacheprovider -k cuda "${tests[@]}"
}

equality() {
    run equality 45 "$python" benchmarks/gpu_equality.py --particles 45000 --json "$results"
}

sanitizer() {
    local small=("$python" benchmarks/gpu_small.py) tool variant
    for variant in bonds half-bonds; do # which also compiles it
        run "small $variant" 20 "${small[@]}" "cuda:$variant"
    done
    if ! command -v compute-sanitizer >/dev/null; then
        failed+=("sanitizer (compute-sanitizer is not on the PATH: memory errors and races were not looked for)")
        return
    fi
    for tool in "memcheck bonds" "memcheck half-bonds" "initcheck bonds" "initcheck half-bonds" \
        "racecheck half-bonds" "synccheck half-bonds"; do # the last two are of what a block shares: "bonds" shares nothing
        run "$tool" 12 compute-sanitizer --tool "${tool% *}" --error-exitcode 9 "${small[@]}" "cuda:${tool#* }"
    done
}

tests() {
    local spread=()
    "$python" -c 'import xdist' 2>/dev/null && spread=(-n "${WORKERS:-6}")
    # every test that takes an engine, on this one, and the tests of its parts
    run tests 90 "$python" -m pytest -q -p no:cacheprovider "${spread[@]}" \
        -k "cuda and not test_cuda_kernels and not test_cuda_compile and not test_cuda_launch" tests
}

case=("$python" benchmarks/run.py --job cylinder --repeats 5 --json "$results")

speed() {
    run "start-up" 25 "${case[@]}" --engine cuda --particles 1000
    run speed 45 "${case[@]}" --engine cuda:bonds,cuda:half-bonds --no-start --particles 1000,10000,100000,1000000
    run "cost of damage" 150 "${case[@]}" --engine cuda --no-start --particles 1000000 --law bilinear --law-active \
        --no-users
    run "pull-out" 30 "$python" benchmarks/gpu_pullout.py --folder "$(mktemp -d)/run" --json "$results"
}

layouts() { # four: two of each variant
    run layouts 30 "$python" benchmarks/gpu_variants.py --particles 200000 --layouts 2 --json "$results"
}

large() { # as long as the others have left, but for the last two
    run "speed of 8 million" $((most - SECONDS - 28)) "${case[@]}" --engine cuda --no-start --particles 8000000
}

shares() {
    run shares 23 "$python" benchmarks/gpu_ceilings.py --json "$results" --beside
    run floors 5 "$python" benchmarks/gpu_floors.py "$results"
}

"$python" -m pybondem info
"$python" -c '
import sys
from pybondem.engines.cuda_device import usable
from pybondem.errors import EngineError
try:
    usable()
except EngineError as error:
    sys.exit(str(error))
' || exit 1
for part in "${parts[@]}"; do "$part"; done
PYTHONPATH=benchmarks:$PYTHONPATH "$python" -c '
import sys
from pathlib import Path
from machine import circumstances
from run import append
path, count, *words = sys.argv[1:]
ran, failed = words[: int(count)], words[int(count) :]
runs = [{"name": n, "exit_code": int(c), "seconds": int(s)} for n, c, s in zip(ran[::3], ran[1::3], ran[2::3])]
append(Path(path), [{"job": "session", **circumstances(), "runs": runs, "failed": failed}])
' "$results" "${#ran[@]}" "${ran[@]}" "${failed[@]}"
printf '\n'
if ((${#failed[@]})); then
    printf 'FAILED: %s\n' "${failed[@]}"
    exit 1
fi
echo "All parts are done; the figures are in $results."
