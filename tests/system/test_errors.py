"""Lists of names in messages."""

import re
from pathlib import Path

import tensegrity_codegen
from tensegrity_codegen.runtime.linear.linearize import describe_kinks
from tensegrity_codegen.system.errors import name_list, suggest


def test_name_list_counts_what_it_leaves_out() -> None:
    assert name_list("abc") == "a, b, c"
    assert name_list("abcdefg") == "a, b, c, d, e and 2 more"
    assert name_list(map(str, range(2005)), 1) == "0 and 2,004 more"


def test_messages_say_how_many_names_they_leave_out() -> None:
    (said,) = describe_kinks({f"s{k}": k < 12 for k in range(14)})
    assert "14 cables are exactly at rest length" in said
    assert "as taut: s0, s1, s2, s3, s4, s5, s6, s7, s8, s9 and 2 more; as slack: s12, s13" in said
    assert suggest("zebra", [f"n{k}" for k in range(20)], most=2) == "known: 'n0', 'n1' and 18 more"


def test_no_other_place_cuts_lists_without_a_word() -> None:
    package = Path(tensegrity_codegen.__file__).parent
    cut = re.compile(r"""join\(\w+\[:\d+\]\)""")
    found = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if cut.search(path.read_text("utf-8"))
    }
    # A file that runs without the package, and an example in a hint.
    assert found == {"codegen/compilation/load_once.py", "sweeps/keys.py"}
