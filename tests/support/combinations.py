"""How many combinations of features and kinds of scene the tests ask: `scripts/study combinations`."""

import argparse
import sys
from collections import Counter
from pathlib import Path
from types import FunctionType

PRODUCTS = Path(__file__).resolve().parents[1] / "products"


def answers() -> tuple[int, Counter[str]]:
    """Combinations with an answer, and by words those that are refused."""
    from kinds import Kind
    from promises import FEATURES
    from test_products import NAMES

    words: Counter[str] = Counter()
    for feature in FEATURES.values():
        for name in NAMES:
            for order in (1, 2):
                for steps in (False, True):
                    words[feature(Kind(name, order, steps)).refused] += 1
    return words.pop(""), words


def cases_of(test: FunctionType, features: int) -> tuple[int, int]:
    """How many cases a test has, and how many of them the quick suite asks; one without cases asks all features."""
    marks = {mark.name: mark.args for mark in test.pytestmark}
    cases = list(marks["parametrize"][1]) if "parametrize" in marks else [None] * features
    slow = [
        "slow" in marks or any(mark.name == "slow" for mark in getattr(case, "marks", ()))
        for case in cases
    ]
    return len(cases), slow.count(False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    sys.path.append(str(PRODUCTS))
    import test_products
    from promises import FEATURES

    answered, refused = answers()
    print(
        f"{len(FEATURES)} features in {len(test_products.NAMES)} kinds of scene, of two orders, in one load step and in "
        f"several: {answered + refused.total()} combinations, of which {answered} have an answer. Refused in words are"
    )
    for words, count in refused.most_common():
        print(f"    {count:5}  {words}")
    print("Cases of the tests (in the quick suite)")
    for name, test in vars(test_products).items():
        if name.startswith("test_"):
            every, quick = cases_of(test, len(FEATURES))
            print(f"    {every:5} ({quick})  {name.removeprefix('test_').replace('_', ' ')}")


if __name__ == "__main__":
    main()
