#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """A run with every fault in every phase on either rank, and the tally of how they ended.

    scripts/fault_injection.py [WORDS ...]

With words, only the cases whose names have them all. Exit code 1 if one of them ended as it must not.
What is tried, and what must hold afterwards, is in tests/fault_cases.py.
"""

import collections
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from fault_cases import TALLY, Case, Ground, Outcome, all_cases

AT_ONCE = 2


def show(outcomes: list[Outcome]) -> None:
    """The tally, and all about those that ended badly."""
    codes = collections.Counter(outcome.code for outcome in outcomes)
    print(f"\n{len(outcomes)} cases; slowest end {max(o.seconds for o in outcomes):.1f} s")
    print("exit codes: " + ", ".join(f"{code}: {codes[code]}" for code in sorted(codes, key=str)))
    for word in TALLY:
        print(f"{word:26} {sum(word in outcome.faults for outcome in outcomes)}")
    for outcome in outcomes:
        if outcome.faults:
            print(f"\n=== {outcome.case.name}: {', '.join(outcome.faults)} (exit code {outcome.code})")
            print(outcome.output)


def main(words: list[str]) -> int:
    cases = [case for case in all_cases() if all(word in case.name for word in words)]
    if not cases:
        sys.exit("no case has all these words in its name")
    outcomes = []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE) as pool:
        ground = Ground(Path(folder))

        def attempt(case: Case) -> Outcome:
            outcome = ground.try_case(case)
            print(f"{case.name:50} {outcome.code!s:>5} {outcome.seconds:6.1f} s ", *outcome.faults, flush=True)
            return outcome

        outcomes = list(pool.map(attempt, cases))
    show(outcomes)
    return int(any(outcome.faults for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
