"""Tables by step length: made once, the last few kept, the one not asked for longest dropped first."""

from __future__ import annotations

from kinetic_solver.operators.tables import Tables


def test_the_last_few_are_kept_and_each_is_made_once() -> None:
    made: list[float] = []

    def make(h: float) -> str:
        made.append(h)
        return f"table of {h}"

    tables = Tables[str](most=3)
    for h in (0.1, 0.2, 0.3):
        assert tables.get(h, make) == f"table of {h}"
    assert tables.get(0.1, make) == "table of 0.1"
    assert made == [0.1, 0.2, 0.3]
    # 0.2 is now the one not asked for longest: it makes room for 0.4, and has to be made again; then 0.3 is gone.
    tables.get(0.4, make)
    tables.get(0.1, make)
    assert made == [0.1, 0.2, 0.3, 0.4]
    tables.get(0.2, make)
    assert made == [0.1, 0.2, 0.3, 0.4, 0.2]
    tables.get(0.3, make)
    assert made == [0.1, 0.2, 0.3, 0.4, 0.2, 0.3]


def test_a_table_is_the_same_object_until_it_is_dropped() -> None:
    tables = Tables[list[float]](most=2)
    first = tables.get(0.7, lambda h: [h])
    assert tables.get(0.7, lambda h: [h]) is first
    tables.get(1.3, lambda h: [h])
    tables.get(1.9, lambda h: [h])
    assert tables.get(0.7, lambda h: [h]) is not first
