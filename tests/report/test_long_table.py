"""Tables of many rows: which are picked, how they are cut, drawn and written."""

import io

import pytest
from rich.console import Console

from tensegrity_codegen.report.long_table import (
    MAX_TOGETHER,
    MAX_WHOLE,
    LongTable,
    find_most_rows,
    is_cut,
    rank_rows,
)


def make(count: int, *ranking: tuple[str, object], **more: object) -> LongTable:
    given = {"title": "net: members", "caption": ""} | more
    return LongTable(
        heads=("member", "tension\n[N]"),
        sides="fr",
        count=count,
        row=lambda k: (f"e{k}", f"{k:.1f}"),
        things="members",
        ranking=ranking or (("first", range(count)),),
        **given,
    )


def render(table: LongTable) -> str:
    console = Console(file=io.StringIO(), width=200, color_system=None)
    console.print(table)
    return console.file.getvalue()


def test_rows_of_each_reason_are_picked_in_turn_and_once() -> None:
    table = make(100, ("least", [7, 3, 5, 1]), ("most", [3, 50, 51, 52, 53]))
    assert table.pick(5) == [7, 5, 3, 50, 51]
    assert make(100, ("least", [7]), ("most", range(50, 60))).pick(4) == [7, 50, 51, 52]


def test_rows_are_ranked_by_value_and_unknown_ones_are_last() -> None:
    assert rank_rows([2.0, float("nan"), 1.0, 2.0, -float("inf")]) == [4, 2, 0, 3, 1]


def test_what_is_cut_says_how_many_rows_are_shown_why_and_how_many_are_not() -> None:
    table = make(9384, ("cables with least tension", range(9384)))
    said = "10 of 9,384 members (cables with least tension), 9,374 more"
    assert table.describe_cut(10) == f"net: members; {said}"
    assert make(9384, ("cables with least tension", range(9384)), title="").describe_cut(10) == said
    assert (
        make(9384, ("bars", []), ("cables with least tension", range(9384)), title="").describe_cut(10)
        == said
    )


def test_drawn_and_written_rows_are_the_same_words() -> None:
    table = make(30, caption="of [all]")
    text = table.write(range(30), table.title)
    drawn = [line.replace("─", "-") for line in render(table).splitlines()]
    texts = [[line.split() for line in lines if line.strip(" -")] for lines in (drawn, text.splitlines())]
    assert texts[0] == texts[1]
    assert text.endswith("\n\n")
    assert text.splitlines()[1:6] == [
        "        tension",
        "member      [N]",
        "---------------",
        "e0          0.0",
        "e1          1.0",
    ]


def test_a_table_without_rows_is_written() -> None:
    assert make(0).write((), "").split() == ["tension", "member", "[N]", "-" * 15]


@pytest.mark.parametrize("counts", [(6, 12), (30,), (15, 10), (), (3, 3, 4, 12)])
def test_few_rows_are_all_shown(counts: tuple[int, ...]) -> None:
    most = find_most_rows(counts)
    assert sum(counts) <= MAX_WHOLE
    assert not any(is_cut(count, most) for count in counts)


@pytest.mark.parametrize(
    ("counts", "shown"),
    [
        ((31,), [10]),
        ((12, 30), [12, 10]),
        ((4000, 9384), [10, 10]),
        ((6, 15, 10), [6, 7, 7]),
        ((99, 99, 99), [6, 6, 6]),
        ((2, 300, 4, 1200), [2, 7, 4, 7]),
        ((5,) * 30, [1] * 30),
    ],
)
def test_many_rows_are_cut_so_that_all_tables_fit(counts: tuple[int, ...], shown: list[int]) -> None:
    most = find_most_rows(counts)
    assert [most if is_cut(count, most) else count for count in counts] == shown
    assert sum(min(count, most) for count in counts) <= max(MAX_TOGETHER, len(counts))


def test_tables_that_fit_beside_few_lines_are_cut_beside_many() -> None:
    assert find_most_rows((12, 6, 10), lines=55) == 12
    assert find_most_rows((12, 6, 10), lines=40) == 6
