"""The table of explicit methods in the documentation is that of the records."""

from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.tableaus import EXPLICIT
from tests.doc_tables import check_table

HEAD = ("name", "evaluations a step", "samples between steps by", "source")


def test_the_table_of_explicit_methods_is_written_from_the_records(update_golden: bool) -> None:
    rows = [
        (f"`{name}`", str(item.stages), INTEGRATORS[name].dense_title, item.source)
        for name, item in EXPLICIT.items()
    ]
    check_table("integrating_in_c.md", "explicit methods", HEAD, rows, update_golden)
