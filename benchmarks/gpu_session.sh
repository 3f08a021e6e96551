#!/usr/bin/env bash
# All that a machine with an NVIDIA GPU can tell that others cannot, without a network: at most ten minutes on an H100.
#
#     benchmarks/gpu_session.sh                      all parts, one after another
#     benchmarks/gpu_session.sh tests speed          some of: standard equality tests speed sanitizer layouts
#
# PYTHON: an interpreter with the cuda extra (default: .venv/bin/python, else python3). OUT: folder of the results
# (default: benchmarks/results). LIMIT: seconds for all of it (default: 600). Each part has a limit of its own too, and
# one that fails does not keep the next from running.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

here=.venv/bin/python
[[ -x $here ]] || here=python3
python=${PYTHON:-$here}
out=${OUT:-benchmarks/results}
mkdir -p "$out"
results=$out/gpu-$(date -u +%Y-%m-%d).json
export PYTHONPATH=src${PYTHONPATH:+:$PYTHONPATH} PYTHONUNBUFFERED=1 PYBONDEM_REQUIRE_GPU=1
most=${LIMIT:-600}
parts=("$@")
((${#parts[@]})) || parts=(standard equality speed sanitizer tests layouts)
failed=()
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
    if ((left <= 0)); then
        failed+=("$name (no time was left for it)")
        return
    fi
    ((limit < left)) || limit=$left
    timeout "$limit" "$@" 2>&1 | tee "$out/gpu-${name// /-}.log"
    local code=${PIPESTATUS[0]}
    ((code == 0)) || failed+=("$name (exit code $code)")
    printf '== %s: exit code %d after %d s\n' "$name" "$code" $((SECONDS - began))
}

standard() {
    local tests=()
    for ((n = 1; n < ${#named[@]}; n += 2)); do tests+=("${named[n]}"); done
    run "S1 S6 S13" 120 "$python" -m pytest -v -p no:cacheprovider -k cuda "${tests[@]}"
}

tests() {
    local spread=()
    "$python" -c 'import xdist' 2>/dev/null && spread=(-n "${WORKERS:-6}")
    # every test that takes an engine, on this one, and the tests of its parts
    run tests 400 "$python" -m pytest -q -p no:cacheprovider "${spread[@]}" -k "cuda and not test_cuda_kernels and not test_cuda_compile" tests
}

equality() {
    run equality 120 "$python" benchmarks/gpu_equality.py --particles 45000 --json "$results"
}

layouts() {
    run layouts 120 "$python" benchmarks/gpu_variants.py --particles 200000 --json "$results"
}

speed() {
    local case=("$python" benchmarks/run.py --job cylinder --repeats 5 --json "$results")
    run "start-up" 60 "${case[@]}" --engine cuda --particles 1000
    run speed 200 "${case[@]}" --engine cuda:bonds,cuda:half-bonds --no-start --particles 1000,10000,100000,1000000
    run "cost of damage" 60 "${case[@]}" --engine cuda --no-start --particles 1000000 --law bilinear --law-active
    run "pull-out" 60 "$python" benchmarks/gpu_pullout.py --folder "$(mktemp -d)/run" --json "$results"
    run "speed of 8 million" 240 "${case[@]}" --engine cuda --no-start --particles 8000000
    run shares 60 "$python" benchmarks/gpu_ceilings.py --json "$results" --beside
    run floors 20 "$python" benchmarks/gpu_floors.py "$results"
}

sanitizer() {
    if ! command -v compute-sanitizer >/dev/null; then
        failed+=("sanitizer (compute-sanitizer is not on the PATH: memory errors and races were not looked for)")
        return
    fi
    local tool variant
    for tool in memcheck racecheck; do
        for variant in bonds half-bonds; do
            run "$tool $variant" 90 compute-sanitizer --tool "$tool" --error-exitcode 9 \
                "$python" benchmarks/start.py "cuda:$variant" strength
        done
    done
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
for part in "${parts[@]}"; do
    case $part in
    standard | tests | equality | layouts | speed | sanitizer) "$part" ;;
    *)
        echo "there is no part $part: standard equality speed sanitizer tests layouts" >&2
        exit 2
        ;;
    esac
done
printf '\n'
if ((${#failed[@]})); then
    printf 'FAILED: %s\n' "${failed[@]}"
    exit 1
fi
echo "All parts are done; the figures are in $results."
