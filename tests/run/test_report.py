"""Messages of a run stay short for many bodies and contacts."""

import logging

from ddmpi.run.report import _log_between_nodes, describe_files, grouped, some


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


def test_what_lies_between_nodes_is_said_of_the_worst_contacts(monkeypatch):
    """Of contacts whose nodes do not match, apart from the certificate; of others nothing."""
    def contact(slave: str | None, deepest: float | None, turned: float, bound: float) -> dict:
        return {"slave": slave, "pointwise_penetration": deepest, "moment_imbalance": turned,
                "moment_imbalance_bound": bound}

    messages: list[str] = []
    monkeypatch.setattr(logging.getLogger("ddmpi"), "info", lambda text, *values: messages.append(text % values))
    _log_between_nodes({"a-b": contact(None, 1.0, 9.0, 9.0)})
    assert not messages
    _log_between_nodes({"a-b": contact(None, 1.0, 9.0, 9.0), "b-c": contact("b", 2e-3, 0.5, 4.0),
                        "c-d": contact("d", 1e-3, 0.75, 3.0)})
    (message,) = messages
    assert "overlap between nodes 0.002, of b-c" in message
    assert "out of balance by 0.75, at most 3, of c-d" in message
