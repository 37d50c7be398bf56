"""Messages of a run stay short for many bodies and contacts."""

from ddmpi.run.report import describe_files, grouped, some


def test_equal_lines_are_said_once():
    pairs = [("touches", "a"), ("open", "b"), ("touches", "c")]
    assert list(grouped(pairs)) == [("touches", ["a", "c"]), ("open", ["b"])]


def test_many_names_are_counted():
    assert some(["a", "b", "c", "d"], "contacts") == "a, b, c, d"
    assert some([f"i{k}" for k in range(12)], "contacts") == "i0, i1, … (12 contacts)"


def test_many_tables_are_one():
    few = ["bodies.png", "contact_a.csv", "contact_b.csv", "summary.json"]
    assert describe_files(few) == ", ".join(few)
    many = ["bodies.png", *(f"contact_{k}.csv" for k in range(9)), "summary.json"]
    assert describe_files(many) == "bodies.png, contact_NAME.csv (9 files), summary.json"
